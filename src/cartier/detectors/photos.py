"""Embedded photograph detector: NanoDet-Plus-m, 51 household names of COCO, 28 ms of one core (onnxruntime)."""

from __future__ import annotations

from cartier.detectors.onnx import DEFAULT_IOU, OnnxDetector
from cartier.errors import BackendError
from cartier.models import nanodet
from cartier.models.onnx_session import Session


def make(threshold: float | None = None, provider: str = "cpu", threads: int | None = None) -> OnnxDetector:
    """``threshold`` is the score from which a detection counts by itself, by default that chosen on photographs.

    ``provider`` is onnxruntime's, such as "cuda"; ``threads`` is its own choice by default. Raises InputError if the
    network's file is missing or was changed.
    """
    if threads is not None and threads < 1:
        raise BackendError(f"option threads must be at least 1, got {threads}")
    model, sidecar = nanodet.checked()
    detector = OnnxDetector(Session(model, provider, threads), sidecar, threshold, DEFAULT_IOU)
    detector.name = f"photos NanoDet-Plus-m (counts from {detector.score_model.threshold:g})"
    return detector
