from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import write_tum
from layouts import room
from PIL import Image

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.types import Camera


def opened(root: Path, **options: object) -> Recording:
    return plugins.open_recording(root, format="tum", **options)


def test_depth_poses_and_times_come_back(tmp_path: Path) -> None:
    write_tum(room(), tmp_path / "a")
    found = opened(tmp_path / "a", up=(0, 0, 1), floor_m=0)
    assert found.camera == room().camera
    for i, frame in enumerate(found):
        source = room()[i]
        assert frame.depth_m is not None
        assert abs(frame.time_s - 1305031102.175304 - i / 10) < 1e-5
        assert np.abs(frame.depth_m - source.depth_m).max() < 1.1e-4
        assert np.abs(frame.world_from_camera - source.world_from_camera).max() < 1e-9
        assert np.array_equal(frame.rgb, source.rgb)


def lines(name: str, change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def apply(root: Path) -> None:
        (root / name).write_text("\n".join(change((root / name).read_text().splitlines())) + "\n")

    return apply


def test_images_without_a_pose_or_depth_are_left_out_and_counted(tmp_path: Path) -> None:
    write_tum(room(), tmp_path / "a")
    lines("groundtruth.txt", lambda rows: rows[:-2])(tmp_path / "a")
    lines("depth.txt", lambda rows: [rows[0], *rows[2:]])(tmp_path / "a")
    found = opened(tmp_path / "a")
    assert len(found) == 2
    assert "1 images left out: groundtruth.txt has no pose at their time" in found.notes
    assert "1 images left out: no depth within 20 ms of them" in found.notes


def published(root: Path) -> None:
    """A sequence without intrinsics of its own, with images of the benchmark's size."""
    write_tum(room(frames=2), root)
    (root / "calibration.txt").unlink()
    for path in (root / "rgb").iterdir():
        Image.open(path).resize((640, 480)).save(path)
    for path in (root / "depth").iterdir():
        Image.fromarray(np.full((480, 640), 10_000, np.uint16)).save(path)


def test_the_published_intrinsics_are_taken_by_the_folders_name(tmp_path: Path) -> None:
    root = tmp_path / "rgbd_dataset_freiburg3_long_office_household"
    published(root)
    found = opened(root)
    assert found.camera == Camera(640, 480, 535.4, 539.2, 320.1, 247.6)
    assert "intrinsics of freiburg3 as published, by the folder's name" in found.notes
    assert opened(root, camera="500,501,320,240").camera == Camera(640, 480, 500, 501, 320, 240)


def test_the_published_intrinsics_are_taken_by_the_head_of_the_files(tmp_path: Path) -> None:
    """Whoever renames the folder still has the benchmark's own comment in line 2 of each list."""
    published(tmp_path / "desk")
    with pytest.raises(InputError, match=r"the folder's name or the second line of rgb\.txt has freiburg1"):
        opened(tmp_path / "desk")
    heads = ["# color images", "# file: 'rgbd_dataset_freiburg3_desk.bag'", "# timestamp filename"]
    lines("rgb.txt", lambda rows: [*heads, *rows[1:]])(tmp_path / "desk")
    found = opened(tmp_path / "desk")
    assert found.camera == Camera(640, 480, 535.4, 539.2, 320.1, 247.6)
    assert "intrinsics of freiburg3 as published, by the head of rgb.txt" in found.notes


def test_a_pose_may_have_more_columns_but_is_no_matrix(tmp_path: Path) -> None:
    write_tum(room(), tmp_path / "a")
    before = opened(tmp_path / "a")
    lines("groundtruth.txt", lambda rows: [rows[0], *(f"{row} 17 lost" for row in rows[1:])])(tmp_path / "a")
    assert np.array_equal(opened(tmp_path / "a")[3].world_from_camera, before[3].world_from_camera)
    lines("groundtruth.txt", lambda rows: [rows[0], *(f"{row} 17 18" for row in rows[1:])])(tmp_path / "a")
    with pytest.raises(InputError, match="8 numbers, got 12"):
        opened(tmp_path / "a")


DAMAGE: list[tuple[Callable[[Path], object], str]] = [
    (lambda root: (root / "calibration.txt").unlink(), r"holds no intrinsics: write fx fy cx cy to .*calibration\.txt"),
    (lambda root: (root / "calibration.txt").write_text("1 2 3"), "needs fx fy cx cy and, if it distorts, .* got 3"),
    (lambda root: (root / "calibration.txt").write_text("1 nan 3 4"), r"calibration\.txt: NaN"),
    (lambda root: (root / "calibration.txt").write_text("-1 1 3 4"), "focal lengths must be positive"),
    (lambda root: (root / "rgb.txt").write_text("# none\n"), r"rgb\.txt names no image"),
    (lambda root: (root / "rgb.txt").write_text("1.0\n"), r"rgb\.txt line 1: expected 'time file'"),
    (lambda root: (root / "rgb.txt").write_text("soon a.png\n"), r"rgb\.txt line 1: could not convert"),
    (lambda root: (root / "rgb.txt").write_text("1.0 ../../secret.png\n"), "leads out of the recording's folder"),
    (lambda root: (root / "rgb.txt").write_text("1.0 /etc/passwd\n"), "leads out of the recording's folder"),
    (lambda root: (root / "groundtruth.txt").write_text("1 2 3\n"), r"groundtruth\.txt line 1: .* 8 numbers, got 3"),
    (
        lambda root: (root / "groundtruth.txt").write_text("1 0 0 0 0 0 0 1\n"),
        "no image has a pose and depth: .*4 images",
    ),
]


@pytest.mark.parametrize(("damage", "fault"), DAMAGE)
def test_damage_is_one_clear_line(tmp_path: Path, damage: Callable[[Path], object], fault: str) -> None:
    write_tum(room(), tmp_path / "a")
    damage(tmp_path / "a")
    with pytest.raises(InputError, match=fault) as caught:
        opened(tmp_path / "a")
    assert "\n" not in str(caught.value)


def test_a_subset_made_of_links_is_read_as_if_it_were_copied(tmp_path: Path) -> None:
    write_tum(room(), tmp_path / "a")
    whole = opened(tmp_path / "a")
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    for image in [*(tmp_path / "b/rgb").iterdir(), *(tmp_path / "b/depth").iterdir()]:
        image.unlink()
        image.symlink_to(tmp_path / "a" / image.relative_to(tmp_path / "b"))
    linked = opened(tmp_path / "b")
    assert linked.fingerprint() == whole.fingerprint()
    assert np.array_equal(linked[1].rgb, whole[1].rgb)
    (note,) = set(linked.notes) - set(whole.notes)
    assert note.startswith(f"{2 * len(whole)} files are links that lead out of the recording's folder, such as rgb/")
