"""Data of a mapped home: objects with their evidence, rooms, floor plan, indices, photos and provenance."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cartier.contracts import SpatialIndex
from cartier.home.corrected import Corrected
from cartier.home.store import Store
from cartier.types import Camera, Inventory, MapObject, OccupancyGrid, Room
from cartier.types.route_rules import RouteRule


@dataclass(frozen=True, eq=False)
class HomeData:
    """The fields of a ``Home``, and what follows from them; ``repository.py`` and ``views.py`` need nothing else."""

    name: str
    detector: str
    camera: Camera
    objects: tuple[MapObject, ...]
    indexes: Mapping[str, SpatialIndex]
    grid: OccupancyGrid | None
    start_xy: tuple[float, float]
    settings: Mapping[str, Any]
    rooms: tuple[Room, ...] = ()
    photos: Mapping[int, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    growth: Mapping[str, bytes] = field(default_factory=dict)
    store: Store | None = None
    corrected: Corrected | None = None

    @property
    def id(self) -> str:
        """Twelve hex digits: the same for the same recordings mapped with the same settings."""
        made_by = json.dumps(dict(self.settings), sort_keys=True)
        return hashlib.sha256(made_by.encode()).hexdigest()[:12]

    @property
    def mapped_name(self) -> str:
        """The name without the one that people gave it."""
        return self.name if self.corrected is None else self.corrected.mapped_name

    @property
    def rules(self) -> tuple[RouteRule, ...]:
        """The route rules that people gave and did not take back, oldest first, expired ones among them."""
        return () if self.corrected is None else self.corrected.rules

    @property
    def scale_guessed(self) -> bool:
        """Whether the scale is a guess: then lengths are right relative to each other, but not in metres."""
        return self.settings.get("scale_guessed") is True

    @property
    def names(self) -> list[str]:
        """The labels of all confirmed objects and the names that people gave them, each once, sorted."""
        return Inventory(self.objects).names


def origin_of(settings: Mapping[str, Any]) -> str:
    """What names the pose frame of a home: its first recording, for growing and mapping it again keep that frame."""
    recordings = settings.get("recordings") or [{}]
    return "".join(filter(str.isalnum, str(recordings[0].get("sha256", ""))))[:12]
