"""Corrected poses move the map of a live session: the map is as if all poses had been right, and ids stay."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_session import Eyes, Scripted

import cartier
from cartier import Live, specs
from cartier.errors import InputError
from cartier.io.spool import Spool
from cartier.live.answers import check_epoch
from cartier.live.sent_poses import SentPoses
from cartier.mapping.poses.motions import moved
from cartier.mapping.replay import KeptFrame, frame_key
from cartier.plugins import open_recording
from cartier.serving.live_homes import LiveHomes
from cartier.serving.operations import Operations
from cartier.types.streams import Event, PoseUpdate, Stamped
from synthetic import THINGS, walk

WALK = walk()
STEP_NS = 10**8
HALF = len(WALK) // 2


def motion(turn_rad: float, x: float, y: float) -> np.ndarray:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    moved = np.eye(4)
    moved[:2] = (c, -s, 0, x), (s, c, 0, y)
    return moved


DRIFT = motion(0.1, 0.5, -0.3)


def stamped(number: int, by: np.ndarray | None = None) -> Stamped:
    frame = WALK[number]
    pose = frame.world_from_camera if by is None else by @ frame.world_from_camera
    return Stamped(cartier.Frame(number, number / 10, frame.rgb, frame.depth_m, pose, frame.camera), number * STEP_NS)


def truth(numbers: range) -> dict[int, np.ndarray]:
    return {number * STEP_NS: WALK[number].world_from_camera for number in numbers}


def run(events: Iterator[Event], spool: Path | None = None) -> tuple[Live, cartier.Home]:
    live = Live(Scripted(events), Eyes(), spool=spool, every=1)
    live.start()
    return live, live.wait()


def places(home: cartier.Home) -> dict[str, tuple[float, ...]]:
    return {obj.label: obj.position for obj in home.objects if obj.confirmed}


@pytest.mark.parametrize("spooled", [True, False])
def test_a_corrected_map_is_as_if_poses_were_right(spooled: bool, tmp_path: Path) -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(HALF))
        yield PoseUpdate(truth(range(HALF)), "/mapPath")
        yield from (stamped(number) for number in range(HALF, len(WALK)))

    _, right = run(stamped(number) for number in range(len(WALK)))
    live, mended = run(events(), tmp_path / "a.spool" if spooled else None)
    assert live.frame_epoch == 1 and not live.moment().correcting
    assert places(mended).keys() == places(right).keys() == {thing.label for thing in THINGS}
    for label, where in places(right).items():
        np.testing.assert_allclose(places(mended)[label], where, atol=0.02)
    assert mended.grid is not None and right.grid is not None
    np.testing.assert_allclose(mended.grid.origin_xy, right.grid.origin_xy, atol=0.1)


def test_ids_stay_when_the_map_moves(tmp_path: Path) -> None:
    before: dict[str, int] = {}

    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(len(WALK)))
        while live.state().looked < len(WALK):
            threading.Event().wait(0.01)
        home, _ = live._map.snapshot()
        home.save(tmp_path / "home")  # as it is while it is mapped
        assert len(cartier.Home.load(tmp_path / "home").objects) == len(home.objects)
        before.update({obj.label: obj.id for obj in home.objects})
        yield PoseUpdate(truth(range(len(WALK))), "/mapPath")

    live = Live(Scripted(events()), Eyes(), every=1)
    live.start()
    after = live.wait()
    assert {obj.label: obj.id for obj in after.objects} == before and len(before) == len(THINGS)
    assert live.frame_epoch == 1


def test_ids_stay_where_a_map_that_begins_anew_has_others() -> None:
    before: list[cartier.MapObject] = []

    def events() -> Iterator[Event]:  # what was seen in the first two frames is seen again elsewhere
        yield from (stamped(number, motion(0, 2.0, 0) if number > 1 else None) for number in range(len(WALK)))
        while live.state().looked < len(WALK):
            threading.Event().wait(0.01)
        before.extend(live._map.snapshot()[0].objects)
        yield PoseUpdate(truth(range(len(WALK))), "/mapPath")

    live = Live(Scripted(events()), Eyes(), every=1)
    live.start()
    after = {obj.label: obj.id for obj in live.wait().objects}
    _, anew = run(stamped(number) for number in range(len(WALK)))
    labels = [obj.label for obj in before]
    once = {obj.label: obj.id for obj in before if labels.count(obj.label) == 1}
    assert len(once) < len(set(labels)) and any(obj.id != once.get(obj.label, obj.id) for obj in anew.objects)
    assert {label: after[label] for label in once} == once


def test_a_corrected_frame_is_no_new_frame() -> None:
    mapper, frame = cartier.Mapper(Eyes()), stamped(3).frame
    mapper.add(frame)
    assert (mapper.add(stamped(3, DRIFT).frame) == -1).all() and not mapper.integrate_depth(stamped(3, DRIFT).frame)
    assert mapper.integrate_depth(stamped(4).frame)


def test_a_mapper_is_reposed_only_if_a_frame_moved() -> None:
    mapper = cartier.Mapper(Eyes())
    kept = []
    for number in range(HALF):
        frame, detections = stamped(number, DRIFT).frame, Eyes().detect(WALK[number])
        mapper.add(frame, detections)

        def read(frame: cartier.Frame = frame, seen: cartier.Detections = detections) -> Any:
            return frame, seen

        kept.append(KeptFrame(number, frame.world_from_camera, frame_key(frame), read))
    hardly = {number: motion(0, 0.01, 0) @ frame.world_from_camera for number, frame in enumerate(kept)}
    assert mapper.repose(hardly, kept) is mapper
    right = mapper.repose({number: WALK[number].world_from_camera for number in range(HALF)}, kept)
    assert right is not mapper
    before, after = ({o.id: o for o in each.home().objects} for each in (mapper, right))
    assert before.keys() == after.keys()
    for number, obj in after.items():
        there = np.linalg.inv(DRIFT) @ np.append(before[number].position, 1.0)
        np.testing.assert_allclose(obj.position, there[:3], atol=0.06)
        assert obj.label == before[number].label


def test_what_counts_as_moved() -> None:
    assert not moved(np.eye(4), motion(0.008, 0.015, 0.0)) and not moved(np.eye(4), np.eye(4))
    assert moved(np.eye(4), motion(0.0, 0.021, 0.0)) and moved(np.eye(4), motion(0.009, 0.0, 0.0))


def test_what_hardly_moves_changes_nothing() -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number) for number in range(HALF))
        yield PoseUpdate({ns: motion(0.004, 0.0, 0.0) @ pose for ns, pose in truth(range(1)).items()}, "/mapPath")
        yield PoseUpdate({ns: motion(0, 0.011, 0.0) @ pose for ns, pose in truth(range(HALF)).items()}, "/mapPath")

    live, _ = run(events())
    assert live.frame_epoch == 0 and live.state().pose_updates == 2


def test_a_spool_gives_corrected_poses(tmp_path: Path) -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(HALF))
        yield PoseUpdate(truth(range(HALF)), "/mapPath")

    live, _ = run(events(), tmp_path / "a.spool")
    live.saved()
    recording = open_recording(tmp_path / "a.spool")
    for number in range(len(recording)):
        np.testing.assert_allclose(recording[number].world_from_camera, WALK[number].world_from_camera, atol=1e-9)
    assert len(Spool(tmp_path / "a.spool").keyframes()) == HALF


def test_a_goal_of_an_older_epoch_is_refused() -> None:
    check_epoch(2, 2)
    with pytest.raises(InputError, match=r"frame epoch 1.*epoch 2.*ask again") as refused:
        check_epoch(1, 2)
    assert "\n" not in str(refused.value)


def test_answers_name_their_epoch() -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(len(WALK)))
        yield PoseUpdate(truth(range(len(WALK))), "/mapPath")

    live, home = run(events())
    answer = live.ask("where is the " + home.objects[0].label)
    assert answer.as_of is not None and answer.as_of.frame_epoch == 1
    old = cartier.ask(home, f"take me to the {home.objects[0].label}")
    assert old.goal is not None
    with pytest.raises(InputError, match="frame epoch 0"):
        live.goal_of(old)


def test_a_served_robot_is_not_sent_to_an_older_epoch() -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(len(WALK)))
        yield PoseUpdate(truth(range(len(WALK))), "/mapPath")

    live, home = run(events())
    served = Operations(LiveHomes(live, "room"), specs.reasoner("embedded"))
    number = str(home.objects[0].id)
    assert served.goal_for(number)["as_of"]["frame_epoch"] == 1
    assert "sent" in served.go(number, "print", frame_epoch=1) and "sent" in served.go(number, "print")
    with pytest.raises(InputError, match=r"frame epoch 0.*ask again"):
        served.go(number, "print", frame_epoch=0)


@settings(max_examples=60, deadline=None)
@given(
    turn=st.floats(-0.5, 0.5), x=st.floats(-2, 2), y=st.floats(-2, 2),
    named=st.sets(st.integers(0, 9), min_size=1), later=st.integers(10, 14),
)  # fmt: skip
def test_a_rigid_correction_of_any_frames_corrects_all_before_it(
    turn: float, x: float, y: float, named: set[int], later: int
) -> None:
    by, poses = motion(turn, x, y), SentPoses()
    sent = {number: np.array(WALK.poses[number]) for number in range(15)}
    for number in range(10):
        poses.add(number, sent[number])
    changed = poses.correct({number: by @ sent[number] for number in named})
    poses.add(later, sent[later])
    if changed:
        for number in range(10):
            np.testing.assert_allclose(poses.pose(number, sent[number]), by @ sent[number], atol=1e-9)
        far = np.hypot(*(poses.pose(9, sent[9]) - sent[9])[:2, 3]) > 0.02 or abs(turn) > 0.01
        assert not far or poses.pose(later, sent[later]) is sent[later], "it came in the corrected world"
    else:
        assert poses.pose(0, sent[0]) is sent[0]


def test_a_correction_between_two_is_between_them() -> None:
    poses = SentPoses()
    for number in range(11):
        poses.add(number, np.eye(4))
    poses.correct({0: np.eye(4), 10: motion(0.4, 1.0, 0)})
    np.testing.assert_allclose(poses.pose(5, np.eye(4)), motion(0.2, 0.5, 0), atol=1e-9)
    poses.correct({99: motion(1, 1, 1)})
    np.testing.assert_allclose(poses.pose(10, np.eye(4)), motion(0.4, 1.0, 0), atol=1e-9)


def test_long_streams_forget_poses_but_not_those_of_keyframes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.live.sent_poses.MOST", 100)
    poses = SentPoses()
    for number in range(1000):
        poses.add(number, np.eye(4))
        if number % 10 == 0:
            poses.hold(number, np.eye(4))
    assert len(poses._sent) <= 201
    assert all(np.array_equal(poses.current(number), np.eye(4)) for number in range(0, 1000, 10))


def test_a_frame_forgotten_while_it_waited_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.live.sent_poses.MOST", 2)
    poses = SentPoses()
    for number in range(9):
        poses.add(number, np.eye(4))
    poses.hold(0, DRIFT)
    np.testing.assert_array_equal(poses.current(0), DRIFT)


def test_poses_are_added_while_others_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.live.sent_poses.MOST", 10)
    poses, failed, done = SentPoses(), list[BaseException](), threading.Event()

    def hold() -> None:
        try:
            number = 0
            while not done.is_set():
                poses.hold(number, np.eye(4))
                poses.current(number)
                number += 7
        except BaseException as error:
            failed.append(error)

    keeper = threading.Thread(target=hold)
    keeper.start()
    for number in range(3000):
        poses.add(number, np.eye(4))
    done.set()
    keeper.join()
    assert not failed


def test_the_camera_is_shown_where_the_map_is() -> None:
    def events() -> Iterator[Event]:
        yield from (stamped(number, DRIFT) for number in range(HALF))
        yield PoseUpdate(truth(range(HALF)), "/mapPath")

    live, home = run(events())
    right = WALK[HALF - 1].world_from_camera[:2, 3]
    here = live.camera_pose()
    assert here is not None
    np.testing.assert_allclose(here[:2], right, atol=0.002)
    homes = LiveHomes(live, "flat")
    np.testing.assert_allclose(homes.start_xy(home), right, atol=0.002)
    goal = live.ask("take me to the table").goal
    served = Operations(homes, specs.reasoner("embedded")).ask("the table")
    assert goal is not None and np.linalg.norm(np.subtract(home.start_xy, right)) > 0.5
    np.testing.assert_allclose(goal.path[0], right, atol=0.1)
    np.testing.assert_allclose(served["goal"]["path"][0], right, atol=0.1)
