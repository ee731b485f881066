"""Depth consistency: whether two overlapping frames agree when the depth of one is carried into the other.

Pixels of frame a are back-projected, moved into frame b by ``b_from_a`` and compared with b's depth there. A point
behind b's surface is occluded and says nothing; a point before it contradicts. Any reading of poses, depth unit and
intrinsics can be tried on the same pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.mapping.samples import Samples
from cartier.types import Array, Camera

PER_PAIR, LEAST_SEEN = 300, 20  # pixels of a pair to compare, and the fewest that count
MOST_BLOCKS, LEAST_BLOCK, ANCHORS = 8, 10, 80
NEAR_FRAMES, CHANGED, COARSE = 60, 0.5, 6
PARTNERS, TIMES_AS_FAR = 3, 8
MOST_TURN_DEG = 95.0  # frames turned further do not overlap; quarter turns are what shows a mirrored world
FEWEST_PAIRS = 4
CAP = 0.06  # relative depth difference from which two depths do not agree at all
LEAST_GAIN, FEWEST_SHARE, ONE_SIDED = 0.05, 0.1, 2
AGREED, AGREED_SHARE = 0.5, 0.9
Floats64 = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well P pairs agree. ``met`` (P,) is the share of a's points that meet b's depth, from 0 to 1.

    ``agreed`` (P,) is that share among the points that b observes. NaN where there are too few points. ``off_m`` is the
    median depth difference of the observed points.
    """

    met: Floats64
    agreed: Floats64
    off_m: float


