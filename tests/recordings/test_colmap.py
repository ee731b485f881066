from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from exports import save_colour, write_colmap, write_nerfstudio
from layouts import room
from matplotlib.figure import Figure

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.mapping.mapper import SCALE_GUESSED
from cartier.mapping.upright import turned_camera, turned_image
from cartier.pipeline import ask, map_home
from cartier.recordings.folder import save
from cartier.render.floor_plan import draw_plan
from cartier.types import Camera, Frame
from synthetic import THINGS, RoomRecording, TrueBoxes, walk

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
    ways = np.array([frame.world_from_camera[:3, 3] for frame in found]) - found[0].world_from_camera[:3, 3]
    true = np.array([pose[:3, 3] for pose in room().poses]) - room().poses[0][:3, 3]
    assert np.allclose(ways * np.linalg.norm(true) / np.linalg.norm(ways), true, atol=1e-9)  # the same up to a scale
    assert found.camera == room().camera
    assert any("COLMAP knows no scale" in note and "no floor plan" in note for note in found.notes)
    for i, frame in enumerate(found):
        assert frame.depth_m is None
        assert np.abs(frame.world_from_camera[:3, :3] - room().poses[i][:3, :3]).max() < 1e-9
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


def in_units(recording: RoomRecording, units_per_metre: float) -> RoomRecording:
    poses = [pose.copy() for pose in recording.poses]
    for pose in poses:
        pose[:3, 3] *= units_per_metre
    return Unscaled(poses, recording.objects, with_depth=False, unscaled=recording)


@dataclass
class Unscaled(RoomRecording):
    """The pictures of the room with poses in other units than metres."""

    unscaled: RoomRecording | None = None

    def __getitem__(self, index: int) -> Frame:
        assert self.unscaled is not None
        return replace(self.unscaled[index], depth_m=None, world_from_camera=self.poses[index].copy())


def write_points(root: Path, units_per_metre: float, binary: bool) -> None:
    """Points on the walls and the floor of the room, each seen by one or two images."""
    spots = [(5.0, 2.0, 1.0), (2.5, 4.0, 1.5), (0.0, 1.0, 0.5), (2.0, 2.0, 0.0), (1000.0, 0.0, 0.0)]
    rows = [
        (i + 1, tuple(units_per_metre * v for v in xyz), (i % 4 + 1, 7)[: 1 + i % 2]) for i, xyz in enumerate(spots)
    ]
    if binary:
        data = struct.pack("<Q", len(rows))
        for key, xyz, images in rows:
            data += struct.pack("<Q3d3BdQ", key, *xyz, 1, 2, 3, 0.5, len(images))
            data += b"".join(struct.pack("<2I", image, 0) for image in images)
        (root / "sparse/0/points3D.bin").write_bytes(data)
    else:
        lines = [
            f"{key} {' '.join(map(repr, xyz))} 1 2 3 0.5 {' '.join(f'{i} 0' for i in images)}"
            for key, xyz, images in rows
        ]
        (root / "sparse/0/points3D.txt").write_text("# 3D point list\n" + "\n".join(lines) + "\n")


@both
@pytest.mark.parametrize("points", [True, False], ids=["points", "no points"])
def test_the_units_of_the_model_change_nothing(tmp_path: Path, binary: bool, points: bool) -> None:
    poses = []
    for units_per_metre in (0.05, 1.0, 60.0):
        root = tmp_path / f"x{units_per_metre:g}"
        write_colmap(in_units(room(), units_per_metre), root, binary)
        if points:
            write_points(root, units_per_metre, binary)
        found = opened(root, up=(0, 0, 1))
        assert getattr(found, "scale_guessed", False)
        assert any("metres are a guess, by which" in note for note in found.notes)
        poses.append(np.array([frame.world_from_camera for frame in found]))
    assert np.allclose(poses[0], poses[1], atol=1e-9) and np.allclose(poses[2], poses[1], atol=1e-9)
    if points:  # the middle one of five distances is as usual, whatever the outlier is
        eyes = [pose[:3, 3] for pose in room().poses]
        true = [
            np.linalg.norm(np.subtract(spot, eyes[i]))
            for i, spot in enumerate([(5, 2, 1), (2.5, 4, 1.5), (0, 1, 0.5), (2, 2, 0)])
        ]
        middle = float(np.median([*true, 999.0]))
        ratio = np.linalg.norm(poses[1][3, :3, 3] - poses[1][0, :3, 3]) / np.linalg.norm(eyes[3] - eyes[0])
        assert ratio == pytest.approx(2.0 / middle)


def test_a_map_of_them_says_that_its_scale_is_a_guess(tmp_path: Path) -> None:
    write_colmap(room(), tmp_path / "a")
    save(opened(tmp_path / "a", **LEVEL), tmp_path / "b")  # in cartier's own format, too
    for found in (opened(tmp_path / "a", **LEVEL), plugins.open_recording(tmp_path / "b")):
        home = map_home(Seeing(found), TrueBoxes(THINGS), ["object_viewpoint"])
        assert home.scale_guessed and home.to_dict()["scale_guessed"] and SCALE_GUESSED in home.notes
        assert SCALE_GUESSED in ask(home, "I want to sit down").notes
        figure = Figure()
        axes = figure.subplots()
        draw_plan(axes, home)
        assert axes.get_xlabel() == "x (m, scale guessed)"
    sound = map_home(room(), TrueBoxes(THINGS), ["object_viewpoint"])
    assert not sound.scale_guessed and "scale_guessed" not in sound.settings and SCALE_GUESSED not in sound.notes


