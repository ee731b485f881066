"""Upper bound of ``cartier bench things``: what a perfect reasoner could reach with the maps.

python benchmarks/things.py RUN/requests.jsonl [--maps DIR]

Finds and bare names: whether the map has an object where an accepted thing is, and leads to it. Counts: how many
objects of those types the map has, in the rooms in question. Where: the object's room, and what the map says it stands
on. Lists: what stands on the same thing, or in the same room. Exists: whether what is there is in the map. Detections
are ground truth and from pixels.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
from command_line import Parser, run_script

from cartier.home import Home
from cartier.spatial.relations import supports
from cartier.types import MapObject, Selection, TrueObject
from cartier_bench.maps import Maps, MapSettings, encoder_for
from cartier_bench.things import FIND, Given, Item, load_items, score
from cartier_bench.things_run import DETECTORS
from cartier_bench.true_home import TrueHome, true_home

SAME_M = 1.0  # an object of the map is at most so far from the true thing of its name


class Best:
    """The best answers that a map allows, from the truth of what is asked."""

    def __init__(self, home: Home, true: TrueHome, truth: dict[int, TrueObject]) -> None:
        self.home, self.true, self.truth = home, true, truth
        self.objects = [obj for obj in home.objects if obj.confirmed]
        self.by_id, self.holder = {obj.id: obj for obj in self.objects}, supports(self.objects)
        self.things = {obj.id: obj for obj in true.objects}
        self.rooms = {room.id: room.kind for room in home.rooms}

    def right(self, item: Item) -> tuple[bool, float | None]:
        """Whether the best answer is right, and the F1 of a list."""
        told = score(item, self._answer(item), self.truth)
        return told.right, told.f1

    def _answer(self, item: Item) -> Given:
        if item.kind in (*FIND, "bare"):
            places = [self.home.locate(Selection("found", o.label, object_id=o.id)) for o in self._mapped(item)]
            given = [Given(item.id, "found", place.position, text="the nearest") for place in places if place]
            return next((g for g in given if score(item, g, self.truth).right), Given(item.id, "absent"))
        return Given(item.id, "told", answer=getattr(self, f"_{item.kind}")(item))

    def _mapped(self, item: Item) -> list[MapObject]:
        found = [self._of(self.things[i]) for i in item.accept_ids]
        return [obj for obj in found if obj is not None]

    def _of(self, true: MapObject) -> MapObject | None:
        far = {
            k: float(np.linalg.norm(np.subtract(obj.position, true.position)))
            for k, obj in enumerate(self.objects) if obj.label == true.label
        }  # fmt: skip
        nearest = min(far, key=lambda k: far[k], default=None)
        return None if nearest is None or far[nearest] > SAME_M else self.objects[nearest]

    def _kind(self, true: MapObject) -> str:
        return self.true.rooms[true.room or 0][1]

    def _in_rooms_of(self, item: Item) -> list[MapObject]:
        """The map's objects in the rooms of what is accepted."""
        kinds = {self._kind(self.things[i]) for i in item.accept_ids}
        return [obj for obj in self.objects if self.rooms.get(-1 if obj.room is None else obj.room) in kinds]

    def _count(self, item: Item) -> int:
        labels = {self.things[i].label for i in item.accept_ids}
        everywhere = sum(obj.label in labels for obj in self.true.objects) == item.answer
        return sum(obj.label in labels for obj in (self.objects if everywhere else self._in_rooms_of(item)))

    def _exists(self, item: Item) -> bool:
        return bool(self._mapped(item))

    def _where(self, item: Item) -> str | None:
        known = [self.rooms.get(-1 if obj.room is None else obj.room, "") for obj in self._mapped(item)]
        known += [self.by_id[self.holder[o.id].object or 0].label for o in self._mapped(item) if o.id in self.holder]
        return next((word for word in known if score(item, Given("", "told", answer=word), self.truth).right), None)

    def _list(self, item: Item) -> list[str]:
        holders = {self.true.holder.get(i, (0, ""))[0] for i in item.accept_ids}
        if 0 in holders or len(holders) > 1:
            return [obj.label for obj in self._in_rooms_of(item)]
        holder = self._of(self.things[holders.pop()])
        return [self.by_id[i].label for i, on in self.holder.items() if holder is not None and on.object == holder.id]


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("requests", type=Path, help="the requests.jsonl of a run")
    parser.add_argument("--maps", type=Path, help="as cartier bench things --maps; default: the run's own")
    options = parser.parse_args()
    keep, items = options.maps or options.requests.parent / "maps", load_items(options.requests)
    asked = [item for item in items if item.kind not in ("compare", "nothing")]
    for detector in DETECTORS:
        right, f1 = defaultdict[str, list[bool]](list), list[float]()
        maps = Maps(keep, MapSettings(detector=detector, encoder=encoder_for(detector)), ("object_depth",))
        for name in dict.fromkeys(item.home for item in asked):
            truth = {obj.id: obj for obj in maps.world.objects(name)}
            best = Best(maps.get(name), true_home(maps.world, name, 0, keep), truth)
            for item in asked:
                if item.home == name:
                    is_right, share = best.right(item)
                    right[item.kind].append(is_right)
                    f1 += [] if share is None else [share]
        print(detector, ", ".join(f"{kind} {np.mean(is_right):.3f}" for kind, is_right in right.items()))
        print(f"  F1 of lists {np.mean(f1 or [1]):.3f}")


if __name__ == "__main__":
    run_script(main)
