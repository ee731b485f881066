"""Drift is found where poses were moved, by as much as they were, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from cartier.geometry import transform
from cartier.mapping.gravity import oriented
from cartier.mapping.poses.drift import find_drift
from synthetic import CAMERA, THINGS, render, walk


def part(first: int, last: int, moved: np.ndarray | None = None) -> np.ndarray:
    """Surfaces (N, 6) that some frames of a walk show, all of them moved."""
    seen = []
    for pose in walk().poses[first:last]:
        depth = render(pose, CAMERA, THINGS)[0]
        seen.append(np.hstack(oriented(pose if moved is None else moved @ pose, CAMERA, depth)))
    return np.concatenate(seen).astype(np.float64)


def motion(turn_deg: float, x: float, y: float) -> np.ndarray:
    """A turn about the middle of the room, and a shift."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn, middle = np.eye(4), np.eye(4)
    turn[:2, :2], turn[:2, 3], middle[:2, 3] = [(c, -s), (s, c)], (x, y), (2.5, 2)
    return np.asarray(middle @ turn @ np.linalg.inv(middle))


def test_sound_poses_do_not_drift() -> None:
    assert find_drift([part(0, 7), part(7, 14), part(14, 20)]) is None


@pytest.mark.parametrize(("turn_deg", "x", "y"), [(0, 0.4, 0), (0, 0.3, -0.3), (8, 0, 0), (-6, 0.2, 0.1)])
def test_drift_is_found_and_measured(turn_deg: float, x: float, y: float) -> None:
    found = find_drift([part(0, 10), part(10, 20, motion(turn_deg, x, y))])
    assert found is not None
    assert found.turn_deg == pytest.approx(abs(turn_deg), abs=1)
    assert found.after > 1.25 * found.before
    if not turn_deg:
        assert found.shift_m == pytest.approx(np.hypot(x, y), abs=0.05)


def test_a_few_centimetres_are_no_drift() -> None:
    assert find_drift([part(0, 10), part(10, 20, motion(0.3, 0.04, 0.02))]) is None


def test_parts_that_share_nothing_say_nothing() -> None:
    elsewhere = transform(motion(0, 40, 0), part(0, 5)[:, :3])
    assert find_drift([part(0, 5), np.hstack([elsewhere, part(0, 5)[:, 3:]])]) is None
    assert find_drift([part(0, 5), np.empty((0, 6))]) is None
    assert find_drift([]) is None
