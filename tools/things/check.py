"""Accepted answers of ``written.txt``, computed from the truth of their homes: ``thing_texts/written.jsonl``.

python tools/things/check.py [--keep FOLDER]
    prints faults by line, never the words; writes only where there is none

What is true stands in each line in a small language. ``mug,cup; room kitchen; on desk`` are the mugs and cups in the
kitchen that stand on a desk; further filters: ``in X``, ``by X``, ``closest X``, ``between A,B``, ``has X``, ``colour
C``, ``big``, ``small``, ``tall``, ``near``, ``far`` (from where the robot starts), ``id 3,4``. A count begins with its
number and exists with yes or no, which are compared with the truth; ``list`` is ``on X``, ``in X`` or ``room R``;
``compare`` is ``bigger A|B``, ``taller A|B``, ``me A|B`` or ``nearer X: A|B``. ``reject!`` marks a last turn that turns
down what the one before it led to. What is computed: the accepted ids, the nearest ones of a bare name, counts, holders
and rooms, lists; what is checked: that things were shown, that nothing else of a name is where an answer could stand
for both, and that superlatives and comparisons have a margin.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

from cartier import plugins
from cartier.geometry import box_distance
from cartier.types import MapObject
from cartier_bench.predicates import MARGIN_M, away, gap, is_beside, sizes
from cartier_bench.statements import (
    APART_M,
    FAR_APART_M,
    FIXTURES,
    LONGER,
    ONE_ROOM,
    SOMETHING_ELSE,
)
from cartier_bench.things import FIND, WRITTEN, Item, load_items
from cartier_bench.true_home import TrueHome, true_home

SOURCE = Path(__file__).with_name("written.txt")
CLEARLY = 1.2  # times as big as any other
ROOMS = {"living room": ("living room", "lounge"), "hall": ("hall", "hallway")}


class Fault(Exception):
    """What a line claims is not so."""


class Home:
    """The truth of a home, asked in the language of ``written.txt``."""

    def __init__(self, truth: TrueHome) -> None:
        self.truth, self.by_id = truth, {obj.id: obj for obj in truth.objects}

    def things(self, claim: str) -> list[MapObject]:
        labels, *filters = (part.strip() for part in claim.split(";"))
        names = [name.strip() for name in labels.split(",")]
        found = [obj for obj in self.truth.objects if obj.label in names]
        for one in filters:
            word, _, rest = one.partition(" ")
            found = self._filters()[word](found, [part.strip() for part in rest.split(",")])
        return found

    def _filters(self) -> dict[str, Callable[[list[MapObject], list[str]], list[MapObject]]]:
        return {
            "room": lambda found, of: [t for t in found if self.room(t)[1] == of[0]],
            "on": self._held, "in": self._held,
            "has": lambda found, of: [t for t in found if any(self._holder(o) == t for o in self._all(of[0]))],
            "by": lambda found, of: [t for t in found if any(is_beside(t, o) for o in self._all(of[0]))],
            "closest": self._closest,
            "between": self._between,
            "colour": lambda found, of: [t for t in found if t.colours and t.colours[0][0] == " ".join(of)],
            "id": lambda found, of: [t for t in found if str(t.id) in of],
            "big": lambda found, _: self._most(found, sizes(found)[0], CLEARLY),
            "small": lambda found, _: self._most(found, -sizes(found)[0], CLEARLY),
            "tall": lambda found, _: self._most(found, sizes(found)[2], 1.1),
            "near": lambda found, _: self._first(found, [away(self.truth.start_xy, t) for t in found]),
            "far": lambda found, _: self._first(found, [-away(self.truth.start_xy, t) for t in found]),
        }  # fmt: skip

    def _all(self, label: str) -> list[MapObject]:
        found = [obj for obj in self.truth.objects if obj.label == label]
        if not found:
            raise Fault(f"there is no {label}")
        return found

    def _holder(self, obj: MapObject) -> MapObject | None:
        held = self.truth.holder.get(obj.id)
        return self.by_id[held[0]] if held else None

    def below(self, obj: MapObject) -> list[MapObject]:
        holder = self._holder(obj)
        return [holder, *self.below(holder)] if holder else []

    def room(self, obj: MapObject) -> tuple[str, str]:
        return self.truth.rooms[obj.room or 0]

    def _held(self, found: list[MapObject], of: list[str]) -> list[MapObject]:
        self._all(of[0])
        return [t for t in found if (holder := self._holder(t)) and holder.label == of[0]]

    def _closest(self, found: list[MapObject], of: list[str]) -> list[MapObject]:
        places = self._all(of[0])
        first = self._first(found, [min(gap(t, o) for o in places if o != t) for t in found], MARGIN_M)
        if any(min(places, key=lambda o: gap(t, o)).room != t.room for t in first):
            raise Fault(f"{of[0]} is in another room")
        return first

    def _between(self, found: list[MapObject], of: list[str]) -> list[MapObject]:
        (a, *_), (b, *_) = self._all(of[0]), self._all(of[1])
        low, high = np.minimum(a.position, b.position), np.maximum(a.position, b.position)
        return [t for t in found if float(box_distance(np.array(t.position[:2]), low[:2], high[:2])) < 0.3]

    @staticmethod
    def _first(found: list[MapObject], metres: Sequence[float], margin_m: float = FAR_APART_M) -> list[MapObject]:
        order = np.argsort(metres)
        if len(found) > 1 and metres[order[1]] - metres[order[0]] < margin_m:
            raise Fault(f"two are as near or far: {[found[k].id for k in order[:2]]}")
        return [found[int(order[0])]] if found else []

    @staticmethod
    def _most(found: list[MapObject], much: Sequence[float], times: float) -> list[MapObject]:
        order = np.argsort(-np.asarray(much))
        if len(found) > 1:
            first, second = sorted(abs(much[int(k)]) for k in order[:2])
            if second < times * first:
                raise Fault(f"two are as large: {[found[int(k)].id for k in order[:2]]}")
        return [found[int(order[0])]] if found else []


def item(home: Home, kind: str, claim: str, turns: tuple[str, ...], key: str) -> Item:
    """One line as a request. Raises Fault where the truth is otherwise."""
    name, rejects, claim = home.truth.name, claim.startswith("reject!"), claim.removeprefix("reject!").strip()
    if kind == "compare":
        return _compared(home, claim, turns, key)
    if kind == "list":
        return _listed(home, claim, turns, key)
    said, _, rest = claim.partition(" ")
    objs = home.things(rest if kind in ("count", "exists") else claim)
    ids = tuple(obj.id for obj in objs)
    hidden = [i for i in ids if i not in home.truth.shown]
    if kind == "count":
        if int(said) != len(objs) or hidden:
            raise Fault(f"there are {len(objs)}, of which {len(hidden)} were not shown")
        return Item(key, name, kind, turns, ids, len(objs))
    if kind == "exists":
        if (said == "yes") != bool(objs) or hidden:
            raise Fault(f"there are {len(objs)}, of which {len(hidden)} were not shown")
        return Item(key, name, kind, turns, ids, bool(objs))
    if kind == "nothing":
        if objs:
            raise Fault(f"there are {len(objs)}")
        return Item(key, name, kind, turns)
    if not objs or (hidden and kind != "need") or not set(ids) & home.truth.shown:
        raise Fault(f"{len(objs)} things, of which {len(hidden)} were not shown")
    if kind == "where":
        return _placed(home, objs, turns, key)
    if kind == "bare":
        far = {obj.id: away(home.truth.start_xy, obj) for obj in objs}
        if len(far) < 2:
            raise Fault("there is only one")
        ids = tuple(i for i, metres in far.items() if metres <= min(far.values()) + FAR_APART_M)
        return Item(key, name, kind, turns, ids)
    assert kind in FIND
    if not rejects and kind != "need":
        if len(ids) != 1:
            raise Fault(f"{len(ids)} things, not one: {ids}")
        _alone(home, objs[0])
    return Item(key, name, kind, turns, ids, rejects=rejects)


def _alone(home: Home, obj: MapObject) -> None:
    low, high = np.array(obj.box_min[:2]), np.array(obj.box_max[:2])
    for other in home.truth.objects:
        near = float(box_distance(np.array(other.position[:2]), low, high)) <= APART_M
        if other.id != obj.id and other.label == obj.label and near:
            raise Fault(f"{other.label} {other.id} is so near that an answer could stand for both")


def _placed(home: Home, objs: Sequence[MapObject], turns: tuple[str, ...], key: str) -> Item:
    if len(objs) != 1:
        raise Fault(f"{len(objs)} things, not one")
    obj, (_, kind) = objs[0], home.room(objs[0])
    odd = kind == "living room" and any(t.label in SOMETHING_ELSE and t.room == obj.room for t in home.truth.objects)
    names = ONE_ROOM if odd else ROOMS.get(kind, (kind,))
    return Item(key, home.truth.name, "where", turns, (obj.id,), (*names, *(t.label for t in home.below(obj))))


def _listed(home: Home, claim: str, turns: tuple[str, ...], key: str) -> Item:
    how, _, rest = claim.partition(" ")
    shown = home.truth.shown
    if how == "room":
        inside = home.things(f"{','.join({t.label for t in home.truth.objects})}; room {rest}")
        sure = [t for t in inside if t.id in shown and t.id not in home.truth.holder]
    else:
        holders = home.things(rest)
        if len(holders) != 1:
            raise Fault(f"{len(holders)} such, not one")
        inside = [t for t in home.truth.objects if holders[0] in home.below(t)]
        sure = [t for t in inside if home._holder(t) == holders[0] and t.id in shown and t.label not in FIXTURES]
    if not sure:
        raise Fault("nothing is there")
    names = tuple(sorted({t.label for t in sure}))
    maybe = tuple(sorted({t.label for t in inside} - set(names)))
    return Item(key, home.truth.name, "list", turns, tuple(t.id for t in sure), names, maybe)


def _compared(home: Home, claim: str, turns: tuple[str, ...], key: str) -> Item:
    how, _, rest = claim.partition(" ")
    place, _, pair = rest.rpartition(":")
    (a, *more), (b, *others) = (home.things(name) for name in pair.split("|"))
    if more or others:
        raise Fault("a thing that is compared is not alone of its name")
    volume, _, height = sizes((a, b))
    if how == "nearer":
        (c,) = home.things(place)
        much, clear = [-gap(a, c), -gap(b, c)], abs(gap(a, c) - gap(b, c)) >= FAR_APART_M
    elif how == "me":
        much = [-away(home.truth.start_xy, t) for t in (a, b)]
        clear = abs(much[0] - much[1]) >= FAR_APART_M
    else:
        much = list(volume if how == "bigger" else height)
        clear = max(much) >= LONGER * min(much)
    if not clear:
        raise Fault("hardly a difference")
    return Item(key, home.truth.name, "compare", turns, (a.id, b.id), ((a if much[0] > much[1] else b).label,))


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument(
        "--keep", type=Path, help="where the truth of homes is kept between runs, as by cartier bench things --maps"
    )
    keep = parser.parse_args().keep or Path(tempfile.mkdtemp())
    world, homes, items, faults = plugins.make("worlds", "dollhouse"), dict[str, Home](), list[Item](), list[str]()
    for number, line in enumerate(SOURCE.read_text("utf-8").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            name, kind, claim, text = (part.strip() for part in line.split(" ~ "))
            if name not in homes:
                homes[name] = Home(true_home(world, name, 0, keep))
            turns = tuple(turn.strip() for turn in text.split("||"))
            items.append(item(homes[name], kind, claim, turns, f"written-{len(items) + 1:03d}"))
        except (Fault, ValueError, KeyError) as error:
            faults.append(f"{SOURCE.name}:{number}: {type(error).__name__} {error}")
    if faults:
        raise SystemExit("\n".join(faults))
    WRITTEN.write_text("".join(json.dumps(one.to_dict(), ensure_ascii=False) + "\n" for one in items), "utf-8")
    assert load_items(WRITTEN) == items
    print(f"{len(items)} requests in {len(homes)} homes: {WRITTEN}")


if __name__ == "__main__":
    run_script(main)
