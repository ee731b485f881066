"""A first look says before the work what would make a map nonsense, and nothing over sound recordings."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faulty_recordings import INJECTED, Faulty, seen

from cartier import cli
from cartier.contracts import Recording
from cartier.doctor.glance import glance
from cartier.mapping.samples import few, sample
from cartier.recordings.folder import save
from cartier.types import Camera, Frame

NAMED = {
    "inverted": "inverted_poses", "opengl": "opengl_axes", "mirrored y": "left_handed", "poses in mm": "pose_scale",
    "depth x 1000": "depth_unit", "depth / 1000": "depth_unit", "depth x 5": "depth_scale",
    "depth 24 px right": "depth_not_registered", "intrinsics x 2": "intrinsics_resolution", "black depth": "no_depth",
}  # fmt: skip


def told(recording: Recording) -> list[str]:
    return [fault.fault for fault in glance(recording, sample(recording, numbers=few(len(recording))))]


@pytest.mark.parametrize("injected", NAMED)
def test_a_fault_is_named_at_a_glance(injected: str) -> None:
    assert NAMED[injected] in told(INJECTED[injected][1](seen("studio", 1.5)))


@pytest.mark.parametrize("home, eye_m, sensor", [("studio", 1.5, True), ("118", 0.2, True), ("old_couple", 1.5, False)])
def test_nothing_is_said_of_a_sound_recording(home: str, eye_m: float, sensor: bool) -> None:
    assert told(seen(home, eye_m, sensor)) == []


def test_poses_of_another_run_are_not_its_own() -> None:
    other = seen("118", 1.5)
    walked = Faulty(
        seen("studio", 1.5),
        lambda frame, _: replace(frame, world_from_camera=other[frame.index % len(other)].world_from_camera),
    )
    assert told(walked) == ["other_poses"]


def test_depth_of_zero_is_nothing_read() -> None:
    depth = np.array([[0.0, 1.0], [-1.0, np.nan]], np.float32)
    frame = Frame(0, 0.0, np.zeros((2, 2, 3), np.uint8), depth, np.eye(4), Camera(2, 2, 1.0, 1.0, 0.5, 0.5))
    assert frame.depth_m is not None and np.array_equal(np.isnan(frame.depth_m), [[True, False], [True, True]])


@pytest.mark.parametrize("anyway", [False, True])
def test_map_stops_before_the_work_unless_it_is_told_to_go_on(
    anyway: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save(INJECTED["opengl"][1](seen("studio", 1.5)), tmp_path / "in")
    words = (
        "cartier",
        "map",
        tmp_path / "in",
        "-o",
        tmp_path / "out",
        "--every",
        30,
        *(("--anyway",) if anyway else ()),
    )
    monkeypatch.setattr(sys, "argv", [*map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    said = capsys.readouterr().err
    assert "opengl_axes: OpenGL axes" in said
    assert anyway or (ended.value.code == 1 and "--anyway maps it as it is" in said and not (tmp_path / "out").exists())
