"""Floor kinds from pixels and depth: tiles, planks, carpet or rug in each cell of the floor plan, where it is clear.

The floor that a keyframe shows is laid out at a known scale, and the texture around each cell (how strong it is at
three scales, whether it has one direction as planks or two as a lattice of tiles, how sparse its lines are, how high it
lies) goes through a small network; ``tools/fit_floor_kinds.py`` made it in the dollhouse. Of real floors it knows
nothing: what looks like none of those it was fitted on stays unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import project
from cartier.io.files import read_npz
from cartier.mapping.occupancy import MAX_CELL
from cartier.types import Frame, OccupancyGrid
from cartier.types.route_rules import FLOOR_KINDS

KNOWN = len(FLOOR_KINDS) - 1  # kinds that are told apart; in ``votes`` they have the places 0 to KNOWN - 1
STRANGE = KNOWN + 1  # in ``votes``
MAX_STRANGE = 0.35  # of all looks: where more are like no floor that was fitted, nothing is told
FINE = 4  # texels along a cell of the floor plan
PATCH = 64  # cells along the side of the square of floor that is laid out
WINDOWS = (3, 11)  # cells around a cell whose texture counts
LEVEL_M = 0.05  # what lies higher or lower is no floor
ENOUGH, NEW = 12, 0.25  # looks at a cell that suffice; share of the seen cells with fewer, for a frame to be looked at
TEXEL_PX_M = 0.02  # a pixel that shows more floor than this shows no texture
MIN_SHARE = 0.4  # of a window's texels that must be seen
CLEAR = 0.8  # posterior from which a kind is told
INDEPENDENT = 3.0  # so many looks at a cell count as independent; further ones look alike
LEAST = -4.0  # log-probability: one look never rules a kind out
STEPS, MAX_LOOKS = 16, 500  # of a log-probability, and looks at a cell: so sums fit 16 bits
FAR_M = 3.2  # how far ahead the square reaches
MODEL = Path(__file__).parent / "floor_network" / "network.npz"

Floats = npt.NDArray[np.float32]
Classifier = Callable[[Frame, "Patch"], npt.NDArray[np.float32]]
"""Log-probabilities (PATCH, PATCH, KNOWN) of the kinds in a patch's cells, NaN where too little is
seen, -inf for all where the texture is like none that it knows."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A square of floor that a frame shows, seen from above; its first cell is ``low`` (row, col) of the world's cells.

    ``eye_xy`` is where the camera is above the floor. With S = PATCH * FINE texels: ``colour`` (S, S, 3) float32 from 0
    to 1, ``height_m`` (S, S), ``seen`` (S, S) and ``texel_m`` (S, S), how much floor the pixel of a texel shows.
    """

    low: npt.NDArray[np.int64]
    resolution_m: float
    eye_xy: npt.NDArray[np.float64]
    colour: Floats
    height_m: Floats
    seen: npt.NDArray[np.bool_]
    texel_m: Floats

    def xy(self) -> npt.NDArray[np.float64]:
        """The middles (S, S, 2) of the texels."""
        return _texels(self.low, self.resolution_m, len(self.seen) // PATCH)


class FloorKindMapper:
    """Gathers, frame by frame, what kind of floor each cell shows."""

    def __init__(self, resolution_m: float = 0.05, classifier: Classifier | None = None) -> None:
        self.resolution_m, self._classify = resolution_m, classifier or from_texture
        self._low = np.zeros(2, np.int64)
        self._votes = np.zeros((0, 0, KNOWN + 2), np.int16)  # sums of STEPS * log-probabilities, looks, strange looks

    def add(self, frame: Frame) -> None:
        """Take in one frame with depth, unless nearly all floor that it shows was looked at often enough."""
        coarse = laid_out(frame, self.resolution_m, 1)
        patch = laid_out(frame, self.resolution_m) if coarse is not None and self._tells_more(coarse) else None
        if patch is None:
            return
        found = self._classify(frame, patch)
        sure, strange = np.isfinite(found).all(-1), np.isneginf(found).all(-1)
        if sure.any() or strange.any():
            window = self._window(patch.low)
            votes = self._votes[window]
            sure &= votes[..., KNOWN] < MAX_LOOKS
            votes[sure, :KNOWN] += np.rint(np.clip(found[sure], LEAST, 0) * STEPS).astype(np.int16)
            votes[sure, KNOWN] += 1
            votes[strange & (votes[..., STRANGE] < MAX_LOOKS), STRANGE] += 1

    def _tells_more(self, coarse: Patch) -> bool:
        window = self._window(coarse.low)  # before ``votes``, which it may replace
        looks = self._votes[window][..., KNOWN:].sum(-1)
        return bool((looks[coarse.seen] < ENOUGH).mean() > NEW)

    def kinds(self, grid: OccupancyGrid) -> npt.NDArray[np.uint8] | None:
        """The kind of floor (rows, cols) in each cell of a floor plan of the same resolution, as ``FLOOR_KINDS`` number
        them; None if no frame showed any."""
        if not self._votes.size:
            return None
        from scipy import ndimage

        looks, strange = self._votes[..., KNOWN:STRANGE], self._votes[..., STRANGE:]
        if strange.sum(dtype=np.int64) > MAX_STRANGE * (looks + strange).sum(dtype=np.int64):
            return np.zeros(grid.cells.shape, np.uint8)  # floors of another world than the network's
        sums = ndimage.uniform_filter(self._votes.astype(np.float32), (3, 3, 1))  # cells around one speak for it
        mean = sums[..., :KNOWN] / (STEPS * np.maximum(sums[..., KNOWN:STRANGE], 1e-6)) * np.minimum(looks, INDEPENDENT)
        score = np.exp(mean - mean.max(-1, keepdims=True))
        posterior = score / score.sum(-1, keepdims=True)
        clear = (looks[..., 0] > 0) & (posterior.max(-1) >= CLEAR)
        mine = np.where(clear, posterior.argmax(-1) + 1, 0).astype(np.uint8)
        kinds = np.zeros(grid.cells.shape, np.uint8)
        at = self._low - np.rint(np.array(grid.origin_xy)[::-1] / self.resolution_m).astype(np.int64)
        low, high = np.maximum(at, 0), np.minimum(at + mine.shape, kinds.shape)
        if (high > low).all():
            kinds[low[0] : high[0], low[1] : high[1]] = mine[
                tuple(slice(*each) for each in zip(low - at, high - at, strict=True))
            ]
        return kinds

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """What it goes on from."""
        return {"votes": self._votes, "low": self._low, "resolution_m": np.array(self.resolution_m)}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from a state. Raises InputError if it is none."""
        try:
            votes, low = state["votes"], state["low"]
            sound = votes.dtype == np.int16 and votes.ndim == 3 and votes.shape[2] == KNOWN + 2 and low.shape == (2,)
            sound = sound and low.dtype.kind == "i" and float(state["resolution_m"]) == self.resolution_m
            if not sound or not (np.abs(low.astype(np.float64)) < MAX_CELL).all() or (votes[..., KNOWN:] < 0).any():
                raise ValueError("arrays of another kind")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"the counts of floor kinds are damaged ({error}): map the recording again") from error
        self._votes, self._low = votes.copy(), low.astype(np.int64)

    def _window(self, low: npt.NDArray[np.int64]) -> tuple[slice, slice]:
        """Where a patch lies in ``votes``, which grow to hold it."""
        high, shape = low + PATCH, np.array(self._votes.shape[:2])
        if not shape.all():
            self._low, shape = low.copy(), np.zeros(2, np.int64)
        new_low = np.minimum(low, self._low)
        new_high = np.maximum(high, self._low + shape)
        before, after = self._low - new_low, new_high - self._low - shape
        if before.any() or after.any():
            pad = [(int(b), int(a)) for b, a in zip(before, after, strict=True)]
            self._votes, self._low = np.pad(self._votes, [*pad, (0, 0)]), new_low
        row, col = (low - self._low).tolist()
        return slice(row, row + PATCH), slice(col, col + PATCH)


