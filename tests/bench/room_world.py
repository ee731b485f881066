"""A world of three tiny rooms, rendered in closed form, so that a whole bench takes a second."""

from __future__ import annotations

from typing import Any

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.types import TrueObject
from synthetic import THINGS, box, walk

EXTRAS = {
    "north": [],
    "south": [box(7, "Sofa", (0.4, 2.6, 0), (1.6, 3.4, 0.8))],
    "east": [box(8, "Bed", (0.3, 2.2, 0), (1.5, 3.6, 0.6))],
}


def make() -> Rooms:
    return Rooms()


class Rooms:
    name = "rooms"

    def homes(self) -> list[str]:
        return list(EXTRAS)

    def explore(self, home: str, **options: Any) -> Recording:
        recording = walk(self.objects(home))
        recording.name = f"rooms {home}"
        return recording

    def objects(self, home: str) -> list[TrueObject]:
        if home not in EXTRAS:
            raise InputError(f"there is no room {home!r}; there are {', '.join(EXTRAS)}")
        return [*THINGS, *EXTRAS[home]]

    def free(self, home: str, xy: Any) -> bool:
        return True
