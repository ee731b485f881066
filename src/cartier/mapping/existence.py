"""How likely it is that a mapped object exists: n_detected against n_observable, counted by standpoint."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.types import Array, DetectorScoreModel

BEARINGS = 12  # directions from which an object is seen
RANGES_M = (1.2, 2.4)  # near, middle and far
STANDPOINTS = BEARINGS * (len(RANGES_M) + 1)
USUAL_RAD = 0.1  # how wide things appear
CONFIRMED = 0.7  # probability from which an object is listed
LEAST_WEIGHT = 0.02  # even the weakest report says that something was there


def standpoints(positions: Array, camera_xyz: Array) -> npt.NDArray[np.intp]:
    """From which of its ``STANDPOINTS`` each object (N, 3) is seen by a camera (3,)."""
    x, y = (camera_xyz - positions)[:, :2].T
    bearing = (np.arctan2(y, x) / (2 * np.pi) % 1 * BEARINGS).astype(np.intp) % BEARINGS
    return np.asarray(bearing + BEARINGS * np.searchsorted(RANGES_M, np.hypot(x, y)), np.intp)


def report_weight(scores: Array, score_model: DetectorScoreModel) -> Array:
    """How far reports (N,) count as n_detected, 0 to 1, by their scores."""
    share = (scores - score_model.zero_weight_score) / max(
        score_model.full_weight_score - score_model.zero_weight_score, 1e-6
    )
    return np.asarray(np.clip(share, LEAST_WEIGHT, 1))


def probability(tried: Array, hits: Array, widest_rad: Array, score_model: DetectorScoreModel) -> Array:
    """The posterior (N,) that objects exist, of n_observable and weighed reports per standpoint (N, STANDPOINTS).
    ``widest_rad`` (N,) is how wide the best view shows each.

    The share of standpoints with a report is spread by one Beta distribution over real objects and by another over inventions;
    the posterior is their Beta-binomial odds. Many frames from one standpoint are hardly more than one frame, and no number of
    frames drives a probability to 0 or 1 by itself.
    """
    from scipy.special import betaln

    counts, reported = tried / (tried + 1), hits / (tried + 1)
    hit, miss = reported.sum(1), (counts - reported).sum(1)
    odds = score_model.prior_log_odds + score_model.best_view_log_odds * (reported.max(1, initial=0) - 0.5)
    odds = odds - score_model.log_odds_per_log_width * np.log(np.maximum(widest_rad, 1e-3) / USUAL_RAD)
    for sign, (a, b) in ((1, score_model.beta_true), (-1, score_model.beta_false)):
        odds = odds + sign * (betaln(hit + a, miss + b) - betaln(a, b))
    return np.asarray(1 / (1 + np.exp(-odds)))
