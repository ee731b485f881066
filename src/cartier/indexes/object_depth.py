"""ObjectDepth: the surface of each name's largest (perspective-corrected) view, among the confirmed objects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy

from cartier.types import MapObject, Place, View


def make() -> ObjectDepth:
    """It has no options."""
    return ObjectDepth()


class LargestView(ABC):
    """One place per name: of the frame with the largest box, corrected for perspective distortion.

    Source: CARTIER (arXiv 2307.11865), object detection and spatial language index. The map of objects keeps the views.
    """

    def __init__(self) -> None:
        self._places: dict[str, Place] = {}

    def __deepcopy__(self, memo: dict[int, object]) -> LargestView:
        again = copy(self)
        again._places = dict(self._places)  # no place ever changes
        return again

    @abstractmethod
    def place(self, obj: MapObject, view: View) -> Place | None:
        """The place that a view of an object gives, or None if it gives none."""

    def locate_object(self, obj: MapObject) -> Place | None:
        """The place that the largest view of this very object gives."""
        places = (self.place(obj, view) for view in sorted(obj.views, key=lambda view: -view.size_px2))
        return next((place for place in places if place is not None), None)

    def set_objects(self, objects: Sequence[MapObject]) -> None:
        best: dict[str, tuple[float, Place]] = {}
        for obj in (obj for obj in objects if obj.confirmed):
            for view in obj.views:
                named = view.label == obj.label  # a view under another name only counts where there is none
                size = view.size_px2 if named else view.size_px2 * 1e-6
                for name in (obj.label, *obj.names):
                    place = self.place(obj, view) if size > best.get(name, (0.0,))[0] else None
                    if place is not None:
                        best[name] = size, place
        self._places = {name: place for name, (_, place) in best.items()}

    def names(self) -> list[str]:
        return sorted(self._places)

    def locate(self, name: str) -> Place | None:
        return self._places.get(name)

    def state(self) -> dict[str, bytes]:
        return {}

    def restore(self, state: Mapping[str, bytes]) -> None:  # noqa: B027
        """Nothing to take: ``set_objects`` brings the objects."""


class ObjectDepth(LargestView):
    """Position = mean of the surface that the largest view shows (arXiv 2307.11865); None for objects without depth."""

    def place(self, obj: MapObject, view: View) -> Place | None:
        if view.surface is None:
            return None
        seen = view.surface, view.score, view.frame, view.box_xyxy
        return Place(obj.label, *seen, obj.box_min, obj.box_max, object_id=obj.id)
