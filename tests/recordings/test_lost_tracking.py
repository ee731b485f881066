"""A tracker that was lost for a moment: its NaN pose leaves out that frame, not the recording, in every format."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import write_rtabmap_database
from layouts import LAYOUTS, room

from cartier import plugins
from cartier.errors import InputError
from cartier.recordings import folder
from cartier.recordings.common.clock import one_run

Damage = Callable[[Path], object]


def words(file: str, lines: list[int], first: int, separator: str = " ") -> Damage:
    """All numbers of some lines from the word ``first`` on."""

    def damage(root: Path) -> None:
        rows = (root / file).read_text().splitlines()
        for i in lines:
            cells = rows[i].split(separator)
            rows[i] = separator.join([*cells[:first], *("nan" for _ in cells[first : first + 7]), *cells[first + 7 :]])
        (root / file).write_text("\n".join(rows) + "\n")

    return damage


def third(file: str, key: str = "") -> Damage:
    """The third matrix or pose of a JSON file, or the fields of one that begin so."""

    def damage(root: Path) -> None:
        path = sorted(root.glob(file))[2] if "*" in file else root / file
        head = json.loads(path.read_text())
        if key == "transform_matrix":
            head["frames"][2][key][0][3] = np.nan
        elif key == "poses":
            head[key][2] = [np.nan] * 7
        elif key == "cameraPoseARFrame":
            head[key] = [np.nan] * 16
        else:
            head |= {name: np.nan for name in head if name.startswith(key)}
        path.write_text(json.dumps(head))

    return damage


LOST: dict[str, Damage] = {
    "folder": words("trajectory.txt", [3], 1),
    "sevenscenes": words("frame-000040.pose.txt", [0, 1, 2, 3], 0, "\t "),
    "scannet": lambda root: (root / "pose/20.txt").write_text("-inf -inf -inf -inf\n" * 4),
    "tum": words("groundtruth.txt", [5, 6], 1),
    "replica": words("traj.txt", [2], 0),
    "nerfstudio": third("transforms.json", "transform_matrix"),
    "stray": words("odometry.csv", [3], 2, ", "),
    "arcore": words("poses.csv", [3], 1, ","),
    "record3d": third("metadata", "poses"),
    "record3d-export": third("metadata.json", "poses"),
    "polycam": third("keyframes/*cameras/*.json", "t_"),
    "scannerapp": third("frame_*.json", "cameraPoseARFrame"),
    "rtabmap": words("home_camera_poses.txt", [3], 1),
}


@pytest.mark.parametrize("name", LOST)
def test_nan_leaves_out_one_frame(tmp_path: Path, name: str) -> None:
    if name.startswith("record3d"):
        pytest.importorskip("OpenEXR")
    LAYOUTS[name](tmp_path / "a")
    if name == "record3d":
        pytest.skip("packed: the code is that of the export")
    whole = plugins.open_recording(tmp_path / "a", **({} if name == "folder" else {"floor_m": 0.0}))
    LOST[name](tmp_path / "a")
    found = plugins.open_recording(tmp_path / "a", **({} if name == "folder" else {"floor_m": 0.0}))
    assert len(found) == len(whole) - 1
    kept = [i for i in range(len(whole)) if i != 2]
    for frame, i in zip(found, kept, strict=True):
        assert np.array_equal(frame.rgb, whole[i].rgb)
    assert [note for note in found.notes if note.startswith("1 images left out: ")]


def test_database_of_two_sessions_or_a_lost_node(tmp_path: Path) -> None:
    write_rtabmap_database(room(), tmp_path / "a.db", optimised=False)
    with sqlite3.connect(tmp_path / "a.db") as base:
        base.execute("UPDATE Node SET map_id = 1 WHERE id = 10")
    found = plugins.open_recording(tmp_path / "a.db")
    says = "2 sessions that no optimised graph binds: only the longest is used, 3 of 4 nodes"
    assert len(found) == 3 and says in found.notes
    with sqlite3.connect(tmp_path / "a.db") as base:
        base.execute("UPDATE Node SET pose = ? WHERE id = 8", (np.full(12, np.nan, "<f4").tobytes(),))
    assert len(plugins.open_recording(tmp_path / "a.db")) == 2


def test_tracker_lost_throughout(tmp_path: Path) -> None:
    LAYOUTS["folder"](tmp_path / "a")
    words("trajectory.txt", [1, 2, 3, 4], 1)(tmp_path / "a")
    with pytest.raises(InputError, match="every pose is NaN"):
        plugins.open_recording(tmp_path / "a")


def test_two_walks_in_one_trajectory(tmp_path: Path) -> None:
    folder.save(room(frames=8), tmp_path / "a")
    lines = (tmp_path / "a/trajectory.txt").read_text().splitlines()
    moved = [line.replace(line.split()[1], "9.0", 1) for line in lines[1:4]]
    (tmp_path / "a/trajectory.txt").write_text("\n".join([*lines[:6], *moved]) + "\n")
    found = plugins.open_recording(tmp_path / "a")
    assert len(found) == 5
    assert [note for note in found.notes if "only the longest of 2 runs is used, 5 of 8 images" in note]


def test_a_clock_that_was_set_loses_no_frame() -> None:
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, 0, 3] = np.arange(9) / 10
    keep, notes = one_run(np.array([0, 1, 2, 3, 4, 2, 3, 4, 5.0]), poses)
    assert keep.all() and notes == ["time goes back by 3 s at frame 5, where the camera stays: its clock was set"]


def test_lists_of_two_sequences(tmp_path: Path) -> None:
    LAYOUTS["tum"](tmp_path / "a")
    truth = tmp_path / "a/groundtruth.txt"
    truth.write_text(truth.read_text() * 2)
    with pytest.raises(InputError, match=r"groundtruth.txt: time goes back by .* at entry 9: several recordings"):
        plugins.open_recording(tmp_path / "a", format="tum")
