from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import save_colour, write_colmap, write_nerfstudio
from layouts import room

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.types import Camera

LEVEL = {"up": (0, 0, 1), "floor_m": 0}
both = pytest.mark.parametrize("binary", [True, False], ids=["bin", "txt"])


def opened(root: Path, **options: object) -> Recording:
    return plugins.open_recording(root, format="colmap", **options)


@both
@pytest.mark.parametrize("place", ["sparse/0", "sparse", "."])
def test_poses_and_intrinsics_come_back_wherever_the_model_lies(tmp_path: Path, binary: bool, place: str) -> None:
    write_colmap(room(), tmp_path / "a", binary)
    for path in (tmp_path / "a/sparse/0").iterdir():
        path.rename(tmp_path / "a" / place / path.name)
    found = opened(tmp_path / "a", **LEVEL)
    assert found.camera == room().camera
    assert any("COLMAP knows no scale" in note and "no floor plan" in note for note in found.notes)
    for i, frame in enumerate(found):
        assert frame.depth_m is None
        assert np.abs(frame.world_from_camera - room().poses[i]).max() < 1e-9
        assert np.array_equal(frame.rgb, room()[i].rgb)


def with_model(root: Path, number: int, name: str, values: tuple[float, ...], binary: bool) -> None:
    if binary:
        head = struct.pack(f"<QIiQQ{len(values)}d", 1, 3, number, 160, 120, *values)
        (root / "sparse/0/cameras.bin").write_bytes(head)
    else:
        (root / "sparse/0/cameras.txt").write_text(f"3 {name} 160 120 {' '.join(map(str, values))}\n")


@both
@pytest.mark.parametrize(
    ("number", "name", "values", "model", "coefficients"),
    [
        (0, "SIMPLE_PINHOLE", (120, 80, 60), "pinhole", ()),
        (2, "SIMPLE_RADIAL", (120, 80, 60, 0.1), "plumb_bob", (0.1, 0, 0, 0)),
        (3, "RADIAL", (120, 80, 60, 0.1, 0.02), "plumb_bob", (0.1, 0.02, 0, 0)),
        (4, "OPENCV", (120, 120, 80, 60, 0.1, 0.02, 0.003, 0.004), "plumb_bob", (0.1, 0.02, 0.003, 0.004)),
        (5, "OPENCV_FISHEYE", (120, 120, 80, 60, 0.1, 0.02, 0.0, 0.0), "equidistant", (0.1, 0.02, 0, 0)),
        (6, "FULL_OPENCV", (120, 120, 80, 60, *np.arange(1, 9) / 100), "plumb_bob", tuple(np.arange(1, 9) / 100)),
        (8, "SIMPLE_RADIAL_FISHEYE", (120, 80, 60, 0.1), "equidistant", (0.1, 0, 0, 0)),
        (9, "RADIAL_FISHEYE", (120, 80, 60, 0.1, 0.02), "equidistant", (0.1, 0.02, 0, 0)),
    ],
)
def test_every_camera_model(
    tmp_path: Path, binary: bool, number: int, name: str, values: tuple[float, ...], model: str, coefficients: tuple
) -> None:
    write_colmap(room(), tmp_path / "a", binary)
    with_model(tmp_path / "a", number, name, values, binary)
    found = opened(tmp_path / "a", **LEVEL)
    lens = found._source.views[0].lens  # type: ignore[attr-defined]
    assert lens.camera == Camera(160, 120, 120, 120, 79.5, 59.5)
    assert (lens.model, lens.coefficients) == (model, coefficients)


def test_images_that_are_missing_and_other_parts_are_said(tmp_path: Path) -> None:
    write_colmap(room(), tmp_path / "a")
    (tmp_path / "a/images/frame_00001.png").unlink()
    (tmp_path / "a/sparse/0").rename(tmp_path / "a/sparse/1")
    write_colmap(room(), tmp_path / "b")
    (tmp_path / "b/sparse/0").rename(tmp_path / "a/sparse/0")
    found = opened(tmp_path / "a", **LEVEL)
    assert len(found) == 3
    assert found.notes[:2] == [
        "1 images of the model left out: they are missing",
        "the model has other parts that do not hang together with it: sparse/1",
    ]


