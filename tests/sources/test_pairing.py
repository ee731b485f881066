"""Pairing under late, double, missing and jumping stamps: whatever is paired has the pose of its exposure."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cartier.types.streams import Fault
from cartier_ros.streams.pairing import QUARANTINE_S, WAIT_S, Paired, Pairer
from cartier_ros.streams.transforms import TransformBuffer

SPEED_M_S, TURN_RAD_S = 0.5, 0.6
IMAGE_S, TF_S, SLOW_TF_S, LENGTH_S = 0.066, 0.03, 0.25, 4.0
START_S = 1_700_000_000.0
OFF_M, OFF_RAD = max(SPEED_M_S * TF_S * 2, SPEED_M_S / 2 * SLOW_TF_S), TURN_RAD_S * TF_S * 2
"""What a jump that is shorter than the period of a transform may cost: it looks like a transform that came late."""


@dataclass
class Told:
    """One message: when it arrives, its stream, its stamp, and when its content was true."""

    arrives_s: float
    stream: str
    stamp_s: float
    true_s: float


def truth(true_s: float) -> np.ndarray:
    yaw = TURN_RAD_S * true_s
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:2, 3] = SPEED_M_S * true_s, 1.0
    return pose


def row(stream: str, true_s: float) -> tuple[float, ...]:
    """The transform of one half of the chain: map to odom holds half of the way, odom to camera the rest."""
    if stream == "slow":
        return (SPEED_M_S * true_s / 2, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    yaw = TURN_RAD_S * true_s
    return (SPEED_M_S * true_s / 2, 0.0, 0.0, 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))


class Stream:
    """The receiver under test, fed message by message."""

    def __init__(self) -> None:
        self.transforms = TransformBuffer()
        self.pairer = Pairer(
            lambda ns: self.transforms.lookup("map", "camera", ns / 1e9), True, self.transforms.forget_moving
        )
        self.paired: list[Paired] = []
        self.faults: list[Fault] = []

    def feed(self, told: Told) -> None:
        now, ns = told.arrives_s, round(told.stamp_s * 1e9)
        if told.stream == "colour":
            self.pairer.colour(ns, told.true_s, now)
        elif told.stream == "depth":
            self.pairer.depth(ns, told.true_s, now)
        elif not self.pairer.quiet(now):
            parent, child = ("map", "odom") if told.stream == "slow" else ("odom", "camera")
            if not self.transforms.add(parent, child, told.stamp_s, row(told.stream, told.true_s), False):
                self.pairer.clock_jumped(now, "/tf went back")
        self.poll(now)

    def poll(self, now: float) -> None:
        for each in self.pairer.poll(now):
            (self.paired if isinstance(each, Paired) else self.faults).append(each)  # type: ignore[arg-type]


def messages(delays_s: dict[str, float], jumps: list[tuple[float, float]]) -> list[Told]:
    """All messages of a drive by a clock that jumps by ``jumps[i][1]`` at ``jumps[i][0]``."""
    told = []
    periods = {"colour": IMAGE_S, "depth": IMAGE_S, "fast": TF_S, "slow": SLOW_TF_S}
    for stream, period in periods.items():
        for k in range(int(LENGTH_S / period)):
            true_s = k * period
            stamp_s = START_S + true_s + sum(by for at, by in jumps if true_s >= at) + 0.003 * (stream == "depth")
            told.append(Told(true_s + delays_s[stream], stream, stamp_s, true_s))
    return sorted(told, key=lambda each: each.arrives_s)


def received(told: list[Told]) -> Stream:
    stream = Stream()
    for each in told:
        stream.feed(each)
    for k in range(20):
        stream.poll(told[-1].arrives_s + k * 0.1)
    return stream


def check_poses(stream: Stream, off_m: float = 1e-6, off_rad: float = 1e-6) -> None:
    for each in stream.paired:
        true = truth(each.colour)
        assert np.linalg.norm(each.world_from_camera[:3, 3] - true[:3, 3]) <= off_m + 1e-3
        angle = np.arccos(np.clip((np.trace(each.world_from_camera[:3, :3].T @ true[:3, :3]) - 1) / 2, -1, 1))
        assert angle <= off_rad + 1e-3
        assert abs(each.depth - each.colour) <= 0.020


DELAYS = st.fixed_dictionaries({name: st.floats(0, 0.4) for name in ("colour", "depth", "fast", "slow")})


def test_a_sound_stream_is_paired_whole() -> None:
    stream = received(messages(dict.fromkeys(("colour", "depth", "fast", "slow"), 0.02), []))
    could = int((int(LENGTH_S / SLOW_TF_S) - 1) * SLOW_TF_S / IMAGE_S)  # the transforms end a little earlier
    assert len(stream.paired) >= 0.99 * could
    check_poses(stream)


@given(DELAYS, st.data())
@settings(max_examples=12, deadline=None)
def test_late_double_and_missing_messages_give_no_wrong_pose(delays_s: dict[str, float], data: st.DataObject) -> None:
    told = messages(delays_s, [])
    kept = data.draw(st.lists(st.sampled_from([1, 1, 1, 1, 0, 2]), min_size=len(told), max_size=len(told)))
    later = [Told(m.arrives_s + 0.2, m.stream, m.stamp_s, m.true_s) for m, n in zip(told, kept, strict=True) if n == 2]
    chosen = [m for m, n in zip(told, kept, strict=True) if n] + later
    stream = received(sorted(chosen, key=lambda each: each.arrives_s))
    check_poses(stream)
    count = Counter(fault.reason for fault in stream.faults)
    sent = sum(m.stream == "colour" for m in chosen)
    passed = stream.pairer.between
    told = sum(fault.frames for fault in stream.faults)
    assert len(stream.paired) + told + passed == sent, "each image is paired or counted"
    assert count["double"] == sum(m.stream == "colour" for m in later)
    assert "clock" not in count


@example(dict.fromkeys(("colour", "depth", "fast", "slow"), 0.0), [(0.5, -5.0)], True)
@given(DELAYS, st.lists(st.tuples(st.floats(0.5, 3.5), st.floats(-30, 30)), min_size=1, max_size=3), st.booleans())
@settings(max_examples=25, deadline=None)
def test_jumping_clocks_give_no_wrong_pose(
    delays_s: dict[str, float], jumps: list[tuple[float, float]], small: bool
) -> None:
    jumps = [(at, by / 30 if small else by) for at, by in jumps]
    check_poses(received(messages(delays_s, jumps)), OFF_M, OFF_RAD)


@given(st.data())
@settings(max_examples=12, deadline=None)
def test_any_order_gives_no_wrong_pose(data: st.DataObject) -> None:
    told = messages(dict.fromkeys(("colour", "depth", "fast", "slow"), 0.0), [])[:120]
    off_s = data.draw(st.lists(st.floats(0, 0.4), min_size=len(told), max_size=len(told)))
    mixed = [Told(m.arrives_s + off, m.stream, m.stamp_s, m.true_s) for m, off in zip(told, off_s, strict=True)]
    check_poses(received(sorted(mixed, key=lambda each: each.arrives_s)))


def test_a_second_after_a_jump_is_left_out() -> None:
    jump_s = 1.5
    stream = received(messages(dict.fromkeys(("colour", "depth", "fast", "slow"), 0.0), [(jump_s, -5.0)]))
    times = [each.colour for each in stream.paired]
    assert not [at for at in times if jump_s + IMAGE_S < at < jump_s + 1.0]
    assert [at for at in times if at < jump_s]
    assert [at for at in times if at > jump_s + 1.0]


def test_an_image_waits_half_a_second_and_no_longer() -> None:
    stream = Stream()
    stream.pairer.colour(10, "a", 0.0)
    stream.poll(WAIT_S - 0.01)
    assert not stream.faults
    stream.poll(WAIT_S + 0.01)
    assert [fault.reason for fault in stream.faults] == ["no_pose"]


def test_nothing_is_extrapolated() -> None:
    stream = Stream()
    for at in (1.0, 1.1):
        stream.transforms.add("map", "camera", at, row("slow", at), False)
    for at, why in ((0.99, "too_early"), (1.11, "wait")):
        found = stream.transforms.lookup("map", "camera", at)
        assert found.matrix is None
        assert found.why == why
    assert stream.transforms.lookup("map", "camera", 1.05).matrix is not None


@pytest.mark.parametrize(
    ("rows", "why"),
    [
        ([(1.0, 0.0), (1.4, 0.2)], "pose_gap"),
        ([(1.0, 0.0), (1.4, 0.0)], ""),
        ([(1.0, 0.0), (1.1, 0.9)], "pose_jump"),
        ([(1.0, 0.0), (1.1, 0.05), (1.1, 0.2)], "pose_jump"),
    ],
)
def test_gaps_and_jumps_are_refused(rows: list[tuple[float, float]], why: str) -> None:
    buffer = TransformBuffer()
    for at, x in rows:
        assert buffer.add("map", "camera", at, (x, 0, 0, 0, 0, 0, 1), False)
    assert buffer.lookup("map", "camera", 1.05).why == why


def test_two_parents_are_refused() -> None:
    buffer = TransformBuffer()
    for parent in ("map", "odom"):
        buffer.add(parent, "camera", 1.0, (0, 0, 0, 0, 0, 0, 1), False)
    assert buffer.lookup("map", "camera", 1.0).why == "two_parents"
    assert buffer.parents("camera") == ("map", "odom")


def test_depth_farther_than_20_ms_is_no_partner() -> None:
    for off_ns, paired in ((20_000_000, 1), (20_000_001, 0)):
        stream = Stream()
        for at in (1.0, 2.0):
            stream.transforms.add("map", "camera", at, (0, 0, 0, 0, 0, 0, 1), False)
        stream.pairer.colour(1_500_000_000, "c", 0.0)
        stream.pairer.depth(1_500_000_000 + off_ns, "d", 0.0)
        stream.poll(0.1)
        assert len(stream.paired) == paired
        assert [fault.reason for fault in stream.faults] == ["no_depth"] * (1 - paired)


def test_after_a_jump_the_stream_goes_on() -> None:
    told = messages(dict.fromkeys(("colour", "depth", "fast", "slow"), 0.05), [(2.0, -100.0)])
    stream = received(told)
    assert [fault.reason for fault in stream.faults].count("clock") >= 1
    assert max(each.colour for each in stream.paired) > 2.0 + QUARANTINE_S
    check_poses(stream)
