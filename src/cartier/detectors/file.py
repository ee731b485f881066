"""Detections that another program made: COCO or LVIS results (JSON), or JSON lines; EVA on LVIS plugs in here."""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np

from cartier.detectors.annotations import Annotations, read_annotations
from cartier.detectors.boxes import clip
from cartier.detectors.rows import rows
from cartier.errors import InputError, brief
from cartier.io.files import sha256_of
from cartier.types import Array, Detections, DetectorScoreModel, Frame

EVA_THRESHOLD = 0.8
OVERHANG = 0.1  # detectors that do not clip reach a little over the edge; more means images of another size


def make(path: str | Path, threshold: float = EVA_THRESHOLD, categories: str | Path | None = None) -> DetectionsFile:
    """A detector that looks up what another program detected in the same frames.

    ``path`` holds a JSON list or JSON lines of COCO results (``image_id``, ``category_id``, ``score``, ``bbox`` x, y,
    width, height) or of ``{"frame": 0, "label": "cup", "score": 0.9, "xyxy": [x1, y1, x2, y2]}``, or per frame
    ``{"frame": 0, "detections": [{"label", "score", "xyxy"}, …]}``; boxes are in pixels of the recording's frames.
    Detections that score ``threshold`` or more count by themselves (default: EVA's own scale); those of two fifths of
    it are evidence. ``categories`` names the category ids: a COCO or LVIS annotations file, or a list of names (the
    first is id 1), by default ``NAME.categories.json`` beside NAME.json. If it lists ``images``, the k-th of them is
    frame k; else image_id is the frame's number, from 0. Raises InputError with the line for whatever is wrong, also if
    no detection is left.
    """
    path = Path(path)
    beside = path.with_suffix(".categories.json")
    named = Path(categories) if categories else beside if beside.is_file() else None
    return DetectionsFile(path, threshold, read_annotations(named) if named else None)


class DetectionsFile:
    """Obeys the Detector contract. Holds the detections that may mean something, 64 bytes each."""

    as_recorded = True

    def __init__(self, path: Path, threshold: float, annotations: Annotations | None) -> None:
        self.score_model = DetectorScoreModel().with_threshold(threshold)
        self.name = f"file {path.name} (counts from {threshold:g})"
        self._path, self._annotations, self._last_asked = path, annotations, -1
        numbers: dict[str, int] = {}
        frames, lines, labels, values = array("q"), array("q"), array("q"), array("d")
        total, best = 0, 0.0
        for row in rows(path, annotations):
            total, best = total + 1, max(best, row.score)
            if row.score >= self.score_model.zero_weight_score:
                frames.append(row.frame)
                lines.append(row.line)
                labels.append(numbers.setdefault(row.label, len(numbers)))
                values.extend((*row.xyxy, row.score))
        if not frames:
            least = f"{self.score_model.zero_weight_score:g} or more (the best has {best:g})"
            low = f"none of its {total} detections scores {least}"
            raise InputError(f"{path}: {low + ': lower the threshold' if total else 'it holds no detections'}")
        table = np.array(values).reshape(-1, 5)
        order = np.lexsort((-table[:, 4], np.array(frames)))
        self._names = tuple(numbers)
        self._frames, self._lines, self._labels = (np.array(column)[order] for column in (frames, lines, labels))
        self._boxes, self._scores = table[order, :4], table[order, 4]
        self.sha256 = sha256_of(path, *([annotations.path] if annotations else []))
        self._kept = (
            f"{path.name}: {len(frames)} of {total} detections score {self.score_model.zero_weight_score:g} or more"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """How many detections count, and, once frames were asked for, whether the file goes beyond them."""
        notes = [self._kept, *(self._annotations.notes if self._annotations else ())]
        beyond = int((self._frames > self._last_asked).sum())
        if self._last_asked >= 0 and beyond:
            notes.append(
                f"{self._path.name}: {beyond} detections belong to frames after {self._last_asked}, the last one here "
                f"(up to {self._frames[-1]}): image ids that are not frame numbers from 0 need the annotations' images"
            )
        return tuple(notes)

    def detect(self, frame: Frame) -> Detections:
        """What the file holds for this frame, clipped, best score first. Raises InputError if a box does not fit it."""
        self._last_asked = max(self._last_asked, frame.index)
        self._check_image(frame)
        low, high = np.searchsorted(self._frames, (frame.index, frame.index + 1))
        boxes, width, height = self._boxes[low:high], frame.camera.width, frame.camera.height
        self._check_boxes(boxes, self._lines[low:high], frame)
        clipped, whole = clip(boxes, width, height)
        labels = tuple(self._names[number] for number in self._labels[low:high][whole])
        return Detections(frame.index, clipped[whole], self._scores[low:high][whole], labels)

    def _check_image(self, frame: Frame) -> None:
        if self._annotations is None or not self._annotations.sizes:
            return
        path, sizes = self._annotations.path, self._annotations.sizes
        there = (frame.camera.width, frame.camera.height)
        if frame.index >= len(sizes):
            raise InputError(f"{path} lists {len(sizes)} images, but the recording has a frame {frame.index}")
        if sizes[frame.index] not in (None, there):
            raise InputError(
                f"{path}: image {frame.index} is {brief(sizes[frame.index], 40)} px (width, height), but frame "
                f"{frame.index} of the recording is {there}"
            )

    def _check_boxes(self, boxes: Array, lines: Array, frame: Frame) -> None:
        size = np.array((frame.camera.width, frame.camera.height) * 2)
        wrong = np.flatnonzero(((boxes < -OVERHANG * size) | (boxes > (1 + OVERHANG) * size)).any(axis=1))
        if len(wrong):
            box = [round(float(side), 1) for side in boxes[wrong[0]]]
            raise InputError(
                f"{self._path} line {lines[wrong[0]]}: the box {box} reaches out of frame {frame.index}, "
                f"which is {frame.camera.width}x{frame.camera.height} px: was it detected in images of another size?"
            )
