"""Existence of mapped objects: the probability that each is real, by detections in the frames that could show it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cartier.mapping.config import ExistenceConfig
from cartier.types import Array, DetectorScoreModel, Frame

BEARING_BINS = 12  # directions from which an object is seen
VIEWPOINT_BINS = 3 * BEARING_BINS  # near, middle and far
REFERENCE_WIDTH_RAD = 0.1  # how wide objects usually appear
MIN_DETECTION_WEIGHT = 0.02  # even the weakest detection is some evidence
MIN_DEPTH_SAMPLES = 4  # of an object's points, with fewer readings depth cannot say whether it is hidden
MIN_PROJECTED_SHARE = 0.1  # of the surface in the image from which a detection may be of the object


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
    """Count a frame, in place: objects ``observable`` (n,) in it, or detected with positive ``weights`` (n,)."""
    rows = np.flatnonzero(observable | (weights > 0))
    centres = (columns["box_min"][rows] + columns["box_max"][rows]) / 2
    bins = viewpoint_bins(centres, frame.world_from_camera[:3, 3], config)
    columns["observable"][rows, bins] += 1
    columns["detected"][rows, bins] += weights[rows]
    columns["n_observable"][rows] += 1
    columns["looked_s"][rows] = frame.time_s


def predict_visibility(
    points: Array, extent_min: Array, extent_max: Array, frame: Frame, config: ExistenceConfig
) -> tuple[npt.NDArray[np.bool_], Array, npt.NDArray[np.intp]]:
    """Which of n objects a frame with depth should show, where, and which it may show at all.

    ``points`` (n, K, 3) are of the objects' surfaces, ``extent_min`` and ``extent_max`` (n, 3) bound them. Returns
    ``observable`` (n,), boxes in the image (n, 4) and the rows of candidates. An object is observable if most of its
    surface is in view, wide enough, and most of that is not hidden by what the depth shows in front of it, nor gone.
    """
    assert frame.depth_m is not None
    n, camera, pose = len(points), frame.camera, frame.world_from_camera.astype(np.float32)
    observable, boxes = np.zeros(n, bool), np.zeros((n, 4))
    radius, ahead = _bounding_spheres(extent_min, extent_max, pose)
    tangent = max(camera.width / camera.fx, camera.height / camera.fy)  # generous: twice the half angle
    sideways = np.abs(ahead[:, :2]).max(1, initial=0)
    near = np.flatnonzero((ahead[:, 2] > -radius) & (sideways < tangent * ahead[:, 2] + 2 * radius))
    if not len(near):
        return observable, boxes, near
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
    n_known, in_view = known.sum(1), inside.mean(1)
    for column, values, least in ((0, u, True), (1, v, True), (2, u, False), (3, v, False)):
        edge = np.where(inside, values, np.inf if least else -np.inf)
        boxes[near, column] = np.where(in_view > 0, edge.min(1) if least else edge.max(1), 0)
    wide = (boxes[near, 2:] - boxes[near, :2]).max(1) / camera.fx >= config.min_angle_rad
    visible = (n_known >= MIN_DEPTH_SAMPLES) & (n_known - hidden - gone >= config.min_visible_share * n_known)
    observable[near] = wide & (in_view >= config.min_in_view_share) & visible
    return observable, boxes, near[in_view > MIN_PROJECTED_SHARE]


def _bounding_spheres(extent_min: Array, extent_max: Array, pose: Array) -> tuple[Array, Array]:
    """Radii (n,) of objects, and their centres (n, 3) in the frame of the camera."""
    centres = (extent_min + extent_max) / 2
    return np.linalg.norm(extent_max - extent_min, axis=1) / 2, (centres - pose[:3, 3]) @ pose[:3, :3]
