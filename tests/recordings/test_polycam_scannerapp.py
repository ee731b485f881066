from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import small_depth, write_polycam, write_scannerapp
from layouts import room
from PIL import Image

from cartier import plugins
from cartier.errors import InputError

WRITERS = {"polycam": write_polycam, "scannerapp": write_scannerapp}
apps = pytest.mark.parametrize("name", WRITERS)


@apps
def test_poses_and_small_depth_come_back(tmp_path: Path, name: str) -> None:
    WRITERS[name](room(), tmp_path / "a")
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    assert found.camera == room().camera and len(found) == 4
    for i, frame in enumerate(found):
        assert np.abs(frame.world_from_camera - room()[i].world_from_camera).max() < 1e-9
        assert frame.depth_m is not None
        whole = np.repeat(np.repeat(small_depth(room(), i), 2, 0), 2, 1)
        assert np.abs(frame.depth_m - whole).max() < 0.00051


def test_polycams_corrected_cameras_are_taken(tmp_path: Path) -> None:
    write_polycam(room(), tmp_path / "a", corrected=True)
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    assert np.abs(found[2].world_from_camera - room()[2].world_from_camera).max() < 1e-9
    assert not any("drift" in note for note in found.notes)
    write_polycam(room(), tmp_path / "b")
    drifting = "there are no corrected cameras: the poses are ARKit's own, which drift in large scans"
    assert drifting in plugins.open_recording(tmp_path / "b").notes


def test_polycams_keyframes_without_a_corrected_camera_are_counted_over_all(tmp_path: Path) -> None:
    write_polycam(room(), tmp_path / "a", corrected=True)
    keyframes = tmp_path / "a/keyframes"
    for kind, name in (("corrected_cameras", 0), ("corrected_cameras", 3), ("corrected_images", 2)):
        stem = sorted(p.stem for p in (keyframes / "cameras").iterdir())[name]
        next((keyframes / kind).glob(f"{stem}.*")).unlink()
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    assert len(found) == 1 and np.abs(found[0].world_from_camera - room()[1].world_from_camera).max() < 1e-9
    assert "1 keyframes without an image or depth left out" in found.notes
    assert any(note.startswith("2 of 4 keyframes left out: they have no corrected camera") for note in found.notes)


def test_polycams_empty_corrected_folders_do_not_count(tmp_path: Path) -> None:
    write_polycam(room(), tmp_path / "a")
    for name in ("corrected_images", "corrected_cameras"):
        (tmp_path / "a/keyframes" / name).mkdir()
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    assert len(found) == 4
    assert "there are no corrected cameras: the poses are ARKit's own, which drift in large scans" in found.notes


def test_depth_that_is_all_below_the_confidence_names_it(tmp_path: Path) -> None:
    write_polycam(room(), tmp_path / "a")
    for path in (tmp_path / "a/keyframes/confidence").iterdir():
        Image.fromarray(np.full((60, 80), 127, np.uint8)).save(path)
    with pytest.raises(InputError, match=r"a: all depth is below --confidence 128 in the 4 frames .* 0 for all depth"):
        plugins.open_recording(tmp_path / "a", confidence=128)
    assert len(plugins.open_recording(tmp_path / "a", confidence=127)) == 4


def test_frames_without_colour_are_left_out_and_counted(tmp_path: Path) -> None:
    write_scannerapp(room(), tmp_path / "a", every=6)
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    assert [frame.time_s for frame in found] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert "20 frames without an image or depth left out" in found.notes
    assert np.abs(found[3].world_from_camera - room()[3].world_from_camera).max() < 1e-9


@pytest.mark.parametrize(("name", "levels"), [("polycam", (0, 127, 255)), ("scannerapp", (0, 1, 2))])
def test_depth_of_low_confidence_is_dropped(tmp_path: Path, name: str, levels: tuple[int, int, int]) -> None:
    WRITERS[name](room(), tmp_path / "a")
    sure = np.full((60, 80), levels[2], np.uint8)
    sure[:20], sure[20:40] = levels[0], levels[1]
    for path in (*(tmp_path / "a").glob("keyframes/confidence/*"), *(tmp_path / "a").glob("conf_*")):
        Image.fromarray(sure).save(path)
    depth = plugins.open_recording(tmp_path / "a", floor_m=0)[0].depth_m
    assert depth is not None
    assert np.isnan(depth[:40]).all() and np.isfinite(depth[40:]).all()
    assert np.isfinite(plugins.open_recording(tmp_path / "a", floor_m=0, confidence=0)[0].depth_m).all()


def head(**changes: object) -> Callable[[Path], object]:
    def apply(root: Path) -> None:
        path = min((*root.glob("keyframes/cameras/*"), *root.glob("frame_*.json")))
        fields = {**json.loads(path.read_text()), **changes}
        path.write_text(json.dumps({name: value for name, value in fields.items() if value is not None}))

    return apply


DAMAGE: list[tuple[str, Callable[[Path], object], str]] = [
    ("polycam", head(t_11=None), "json lacks t_11"),
    ("polycam", head(fx="wide"), "json: could not convert"),
    ("polycam", head(cx=1000.0), "the principal point 1000, "),
    ("polycam", head(t_11=9.0), "the rotation is not orthonormal"),
    ("polycam", lambda root: min((root / "keyframes/cameras").iterdir()).rename(root / "keyframes/cameras/a.json"),
        None),
    ("polycam", lambda root: [p.unlink() for p in (root / "keyframes/images").iterdir()],
        "none of its 4 cameras has an"),
    ("scannerapp", head(intrinsics=[1, 2]), "intrinsics must be a list of 9 numbers"),
    ("scannerapp", head(cameraPoseARFrame=None), "cameraPoseARFrame must be a list of 16 numbers, got None"),
    ("scannerapp", head(cameraPoseARFrame=[0] * 16), "cameraPoseARFrame: the last row of a pose must be"),
    ("scannerapp", head(time="soon"), "time: could not convert"),
    ("scannerapp",
        lambda root: [(root / f"depth_{i:05d}.png").unlink() for i in (0, 1, 2)]
        + [(root / "frame_00003.jpg").unlink()],
        "none of its 4 frames"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(
    tmp_path: Path, name: str, damage: Callable[[Path], object], fault: str | None
) -> None:
    WRITERS[name](room(), tmp_path / "a")
    damage(tmp_path / "a")
    if fault is None:
        assert "1 keyframes without an image or depth left out" in plugins.open_recording(tmp_path / "a").notes
        return
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "a", format=name)[0]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("times", [1, 2])
def test_polycam_without_sizes(tmp_path: Path, corrected: bool, times: int) -> None:
    """The intrinsics are those of the image, or of the keyframe as it was taken, which says its size."""
    write_polycam(room(), tmp_path / "a", corrected)
    c = room().camera.scaled(160 * times, 120 * times)
    for path in sorted((tmp_path / "a/keyframes").glob("*cameras/*.json")):
        head = json.loads(path.read_text()) | {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
        del head["width"], head["height"]
        taken = {"width": c.width, "height": c.height} if path.parent.name == "cameras" and times > 1 else {}
        path.write_text(json.dumps(head | taken))
    found = plugins.open_recording(tmp_path / "a")
    assert found.camera == room().camera and len(found) == 4
