"""ObjectDepth: the surface of each name's largest (perspective-corrected) view, among the confirmed objects."""

from __future__ import annotations

from cartier.indexes._objects import Objects
from cartier.types import MapObject, Place, View


def make() -> ObjectDepth:
    """It has no options."""
    return ObjectDepth()


class ObjectDepth(Objects):
    """Position = mean of the surface that the winning view shows (arXiv 2307.11865); objects seen without depth have none."""

    def place(self, obj: MapObject, view: View) -> Place | None:
        if view.surface is None:
            return None
        return Place(
            obj.label,
            view.surface,
            view.score,
            view.frame,
            view.box_xyxy,
            obj.box_min,
            obj.box_max,
            object_id=obj.id,
        )
