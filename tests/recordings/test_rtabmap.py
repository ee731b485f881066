from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exports import rvl, write_rtabmap, write_rtabmap_database
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from layouts import room

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.recordings.common.depth import unpack_rvl


def same(found: Recording, pose_error: float, depth_error: float = 0.00051) -> None:
    assert len(found) == len(room())
    assert found.camera == room().camera
    for i, frame in enumerate(found):
        assert np.abs(frame.world_from_camera - room().poses[i]).max() < pose_error
        assert np.abs(frame.rgb.astype(int) - room()[i].rgb).mean() < 8
        if frame.depth_m is not None:
            assert np.abs(frame.depth_m - room()[i].depth_m).max() < depth_error


@pytest.mark.parametrize("by_id", [True, False])
@pytest.mark.parametrize("camera_poses", [True, False])
def test_an_export_comes_back(tmp_path: Path, by_id: bool, camera_poses: bool) -> None:
    write_rtabmap(room(), tmp_path / "a", by_id, camera_poses)
    found = plugins.open_recording(tmp_path / "a", floor_m=0)
    same(found, 1e-6)
    assert found[0].depth_m is not None and found[2].time_s == pytest.approx(1_700_000_000.45)
    assert any("taken for poses of the robot's base" in note for note in found.notes) == (not camera_poses)


@pytest.mark.parametrize("optimised", [True, False])
@pytest.mark.parametrize("depth_as", ["rvl", "png", "float"])
def test_a_database_comes_back(tmp_path: Path, optimised: bool, depth_as: str) -> None:
    write_rtabmap_database(room(), tmp_path / "home.db", optimised, depth_as)
    found = plugins.open_recording(tmp_path / "home.db", floor_m=0)
    assert found.name == "home" and found[0].depth_m is not None
    same(found, 1e-5, 1e-6 if depth_as == "float" else 0.00051)
    assert any("optimised graph" in note and ("odometry" in note) != optimised for note in found.notes)
    before = found.fingerprint()
    assert plugins.open_recording(tmp_path / "home.db", floor_m=0).fingerprint() == before
    base = sqlite3.connect(tmp_path / "home.db")
    base.execute("UPDATE Data SET depth = NULL WHERE id = 6")
    base.commit()
    assert "1 nodes without depth left out" in plugins.open_recording(tmp_path / "home.db", floor_m=0).notes
    base.execute("UPDATE Data SET depth = NULL")
    base.commit()
    assert plugins.open_recording(tmp_path / "home.db", floor_m=0)[3].depth_m is None


def edit(question: str, *values: object) -> Callable[[Path], object]:
    def apply(path: Path) -> None:
        base = sqlite3.connect(path)
        base.execute(question, values)
        base.commit()
        base.close()

    return apply


def calibration(*head: int, more: bytes = b"") -> Callable[[Path], object]:
    return edit("UPDATE Data SET calibration = ? WHERE id = 6", struct.pack(f"<{len(head)}i", *head) + more)


DAMAGE: list[tuple[Callable[[Path], object], str]] = [
    (edit("DROP TABLE Data"), "is no RTAB-Map database: it has no tables 'Node' and 'Data'"),
    (edit("CREATE VIEW v AS SELECT 1"), "it holds more than table, index"),
    (edit("ALTER TABLE Data DROP COLUMN calibration"), r"older than 0\.11: 'rtabmap-reprocess home\.db NEW\.db'"),
    (calibration(0, 21), r"node 6: its calibration is damaged, or of an RTAB-Map older than 0\.18"),
    (calibration(0, 21, 4, 1, 0, 0, 0, 0, 0, 0, 0), "node 6 is of a stereo camera"),
    (calibration(0, 21, 4, 0, 160, 120, 9, 2**30, 2**30, 12, 12), "node 6: its calibration is damaged"),
    (calibration(0, 21, 4, 0, 160, 120, 9, -5, 5, 0, 0, more=bytes(72)), "node 6: its calibration is damaged"),
    (calibration(0, 21, 4, 0, 160, 120, 9, 0, 0, 0, 0, more=bytes(72)), "node 6: camera focal lengths must be"),
    (calibration(0, 21, 4, 0, 160, 120, 9, 0, 0, 0, 0, more=bytes(99)), "node 6 is of several cameras"),
    (edit("UPDATE Admin SET opt_ids = x'00'"), "its optimised graph is damaged"),
    (edit("UPDATE Admin SET opt_ids = opt_poses"), "its optimised graph has 48 nodes, but 48 numbers"),
    (edit("UPDATE Data SET image = x'00'"), "image of node 4 is not a JPEG or PNG image"),
    (edit("UPDATE Data SET depth = x'00'"), "depth of node 4 is not a JPEG or PNG image"),
    (edit("UPDATE Data SET depth = image"), "depth of node 4 is a RGB JPEG, which is no depth"),
    (edit("UPDATE Data SET depth = CAST('DEPTHRVL1234' AS BLOB)"), "depth of node 4 is damaged .unpack_from requires"),
    (edit("UPDATE Data SET depth = CAST('DEPTHRVL12341234' AS BLOB)"),
        "depth of node 4 is damaged .it claims 875770417x"),
    (edit("UPDATE Data SET depth = x'4445505448525641' || image"), "depth of node 4 is not a JPEG or PNG"),
    (edit("UPDATE Data SET depth = substr(depth, 1, 200)"), "depth of node 4 is damaged .it holds more than 19200"),
    (edit("UPDATE Data SET depth = substr(depth, 1, 16)"), "depth of node 4 is damaged .it holds no number"),
    (edit("UPDATE Data SET depth = substr(depth, 1, 16) || zeroblob(16)"), "it ends after 0 of 19200 pixels"),
    (edit("UPDATE Data SET depth = substr(depth, 1, 16) || x'ffffffffffffffff07000000'"), "a number does not end"),
    (edit("UPDATE Data SET image = NULL"), "holds no node with an image, a pose and a calibration"),
    (edit("UPDATE Node SET stamp = 'soon'"), "node 4: could not convert"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "fault"), DAMAGE)
