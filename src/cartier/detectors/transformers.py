"""Detectors from the hub or a folder: OWLv2, Grounding DINO, LLMDet, OmDet-Turbo, DETR, RT-DETR, D-FINE, YOLOS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cartier.detectors import _hub
from cartier.detectors._boxes import clip, nms
from cartier.detectors._vocabulary import read_vocabulary
from cartier.detectors._zero_shot import ClosedSet, Grounding, OmDetTurbo, Owl, Pass
from cartier.errors import BackendError, CartierError
from cartier.mapping.existence import at_threshold
from cartier.types import Array, Calibration, Detections, Floats, Frame

EXTRA = "detect"
BATCH = 8  # images in one forward
BATCH_SCORES = 40_000_000  # and fewer where their scores would be more than this many numbers (160 MB)
CANDIDATES = 1000  # the best so many boxes of a frame enter the suppression of duplicates
SAME_NAME_IOU = 0.5  # of two boxes of one name that overlap by more, the weaker goes
ANY_NAME_IOU = 0.8  # and of two of any names: one thing has one name


@dataclass(frozen=True)
class Family:
    """How a type of model is asked, and from which score on a detection counts by itself."""

    head: type[ClosedSet | Owl | Grounding | OmDetTurbo]
    threshold: float
    square: bool = False
    """Boxes are shares of the square that the image was padded to."""


FAMILIES = {
    # Scores of open vocabularies are low even on good boxes, and with 1,203 names some wrong one always scores a little:
    # the thresholds lie above the 0.1 of OWL's own examples and below the 0.4 that Grounding DINO's have for the best
    # token, since ours is the mean over a name's tokens. No published weights were measured here.
    "owlv2": Family(Owl, 0.25, square=True),
    "owlvit": Family(Owl, 0.15),
    "grounding-dino": Family(Grounding, 0.3),
    "mm-grounding-dino": Family(Grounding, 0.3),  # LLMDet is of this type too
    "omdet-turbo": Family(OmDetTurbo, 0.3),
    "detr": Family(ClosedSet, 0.7),
    "yolos": Family(ClosedSet, 0.7),
    "rt_detr": Family(ClosedSet, 0.5),
    "rt_detr_v2": Family(ClosedSet, 0.5),
    "d_fine": Family(ClosedSet, 0.5),
}


def make(
    model: str | Path,
    threshold: float | None = None,
    vocabulary: str | Path | Sequence[str] | None = None,
    device: str | None = None,
) -> TransformersDetector:
    """A detector from a hub id (``google/owlv2-base-patch16-ensemble``), such an id ``@revision``, or a saved folder.

    ``threshold`` is the score from which a detection counts by itself, by default that of FAMILIES. ``vocabulary`` are the names that a zero-shot model is
    asked for, a text file or a list; by default LVIS's 1,203. ``device`` is torch's, by default the GPU if there is one;
    there it runs in half precision. Only safetensors are read, and no code from outside runs. Raises InputError if there
    is no such model, if it is damaged or no detector, or if the vocabulary is wrong; BackendError for a wrong option.

    Older DETRs take their backbone from timm, which brings torchvision: ``facebook/detr-resnet-50@no_timm`` needs neither.
    """
    chosen = _hub.best_device(device)
    source = _hub.find(model, FAMILIES)
    family = FAMILIES[source.config.model_type]
    closed = family.head is ClosedSet
    if closed and vocabulary is not None:
        raise BackendError(f"{source.name} knows a fixed set of names: option vocabulary is for zero-shot models")
    words = None if closed else read_vocabulary(vocabulary)
    loaded = _hub.load(source, chosen, zero_shot=not closed)
    with _running(loaded.model, source.name, "its vocabulary"):
        head = family.head(loaded, words.names if words else ())
    notes = [*(words.notes if words else ()), *head.notes]
    return TransformersDetector(
        loaded, family, head, at_threshold(at_threshold(Calibration(), family.threshold), threshold), notes
    )


class TransformersDetector:
    """Obeys the Detector contract. ``notes`` say what was cut, merged or assumed."""

    def __init__(
        self, loaded: _hub.Loaded, family: Family, head: Any, calibration: Calibration, notes: Sequence[str]
    ) -> None:
        self._loaded, self._family, self._head, self.calibration = loaded, family, head, calibration
        self._zero_shot = family.head is not ClosedSet
        self.sha256 = loaded.sha256
        asked = ""
        if self._zero_shot:
            self.sha256, asked = _hub.with_names(loaded.sha256, head.names), f", {len(head.names)} names"
        half = _is_half(loaded.model)
        self.name = f"transformers {loaded.source.name} (counts from {calibration.threshold:g}{asked}{', half precision' * half})"
        self.knows = tuple(name for name in head.names if name)
        self.notes = tuple(notes)
        self._step = max(1, min(BATCH, BATCH_SCORES // head.scores_per_image))

    def detect(self, frame: Frame) -> Detections:
        """Boxes clipped to the frame, best score first. Raises BackendError if the model fails on it or gives NaN."""
        return self.detect_batch([frame])[0]

    def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
        """The same for many frames, in their order. Frames of one size share a forward; sizes may change freely."""
        sizes: dict[tuple[int, ...], list[int]] = {}
        for number, frame in enumerate(frames):
            sizes.setdefault(frame.rgb.shape, []).append(number)
        found: dict[int, Detections] = {}
        for numbers in sizes.values():
            for start in range(0, len(numbers), self._step):
                some = numbers[start : start + self._step]
                found |= zip(some, self._detect([frames[i] for i in some]), strict=True)
        return [found[number] for number in range(len(frames))]

    def _detect(self, frames: Sequence[Frame]) -> list[Detections]:
        """Detections in frames of one size."""
        model, where = self._loaded.model, ", ".join(f"frame {frame.index}" for frame in frames)
        with _running(model, self._loaded.source.name, where):
            given = self._loaded.images(
                images=[frame.rgb for frame in frames], return_tensors="pt", input_data_format="channels_last"
            )
            pixels = {key: given[key].to(model.device) for key in ("pixel_values", "pixel_mask") if key in given}
            passes = [_best_names(answer) for answer in self._head.passes(pixels)]
        scores, classes, boxes = (np.concatenate(parts, axis=1) for parts in zip(*passes, strict=True))
        if not (np.isfinite(scores).all() and np.isfinite(boxes).all()):
            raise BackendError(f"{self._loaded.source.name} gives NaN or infinity for {where}")
        return [self._chosen(frame, *of) for frame, *of in zip(frames, scores, classes, boxes, strict=True)]

    def _chosen(self, frame: Frame, scores: Floats, classes: Array, boxes_cxcywh: Floats) -> Detections:
        width, height = frame.camera.width, frame.camera.height
        scale = (max(width, height),) * 4 if self._family.square else (width, height) * 2
        centres, halves = boxes_cxcywh[:, :2], boxes_cxcywh[:, 2:] / 2
        boxes, whole = clip(np.hstack([centres - halves, centres + halves]) * scale, width, height)
        named = np.array([name is not None for name in self._head.names])[classes]
        best = np.flatnonzero(whole & named & (scores >= self.calibration.low))
        best = best[np.argsort(-scores[best], kind="stable")][:CANDIDATES]
        if self._zero_shot:
            best = best[nms(boxes[best], scores[best], classes[best], SAME_NAME_IOU)]
            best = best[nms(boxes[best], scores[best], np.zeros(len(best)), ANY_NAME_IOU)]
        return Detections(frame.index, boxes[best], scores[best], tuple(self._head.names[i] for i in classes[best]))


def _best_names(answer: Pass) -> tuple[Floats, Array, Floats]:
    """Scores (B, Q) and numbers (B, Q) of each query's best name, and boxes (B, Q, 4), of one pass."""
    scores, best = answer.scores.max(-1)
    return scores.cpu().numpy(), np.asarray(answer.names)[best.cpu().numpy()], answer.boxes.cpu().numpy()


def _is_half(model: Any) -> bool:
    return bool(model.device.type == "cuda")


@contextmanager
def _running(model: Any, name: str, what: str) -> Iterator[None]:
    """Without gradients, in half precision where the device is good at it, and with torch's errors in one line."""
    import torch

    try:
        with torch.inference_mode(), torch.autocast(model.device.type, torch.float16, enabled=_is_half(model)):
            yield
    except CartierError:
        raise
    except Exception as error:  # torch's and transformers' errors share no base class
        raise BackendError(f"{name} failed on {what}: {_hub.line_of(error)}") from error
