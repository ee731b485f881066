"""Pose graph: drift of a recording's poses found and mended by its own depth.

Each sampled frame is registered, point to plane, to those before it, and then to single earlier ones that show the same
surfaces. A graph of the steps between frames and of these registrations, each weighed by what its surfaces determine
(Lu and Milios, Globally consistent range scan alignment, 1997), gives the corrections: a turn about z and a shift for
each sample. Some registrations are left out of it. Only if the surfaces of those lie closer together than before are
the corrections taken.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.mapping.gravity import oriented
from cartier.mapping.poses import jumps
from cartier.mapping.poses.registration import Surface, about_z, apart_m, corrected, register
from cartier.types import Camera, Frame

Floats = npt.NDArray[np.float64]
SAMPLES = 256  # frames that are examined, spread evenly over the recording
ACROSS, POINTS, AGAINST = 40, 300, 4000  # px; points of a frame that are moved, and with how many they are compared
FEWEST_SAMPLES, FEWEST = 8, 60
REACHES_M = (0.3, 0.3, 0.2, 0.2, 0.15, 0.1, 0.1)
PAIR_REACHES_M = (0.2, 0.15, 0.1, 0.1)
MOST_STEP_M = 0.25  # a registration that moves a frame farther from where the last ones lead is not believed
STEP_SIGMA = np.array([np.deg2rad(0.5), 0.02, 0.02, 0.02])  # what odometry may be off from a sample to the next
JUMPED = 50.0  # times as much, from a sample to the next with a jump between them
PAIR_SIGMA = np.array([np.deg2rad(1.0), 0.05, 0.05, 0.05])
CELL_M, SHARED, PAIRS_EACH = 0.3, 0.25, 5  # frames show the same where they share a quarter of cells of this side
HELD_OUT = 5  # each fifth registration is left out of the graph, and judges it
LEAST_M, LEAST_RAD = 0.05, float(np.deg2rad(1.0))  # smaller drift is left alone: it is what registration is off, too
BETTER = 0.9  # of the distance between surfaces that may be left
STAKED, HOPELESS = 40, 0.95  # pairs that are fitted each by itself first; what that leaves where no graph does better


@dataclass(frozen=True, eq=False)
class Mended:
    """Corrections of a recording's poses.

    Args:
        frames: (n,) the numbers of the frames that were examined, rising.
        corrections: (n, 4) the turn about z (rad) and the shift of the camera (m) of each.
        before_m, after_m: How far surfaces that two frames show lay apart, in frames that were left out of the graph.
    """

    frames: npt.NDArray[np.int64]
    corrections: Floats
    before_m: float
    after_m: float

    @property
    def shift_m(self) -> float:
        """The largest shift of a camera."""
        return float(np.linalg.norm(self.corrections[:, 1:], axis=1).max())

    def pose(self, index: int, world_from_camera: Floats) -> Floats:
        """The corrected pose (4, 4) of any frame; between two that were examined, corrections are blended, or that of
        the nearer one is taken where the poses jump."""
        at = float(np.interp(index, self.frames, np.arange(len(self.frames))))
        one, two = self.corrections[int(at)], self.corrections[min(int(at) + 1, len(self.corrections) - 1)]
        jump = np.linalg.norm(two[1:] - one[1:]) > jumps.LEAST_M or abs(two[0] - one[0]) > jumps.LEAST_RAD
        yaw, *shift = one + (round(at % 1) if jump else at % 1) * (two - one)
        pose = np.array(world_from_camera, np.float64)
        pose[:3, :3] = about_z(float(yaw)) @ pose[:3, :3]
        pose[:3, 3] += shift
        return pose

    def rows(self) -> list[list[float]]:
        """The corrections as JSON values: the frame's number, the turn (rad) and the shift (m) of each."""
        table = zip(self.frames.tolist(), self.corrections.round(5).tolist(), strict=True)
        return [[number, *row] for number, row in table]

    @classmethod
    def of_rows(cls, rows: Sequence[Sequence[float]]) -> Mended:
        """What ``rows`` gave, but for how far surfaces lay apart."""
        table = np.array(rows, np.float64).reshape(-1, 5)
        return cls(table[:, 0].astype(np.int64), table[:, 1:], 0.0, 0.0)

    def note(self) -> str:
        """What a person should know."""
        return (
            f"the poses drift: they were corrected by up to {self.shift_m:.2f} m, until surfaces that lay "
            f"{100 * self.before_m:.1f} cm apart lie {100 * self.after_m:.1f} cm apart; --keep-poses maps without"
        )