def test_a_damaged_database_is_one_clear_line(tmp_path: Path, damage: Callable[[Path], object], fault: str) -> None:
    write_rtabmap_database(room(), tmp_path / "home.db")
    damage(tmp_path / "home.db")
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "home.db")[0]
    assert "\n" not in str(caught.value)


def test_a_truncated_database(tmp_path: Path) -> None:
    write_rtabmap_database(room(), tmp_path / "home.db")
    data = (tmp_path / "home.db").read_bytes()
    (tmp_path / "home.db").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="damaged"):
        list(plugins.open_recording(tmp_path / "home.db"))
    (tmp_path / "other.db").write_bytes(b"not sqlite at all")
    with pytest.raises(InputError, match="is no recording that cartier knows"):
        plugins.open_recording(tmp_path / "other.db")


@given(
    arrays(
        np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([0, 1, 7, 8, 900, 65535])
    )
)
def test_rvl_comes_back(image: np.ndarray) -> None:
    assert np.array_equal(unpack_rvl(rvl(image), image.shape[1], image.shape[0]), image)


def test_rvl_by_hand() -> None:
    """Two zeros, three pixels 5, 4, 12 in steps of 5, -1 and 8 (written 10, 1, 16), one zero, no pixel."""
    assert unpack_rvl(struct.pack("<2I", 0x23A11821, 0), 6, 1).tolist() == [[0, 0, 5, 4, 12, 0]]


def text(name: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    return lambda root: (root / name).write_text(change((root / name).read_text()))


EXPORT_DAMAGE: list[tuple[Callable[[Path], object], str]] = [
    (text("home_camera_poses.txt", lambda t: "\n".join(r.rpartition(" ")[0] for r in t.splitlines())),
        "not of poses format 11"),
    (text("home_camera_poses.txt", lambda t: t.replace(" 7\n", " 99\n").replace("1700000000.25", "1.0")), None),
    (text("home_camera_poses.txt", lambda t: "#\n1 0 0 0 0 0 0 1 999\n"), "none of the 1 poses in home_camera_poses"),
    (text("home_calib/7.yaml", lambda t: t.replace("camera_matrix", "matrix")),
        "camera_matrix must have data of 9 numbers"),
    (text("home_calib/7.yaml", lambda t: t.replace("image_width: 160", "")), "7.yaml: .*float"),
    (text("home_calib/7.yaml", lambda t: "a: &b [1]\nc: *b\n"), r"7\.yaml line 2: YAML aliases"),
    (text("home_calib/7.yaml", lambda t: "- 1\n"), "must hold a calibration: image_width"),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "fault"), EXPORT_DAMAGE)
def test_a_damaged_export_is_one_clear_line(
    tmp_path: Path, damage: Callable[[Path], object], fault: str | None
) -> None:
    write_rtabmap(room(), tmp_path / "a")
    damage(tmp_path / "a")
    if fault is None:
        assert "1 poses without an image or depth left out" in plugins.open_recording(tmp_path / "a").notes
        return
    with pytest.raises(InputError, match=fault) as caught:
        plugins.open_recording(tmp_path / "a")
    assert "\n" not in str(caught.value)
