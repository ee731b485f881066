"""Ground truth of a simulator's instance masks, exact or with seeded misses, box jitter and label confusion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier.errors import BackendError
from cartier.labels import display_name
from cartier.types import Detections, DetectorScoreModel, Frame, TrueObject

MIN_PIXELS = 64  # visible pixels below which even an ideal detector sees nothing


def make(
    truth: Sequence[TrueObject] | None = None,
    source: str = "simulator",
    min_pixels: int = MIN_PIXELS,
    misses: float = 0.0,
    jitter: float = 0.0,
    confusion: float = 0.0,
    seed: int = 0,
) -> GroundTruth:
    """``truth`` are the recording's true objects; ``source`` says whose they are.

    ``misses`` is the chance to miss an object of ``min_pixels``, falling with the square root of its area; ``jitter``
    the standard deviation of each box side as a share of the box; ``confusion`` the chance of another object's name.
    """
    if truth is None:
        raise BackendError("the ground_truth detector needs a simulator's recording: this one has no true objects")
    disturbed = {"misses": misses, "jitter": jitter, "confusion": confusion}
    for name, value in disturbed.items():
        if not 0 <= value <= 1:
            raise BackendError(f"option {name} must be from 0 to 1, got {value}")
    return GroundTruth(truth, source, max(1, min_pixels), disturbed, seed)


class GroundTruth:
    """Obeys the Detector contract, with masks where nothing is disturbed. Its name says that it is no real detector."""

    score_model = DetectorScoreModel(
        0.5,
        spawn_threshold=0.0,
        zero_weight_score=0.0,
        full_weight_score=0.01,
        prior_log_odds=6.0,
        measured="it is the truth",
    )
    notes: Sequence[str] = ()
    sha256 = ""

    def __init__(
        self, truth: Sequence[TrueObject], source: str, min_pixels: int, disturbed: dict[str, float], seed: int
    ) -> None:
        self._labels = {obj.id: display_name(obj.label) for obj in truth}
        self._names = sorted(set(self._labels.values()))
        self._min_pixels, self._disturbance, self._seed = min_pixels, disturbed, seed
        with_what = "".join(f", {name} {value:g}" for name, value in disturbed.items() if value)
        self.name = f"ground truth ({source}{with_what}{f', seed {seed}' if with_what else ''})"
        self._exact = not with_what

    def detect(self, frame: Frame) -> Detections:
        """Every object with enough visible pixels. Raises BackendError if the frame holds no instances."""
        if frame.instances is None:
            raise BackendError(f"frame {frame.index} has no instances: ground truth exists in simulators only")
        ids, boxes, pixels = _visible(frame.instances, self._min_pixels)
        known = np.array([int(i) in self._labels for i in ids], bool)
        ids, boxes, pixels = ids[known], boxes[known], pixels[known]
        labels = [self._labels[int(i)] for i in ids]
        if self._exact:
            masks = frame.instances[None] == ids[:, None, None]
            return Detections(frame.index, boxes, np.ones(len(ids), np.float32), tuple(labels), masks)
        return self._disturbed(frame, boxes, labels, pixels)

    def _disturbed(
        self, frame: Frame, boxes: npt.NDArray[np.float32], labels: list[str], pixels: npt.NDArray[np.int64]
    ) -> Detections:
        rng = np.random.default_rng((self._seed, frame.index))
        chance = self._disturbance["misses"] * np.sqrt(self._min_pixels / np.maximum(pixels, 1))
        seen = rng.random(len(boxes)) >= chance
        side = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
        shaken = boxes + self._disturbance["jitter"] * side * rng.standard_normal(boxes.shape).astype(np.float32)
        shaken = np.clip(shaken, 0, np.tile((frame.camera.width, frame.camera.height), 2)).astype(np.float32)
        ordered = np.hstack([np.minimum(shaken[:, :2], shaken[:, 2:]), np.maximum(shaken[:, :2], shaken[:, 2:])])
        confused = rng.random(len(boxes)) < self._disturbance["confusion"]
        others = rng.integers(0, max(1, len(self._names)), len(boxes))
        names = [
            self._names[other] if mixed else label for label, mixed, other in zip(labels, confused, others, strict=True)
        ]
        return Detections(frame.index, ordered, np.ones(len(boxes), np.float32), tuple(names)).keep(seen)


def _visible(
    instances: npt.NDArray[np.int32], min_pixels: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32], npt.NDArray[np.int64]]:
    """Ids, boxes (N, 4) and pixel counts of what shows at least ``min_pixels``."""
    from scipy.ndimage import find_objects

    pixels = np.bincount(instances.ravel())
    ids = np.flatnonzero(pixels >= min_pixels)
    ids = ids[ids > 0]
    spans = find_objects(instances)
    boxes = [(spans[i - 1][1].start, spans[i - 1][0].start, spans[i - 1][1].stop, spans[i - 1][0].stop) for i in ids]
    return ids, np.array(boxes, np.float32).reshape(-1, 4), pixels[ids]
