"""Any ONNX detector: FastestDet, YOLOv8, YOLOX, NanoDet, PicoDet, DETR, or labels, boxes and scores (onnxruntime)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cartier.detectors.boxes import clip, nms
from cartier.detectors.layouts import ANY_NAME, LAYOUTS, Candidates, Size, recognised, recognised_task
from cartier.detectors.metadata import Metadata, read_metadata
from cartier.detectors.pixels import to_tensor
from cartier.detectors.sidecar import Sidecar, read_sidecar, sidecar_of
from cartier.errors import BackendError, InputError, brief
from cartier.io.files import sha256_of
from cartier.models.onnx_session import Session, shape_text
from cartier.types import Array, Detections, DetectorScoreModel, Frame

DEFAULT_IOU = 0.5
SHOWN_NAMES = 4
MAX_SCORE = 1.001  # half precision rounds a little above 1


def make(
    model: str | Path,
    sidecar: str | Path | None = None,
    threshold: float | None = None,
    iou: float = DEFAULT_IOU,
    provider: str = "cpu",
    threads: int | None = None,
) -> OnnxDetector:
    """A detector from an ONNX file and its sidecar, by default ``MODEL.json`` beside it.

    ``threshold`` is the score from which a detection counts by itself, by default the sidecar's or the layout's;
    ``iou`` is the overlap above which the weaker of two boxes of a class goes (layouts fastestdet, yolov8, yolox,
    nanodet). ``provider`` is onnxruntime's, as "cuda"; ``threads`` is onnxruntime's own choice by default. Raises
    InputError if the model cannot be loaded, if the sidecar is wrong or does not fit it, or if there is none and the
    model's shapes do not prove what it is.
    """
    if not 0 <= iou <= 1:
        raise BackendError(f"option iou must be from 0 to 1, got {iou}")
    if threads is not None and threads < 1:
        raise BackendError(f"option threads must be at least 1, got {threads}")
    path = Path(model)
    beside = path.with_suffix(".json")
    described = Path(sidecar) if sidecar else beside if beside.is_file() else None
    return OnnxDetector(Session(path, provider, threads), described, threshold, iou)


class OnnxDetector:
    """Obeys the Detector contract. ``notes`` says what was assumed because no sidecar says it."""

    world = ""

    def __init__(self, session: Session, described: Path | None, threshold: float | None, iou: float) -> None:
        given = read_sidecar(described) if described else None
        told = None if given else read_metadata(session.metadata, session.path)
        self.sha256 = sha256_of(session.path, *([described] if described else []))
        self._session, self._iou = session, iou
        self._size = _input_size(session, given, described, told)
        trial = session.run(np.zeros((1, 3, *self._size[::-1]), np.float32), f"a black {_wxh(self._size)} image")
        self._sidecar = given or _recognised(session, trial, self._size, told)
        self._layout = LAYOUTS[self._sidecar.layout]
        self._outputs = _pick_outputs(session, self._sidecar, described)
        self._check_shapes(trial, f"{described} does not fit it")
        measured = (
            DetectorScoreModel().with_threshold(self._sidecar.threshold)
            if self._sidecar.score_model is None
            else self._sidecar.score_model
        )
        self.score_model = measured.with_threshold(threshold)
        self.knows = tuple(dict.fromkeys(label for label in self._sidecar.labels if label is not None))
        file = session.path.name
        overlap = f", iou {iou:g}" if self._layout.nms and iou != DEFAULT_IOU else ""
        self.name = f"onnx {file} (counts from {self.score_model.threshold:g}{overlap})"
        self.notes: tuple[str, ...] = ()
        if told is not None:
            names = ", ".join(self.knows[:SHOWN_NAMES]) + (", …" if len(self.knows) > SHOWN_NAMES else "")
            self.notes = (
                f"{file} has no sidecar: read as {self._sidecar.layout} with its own names ({brief(names, 80)})",
            )
        elif given is None:
            self.notes = (
                f"{file} has no sidecar: its output has the shape of {self._sidecar.layout} with the 80 COCO labels, "
                f"so that is assumed ({self._sidecar.channels}, value / {self._sidecar.scale:g}, "
                f"{self._sidecar.resize})",
            )

    def detect(self, frame: Frame) -> Detections:
        """Boxes clipped to the frame, best score first.

        Raises BackendError if the model gives NaN, scores above 1, or a class that has no label.
        """
        return self.detect_from(frame, self.score_model.zero_weight_score)

    def detect_from(self, frame: Frame, score: float) -> Detections:
        """``detect`` from another least score, for who weighs the boxes further."""
        where = f"frame {frame.index}"
        tensor, placement = to_tensor(frame.rgb, self._size, self._sidecar)
        found = self._decode(self._session.run(tensor, where), where)
        boxes, whole = clip(placement.to_frame(found.boxes), frame.camera.width, frame.camera.height)
        chosen = np.flatnonzero(whole & (found.scores >= score))
        names = self._names(found.classes[chosen], where)
        chosen = chosen[[name is not None for name in names]]
        boxes, scores = boxes[chosen], found.scores[chosen]
        labels = [name for name in names if name is not None]
        if self._layout.nms:
            order = nms(boxes, scores, found.classes[chosen], self._iou)
        else:
            order = np.argsort(-scores, kind="stable")
        return Detections(frame.index, boxes[order], scores[order], tuple(labels[i] for i in order))

    def _decode(self, outputs: Mapping[str, Array], where: str) -> Candidates:
        self._check_shapes(outputs, where)
        values = [outputs[name].astype(np.float32, copy=False) for name in self._outputs]
        for name, value in zip(self._outputs, values, strict=True):
            if not np.isfinite(value).all():
                raise BackendError(f"{self._session.path}: output {brief(name, 40)} holds NaN or infinity for {where}")
        found = self._layout.decode(values, self._sidecar, self._size)
        if not len(found.boxes) == len(found.scores) == len(found.classes):
            raise BackendError(
                f"{self._session.path} gives {len(found.boxes)} boxes, {len(found.scores)} scores and "
                f"{len(found.classes)} classes for {where}"
            )
        if found.scores.max(initial=0) > MAX_SCORE:
            raise BackendError(
                f"{self._session.path} gives a score of {found.scores.max():.4g} for {where}, where layout "
                f"{self._sidecar.layout} has 0 to 1: is the sidecar's layout wrong?"
            )
        return found

    def _names(self, classes: Array, where: str) -> list[str | None]:
        labels, numbers = self._sidecar.labels, [round(float(number)) for number in classes]
        wrong = [number for number in numbers if not 0 <= number < len(labels)]
        if wrong:
            raise BackendError(
                f"{self._session.path} gives class {wrong[0]} for {where}, but its sidecar has labels for 0 to "
                f"{len(labels) - 1}"
            )
        return [labels[number] for number in numbers]

    def _check_shapes(self, outputs: Mapping[str, Array], what: str) -> None:
        wanted = self._layout.shapes(self._sidecar, self._size, len(self._outputs))
        for name, shape in zip(self._outputs, wanted, strict=True):
            if not _fits(outputs[name].shape, shape):
                raise InputError(
                    f"{self._session.path}: {what}: layout {self._sidecar.layout} with {len(self._sidecar.labels)} "
                    f"labels and a {_wxh(self._size)} input needs the output {brief(name, 40)} to be "
                    f"{shape_text(shape)}, "
                    f"but it is {shape_text(outputs[name].shape)}"
                )


def _pick_outputs(session: Session, sidecar: Sidecar, described: Path | None) -> tuple[str, ...]:
    """The names of the outputs that the layout reads, in its order."""
    layout, there = LAYOUTS[sidecar.layout], session.outputs
    wanted = layout.outputs
    if sidecar.outputs is not None:
        names = sidecar.outputs
    elif wanted in ((ANY_NAME,), ()):
        names = there
    else:
        names = tuple(name for aliases in wanted for name in [a for a in aliases if a in there][:1])
    if len(names) not in (layout.numbers or (len(wanted),)) or not set(names) <= set(there):
        roles = ", ".join(aliases[0] if aliases else "the one that holds the boxes" for aliases in wanted)
        roles = roles or "its one output, or the scores of three or four strides and then their distances"
        raise InputError(
            f'{described} does not fit {session.path}: the key "outputs" must name, for layout {sidecar.layout}, '
            f"{roles}; the model has {brief(', '.join(there), 160)}"
        )
    return names


def _recognised(session: Session, trial: Mapping[str, Array], size: Size, told: Metadata | None) -> Sidecar:
    shapes = [value.shape for value in trial.values()]
    if told is not None:
        return _by_metadata(session, trial, size, told)
    layout = recognised(shapes, size)
    if layout is None:
        raise InputError(
            f"{session.path} has no sidecar, and its shapes do not prove how to read it "
            f"({session.describe(trial)}): {_how_to_describe(session)}"
        )
    return Sidecar.model_validate({"layout": layout, "labels": "coco"})


def _by_metadata(session: Session, trial: Mapping[str, Array], size: Size, told: Metadata) -> Sidecar:
    """How to read a model whose file names its classes."""
    shapes, classes = [value.shape for value in trial.values()], len(told.names)
    layout, more = recognised(shapes, size, classes), 0
    if layout is None:
        layout, more = recognised_task(shapes, size, told.task, classes) or (None, 0)
    if layout is None:
        kind = f"{told.task or 'detect'} model of {classes} classes ({brief(', '.join(map(str, told.names)), 60)})"
        raise InputError(
            f"{session.path} says that it is a {kind}, but its outputs are not ({session.describe(trial)}): "
            "export it anew with 'yolo export format=onnx nms=False', a model of task detect, or "
            f"{_how_to_describe(session)}"
        )
    keys: dict[str, Any] = {"layout": layout, "labels": told.names} | ({"more_columns": more} if more else {})
    return sidecar_of(session.path, keys | ({"outputs": session.outputs[:1]} if len(shapes) > 1 else {}))


def _input_size(session: Session, sidecar: Sidecar | None, described: Path | None, told: Metadata | None) -> Size:
    asked = sidecar.input_size if sidecar else told.size if told else None
    size = session.size or asked
    if size is None and sidecar is None:
        raise InputError(
            f"{session.path} has no sidecar, and leaves its input size open ({session.describe({})}): "
            f"{_how_to_describe(session)}"
        )
    if size is None:
        raise InputError(f'{session.path} leaves its input size open: add "input_size": [width, height] to {described}')
    if sidecar and asked not in (None, size):
        raise InputError(f"{described} does not fit {session.path}: input_size is {asked}, but the model takes {size}")
    return size


def _how_to_describe(session: Session) -> str:
    return (
        f"write {session.path.with_suffix('.json').name} beside it, with at least "
        f'{{"layout": "{"|".join(LAYOUTS)}", "labels": ["name", …] or "coco"}} (all keys: '
        f"{', '.join(Sidecar.model_fields)})"
    )


def _wxh(size: Size) -> str:
    return f"{size[0]}x{size[1]}"


def _fits(shape: Sequence[int], wanted: Sequence[int | None]) -> bool:
    return len(shape) == len(wanted) and all(w is None or s == w for s, w in zip(shape, wanted, strict=True))
