"""``cartier live --check``: faults of streams are named with their mend, and sound ones raise no alarm."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from cartier.cli import app
from cartier.doctor import FAULTS
from cartier.doctor.explanation import explained
from cartier.doctor.stream_check import DRIVER_MENDS, KEPT, check_stream
from cartier.mapping.samples import sample
from cartier.recordings.folder import save
from cartier.types import Frame
from cartier.types.streams import Event, Fault, Stamped
from studio import studio

FRAMES = 10


@pytest.fixture(autouse=True, scope="module")
def rendered() -> None:
    """Before a stream begins: the check listens for ten seconds."""
    studio()


class Scripted:
    name, waits, recording, notes = "scripted", True, None, ()

    def __init__(self, events: Iterator[Event]) -> None:
        self.events, self.closed = events, False

    def __iter__(self) -> Iterator[Event]:
        yield from self.events

    def close(self) -> None:
        self.closed = True


def frames(change: Callable[[int, Frame], Frame] = lambda i, frame: frame, step_ns: int = 10**8) -> Iterator[Stamped]:
    for i in range(FRAMES):
        yield Stamped(change(i, studio()[i]), 10**18 + i * step_ns)


def told(events: Iterator[Event]) -> set[str]:
    source = Scripted(events)
    report = check_stream(source)
    assert source.closed
    assert report.ok is (not report.faults)
    assert all(fault.repair and "\n" not in fault.evidence and not fault.fix for fault in report.faults)
    assert "--fix" not in str(report), "there is nothing to write"
    return {fault.fault for fault in report.faults}


def moved(pose: np.ndarray, by: np.ndarray) -> np.ndarray:
    out = pose.copy()
    out[:3, 3] += by
    return out


def with_far(depth_m: np.ndarray) -> np.ndarray:
    """Depth with a corner that holds no reading, sent as 10 m."""
    out = depth_m.copy()
    out[: len(out) // 3, : out.shape[1] // 3] = 10.0
    return out


def some(kind: str, lost: int, count: int) -> Iterator[Event]:
    yield from frames()
    yield from (Fault(kind, "the test says so", lost) for _ in range(count))


def test_a_sound_stream_is_sound() -> None:
    report = check_stream(Scripted(frames()))
    assert report.ok, report.faults
    assert report.frames == FRAMES
    lines = "\n".join(report.sound)
    for word in ("10.0 a second", "160x120", "half of them within", "the camera moved by", "z is up"):
        assert word in lines
    assert json.loads(json.dumps(report.to_dict()))["ok"] is True


SEEDED: dict[str, tuple[Callable[[], Iterator[Event]], str]] = {
    "nothing": (lambda: iter(()), "silent"),
    "silence": (lambda: iter([Fault("silent", "no images arrive")] * 3), "silent"),
    "no depth": (lambda: frames(lambda i, f: replace(f, depth_m=None)), "no_depth"),
    "a second a frame": (lambda: frames(step_ns=2 * 10**9), "rate"),
    "millimetres": (lambda: frames(lambda i, f: replace(f, depth_m=f.depth_m * 1000)), "depth_unit"),
    "upside down": (
        lambda: frames(lambda i, f: replace(f, world_from_camera=f.world_from_camera @ np.diag([-1.0, -1, 1, 1]))),
        "opengl_axes",
    ),
    "still pose": (
        lambda: frames(lambda i, f: replace(f, world_from_camera=studio()[0].world_from_camera)),
        "still_pose",
    ),
    "a leap": (
        lambda: frames(
            lambda i, f: replace(f, world_from_camera=moved(f.world_from_camera, np.array([9.0 * (i > 5), 0, 0])))
        ),
        "pose_jump",
    ),
    "a leap without depth": (
        lambda: frames(
            lambda i, f: replace(
                f, depth_m=None, world_from_camera=moved(f.world_from_camera, np.array([9.0 * (i > 5), 0, 0]))
            )
        ),
        "pose_jump",
    ),
    "a short leap": (
        lambda: frames(
            lambda i, f: replace(
                f, depth_m=None, world_from_camera=moved(f.world_from_camera, np.array([0, 2.0 * (i > 5), 0]))
            )
        ),
        "pose_jump",
    ),
    "a lens cap": (lambda: frames(lambda i, f: replace(f, rgb=f.rgb // 60)), "black"),
    "a picture that stays": (lambda: frames(lambda i, f: replace(f, rgb=studio()[0].rgb)), "frozen"),
    "red and blue swapped": (lambda: frames(lambda i, f: replace(f, rgb=f.rgb[..., ::-1].copy())), "colours_swapped"),
    "colour upside down": (lambda: frames(lambda i, f: replace(f, rgb=f.rgb[::-1].copy())), "turned_pictures"),
    "colour mirrored": (lambda: frames(lambda i, f: replace(f, rgb=f.rgb[:, ::-1].copy())), "turned_pictures"),
    "infrared as colour": (
        lambda: frames(lambda i, f: replace(f, rgb=np.repeat(f.rgb[..., 1:2], 3, axis=2))), "grey",
    ),
    "no reading is 10 m": (lambda: frames(lambda i, f: replace(f, depth_m=with_far(f.depth_m))), "no_reading_far"),
    "half without transforms": (lambda: some("no_pose", FRAMES, 1), "no_pose"),
    "two parents": (lambda: some("two_parents", 0, 1), "two_parents"),
    "a clock that jumps": (lambda: some("clock", 1, 1), "clock"),
}  # fmt: skip


@pytest.mark.parametrize("name", SEEDED)
def test_a_seeded_fault_is_named(name: str) -> None:
    make, fault = SEEDED[name]
    assert fault in told(make())


@pytest.mark.parametrize(
    ("mount", "says"),
    [
        (Rotation.from_euler("y", 12, degrees=True).as_matrix(), "yaw: a mount that is turned by"),
        (Rotation.from_euler("x", 12, degrees=True).as_matrix(), "pitch: a mount that is turned by"),
    ],
)
def test_a_contradiction_is_explained(mount: np.ndarray, says: str) -> None:
    turn = np.eye(4)
    turn[:3, :3] = mount
    assert explained(sample(_Mounted(turn))).startswith(says)
    assert not explained(sample(_Mounted(np.eye(4))))


def test_a_fault_of_a_driver_is_mended_at_the_driver() -> None:
    assert set(DRIVER_MENDS) <= set(FAULTS)
    report = check_stream(Scripted(SEEDED["upside down"][0]()))
    mends = {fault.fault: fault.repair for fault in report.faults}
    assert "frame_id" in mends["opengl_axes"]


def test_a_few_images_left_out_are_no_fault() -> None:
    assert not told(some("no_pose", 1, 2))


def test_a_robot_that_stands_still_is_no_fault() -> None:
    report = check_stream(Scripted(frames(lambda i, f: replace(studio()[3], index=i))))
    assert report.ok, report.faults
    assert any("stood still" in note for note in report.notes)


def test_stamps_of_now_are_compared_with_this_clock() -> None:
    for late_s, fault in ((0.0, False), (3.0, True), (-3.0, True)):
        stamped = (
            Stamped(studio()[i], round((time.time() - late_s) * 1e9)) for i in range(FRAMES)
        )  # as it is asked for
        report = check_stream(Scripted(stamped))
        assert ("age" in {each.fault for each in report.faults}) is fault, report


def test_frames_in_memory_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = list[int]()

    def examined(source: object, watched: Any, *_: object) -> list[object]:
        kept.append(len(watched.frames))
        return []

    monkeypatch.setattr("cartier.doctor.stream_check._examined", examined)
    check_stream(Scripted(Stamped(studio()[i % FRAMES], 10**18 + i * 10**8) for i in range(300)))
    assert KEPT / 2 <= kept[0] <= KEPT


def test_the_command_prints_and_writes_nothing(tmp_path: Path) -> None:
    save(studio(), tmp_path / "walk")
    result = CliRunner().invoke(app, ["live", "--check", "--from", f"bag:{tmp_path / 'walk'}@max"])
    assert result.exit_code == 0, result.output
    assert "it can be mapped" in result.stdout and "WRONG" not in result.stdout
    broken = tmp_path / "broken"
    save(_Without(), broken)
    result = CliRunner().invoke(app, ["live", "--check", "--from", f"bag:{broken}@max", "--json"])
    assert result.exit_code == 1
    assert "no_depth" in {fault["fault"] for fault in json.loads(result.stdout)["faults"]}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken", "walk"]
    assert CliRunner().invoke(app, ["live", "--from", f"bag:{broken}"]).exit_code == 1


class _Mounted:
    """The walk by a camera that is turned on the robot."""

    name, truth, notes = "mounted", None, ()

    def __init__(self, turn: np.ndarray) -> None:
        self.turn, self.camera = turn, studio().camera

    def __len__(self) -> int:
        return FRAMES

    def __getitem__(self, index: int) -> Frame:
        frame = studio()[index]
        return replace(frame, world_from_camera=frame.world_from_camera @ self.turn)

    def fingerprint(self) -> str:
        return "mounted"


class _Without:
    """The walk without depth."""

    name, truth, notes = "without depth", None, ()

    def __init__(self) -> None:
        self.camera = studio().camera

    def __len__(self) -> int:
        return FRAMES

    def __getitem__(self, index: int) -> Frame:
        return replace(studio()[index], depth_m=None)

    def fingerprint(self) -> str:
        return "without depth"
