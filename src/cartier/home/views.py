"""Views of a home for other programs: plain JSON values."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from cartier.home.data import HomeData
from cartier.spatial.relations import Relation, supports
from cartier.types import MapObject


def to_dict(home: HomeData) -> dict[str, Any]:
    """Everything in a home as plain JSON values; see ``Home.to_dict``."""
    standing = supports([obj for obj in home.objects if obj.confirmed]) if home.grid is not None else {}
    objects = sorted(home.objects, key=lambda obj: (not obj.confirmed, obj.id))
    cell_m2 = home.grid.resolution_m**2 if home.grid else 0.0
    return {
        "home": home.name,
        "id": home.id,
        "detector": home.detector,
        "objects": [_object(obj, standing.get(obj.id)) for obj in objects],
        "rooms": [
            {"id": r.id, "name": r.name, "kind": r.kind, "area_m2": round(len(r.cells) * cell_m2, 2)}
            for r in home.rooms
        ],
        "scale_guessed": home.scale_guessed,
        "notes": [*home.notes, *(home.corrected.notes if home.corrected else ())],
    }


def _object(obj: MapObject, on: Relation | None) -> dict[str, Any]:
    size_m = [round(high - low, 3) for low, high in zip(obj.box_min, obj.box_max, strict=True)]
    support = None if on is None else {"id": on.object, "relation": on.kind, "probability": round(on.probability, 3)}
    return {**asdict(obj), "located": obj.located, "size_m": size_m, "on": support}
