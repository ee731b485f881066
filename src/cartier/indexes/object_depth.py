"""ObjectDepth: the surface of each name's largest (perspective-corrected) view, among the confirmed objects."""

from __future__ import annotations

from cartier.indexes._objects import Objects
from cartier.types import MapObject, Place, View


def make() -> ObjectDepth:
    """It has no options."""
    return ObjectDepth()


class ObjectDepth(Objects):
    """Position = mean of the surface that the winning view shows (arXiv 2307.11865); objects seen without depth have none."""

    def place(self, thing: MapObject, view: View) -> Place | None:
        if view.surface is None:
            return None
        return Place(
            thing.label,
            view.surface,
            view.score,
            view.frame,
            view.box_xyxy,
            thing.box_min,
            thing.box_max,
            object_id=thing.id,
        )
