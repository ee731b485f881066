"""ObjectViewpoint: where the camera stood at each name's largest (perspective-corrected) view; needs no depth."""

from __future__ import annotations

from cartier.indexes.object_depth import LargestView
from cartier.types import MapObject, Place, View


def make() -> ObjectViewpoint:
    """It has no options."""
    return ObjectViewpoint()


class ObjectViewpoint(LargestView):
    """Position = camera position of the winning view, with the heading in which its box's centre was seen."""

    def place(self, obj: MapObject, view: View) -> Place:
        return Place(obj.label, view.camera, view.score, view.frame, view.box_xyxy, view_yaw=view.yaw, object_id=obj.id)
