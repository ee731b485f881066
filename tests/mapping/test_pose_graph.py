"""Pose graph: drift is mended by depth, what is sound is left alone, and registration agrees with closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cartier
from cartier.mapping.gravity import oriented
from cartier.mapping.poses.motions import Reposed
from cartier.mapping.poses.pose_graph import Mended, PoseGraph
from cartier.mapping.poses.registration import Surface, about_z, apart_m, corrected, register
from synthetic import CAMERA, THINGS, RoomRecording, TrueBoxes, look, render

AROUND = [
    look((2.4 + 0.9 * np.cos(a), 2.0 + 0.9 * np.sin(a), 1.5), (2.4 + 2 * np.cos(a), 2.0 + 2 * np.sin(a), 1.0))
    for a in np.linspace(0, 4 * np.pi, 48)
]
ROOM = RoomRecording(AROUND, THINGS)


def drifting(most_m: float, most_rad: float) -> Reposed:
    """Two rounds through the room whose poses drift, ever farther."""

    def pose(index: int, true: np.ndarray) -> np.ndarray:
        share = index / (len(ROOM) - 1)
        moved = true.copy()
        moved[:3, :3] = about_z(most_rad * share) @ true[:3, :3]
        moved[:2, 3] += most_m * share * np.array([0.8, -0.6])
        return moved

    return Reposed(ROOM, pose)


def mend(recording: cartier.Recording | Reposed) -> Mended | None:
    graph = PoseGraph()
    for number in range(len(recording)):
        graph.add(recording[number])
    return graph.mend()


def off_m(recording: Reposed, mended: Mended | None) -> float:
    """How far the worst camera is off."""
    told = [recording[number].world_from_camera for number in range(len(recording))]
    poses = told if mended is None else [mended.pose(number, pose) for number, pose in enumerate(told)]
    return max(float(np.linalg.norm(pose[:3, 3] - true[:3, 3])) for pose, true in zip(poses, AROUND, strict=True))


def test_drift_is_mended() -> None:
    recording = drifting(0.5, 0.1)
    mended = mend(recording)
    assert mended is not None and mended.after_m < 0.5 * mended.before_m
    assert off_m(recording, None) == pytest.approx(0.5, abs=1e-6)
    assert off_m(recording, mended) < 0.1
    last = mended.pose(47, recording[47].world_from_camera)
    np.testing.assert_allclose(last[:3, :3], AROUND[47][:3, :3], atol=0.02)
    np.testing.assert_array_equal(mended.pose(0, AROUND[0]), AROUND[0])


@pytest.mark.parametrize(("at", "shift_m", "turn_rad"), [(30, (0.34, 0.2), 0.07), (38, (-0.2, 0.1), -0.1)])
def test_a_jump_is_taken_back(at: int, shift_m: tuple[float, float], turn_rad: float) -> None:
    recording = jumping(at, shift_m, turn_rad)
    mended = mend(recording)
    assert mended is not None
    assert off_m(recording, mended) < 0.06 < 0.2 < off_m(recording, None)


def jumping(at: int, shift_m: tuple[float, float], turn_rad: float) -> Reposed:
    """Two rounds whose poses are all off by one motion from some frame on."""
    here, turn = np.array(AROUND[at][:3, 3]), about_z(turn_rad)

    def pose(index: int, true: np.ndarray) -> np.ndarray:
        moved = true.copy()
        if index >= at:
            moved[:3, :3] = turn @ true[:3, :3]
            moved[:3, 3] = turn @ (true[:3, 3] - here) + here + (*shift_m, 0.0)
        return moved

    return Reposed(ROOM, pose)


def test_poses_jump_between_samples() -> None:
    corrections = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 0.02, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0]])
    mended = Mended(np.array([0, 10, 20]), corrections, 0.1, 0.0)
    x = [float(mended.pose(number, np.eye(4))[0, 3]) for number in (0, 5, 10, 14, 16, 20, 30)]
    assert x == pytest.approx([0.0, 0.01, 0.02, 0.02, 0.5, 0.5, 0.5])


def test_sound_poses_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def unasked(*given: object) -> None:
        raise AssertionError("nothing is solved where registration finds next to nothing")

    monkeypatch.setattr("cartier.mapping.poses.pose_graph._solved", unasked)
    assert mend(ROOM) is None
    assert mend(drifting(0.03, 0.0)) is None


def test_nothing_at_stake_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    def unasked(*given: object) -> None:
        raise AssertionError("no pair of frames comes closer")

    def astray(samples: list[Surface]) -> np.ndarray:
        return np.array([(0.0, 0.08 * (k > 0), 0.0, 0.0) for k in range(len(samples))])

    monkeypatch.setattr("cartier.mapping.poses.pose_graph._one_by_one", astray)
    monkeypatch.setattr("cartier.mapping.poses.pose_graph._solved", unasked)
    assert mend(ROOM) is None


def test_without_depth_or_with_few_frames_nothing_is_mended() -> None:
    assert mend(RoomRecording(AROUND, THINGS, with_depth=False)) is None
    assert mend(RoomRecording(AROUND[:5], THINGS)) is None


def test_corrections_that_help_nothing_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.mapping.poses.pose_graph._solved", lambda samples, first, *more: np.zeros_like(first))
    assert mend(drifting(0.5, 0.1)) is None


def test_the_judges_are_not_in_the_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier.mapping.poses import pose_graph

    seen: dict[str, set[tuple[int, int]]] = {}
    solved, residual_m = pose_graph._solved, pose_graph._residual_m

    def spy_solved(
        samples: list[Surface], first: np.ndarray, pairs: list[tuple[int, int]], leaps: list[int]
    ) -> np.ndarray | None:
        seen["edges"] = set(pairs)
        return solved(samples, first, pairs, leaps)

    def spy_residual(samples: list[Surface], pairs: list[tuple[int, int]], corrections: np.ndarray) -> float:
        seen["judges"] = set(pairs)
        return residual_m(samples, pairs, corrections)

    monkeypatch.setattr(pose_graph, "_solved", spy_solved)
    monkeypatch.setattr(pose_graph, "_residual_m", spy_residual)
    mend(drifting(0.5, 0.1))
    assert len(seen["judges"]) > 5 and len(seen["edges"]) > 20 and not seen["judges"] & seen["edges"]


def surface(number: int) -> Surface:
    points = np.hstack(oriented(np.eye(4), CAMERA, render(AROUND[number], CAMERA, THINGS)[0])).astype(np.float32)
    return Surface(np.array(AROUND[number]), points[np.random.default_rng(0).permutation(len(points))])


EVERYTHING = np.concatenate([surface(number).placed(np.zeros(4), 800) for number in range(0, 48, 3)])


@settings(max_examples=15, deadline=None)
@given(
    turn=st.floats(-0.06, 0.06), x=st.floats(-0.12, 0.12), y=st.floats(-0.12, 0.12), z=st.floats(-0.08, 0.08),
    number=st.integers(0, 47),
)  # fmt: skip
def test_a_frame_is_brought_back(turn: float, x: float, y: float, z: float, number: int) -> None:
    reaches, sigma = (0.3, 0.3, 0.2, 0.2, 0.15, 0.1, 0.1, 0.1), np.full(4, 1.0)
    found = register(surface(number).first(400), np.array([turn, x, y, z]), EVERYTHING, reaches, sigma)
    assert found is not None and found.root is not None
    least, *_ = np.linalg.svd(found.root)[1][::-1]
    if least > 30:  # else it sees one wall, along which it may lie anywhere
        assert abs(found.correction[0]) < 0.015
        np.testing.assert_allclose(found.correction[1:], 0, atol=0.03)
    assert apart_m(surface(number).placed(found.correction, 300), EVERYTHING) < 0.012


def test_where_surfaces_say_nothing_the_start_holds() -> None:
    x, y = np.meshgrid(np.linspace(0, 2, 20), np.linspace(0, 2, 20))
    floor = np.column_stack([x.ravel(), y.ravel(), np.zeros(400), np.zeros(400), np.zeros(400), np.ones(400)])
    camera = Surface(np.eye(4), floor.astype(np.float32))
    found = register(camera, np.array([0.01, 0.05, -0.04, 0.06]), floor, (0.3, 0.2, 0.1), np.full(4, 0.05))
    assert found is not None and found.root is not None
    np.testing.assert_allclose(found.correction, (0.01, 0.05, -0.04, 0.0), atol=0.004)
    weights = np.abs(found.root).sum(axis=0)
    assert weights[3] > 100 * max(weights[:3]), "only the height is determined"


def test_too_little_registers_nothing() -> None:
    here, sigma = surface(0), np.full(4, 1.0)
    assert register(here.first(10), np.zeros(4), EVERYTHING, (0.2,), sigma) is None
    assert register(here, np.zeros(4), EVERYTHING[:5], (0.2,), sigma) is None
    far = EVERYTHING + np.array([30.0, 0, 0, 0, 0, 0])
    assert register(here, np.zeros(4), far, (0.2,), sigma) is None


def test_surfaces_at_an_angle_are_not_one() -> None:
    y, z = np.meshgrid(np.linspace(0, 2, 20), np.linspace(0, 2, 20))
    wall = np.column_stack([np.zeros(400), y.ravel(), z.ravel(), np.ones(400), np.zeros(400), np.zeros(400)])
    leaning = wall.copy()
    leaning[:, 3:5] = 0.5, np.sqrt(0.75)
    camera, sigma = Surface(np.eye(4), wall.astype(np.float32)), np.full(4, 1.0)
    assert register(camera, np.zeros(4), wall, (0.2,), sigma) is not None
    assert register(camera, np.zeros(4), leaning, (0.2,), sigma) is None


def test_a_correction_leads_the_next_frame() -> None:
    one, other = surface(0), surface(5)
    correction = np.array([0.2, 0.3, -0.1, 0.05])
    rigid = np.eye(4)
    rigid[:3, :3] = about_z(0.2)
    at = one.world_from_camera[:3, 3]
    rigid[:3, 3] = at + correction[1:] - about_z(0.2) @ at
    moved = (rigid @ other.world_from_camera)[:3, 3]
    led = corrected(one, correction, other)
    np.testing.assert_allclose(other.world_from_camera[:3, 3] + led[1:], moved, atol=1e-9)
    assert led[0] == 0.2


def test_surfaces_apart_are_measured() -> None:
    wall = EVERYTHING[:2000]
    assert apart_m(wall, EVERYTHING) == pytest.approx(0, abs=1e-6)
    up = wall[np.abs(wall[:, 5]) > 0.99]
    lifted = up + np.array([0, 0, 0.06, 0, 0, 0])
    assert apart_m(lifted, up) == pytest.approx(0.06, abs=0.005)
    assert apart_m(up + np.array([0, 0, 30.0, 0, 0, 0]), up) == pytest.approx(0.15)


def test_a_drifting_recording_is_mapped_as_if_it_did_not() -> None:
    right = cartier.map_home(ROOM, TrueBoxes(THINGS), every=2)
    mended = cartier.map_home(drifting(0.5, 0.1), TrueBoxes(THINGS), every=2)
    kept = cartier.map_home(drifting(0.5, 0.1), TrueBoxes(THINGS), every=2, mend_poses=False)

    def off_m(home: cartier.Home) -> float:
        """How far the worst object is from the nearest one of its label that is confirmed."""
        sure = [o for o in home.objects if o.confirmed]
        return max(
            min(float(np.linalg.norm(np.subtract(o.position, there.position))) for o in sure if o.label == there.label)
            for there in right.objects
        )

    assert off_m(mended) < 0.05 < 0.2 < off_m(kept)
    assert len(mended.objects) < len(kept.objects), "what was seen twice is one"
    row = mended.settings["recordings"][0]
    assert row["sha256"] == right.settings["recordings"][0]["sha256"]
    again = Mended.of_rows(row["mended"])
    np.testing.assert_allclose(again.pose(40, AROUND[40])[:3, 3], mended_pose(40), atol=1e-4)
    assert any("corrected by up to 0." in note and "--keep-poses" in note for note in mended.notes)
    assert "mended" not in kept.settings["recordings"][0] and not right.settings["recordings"][0].get("mended")


def mended_pose(number: int) -> np.ndarray:
    mended = mend(drifting(0.5, 0.1))
    assert mended is not None
    return np.asarray(mended.pose(number, AROUND[number])[:3, 3])
