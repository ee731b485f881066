"""Existence of mapped objects: the probability that each is real, by detections in the frames that could show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, check_pose
from cartier.mapping.config import ExistenceConfig
from cartier.types import Array, Camera, DetectorScoreModel, Frame

BEARING_BINS = 12  # directions from which an object is seen
VIEWPOINT_BINS = 3 * BEARING_BINS  # near, middle and far
REFERENCE_WIDTH_RAD = 0.1  # how wide objects usually appear
MIN_DETECTION_WEIGHT = 0.02  # even the weakest detection is some evidence
MIN_DEPTH_SAMPLES = 4  # of an object's points, with fewer readings depth cannot say whether it is hidden
MIN_VACATED_SHARE = 0.9  # of an object's points, behind which depth shows the background: it stands there no more
MIN_PROJECTED_SHARE = 0.1  # of the surface in the image from which a detection may be of the object
MAX_EARLIER = 64  # frames kept; then every other one goes, and half as many are added from there on
FIRST_STRIDE = 2  # frames from one kept to the next, at first
COARSE_PX = 40  # about so many samples along a frame's width
EARLIER = ("earlier_depth", "earlier_pose", "earlier_camera", "earlier_counts")


class CoarseFrame(NamedTuple):
    """What is kept of an earlier frame: depth (h, w) at every so manieth pixel, of half precision, and the pose."""

    depth_m: npt.NDArray[np.float32]
    world_from_camera: npt.NDArray[np.float64]
    camera: Camera


class Visibility(NamedTuple):
    """What a frame says of n objects before its detections are known."""

    observable: npt.NDArray[np.bool_]
    """Which of them (n,) it should show where they are."""
    vacated: npt.NDArray[np.bool_]
    """Which of them (n,) it should show, and shows what is clearly behind them instead."""
    boxes_xyxy: Array
    """Where they should appear (n, 4)."""
    candidates: npt.NDArray[np.intp]
    """The rows of those that may appear."""


def viewpoint_bins(positions: Array, camera_xyz: Array, config: ExistenceConfig) -> npt.NDArray[np.intp]:
    """The viewpoint bin, 0 to ``VIEWPOINT_BINS`` - 1, from which a camera (3,) sees objects at ``positions`` (N, 3)."""
    x, y = (camera_xyz - positions)[:, :2].T
    bearing = (np.arctan2(y, x) / (2 * np.pi) % 1 * BEARING_BINS).astype(np.intp) % BEARING_BINS
    ranges = np.searchsorted((config.near_range_m, config.far_range_m), np.hypot(x, y))
    return np.asarray(bearing + BEARING_BINS * ranges, np.intp)


def detection_weights(scores: Array, score_model: DetectorScoreModel) -> Array:
    """How much detections (N,) count as evidence by their scores, 0 to 1."""
    low, high = score_model.zero_weight_score, score_model.full_weight_score
    return np.asarray(np.clip((scores - low) / max(high - low, 1e-6), MIN_DETECTION_WEIGHT, 1))


def posterior(observable: Array, detected: Array, widest_rad: Array, score_model: DetectorScoreModel) -> Array:
    """The probability (N,) that objects exist.

    ``observable`` (N, bins) counts the frames from each viewpoint bin that would have shown the object, ``detected``
    (N, bins) is the weight of its detections there, ``widest_rad`` (N,) how wide its best view shows it.

    The share of viewpoint bins with a detection follows one Beta distribution over real objects and another over
    false positives; the posterior is the Beta-binomial odds of the two. Many frames from one bin count hardly more
    than one frame, so that no number of frames alone drives a probability to 0 or 1.
    """
    from scipy.special import betaln

    counts, share = observable / (observable + 1), detected / (observable + 1)
    hit, miss = share.sum(1), (counts - share).sum(1)
    log_odds = score_model.prior_log_odds + score_model.best_view_log_odds * (share.max(1, initial=0) - 0.5)
    log_width = np.log(np.maximum(widest_rad, 1e-3) / REFERENCE_WIDTH_RAD)
    log_odds = log_odds - score_model.log_odds_per_log_width * log_width
    for sign, (a, b) in ((1, score_model.beta_true), (-1, score_model.beta_false)):
        log_odds = log_odds + sign * (betaln(hit + a, miss + b) - betaln(a, b))
    return np.asarray(1 / (1 + np.exp(-log_odds)))


def mark_detected(columns: Mapping[str, Array], rows: npt.NDArray[np.intp], time_s: float) -> None:
    """Count a detection of objects, in place."""
    columns["n_detected"][rows] += 1
    columns["last_s"][rows], columns["changed"][rows] = time_s, True


def update_existence(
    columns: Mapping[str, Array],
    frame: Frame,
    weights: Array,
    observable: npt.NDArray[np.bool_],
    config: ExistenceConfig,
) -> None:
    """Count a frame, in place: objects ``observable`` (n,) in it, or detected with positive ``weights`` (n,).

    Frames in which an object is vacated count as observable, too: as what should have shown it.
    """
    rows = np.flatnonzero(observable | (weights > 0))
    centres = (columns["box_min"][rows] + columns["box_max"][rows]) / 2
    bins = viewpoint_bins(centres, frame.world_from_camera[:3, 3], config)
    columns["observable"][rows, bins] += 1
    columns["detected"][rows, bins] += weights[rows]
    columns["n_observable"][rows] += 1
    columns["looked_s"][rows] = frame.time_s


def predict_visibility(
    points: Array, extent_min: Array, extent_max: Array, frame: Frame | CoarseFrame, config: ExistenceConfig
) -> Visibility:
    """Which of n objects a frame with depth should show, where, and which it may show at all.

    ``points`` (n, K, 3) are of the objects' surfaces, ``extent_min`` and ``extent_max`` (n, 3) bound them. An object is
    observable if most of its surface is in view, wide enough, and most of that is not hidden by what the depth shows in
    front of it, nor gone. It is vacated if the depth shows what is behind its extent nearly everywhere: one that was
    taken away. Depth that ends between its surface and that says nothing, since extents hold some of the background.
    """
    assert frame.depth_m is not None
    n, camera, pose = len(points), frame.camera, frame.world_from_camera.astype(np.float32)
    observable, vacated, boxes = np.zeros(n, bool), np.zeros(n, bool), np.zeros((n, 4))
    radius, ahead = _bounding_spheres(extent_min, extent_max, pose)
    tangent = max(camera.width / camera.fx, camera.height / camera.fy)  # generous: twice the half angle
    sideways = np.abs(ahead[:, :2]).max(1, initial=0)
    near = np.flatnonzero((ahead[:, 2] > -radius) & (sideways < tangent * ahead[:, 2] + 2 * radius))
    if not len(near):
        return Visibility(observable, vacated, boxes, near)
    x, y, z = ((points[near].reshape(-1, 3) - pose[:3, 3]) @ pose[:3, :3]).T
    z = np.where(z > 0.05, z, np.nan)
    u = x / z * np.float32(camera.fx) + np.float32(camera.cx)
    v = y / z * np.float32(camera.fy) + np.float32(camera.cy)
    inside = (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)  # NaN compares as False
    pixels = np.where(inside, v, 0).astype(np.intp) * camera.width + np.where(inside, u, 0).astype(np.intp)
    measured = frame.depth_m.ravel()[pixels]
    inside = inside.reshape(len(near), -1)
    measured, z, u, v = (a.reshape(inside.shape) for a in (measured, z, u, v))
    known = inside & (measured > 0)
    size, slack = (extent_max - extent_min)[near].max(1, initial=0)[:, None], 0.1 + 0.03 * np.where(known, z, 1)
    hidden = (known & (measured < z - slack - 0.5 * size)).sum(1)
    gone = (known & (measured > z + slack + 0.15 * size)).sum(1)
    reach_m = (
        np.abs(pose[:3, 2]) @ (extent_max - extent_min)[near].T / 2
    )  # from the middle to the far side, along the axis
    behind = (known & (measured > (ahead[near, 2] + reach_m)[:, None] + slack)).sum(1)
    n_known, in_view = known.sum(1), inside.mean(1)
    for column, values, least in ((0, u, True), (1, v, True), (2, u, False), (3, v, False)):
        edge = np.where(inside, values, np.inf if least else -np.inf)
        boxes[near, column] = np.where(in_view > 0, edge.min(1) if least else edge.max(1), 0)
    wide = (boxes[near, 2:] - boxes[near, :2]).max(1) / camera.fx >= config.min_angle_rad
    visible = (n_known >= MIN_DEPTH_SAMPLES) & (n_known - hidden - gone >= config.min_visible_share * n_known)
    in_view_whole = wide & (in_view >= config.min_in_view_share)
    observable[near] = in_view_whole & visible
    vacated[near] = in_view_whole & ~visible & (behind >= np.maximum(MIN_DEPTH_SAMPLES, MIN_VACATED_SHARE * n_known))
    return Visibility(observable, vacated, boxes, near[in_view > MIN_PROJECTED_SHARE])


def _bounding_spheres(extent_min: Array, extent_max: Array, pose: Array) -> tuple[Array, Array]:
    """Radii (n,) of objects, and their centres (n, 3) in the frame of the camera."""
    centres = (extent_min + extent_max) / 2
    return np.linalg.norm(extent_max - extent_min, axis=1) / 2, (centres - pose[:3, 3]) @ pose[:3, :3]


class EarlierFrames:
    """Depth and poses of at most 64 earlier frames, evenly over the recording.

    An object counts the frames that should show it from its first detection on. Without those before, it would be the
    likelier the later it is first detected, and another order of the frames would give another map.
    """

    def __init__(self) -> None:
        self._frames: list[CoarseFrame] = []
        self._camera: Camera | None = None  # of the frames before they were made coarse
        self._stride, self._count = FIRST_STRIDE, 0

    def add(self, frame: Frame) -> None:
        """Keep a frame with depth, if it is its turn; frames of another camera replace all."""
        if frame.depth_m is None:
            return
        if self._count % self._stride == 0:
            kept = self._frames[0].camera if self._frames else None
            small = kept if kept and frame.camera == self._camera else coarse_camera(frame.camera)
            if small != kept:
                self._frames = []
            if len(self._frames) == MAX_EARLIER:
                self._frames, self._stride = self._frames[::2], 2 * self._stride
            step = coarse_step(frame.camera)
            depth_m = frame.depth_m[step // 2 :: step, step // 2 :: step].astype(np.float16).astype(np.float32)
            self._frames.append(CoarseFrame(depth_m, frame.world_from_camera, small))
            self._camera = frame.camera
        self._count += 1

    def count(self, columns: Mapping[str, Array], rows: npt.NDArray[np.intp], config: ExistenceConfig) -> None:
        """Count the frames that should have shown the new objects ``rows`` (k,), in place.

        Frames that show what is behind them do not count: what is new may have been brought since.
        """
        if not len(rows):
            return
        points, low, high = (columns[name][rows] for name in ("points", "extent_min", "extent_max"))
        centres, reach_m = (columns["box_min"][rows] + columns["box_max"][rows]) / 2, np.ptp(points, axis=1).max(1)
        for frame in self._in_view(centres, reach_m):
            seen = np.flatnonzero(predict_visibility(points, low, high, frame, config).observable)
            if len(seen):
                bins = viewpoint_bins(centres[seen], frame.world_from_camera[:3, 3], config)
                columns["observable"][rows[seen], bins] += 1

    def _in_view(self, centres: Array, reach_m: Array) -> list[CoarseFrame]:
        """The frames that may show most of an object by its centre (k, 3)."""
        if not self._frames:
            return []
        poses = np.array([frame.world_from_camera for frame in self._frames])
        camera = self._frames[0].camera
        x, y, z = np.moveaxis(np.einsum("fkx,fxy->fky", centres - poses[:, None, :3, 3], poses[:, :3, :3]), 2, 0)
        wide, tall = camera.width / camera.fx / 2, camera.height / camera.fy / 2
        inside = (z > 0) & (np.abs(x) < wide * z + reach_m / 4) & (np.abs(y) < tall * z + reach_m / 4)
        return [self._frames[k] for k in np.flatnonzero(inside.any(1)).tolist()]

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """All of it, as named arrays; none without frames."""
        if not self._frames:
            return {}
        of = self._frames[0].camera
        depth = np.array([frame.depth_m for frame in self._frames], np.float16)
        poses = np.array([frame.world_from_camera for frame in self._frames])
        camera = np.array([of.fx, of.fy, of.cx, of.cy])
        return dict(zip(EARLIER, (depth, poses, camera, np.array([self._stride, self._count])), strict=True))

    def restore(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take what ``state`` gave; maps made before hold none. Raises KeyError or ValueError."""
        if EARLIER[0] not in arrays:
            return
        depth, poses, lens, counts = (arrays[name] for name in EARLIER)
        stride, count = (int(number) for number in counts)
        if not (len(depth) <= MAX_EARLIER and stride >= FIRST_STRIDE and count > 0) or depth.dtype != np.float16:
            raise ValueError("its earlier frames are none")
        self._stride, self._count = stride, count
        try:
            camera = Camera(depth.shape[2], depth.shape[1], *map(float, lens))
            pairs = zip(depth.astype(np.float32), poses, strict=True)
            self._frames = [CoarseFrame(depth_m, check_pose(pose), camera) for depth_m, pose in pairs]
        except InputError as error:
            raise ValueError(f"an earlier frame: {error}") from error


def coarse_camera(camera: Camera) -> Camera:
    """The camera of every so manieth pixel; a point is at the nearest of them."""
    step = coarse_step(camera)
    first, width, height = step // 2, *(len(range(step // 2, side, step)) for side in (camera.width, camera.height))
    cx, cy = ((middle - first) / step + 0.5 for middle in (camera.cx, camera.cy))
    return Camera(width, height, camera.fx / step, camera.fy / step, cx, cy)


def coarse_step(camera: Camera) -> int:
    """How many pixels lie from one to the next that are kept."""
    return max(1, round(camera.width / COARSE_PX))
