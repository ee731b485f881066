"""Embedded dollhouse detector: a small network trained on generated homes, for simulated images (onnxruntime)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cartier.detectors.boxes import clip, nms
from cartier.errors import BackendError
from cartier.types import Detections, Frame
from cartier_dollhouse.network import FOLDER

if TYPE_CHECKING:
    from cartier_dollhouse.network.inference import Inference

MAX_IOU = 0.5
FLAT = 6  # levels between the darkest and the brightest value of an image in which nothing can be made out


def make(
    threshold: float | None = None,
    folder: str | Path = FOLDER,
    provider: str = "cpu",
    threads: int = 1,
) -> Embedded:
    """``threshold`` is the score from which a detection counts by itself, by default that chosen on generated homes.

    ``folder`` holds another model of the same make (tools/train_dollhouse_detector.py); ``provider`` is onnxruntime's,
    such as "cuda"; more ``threads`` answer sooner on idle cores, and compute longer. Raises InputError if the network's
    file is missing or changed.
    """
    from cartier_dollhouse.network.inference import open_inference

    if threads < 1:
        raise BackendError(f"option threads must be at least 1, got {threads}")
    return Embedded(threshold, open_inference(Path(folder), provider, threads))


class Embedded:
    """Obeys the Detector contract: a CenterNet (Zhou et al. 2019), trained as TTFNet (Liu et al. 2020), on RGB."""

    world = "dollhouse"

    def __init__(self, threshold: float | None, inference: Inference) -> None:
        self._inference = inference
        self.model = inference.model
        self.score_model = self.model.score_model.with_threshold(threshold)
        self.sha256, self.knows = self.model.sha256, self.model.names
        self.name = f"embedded dollhouse detector (counts from {self.score_model.threshold:g})"
        self.notes: tuple[str, ...] = (
            f"the embedded detector knows the dollhouse's types and no photographs: {self.model.trained}",
        )

    def detect(self, frame: Frame) -> Detections:
        """Boxes clipped to the frame, best score first; one object may come with two names.

        Raises BackendError if the network gives what it must not.
        """
        boxes, scores, classes = self._inference.detections(frame)
        if np.ptp(frame.rgb) < FLAT:
            return Detections(frame.index, boxes[:0], scores[:0], ())
        boxes, whole = clip(boxes, frame.camera.width, frame.camera.height)
        chosen = np.flatnonzero(whole & (scores >= self.score_model.zero_weight_score))
        boxes, scores, classes = boxes[chosen], scores[chosen], classes[chosen]
        order = nms(boxes, scores, classes, MAX_IOU)
        names = tuple(self.model.names[int(classes[i])] for i in order)
        return Detections(frame.index, boxes[order], scores[order], names)