def test_nerfstudios_own_file_says_more(tmp_path: Path) -> None:
    """What ns-process-data leaves: transforms.json, images/ and colmap/sparse/0 in one folder."""
    write_nerfstudio(room(), tmp_path / "a")
    write_colmap(room(), tmp_path / "b")
    (tmp_path / "b/sparse").rename(tmp_path / "b/colmap")
    (tmp_path / "a/colmap").mkdir()
    (tmp_path / "b/colmap").rename(tmp_path / "a/colmap/sparse")
    assert plugins.open_recording(tmp_path / "a")[0].depth_m is not None
    (tmp_path / "a/transforms.json").unlink()
    with pytest.raises(InputError, match=r"none of them is in .*give the folder that holds images/ and sparse/"):
        [path.unlink() for path in (tmp_path / "a/images").iterdir()]
        plugins.open_recording(tmp_path / "a")


def model(name: str, change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    def apply(root: Path) -> None:
        path = root / "sparse/0" / name
        path.write_bytes(change(path.read_bytes()))

    return apply


DAMAGE: list[tuple[bool, Callable[[Path], object], str]] = [
    (True, model("cameras.bin", lambda b: b[:-1]), r"cameras\.bin is damaged or truncated"),
    (True, model("cameras.bin", lambda b: struct.pack("<Q", 1 << 60) + b[8:]), "it claims 1152921504606846976 cameras"),
    (True, model("cameras.bin", lambda b: b[:12] + struct.pack("<i", 10) + b[16:]), "model 10, which cartier does not"),
    (True, model("cameras.bin", lambda b: b[:16] + struct.pack("<Q", 1 << 40) + b[24:]), "must have 1 to 32768 px"),
    (True, model("cameras.bin", lambda b: b[:8] + struct.pack("<I", 4) + b[12:]), r"camera 3 is not in cameras\.bin"),
    (True, model("images.bin", lambda b: b[:-30]), r"images\.bin is damaged or truncated"),
    (True, model("images.bin", lambda b: struct.pack("<Q", 1 << 60) + b[8:]), r"images\.bin is damaged"),
    (True, model("images.bin", lambda b: b.replace(b"frame_00002.png\0", b"../me_00002.png\0")), "leads out of the rec"),
    (True, model("images.bin", lambda b: b.replace(b"\0", b"x") + b"y" * 3000), r"images\.bin is damaged"),
    (True, model("images.bin", lambda b: b[:12] + struct.pack("<d", np.nan) + b[20:]), "image frame_00000.png: NaN"),
    (True, model("images.bin", lambda b: b[:12] + struct.pack("<d", 9.0) + b[20:]), "not of length 1"),
    (True, model("images.bin", lambda b: b""), r"images\.bin is empty"),
    (True, lambda root: save_colour(root / "images/frame_00002.png", np.zeros((9, 9, 3), np.uint8)), "is 9x9 px, but"),
    (False, model("cameras.txt", lambda b: b"3 PINHOLE 160"), "line 1: a camera is 'ID MODEL WIDTH HEIGHT PARAMETERS'"),
    (False, model("cameras.txt", lambda b: b"3 FOV 160 120 1 1 1 1 1"), "camera model 'FOV' is not read: .*undistorter"),
    (False, model("cameras.txt", lambda b: b"3 PINHOLE 160 120 1 1 1"), "PINHOLE has 4 parameters, got 3"),
    (False, model("images.txt", lambda b: b"1 1 0 0 0 0 0 0 3"), "line 1: an image is .* got 9 words"),
    (False, model("images.txt", lambda b: b"# nothing\n"), r"images\.txt names 0 images, but none"),
]  # fmt: skip


@pytest.mark.parametrize(("binary", "damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, binary: bool, damage: Callable[[Path], object], fault: str) -> None:
    write_colmap(room(), tmp_path / "a", binary)
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        list(opened(tmp_path / "a"))
    assert "\n" not in str(caught.value)