class PoseGraph:
    """Examines frames as they pass; keeps small samples of some."""

    def __init__(self) -> None:
        self._samples: list[Surface] = []
        self._numbers: list[int] = []
        self._every, self._frames = 1, 0

    def add(self, frame: Frame) -> None:
        """Take in the next frame."""
        if self._frames % self._every == 0 and frame.depth_m is not None:
            self._samples.append(_surface(frame))
            self._numbers.append(frame.index)
            if len(self._samples) > SAMPLES:
                self._samples, self._numbers = self._samples[::2], self._numbers[::2]
                self._every *= 2
        self._frames += 1

    def mend(self) -> Mended | None:
        """The corrections, or None where poses hardly drift or corrections do not bring surfaces together."""
        samples = self._samples
        if len(samples) < FEWEST_SAMPLES:
            return None
        leaps = jumps.find_jumps(samples)
        told, samples = samples, jumps.moved(samples, leaps)
        first = _one_by_one(samples)
        if not leaps and np.abs(first[:, 1:]).max() < LEAST_M and np.abs(first[:, 0]).max() < LEAST_RAD:
            return None
        pairs = _pairs(samples, first)
        judges, edges = pairs[::HELD_OUT], [pair for k, pair in enumerate(pairs) if k % HELD_OUT]
        if not leaps and not _at_stake(samples, first, judges[:: max(1, len(judges) // STAKED)]):
            return None
        solved = _solved(samples, first, edges, [jump.sample for jump in leaps])
        if solved is None or not judges:
            return None
        across = [pair for pair in judges if any(pair[0] < jump.sample <= pair[1] for jump in leaps)]
        judges = across or judges  # all others look the same with and without a jump
        before_m, after_m = _residual_m(told, judges, np.zeros_like(solved)), _residual_m(samples, judges, solved)
        if after_m > BETTER * before_m:
            return None
        return Mended(np.array(self._numbers), _from(told, samples, solved), before_m, after_m)


def _at_stake(samples: Sequence[Surface], first: Floats, pairs: Sequence[tuple[int, int]]) -> bool:
    """Whether surfaces of some pairs come closer where each pair is fitted by itself; no graph does much better."""
    pairs = [(k, late) for k, late in pairs if min(len(samples[k]), len(samples[late]) - POINTS) >= FEWEST]
    apart = 0.0
    for early, late in pairs:
        against = samples[early].placed(first[early])
        fitted = register(samples[late].first(POINTS), first[late], against, PAIR_REACHES_M, PAIR_SIGMA)
        apart += 0.0 if fitted is None else apart_m(samples[late].placed(fitted.correction)[POINTS:], against)
    return apart <= HOPELESS * len(pairs) * _residual_m(samples, pairs, np.zeros_like(first))


def _surface(frame: Frame) -> Surface:
    """Points and normals that a frame shows, in a mixed order."""
    assert frame.depth_m is not None
    stride = max(1, frame.camera.width // ACROSS)
    depth_m, c = frame.depth_m[::stride, ::stride], frame.camera
    camera = Camera(depth_m.shape[1], depth_m.shape[0], c.fx / stride, c.fy / stride, c.cx / stride, c.cy / stride)
    points = np.hstack(oriented(np.eye(4), camera, depth_m)).astype(np.float32)
    mixed = np.random.default_rng(frame.index).permutation(len(points))[: 2 * POINTS]
    return Surface(np.asarray(frame.world_from_camera, np.float64), points[mixed])


def _one_by_one(samples: Sequence[Surface]) -> Floats:
    """Corrections (n, 4) of samples that are registered to those before them, one after the other."""
    found = np.zeros((len(samples), 4))
    seen = [samples[0].placed(found[0], POINTS)]
    order = np.random.default_rng(0)
    for k in range(1, len(samples)):
        here = samples[k]
        found[k] = led = corrected(samples[k - 1], found[k - 1], here)
        points = here.placed(led, POINTS)
        if len(points) >= FEWEST:
            near = np.concatenate(seen)
            low, high = points[:, :3].min(axis=0) - REACHES_M[0], points[:, :3].max(axis=0) + REACHES_M[0]
            near = near[((near[:, :3] > low) & (near[:, :3] < high)).all(axis=1)]
            if len(near) > AGAINST:
                near = near[order.permutation(len(near))[:AGAINST]]
            fitted = register(here.first(POINTS), led, near, REACHES_M, STEP_SIGMA)
            if fitted is not None and np.abs(fitted.correction - led)[1:].max() < MOST_STEP_M:
                found[k] = fitted.correction
        seen.append(here.placed(found[k], POINTS))
    return found


def _pairs(samples: Sequence[Surface], corrections: Floats) -> list[tuple[int, int]]:
    """Pairs of samples, the earlier one first, that show the same surfaces; at most five with each later one."""
    cells: dict[tuple[int, ...], list[int]] = defaultdict(list)
    sizes = np.ones(len(samples))
    for k, sample in enumerate(samples):
        own = np.unique(np.floor(sample.placed(corrections[k], POINTS)[:, :3] / CELL_M).astype(int), axis=0)
        sizes[k] = max(1, len(own))
        for cell in map(tuple, own.tolist()):
            cells[cell].append(k)
    shared = np.zeros((len(samples), len(samples)))
    for numbers in cells.values():
        shared[np.ix_(numbers, numbers)] += 1
    found = []
    for late in range(2, len(samples)):
        share = shared[late, : late - 1] / sizes[late]  # the step to the one just before is in the graph anyway
        best = np.argsort(-share, kind="stable")[:PAIRS_EACH]
        found += [(int(early), late) for early in best if share[early] > SHARED]
    return found


def _from(told: Sequence[Surface], samples: Sequence[Surface], corrections: Floats) -> Floats:
    """Corrections (n, 4) of poses that are off by jumps, from those of poses without jumps."""
    whole = corrections.copy()
    for row, one, other in zip(whole, told, samples, strict=True):
        turn = other.world_from_camera[:3, :3] @ one.world_from_camera[:3, :3].T
        row[0] += np.arctan2(turn[1, 0], turn[0, 0])
        row[1:] += other.world_from_camera[:3, 3] - one.world_from_camera[:3, 3]
    return whole


def _solved(
    samples: Sequence[Surface], first: Floats, pairs: Sequence[tuple[int, int]], leaps: Sequence[int]
) -> Floats | None:
    """The corrections (n, 4) that fit steps and registrations best; None without registrations.

    The step to a sample behind one of ``leaps`` weighs nearly nothing: both sides of it are free.
    """
    from scipy.optimize import least_squares
    from scipy.sparse import lil_matrix

    rows, measured, roots = [], [], []
    for early, late in pairs:
        if min(len(samples[early]), len(samples[late])) < FEWEST:
            continue
        against = samples[early].placed(first[early])
        fitted = register(samples[late].first(POINTS), first[late], against, PAIR_REACHES_M, PAIR_SIGMA)
        if fitted is not None and fitted.root is not None:
            rows.append((early, late))
            measured.append(fitted.correction - corrected(samples[early], first[early], samples[late]))
            roots.append(fitted.root)
    if not rows:
        return None
    count, at = len(samples), np.array([sample.world_from_camera[:3, 3] for sample in samples])
    steps = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    sigma = np.tile(STEP_SIGMA, (count - 1, 1))
    sigma[[number - 1 for number in leaps]] *= JUMPED
    links, offs, weights = np.array(rows), np.array(measured), np.array(roots)

    def residuals(flat: Floats) -> Floats:
        found = np.vstack([np.zeros(4), flat.reshape(count, 4)[1:]])
        odometry = (found[steps[:, 1]] - _led(at, found, steps)) / sigma
        off = np.einsum("eij,ej->ei", weights, found[links[:, 1]] - _led(at, found, links) - offs)
        off = np.sign(off) * np.sqrt(
            2 * (np.sqrt(1 + off * off) - 1)
        )  # a wrong registration pulls no more than it must
        return np.concatenate([odometry.ravel(), off.ravel()])

    sparsity = lil_matrix((4 * (count - 1 + len(rows)), 4 * count), dtype=np.int8)
    for number, (one, two) in enumerate([*map(tuple, steps.tolist()), *rows]):
        sparsity[4 * number : 4 * number + 4, [*range(4 * one, 4 * one + 4), *range(4 * two, 4 * two + 4)]] = 1
    solved = np.asarray(least_squares(residuals, first.ravel(), jac_sparsity=sparsity, max_nfev=20).x).reshape(count, 4)
    solved[0] = 0  # the world is that of the first frame
    return solved


def _led(at: Floats, corrections: Floats, pairs: npt.NDArray[np.intp]) -> Floats:
    """Corrections (e, 4) of the second frames of pairs, if they move with the first ones; ``at`` (n, 3) are cameras."""
    one, way = corrections[pairs[:, 0]], at[pairs[:, 1]] - at[pairs[:, 0]]
    c, s = np.cos(one[:, 0]), np.sin(one[:, 0])
    turned = np.column_stack([c * way[:, 0] - s * way[:, 1], s * way[:, 0] + c * way[:, 1], way[:, 2]])
    return np.column_stack([one[:, 0], turned - way + one[:, 1:]])


def _residual_m(samples: Sequence[Surface], pairs: Sequence[tuple[int, int]], corrections: Floats) -> float:
    """How far the surfaces of pairs of samples lie apart, by points that registered nothing."""
    off = [
        apart_m(samples[late].placed(corrections[late])[POINTS:], samples[early].placed(corrections[early]))
        for early, late in pairs
        if min(len(samples[early]), len(samples[late]) - POINTS) >= FEWEST
    ]
    return float(np.mean(off)) if off else 0.0