class Seeing:
    """A recording with the true instances of the room, so that there is something to map."""

    def __init__(self, source: Recording) -> None:
        self._source, self.name, self.camera, self.truth, self.notes = source, "x", source.camera, None, source.notes
        self.scale_guessed = getattr(source, "scale_guessed", False)

    def __len__(self) -> int:
        return len(self._source)

    def __getitem__(self, index: int) -> Frame:
        return replace(self._source[index], instances=room()[index].instances)

    def fingerprint(self) -> str:
        return self._source.fingerprint()


@pytest.mark.parametrize("turns", [0, 1, 3])
@pytest.mark.parametrize("layout", ["colmap", "nerfstudio", "nerfstudio-without-depth"])
def test_pictures_held_sideways_come_out_upright(tmp_path: Path, layout: str, turns: int) -> None:
    camera, old_from_new = turned_camera(room().camera, turns)
    whole = walk(with_depth=layout == "nerfstudio")
    held = Turned(
        [pose @ old_from_new for pose in whole.poses], THINGS, camera, whole.with_depth, whole=whole, turns=turns
    )
    (write_colmap if layout == "colmap" else write_nerfstudio)(held, tmp_path / "a")
    found = plugins.open_recording(tmp_path / "a")
    assert (found.camera.width, found.camera.height) == (160, 120)
    assert any("images turned by" in note for note in found.notes) == bool(turns)
    for i in (0, 7, 15):
        assert np.array_equal(found[i].rgb, whole[i].rgb)
        assert np.allclose(found[i].world_from_camera[2, :3], whole.poses[i][2, :3], atol=0.01)


@dataclass
class Turned(RoomRecording):
    """The room's pictures, turned to the left with all that belongs to them."""

    whole: RoomRecording | None = None
    turns: int = 0

    def __getitem__(self, index: int) -> Frame:
        assert self.whole is not None
        frame = self.whole[index]
        depth_m = None if frame.depth_m is None else turned_image(frame.depth_m, self.turns)
        return replace(
            frame, rgb=turned_image(frame.rgb, self.turns), depth_m=depth_m, instances=None,
            world_from_camera=self.poses[index].copy(), camera=self.camera,
        )  # fmt: skip


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


@pytest.mark.parametrize("points", ["none", "empty", "some", "before a remark", "numbers in names"])
def test_points_lines_may_be_missing(tmp_path: Path, points: str) -> None:
    write_colmap(room(), tmp_path / "a", False)
    path = tmp_path / "a/sparse/0/images.txt"
    images = [line for line in path.read_text().splitlines() if line.endswith(".png")]
    after = {"empty": [""], "some": ["1.5 2.5 -1 3.5 4.5 17 1 2 9 4 5 6"], "before a remark": ["# 1 2 3"]}.get(
        points, []
    )
    if points == "numbers in names":
        for file in (tmp_path / "a/images").iterdir():
            file.rename(file.with_name(f"cam 1 {file.stem[-1]}"))
        images = [line.replace("frame_0000", "cam 1 ").removesuffix(".png") for line in images]
    path.write_text("\n".join(row for image in images for row in (image, *after)) + "\n")
    assert len(opened(tmp_path / "a")) == len(images) == 4


@pytest.mark.parametrize("prefix", ["C:\\scan\\images\\", "/home/me/scan/images/", "/home/me/scan/"])
def test_absolute_names(tmp_path: Path, prefix: str) -> None:
    write_colmap(room(), tmp_path / "a", False)
    path = tmp_path / "a/sparse/0/images.txt"
    path.write_text(path.read_text().replace("frame_", f"{prefix}frame_"))
    found = opened(tmp_path / "a")
    assert len(found) == 4 and any("images.txt has absolute paths, such as" in note for note in found.notes)


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
    (True, model("images.bin", lambda b: b.replace(b"frame_00002.png\0", b"../me_00002.png\0")),
        "leads out of the rec"),
    (True, model("images.bin", lambda b: b.replace(b"\0", b"x") + b"y" * 3000), r"images\.bin is damaged"),
    (True, model("images.bin", lambda b: b[:12] + struct.pack("<d", np.nan) + b[20:]), "image frame_00000.png: NaN"),
    (True, model("images.bin", lambda b: b[:12] + struct.pack("<d", 9.0) + b[20:]), "not of length 1"),
    (True, model("images.bin", lambda b: b""), r"images\.bin is empty"),
    (True, lambda root: save_colour(root / "images/frame_00002.png", np.zeros((9, 9, 3), np.uint8)), "is 9x9 px, but"),
    (True, lambda root: (root / "sparse/0/points3D.bin").write_bytes(struct.pack("<Q", 9)),
        r"points3D\.bin is damaged"),
    (False, model("cameras.txt", lambda b: b"3 PINHOLE 160"), "line 1: a camera is 'ID MODEL WIDTH HEIGHT PARAMETERS'"),
    (False, model("cameras.txt", lambda b: b"3 FOV 160 120 1 1 1 1 1"),
        "camera model 'FOV' is not read: .*undistorter"),
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
