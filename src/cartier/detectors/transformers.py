"""Detectors from the hub or a folder: OWLv2, Grounding DINO, LLMDet, OmDet-Turbo, DETR, RT-DETR, D-FINE, YOLOS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartier.detectors import hub
from cartier.detectors.device_boxes import best_first, to_pixels, without_duplicates
from cartier.detectors.device_images import DeviceImages
from cartier.detectors.vocabulary import read_vocabulary
from cartier.detectors.zero_shot import ClosedSet, Grounding, OmDetTurbo, Owl, Pass
from cartier.errors import BackendError, CartierError
from cartier.models.hub import best_device, line_of
from cartier.types import Detections, DetectorScoreModel, Floats, Frame

EXTRA = "detect"
BATCH = 32  # images in one forward
BATCH_SCORES = 80_000_000  # and fewer where their scores would be more than this many numbers (320 MB)
BATCH_PIXELS = 16 * 1920 * 1080  # and fewer of images larger than that


@dataclass(frozen=True)
class Family:
    """How a type of model is asked, and from which score on a detection counts by itself."""

    head: type[ClosedSet | Owl | Grounding | OmDetTurbo]
    threshold: float
    square: bool = False
    """Boxes are shares of the square that the image was padded to."""


FAMILIES = {
    # Scores of open vocabularies are low even on good boxes, and of 1,203 names some wrong one always scores a little:
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

    ``threshold`` is the score from which a detection counts by itself, by default that of FAMILIES. ``vocabulary`` are
    the names that a zero-shot model is asked for, a text file or a list; by default LVIS's 1,203. ``device`` is
    torch's, by default the GPU if there is one, where it runs in half precision. Only safetensors are read, and no code
    from outside runs. Raises InputError if there is no such model, if it is damaged or no detector, or if the
    vocabulary is wrong; BackendError for a wrong option.

    Older DETRs take their backbone from timm, which needs torchvision: ``facebook/detr-resnet-50@no_timm`` needs
    neither.
    """
    chosen = best_device(device)
    source = hub.find(model, FAMILIES)
    family = FAMILIES[source.config.model_type]
    closed = family.head is ClosedSet
    if closed and vocabulary is not None:
        raise BackendError(f"{source.name} knows a fixed set of names: option vocabulary is for zero-shot models")
    words = None if closed else read_vocabulary(vocabulary)
    loaded = hub.load(source, chosen, zero_shot=not closed)
    with _running(loaded.model, source.name, "its vocabulary"):
        head = family.head(loaded, words.names if words else ())
    notes = [*(words.notes if words else ()), *head.notes]
    return TransformersDetector(
        loaded, family, head, DetectorScoreModel().with_threshold(family.threshold).with_threshold(threshold), notes
    )


class TransformersDetector:
    """Obeys the Detector contract. ``notes`` say what was cut, merged or assumed."""

    world = ""

    def __init__(
        self, loaded: hub.Loaded, family: Family, head: Any, score_model: DetectorScoreModel, notes: Sequence[str]
    ) -> None:
        import torch

        self._loaded, self._family, self._head, self.score_model = loaded, family, head, score_model
        self._zero_shot = family.head is not ClosedSet
        self.sha256 = loaded.sha256
        asked = ""
        if self._zero_shot:
            self.sha256, asked = hub.with_names(loaded.sha256, head.names), f", {len(head.names)} names"
        half = _is_half(loaded.model)
        counts = f"counts from {score_model.threshold:g}{asked}{', half precision' * half}"
        self.name = f"transformers {loaded.source.name} ({counts})"
        self.knows = tuple(name for name in head.names if name)
        self._notes = tuple(notes)
        self._images = DeviceImages(loaded.images, loaded.model.device, family.square)
        self._named = torch.tensor([name is not None for name in head.names], device=loaded.model.device)
        self._most = max(1, min(BATCH, BATCH_SCORES // head.scores_per_image))

    @property
    def notes(self) -> Sequence[str]:
        return (*self._notes, *self._images.notes)

    @property
    def batch(self) -> int:
        """On a CPU many frames take as long together as one by one."""
        return self._most if _is_half(self._loaded.model) else 1

    def detect(self, frame: Frame) -> Detections:
        """Boxes clipped to the frame, best score first. Raises BackendError if the model fails on it or gives NaN."""
        return self.detect_batch([frame])[0]

    def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
        """The same for many frames, in their order. Frames of one size share a forward; sizes may change freely."""
        sizes: dict[tuple[int, ...], list[int]] = {}
        for number, frame in enumerate(frames):
            sizes.setdefault(frame.rgb.shape[:2], []).append(number)
        found: dict[int, Detections] = {}
        for (height, width), numbers in sizes.items():
            while numbers:
                step = max(1, min(self._most, BATCH_PIXELS // (height * width)))
                some, numbers = numbers[:step], numbers[step:]
                found |= zip(some, self._detect([frames[i] for i in some]), strict=True)
        return [found[number] for number in range(len(frames))]

    def _detect(self, frames: Sequence[Frame]) -> list[Detections]:
        """Detections in frames of one size; where they do not fit in memory together, in halves of them."""
        import torch

        try:
            found = self._forward(frames)
        except BackendError as error:
            if len(frames) == 1 or not isinstance(error.__cause__, torch.OutOfMemoryError):
                raise
            found = None  # and what the forward held is free again once this block is left
        if found is None:
            half = self._most = len(frames) // 2
            return [*self._detect(frames[:half]), *self._detect(frames[half:])]
        names = self._head.names
        return [
            Detections(frame.index, rows[:, 2:], rows[:, 0], tuple(names[i] for i in rows[:, 1].astype(int)))
            for frame, rows in zip(frames, found, strict=True)
        ]

    def _forward(self, frames: Sequence[Frame]) -> list[Floats]:
        """For each frame rows (n, 6), best first: score, number of the name, box xyxy in pixels."""
        import torch

        model, name, camera = self._loaded.model, self._loaded.source.name, frames[0].camera
        where = ", ".join(f"frame {frame.index}" for frame in frames)
        with _running(model, name, where):
            passes = [_best_names(answer) for answer in self._head.passes(self._images([f.rgb for f in frames]))]
            scores, classes, shares = (torch.cat(parts, dim=1) for parts in zip(*passes, strict=True))
            sound = scores.isfinite().all() & shares.isfinite().all()
            boxes = to_pixels(shares, camera.width, camera.height, self._family.square)
            best, stays = best_first(
                scores, self._named[classes] & (scores >= self.score_model.zero_weight_score), boxes
            )
            scores, classes = scores.gather(1, best), classes.gather(1, best)
            boxes = boxes.gather(1, best[..., None].expand(-1, -1, 4))
            if self._zero_shot:
                stays = without_duplicates(boxes, classes, stays)
            columns = scores, classes.float(), boxes, stays.float(), sound.float().expand_as(scores)
            rows = torch.cat([c if c.ndim == 3 else c[..., None] for c in columns], dim=-1).cpu().numpy()
        if not rows[..., 7].all():
            raise BackendError(f"{name} gives NaN or infinity for {where}")
        return [of[of[:, 6] > 0, :6] for of in rows]


def _best_names(answer: Pass) -> tuple[Any, Any, Any]:
    """Scores (B, Q) and numbers (B, Q) of each query's best name, and boxes (B, Q, 4), of one pass."""
    import torch

    scores, best = answer.scores.max(-1)
    return scores, torch.tensor(answer.names, device=best.device)[best], answer.boxes


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
        raise BackendError(f"{name} failed on {what}: {line_of(error)}") from error