def _texels(low: npt.NDArray[np.int64], resolution_m: float, fine: int) -> npt.NDArray[np.float64]:
    step = resolution_m / fine
    rows, cols = ((low[k] * fine + np.arange(PATCH * fine) + 0.5) * step for k in (0, 1))
    return np.stack(np.broadcast_arrays(cols, rows[:, None]), -1)


def laid_out(frame: Frame, resolution_m: float, fine: int = FINE) -> Patch | None:
    """The floor ahead of the camera as a square from above, or None if too little of it can be seen.

    Each cell has ``fine`` by ``fine`` texels.

    The floor is at z = 0 (``occupancy.py``); where the frame's depth lies elsewhere, it shows no floor.
    """
    assert frame.depth_m is not None
    pose, camera = frame.world_from_camera, frame.camera
    ahead = pose[:2, 2]
    if pose[2, 3] < LEVEL_M:
        return None
    lowest = pose[:3, :3] @ (0.0, (camera.height - 1 - camera.cy) / camera.fy, 1.0)
    if lowest[2] > -1e-3:
        return None  # the camera looks up
    begin = lowest[:2] * min(-pose[2, 3] / lowest[2], FAR_M)
    side_m = PATCH * resolution_m
    middle = pose[:2, 3] + begin + ahead / max(float(np.hypot(*ahead)), 0.3) * (side_m / 2 - 0.4)
    low = np.floor((middle[::-1] - side_m / 2) / resolution_m).astype(np.int64)
    xy = _texels(low, resolution_m, fine)
    points = np.concatenate([xy, np.zeros((*xy.shape[:2], 1))], -1).reshape(-1, 3).astype(np.float32)
    uv, z = project(points, camera, pose)
    with np.errstate(invalid="ignore"):
        col, row = np.rint(np.where(z[:, None] > 0.2, uv, -1)).astype(np.int64).T
    inside = np.flatnonzero((row >= 0) & (col >= 0) & (row < camera.height) & (col < camera.width))
    row, col, z = row[inside], col[inside], z[inside]
    depth = frame.depth_m[row, col]
    # Along one ray heights change in proportion to depth: where it meets z = 0, depth is ``z``.
    with np.errstate(invalid="ignore", divide="ignore"):
        height = pose[2, 3] * (1 - depth / z)
        pixel_m = z * z / (camera.fy * pose[2, 3])  # along the view, where a pixel reaches farthest
        seen = (np.abs(height) < LEVEL_M) & (pixel_m < TEXEL_PX_M)
    if seen.sum() < fine * fine * 40:
        return None
    shape = (PATCH * fine, PATCH * fine)
    layers = np.zeros((shape[0] * shape[1], 5), np.float32)
    kept = inside[seen]
    layers[kept, :3] = frame.rgb[row[seen], col[seen]] / np.float32(255)
    layers[kept, 3], layers[kept, 4] = height[seen], pixel_m[seen]
    mask = np.zeros(len(layers), np.bool_)
    mask[kept] = True
    square = layers.reshape(*shape, 5)
    return Patch(
        low, resolution_m, pose[:2, 3].copy(), square[..., :3], square[..., 3], mask.reshape(shape), square[..., 4]
    )