class Pairs:
    """P pairs (a, b) of sampled frames, and the pixels of a that are compared."""

    def __init__(self, samples: Samples, pairs: Array, pixels: int = PER_PAIR) -> None:
        self.samples = samples
        self.pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        height, width = samples.grey.shape[1:]
        step = max(1, round((height * width / pixels) ** 0.5))
        rows, cols = np.meshgrid(np.arange(step // 2, height, step), np.arange(step // 2, width, step), indexing="ij")
        self._rows, self._cols = rows.ravel(), cols.ravel()
        self._z = samples.depth_m[self.pairs[:, :1], self._rows, self._cols]
        self._measured = np.isfinite(self._z)

    def __len__(self) -> int:
        return len(self.pairs)

    def agreement(self, b_from_a: Array, scale: float = 1.0, small: Camera | None = None) -> Agreement:
        """The agreement by motions (P, 4, 4), with the depth times ``scale`` and the small camera or another one."""
        camera = small or self.samples.small
        moved, u, v, inside = self.carry(b_from_a, scale, camera)
        there = self._there(self.samples.depth_m, u, v) * np.float32(scale)
        with np.errstate(invalid="ignore", divide="ignore"):
            behind = np.where(inside, moved - there, 0)
            meets = np.fmin(np.fmax(1 - np.abs(behind) / (CAP * moved), 0), 1) * inside  # NaN becomes 0
        read = self._measured & ~(inside & np.isnan(there))
        both = read & inside
        met = (meets * both).sum(axis=1)
        before = ((1 - meets) * (both & (behind < 0))).sum(axis=1)
        count = np.where(np.isfinite(b_from_a).all(axis=(1, 2)), np.count_nonzero(read, axis=1), 0)
        visible = both & ((behind < 0) | (meets > 0))
        return Agreement(
            np.where(count >= LEAST_SEEN, met / np.maximum(count, 1), np.nan),
            np.where(met + before >= LEAST_SEEN, met / np.maximum(met + before, 1), np.nan),
            float(np.median(np.abs(behind[visible]))) if visible.any() else float("nan"),
        )

    def alike(self, b_from_a: Array, scale: float, small: Camera) -> Floats64:
        """The correlation (P,) of a's brightness with b's at the points; NaN where there are too few."""
        _, u, v, inside = self.carry(b_from_a, scale, small)
        grey = self.samples.grey
        a = np.where(inside, grey[self.pairs[:, :1], self._rows, self._cols], 0)
        b = np.where(inside, self._there(grey, u, v), 0)
        count = np.maximum(inside.sum(axis=1, keepdims=True), 1)
        a, b = (np.where(inside, x - x.sum(axis=1, keepdims=True) / count, 0) for x in (a, b))
        norm = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
        enough = (count[:, 0] >= LEAST_SEEN) & (norm > 1e-6)
        return np.asarray(np.where(enough, (a * b).sum(axis=1) / np.maximum(norm, 1e-6), np.nan), dtype=np.float64)

    def carry(self, b_from_a: Array, scale: float, camera: Camera) -> tuple[Array, Array, Array, Array]:
        """The points of a in b: z (m), pixel column u and row v, and whether they lie in the image; each (P, n)."""
        z = self._z * np.float32(scale)
        points = np.empty((*z.shape, 3), np.float32)
        points[..., 0] = z * ((self._cols - camera.cx) / camera.fx)
        points[..., 1] = z * ((self._rows - camera.cy) / camera.fy)
        points[..., 2] = z
        motion = np.asarray(b_from_a, dtype=np.float32)
        points = points @ motion[:, :3, :3].transpose(0, 2, 1)
        x, y, moved = (points[..., i] + motion[:, None, i, 3] for i in range(3))
        height, width = self.samples.grey.shape[1:]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for along, focal, middle in ((x, camera.fx, camera.cx), (y, camera.fy, camera.cy)):
                along /= moved  # in place: this is run for a hundred readings of every recording
                along *= focal
                along += middle
                np.rint(along, out=along)
            inside = (moved > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
        u, v = (np.where(inside, along, 0).astype(np.int64) for along in (x, y))
        return moved, u, v, inside

    def _there(self, images: Array, u: Array, v: Array) -> Array:
        """The values of images (M, h, w) of the frames b at pixels (P, n)."""
        _, height, width = images.shape
        return np.asarray(images.reshape(-1).take((self.pairs[:, 1:] * height + v) * width + u))


@dataclass(frozen=True, eq=False)
class Verdict:
    """How well a reading makes ``pairs`` (P, 2) agree: ``met`` (P,), ``agreed`` (P,) and ``off_m`` as in Agreement."""

    met: Floats64
    agreed: Floats64
    off_m: float
    pairs: Numbers

    @property
    def seen(self) -> int:
        """How many of the pairs overlap in this reading."""
        return int(np.isfinite(self.agreed).sum())

    @property
    def score(self) -> float:
        """The mean agreement (0 to 1) of the overlapping pairs; 0 without any."""
        return float(np.nanmean(self.agreed)) if self.seen else 0.0

    @property
    def fit(self) -> float:
        """What readings are ranked by: the mean of ``met`` over all pairs, overlapping or not."""
        known = self.met[np.isfinite(self.met)]
        return float(known.mean()) if known.size else 0.0

    @property
    def disagreeing(self) -> int:
        """How many of the overlapping pairs disagree."""
        return int((self.agreed < AGREED).sum())

    @property
    def consistent(self) -> bool:
        """Whether nearly all overlapping pairs agree."""
        return self.seen >= FEWEST_PAIRS and self.disagreeing <= (1 - AGREED_SHARE) * self.seen


def judge(those: Pairs, poses: Array, scale: float, small: Camera) -> Verdict:
    """How well pairs agree by poses (M, 4, 4; NaN = unknown), scale of depth and camera."""
    if not len(those):
        return Verdict(np.empty(0), np.empty(0), float("nan"), those.pairs)
    found = those.agreement(motions(poses, those.pairs), scale, small)
    return Verdict(found.met, found.agreed, found.off_m, those.pairs)


def much_better(new: Verdict, old: Verdict) -> bool:
    """Whether one reading makes the same pairs agree much better: nearly all pairs that differ prefer it."""
    known = np.isfinite(new.met) & np.isfinite(old.met)
    gain = new.met[known] - old.met[known]
    won, lost = int((gain > LEAST_GAIN).sum()), int((gain < -LEAST_GAIN).sum())
    enough = won >= max(FEWEST_PAIRS, FEWEST_SHARE * len(gain))
    return enough and won > ONE_SIDED * lost and new.score >= AGREED


def near_pairs(samples: Samples) -> tuple[Numbers, Numbers]:
    """Pairs (P, 2) of frames near in time, in both directions: those that choose a reading, and those that test it.

    No frame is in both: stretches of the recording alternate. A frame is paired with the first later ones whose depth
    image differs, up to a few times as far away, unless they are turned away. The turn between two cameras is the same
    in every reading without a shift, so no reading selects pairs in its favour.
    """
    blocks = int(np.clip(len(samples) // LEAST_BLOCK, 2, MOST_BLOCKS))
    found = [
        _pairs_within(samples, block[samples.valid_share[block] > 0.05], ANCHORS // blocks)
        for block in np.array_split(np.arange(len(samples)), blocks)
    ]
    return np.concatenate(found[::2]), np.concatenate(found[1::2])


def _pairs_within(samples: Samples, usable: Numbers, most: int) -> Numbers:
    """Pairs (P, 2) with ``most`` first frames, spread evenly over the ``usable`` ones of a stretch."""
    if len(usable) < 2:
        return np.empty((0, 2), np.int64)
    coarse = samples.depth_m[usable, ::COARSE, ::COARSE].reshape(len(usable), -1)
    turns = np.swapaxes(samples.poses[usable, :3, :3], 1, 2)
    anchors = np.unique(np.linspace(0, len(usable) - 1, most).round().astype(int))
    found: list[tuple[int, int]] = []
    for i in anchors.tolist():
        near = np.flatnonzero(samples.index[usable] - samples.index[usable[i]] <= NEAR_FRAMES)
        later = near[near > i]
        both = np.isfinite(coarse[i]) & np.isfinite(coarse[later])
        with np.errstate(invalid="ignore"):
            other = (np.abs(coarse[later] - coarse[i]) > CAP * coarse[i]) & both
        changed = np.flatnonzero(other.sum(axis=1) > CHANGED * np.maximum(both.sum(axis=1), 1))
        if len(changed):
            step = int(changed[0]) + 1
            there = later[step - 1 : TIMES_AS_FAR * step : step]
            little = turns_deg(turns[there] @ samples.poses[usable[i], :3, :3]) < MOST_TURN_DEG
            found += [(i, int(j)) for j in there[little][:PARTNERS]]
    pairs = usable[np.array(found, dtype=np.int64).reshape(-1, 2)]
    return np.concatenate([pairs, pairs[:, ::-1]])


def motions(poses: Array, pairs: Array) -> Floats64:
    """``b_from_a`` (P, 4, 4) of pairs (P, 2) of camera poses."""
    return np.asarray(np.linalg.inv(poses[pairs[:, 1]]) @ poses[pairs[:, 0]], dtype=np.float64)


def turns_deg(motion: Array) -> Floats64:
    """The angles of rotations (..., 4, 4) or (..., 3, 3)."""
    trace = np.trace(motion[..., :3, :3], axis1=-2, axis2=-1)
    return np.asarray(np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))), dtype=np.float64)
