"""ObjectViewpoint: where the camera stood when it saw the largest (perspective-corrected) box; needs no depth."""

from __future__ import annotations

from cartier.geometry import view_yaw
from cartier.indexes._largest_view import LargestView
from cartier.types import Detections, Frame, Place


def make(min_views: int = 1) -> ObjectViewpoint:
    """``min_views`` frames must agree."""
    return ObjectViewpoint(min_views)


class ObjectViewpoint(LargestView):
    """Position = camera position of the winning frame, with the heading in which the box's centre was seen."""

    def place(self, frame: Frame, detections: Detections, which: int) -> Place:
        box = detections.boxes_xyxy[which]
        yaw = view_yaw(frame.world_from_camera, frame.camera, float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2)
        position = tuple(frame.world_from_camera[:3, 3].tolist())
        score = float(detections.scores[which])
        return Place(detections.labels[which], position, score, frame.index, tuple(box.tolist()), view_yaw=yaw)