def features(patch: Patch) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """What the texture around each cell is like (PATCH, PATCH, F), and where enough of it is seen."""
    light = patch.colour @ np.array([0.3, 0.59, 0.11], np.float32)
    tint = np.stack([patch.colour[..., 0] - light, patch.colour[..., 2] - light], -1)
    seen = patch.seen.astype(np.float32)
    sums = [
        seen,
        light * seen,
        light * light * seen,
        patch.height_m * seen,
        patch.height_m**2 * seen,
        patch.texel_m * seen,
    ]
    sums += [tint[..., k] * seen for k in (0, 1)] + [tint[..., k] ** 2 * seen for k in (0, 1)]
    cells = [np.stack([_blocks(each, FINE) for each in sums], -1)]
    share = FINE
    while share >= 1:
        mean = _blocks(light * seen, FINE // share) if share < FINE else light * seen
        weight = _blocks(seen, FINE // share) if share < FINE else seen
        mean = np.asarray(mean / np.maximum(weight, np.float32(1e-6)), np.float32)
        cells.append(_gradients(mean, weight > 0.5 * (FINE // share) ** 2, share))
        share //= 2
    every = np.concatenate(cells, -1)
    middles = patch.xy()[FINE // 2 :: FINE, FINE // 2 :: FINE] - patch.eye_xy
    turn = 2 * np.arctan2(middles[..., 1], middles[..., 0])
    view = np.stack([np.cos(turn), np.sin(turn)])  # along the view texture is seen less sharply
    parts = [_window_features(_box(every, window), view) for window in WINDOWS]
    wide = parts[1]
    enough = (_box(every[..., :1], WINDOWS[0])[..., 0] >= MIN_SHARE * (WINDOWS[0] * FINE) ** 2) & (every[..., 0] > 0)
    floor_m = np.median(wide[enough][:, 4]) if enough.any() else 0.0
    step = [np.stack([part[..., 4] - floor_m for part in parts], -1) / 0.01]
    return np.concatenate([*parts, *step], -1).astype(np.float32), enough


def from_texture(frame: Frame, patch: Patch) -> Floats:
    """What the network says of a patch: see ``Classifier``."""
    found, enough = features(patch)
    out = np.full((PATCH, PATCH, KNOWN), np.nan, np.float32)
    if enough.any():
        net = network()
        x = (found[enough] - net["mean"]) / net["scale"]
        alike = np.mean(np.square(x @ net["whiten"]), 1) <= float(net["strange"])
        hidden = np.maximum(np.clip(x, -5, 5) @ net["w1"] + net["b1"], 0)
        scores = hidden @ net["w2"] + net["b2"]
        scores -= scores.max(1, keepdims=True)
        logs = scores - np.log(np.exp(scores).sum(1, keepdims=True))
        logs[~alike] = -np.inf
        out[enough] = logs
    return out


@cache
def network() -> dict[str, npt.NDArray[Any]]:
    """The network's arrays. Raises InputError if the file is missing."""
    return read_npz(MODEL.read_bytes(), where=MODEL.name)


def _gradients(light: Floats, seen: npt.NDArray[np.bool_], share: int) -> Floats:
    """Sums over cells (PATCH, PATCH, 7) of the gradient's weight, square, fourth power, and its two- and fourfold
    direction."""
    across = np.zeros_like(light)
    down = np.zeros_like(light)
    across[:-1, :-1] = light[:-1, 1:] - light[:-1, :-1]
    down[:-1, :-1] = light[1:, :-1] - light[:-1, :-1]
    ok = np.zeros_like(seen)
    ok[:-1, :-1] = seen[:-1, :-1] & seen[:-1, 1:] & seen[1:, :-1]
    across, down = across * ok, down * ok
    square = across * across + down * down
    twice = (across * across - down * down, 2 * across * down)
    with np.errstate(invalid="ignore", divide="ignore"):
        four = [np.nan_to_num(part / square) for part in (twice[0] ** 2 - twice[1] ** 2, 2 * twice[0] * twice[1])]
    layers = [ok.astype(np.float32), square, square * square, *twice, *four]
    return np.stack([_blocks(layer, share) for layer in layers], -1)


def _window_features(sums: Floats, view: npt.NDArray[np.float64]) -> Floats:
    """Features from sums over windows: of light, height, tint, and of the gradients at each scale.

    ``view`` (2, PATCH, PATCH) are cosine and sine of twice the angle from which each cell is seen.
    """
    weight = np.maximum(sums[..., :1], 1.0)
    mean = sums[..., 1:10] / weight
    light = np.maximum(mean[..., 0], 0.02)
    spread = np.sqrt(np.maximum(mean[..., 1] - mean[..., 0] ** 2, 1e-8)) / light
    high = np.sqrt(np.maximum(mean[..., 3] - mean[..., 2] ** 2, 1e-10))
    tints = np.sqrt(np.maximum(mean[..., 7:9] - mean[..., 5:7] ** 2, 1e-8)) / light[..., None]
    out = [
        np.log(spread),
        np.log(high + 1e-3),
        np.log(tints[..., 0]),
        np.log(tints[..., 1]),
        mean[..., 2],
        np.log(mean[..., 4] + 1e-4),
    ]
    for first in range(10, sums.shape[-1], 7):
        count, square, fourth, a2, b2, a4, b4 = np.moveaxis(sums[..., first : first + 7], -1, 0)
        count, total = np.maximum(count, 1.0), np.maximum(square, 1e-9)
        out += [
            np.log(np.sqrt(total / count) / light), np.hypot(a2, b2) / total, np.hypot(a4, b4) / total,
            (a2 * view[0] + b2 * view[1]) / total,
            np.log(np.maximum(fourth * count, 1e-18) / total**2 + 1e-3),
        ]  # fmt: skip
    return np.stack(out, -1)


def _blocks(layer: Floats, side: int) -> Floats:
    """Sums over squares of texels; numpy adds long rows faster than it reduces short ones."""
    down = sum((layer[k::side] for k in range(1, side)), layer[::side])
    return np.asarray(sum((down[:, k::side] for k in range(1, side)), down[:, ::side]))


def _box(cells: Floats, window: int) -> Floats:
    """Sums over a square of cells around each."""
    from scipy import ndimage

    return np.asarray(ndimage.uniform_filter(cells, (window, window, 1), mode="constant") * window**2)
