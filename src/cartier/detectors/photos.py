"""Embedded photograph detector: three passes of two small networks, fused; 51 household names of COCO (onnxruntime)."""

from __future__ import annotations

import hashlib

from cartier.detectors.fusion import fuse
from cartier.detectors.onnx import DEFAULT_IOU, OnnxDetector
from cartier.errors import BackendError
from cartier.io.files import parse_json, read_text
from cartier.models import photos
from cartier.models.onnx_session import Session
from cartier.types import Detections, DetectorScoreModel, Frame

LOW = 0.05  # of a member: its weaker boxes say nothing
MAX_SCORES_BYTES = 1 << 16


def make(threshold: float | None = None, provider: str = "cpu", threads: int = 1) -> PhotosDetector:
    """``threshold`` is the score from which a detection counts by itself, by default that chosen on photographs.

    ``provider`` is onnxruntime's, such as "cuda"; more ``threads`` answer sooner on idle cores, and compute longer.
    Raises InputError if a network's file is missing or was changed.
    """
    if threads < 1:
        raise BackendError(f"option threads must be at least 1, got {threads}")
    members = [
        OnnxDetector(Session(network, provider, threads), sidecar, None, DEFAULT_IOU)
        for network, sidecar in photos.checked()
    ]
    return PhotosDetector(members, threshold)


class PhotosDetector:
    """Obeys the Detector contract."""

    world = ""
    notes: tuple[str, ...] = ()

    def __init__(self, members: list[OnnxDetector], threshold: float | None) -> None:
        told = read_text(photos.SCORES, MAX_SCORES_BYTES)
        self._members, self.knows = members, members[0].knows
        self.score_model = DetectorScoreModel.from_dict(parse_json(told.encode(), photos.SCORES)).with_threshold(
            threshold
        )
        made_of = " ".join([*(member.sha256 for member in members), told])
        self.sha256 = hashlib.sha256(made_of.encode()).hexdigest()
        self.name = f"photos NanoDet-Plus-m-1.5x + DEIMv2 femto (counts from {self.score_model.threshold:g})"

    def detect(self, frame: Frame) -> Detections:
        """Boxes clipped to the frame, best score first. Raises BackendError if a network fails."""
        found = fuse([member.detect_from(frame, LOW) for member in self._members])
        return found.keep(found.scores >= self.score_model.zero_weight_score)
