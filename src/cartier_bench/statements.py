"""Referring expressions that are true of one object: "the cup next to the sink", "the biggest table"; with a margin."""

from __future__ import annotations

import itertools
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from cartier.geometry import box_distance
from cartier.types import MapObject
from cartier_bench.predicates import NEXT_M, away, closest, gap, is_beside, only_between, sizes
from cartier_bench.true_home import TrueHome

TEXTS = Path(__file__).parent / "thing_texts" / "words.toml"
APART_M = 0.4  # from the middle of what is not meant to the box of what is: no answer can stand for both
NOT_NEXT_M = 1.0  # what is so far away is next to nothing
FAR_APART_M, FAR_APART = 0.7, 1.3  # nearest to a person: any other is so much, and so many times, farther
LARGER, LONGER = 1.6, 1.2  # times the volume, and the longest side, of what is bigger
DOMINANT, TRACE = 0.55, 0.15  # shares of its surface: of an object's colour, and of one that it does not have
FIXTURES = frozenset(
    {"sink", "faucet", "stove burner", "painting", "poster", "mirror", "shower head", "toilet paper hanger"}
)
"""Part of a counter rather than on it; or it hangs on a wall, whatever it touches."""
SAME_PLACE = frozenset({"stove burner", "faucet"})  # nobody asks for one of these
MOTLEY = frozenset(
    {"painting", "poster", "mirror", "book", "television", "key chain", "window"}
)  # nobody says one colour of these
SOMETHING_ELSE = frozenset({"bed", "fridge"})  # in a living room: people may call it any of these
ONE_ROOM = ("living room", "studio", "bedroom", "kitchen")


class Words:
    """``words.toml``: how objects are called and asked for."""

    def __init__(self, path: Path = TEXTS) -> None:
        self.texts: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        self.called: dict[str, list[str]] = self.texts["called"]

    def meant(self, word: str) -> set[str]:
        """The types that a word may mean."""
        named = {label for label, words in self.called.items() if word in words} or {word}
        return named | set(self.texts["also"].get(word, ()))

    def pick(self, rng: Random, *path: str) -> str:
        """One of the texts of an entry."""
        entry = self.texts
        for key in path:
            entry = entry[key]
        return str(rng.choice(list(entry)))


@dataclass(frozen=True)
class Statement:
    """A noun phrase that is true of one object: "the ``adjective`` ``word`` ``tail``"; ``others`` are so many of its
    name.

    ``how`` is the sort of its tail: on, in, under, next to, between, closest, room.
    """

    kind: str
    word: str
    obj: int
    others: int
    adjective: str = ""
    tail: str = ""
    how: str = ""

    def phrase(self) -> str:
        return " ".join(part for part in ("the", self.adjective, self.word, self.tail) if part)


class Statements:
    """All that can be said of the objects of a home, in words that are drawn anew for each."""

    def __init__(self, home: TrueHome, words: Words, rng: Random) -> None:
        self.home, self.words, self.rng = home, words, rng
        self.shown, self.by_id = home.shown, {obj.id: obj for obj in home.objects}
        kinds = Counter(kind for _, kind in home.rooms)
        odd = {obj.room for obj in home.objects if obj.label in SOMETHING_ELSE}
        self.rooms = {
            number: kind for number, (_, kind) in enumerate(home.rooms)
            if kinds[kind] == 1 and kind in words.texts["rooms"] and not (kind == "living room" and number in odd)
        }  # fmt: skip
        """The rooms that have a name which everybody understands."""

    @cached_property
    def labels(self) -> set[str]:
        return {obj.label for obj in self.home.objects}

    def meant(self, word: str) -> list[MapObject]:
        """All objects of the home that a word may mean."""
        labels = self.words.meant(word)
        return [obj for obj in self.home.objects if obj.label in labels]

    def names(self, label: str) -> list[str]:
        return self.words.called.get(label, [label])

    def so_called(self, word: str, objs: Iterable[MapObject]) -> bool:
        """Whether people call all of some objects by a word, rather than that it might mean them."""
        return all(word in self.names(obj.label) for obj in objs)

    def only(self, label: str) -> str | None:
        """A word that means an object of this type alone in this home, which is shown; else None."""
        sole = [word for word in self.names(label) if len(found := self.meant(word)) == 1 and found[0].id in self.shown]
        return self.rng.choice(sole) if sole else None

    def every(self) -> dict[str, list[Statement]]:
        """By kind: relation, room, attribute, superlative."""
        found: dict[str, list[Statement]] = {"relation": [], "room": [], "attribute": [], "superlative": []}
        said = sorted({word for label in self.labels - SAME_PLACE for word in self.names(label)})
        for word in said:
            objs = self.meant(word)
            for made in (self._held, self._next, self._under, self._between, self._closest, self._in_room):
                for statement in made(word, objs):
                    found[statement.kind].append(statement)
            for statement in itertools.chain(self._coloured(word, objs), self._ranked(word, objs)):
                found[statement.kind].append(statement)
        return found

    def _make(
        self, kind: str, word: str, objs: Sequence[MapObject], obj: MapObject, **said: str
    ) -> Iterator[Statement]:
        """The statement, if the object was shown and no other of the name is where an answer could stand for both."""
        low, high = np.array(obj.box_min[:2]), np.array(obj.box_max[:2])
        middles = np.array([other.position[:2] for other in objs if other.id != obj.id]).reshape(-1, 2)
        if obj.id in self.shown and self.so_called(word, [obj]) and (box_distance(middles, low, high) > APART_M).all():
            others = sum(self.so_called(word, [other]) for other in objs) - 1
            yield Statement(kind, word, obj.id, others, **said)

    def _tail(self, how: str, *places: str) -> str:
        return self.words.pick(self.rng, "tails", how).format(**dict(zip("yz", places, strict=False)))

    def _held(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        """What stands on or in something: only one of the name does on any such, and none by way of others."""
        if FIXTURES & {obj.label for obj in objs}:
            return
        for label in sorted({self.by_id[self.home.holder[t.id][0]].label for t in objs if t.id in self.home.holder}):
            place = self.rng.choice(self.names(label))
            direct, chain = self.held_by(objs, place)
            if len(direct) != 1 or len(chain) > 1 or label in SAME_PLACE:
                continue
            obj = direct[0]
            holder, how = self.home.holder[obj.id]
            if holder in self.shown:
                how = "shelf" if label == "shelving unit" else how
                yield from self._make("relation", word, objs, obj, how=how, tail=self._tail(how, place))

    def below(self, obj: MapObject) -> list[MapObject]:
        """What an object stands on or in, what that does, and so on."""
        found, held = list[MapObject](), self.home.holder.get(obj.id)
        while held:
            found.append(self.by_id[held[0]])
            held = self.home.holder.get(held[0])
        return found

    def held_by(self, objs: Iterable[MapObject], place: str) -> tuple[list[MapObject], list[MapObject]]:
        """What of some objects stands on or in what a word means; and what does so by itself or by way of others."""
        holders = {holder.id for holder in self.meant(place)}
        below = [(obj, [other.id for other in self.below(obj)]) for obj in objs]
        direct = [obj for obj, ids in below if ids and ids[0] in holders]
        return direct, [obj for obj, ids in below if holders.intersection(ids)]

    @cached_property
    def landmarks(self) -> list[tuple[str, MapObject]]:
        """Shown objects that a word means alone, each with it."""
        words = [self.only(label) for label in sorted(self.labels - SAME_PLACE)]
        return [(word, self.meant(word)[0]) for word in words if word]

    @cached_property
    def furniture(self) -> list[tuple[str, MapObject]]:
        """Those that stand on the floor by themselves."""
        return [(w, obj) for w, obj in self.landmarks if obj.id not in self.home.holder and obj.label not in FIXTURES]

    def _next(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for place, landmark in self.landmarks:
            if landmark in objs:
                continue
            far = {obj.id: gap(obj, landmark) for obj in objs}
            beside = [obj for obj in objs if is_beside(obj, landmark) and not self._holds(obj, landmark)]
            if len(beside) == 1 and all(
                far[t.id] >= max(NOT_NEXT_M, far[beside[0].id] + NEXT_M) or t.room != landmark.room
                for t in objs if t != beside[0]
            ):  # fmt: skip
                yield from self._make(
                    "relation", word, objs, beside[0], how="next to", tail=self._tail("next to", place)
                )

    def _holds(self, one: MapObject, other: MapObject) -> bool:
        """Whether one of two stands on the other, or both are parts of one counter."""
        below, above = (self.home.holder.get(t.id, (0, ""))[0] for t in (one, other))
        return below == other.id or above == one.id

    def _under(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for place, landmark in self.landmarks:
            below = [obj for obj in objs if (obj.id, landmark.id) in self.home.covered]
            if len(below) == 1 and landmark not in objs:
                yield from self._make("relation", word, objs, below[0], how="under", tail=self._tail("under", place))

    def _between(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for (place, one), (other_place, other) in itertools.combinations(self.furniture, 2):
            far = float(np.linalg.norm(np.subtract(one.position, other.position)[:2]))
            if one.room != other.room or not 1.0 < far < 3.5 or one in objs or other in objs:
                continue
            found = only_between(one, other, [obj for obj in objs if obj.id not in self.home.holder])
            if found is not None and self.by_id[found].room == one.room:
                tail = self._tail("between", place, other_place)
                yield from self._make("relation", word, objs, self.by_id[found], how="between", tail=tail)

    def _closest(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for place, landmark in self.landmarks:
            first = closest(landmark, objs) if landmark not in objs else None
            if first is not None and self.by_id[first].room == landmark.room:  # nobody means what is behind a wall
                yield from self._make(
                    "relation", word, objs, self.by_id[first], how="closest", tail=self._tail("closest", place)
                )

    def _in_room(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for number, kind in self.rooms.items():
            inside = [obj for obj in objs if obj.room == number]
            if len(inside) == 1:
                tail = self._tail("room", self.words.pick(self.rng, "rooms", kind))
                yield from self._make("room", word, objs, inside[0], how="room", tail=tail)

    def _coloured(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        for obj in objs:
            colour, share = obj.colours[0] if obj.colours else ("", 0.0)
            near = {colour, *self.words.texts["colours"].get(colour, ())}
            clear = all(
                share < TRACE or name not in near for t in objs if t != obj for name, share in t.colours
            ) and all(t == obj or t.colours for t in objs)
            if share >= DOMINANT and colour in self.words.texts["colours"] and clear and obj.label not in MOTLEY:
                yield from self._make("attribute", word, objs, obj, adjective=colour)

    def _ranked(self, word: str, objs: Sequence[MapObject]) -> Iterator[Statement]:
        """The biggest, the smallest and the tallest; the nearest and the farthest from where the person stands."""
        if len(objs) < 2 or not self.so_called(word, objs):
            return
        volume, longest, height = sizes(objs)
        for how, sign in (("biggest", 1), ("smallest", -1)):
            order = np.argsort(-sign * volume)
            first, second = (order[0], order[1]) if sign > 0 else (order[1], order[0])
            if volume[first] >= LARGER * volume[second] and longest[first] >= LONGER * longest[second]:
                obj, said = objs[int(order[0])], self.words.pick(self.rng, "superlatives", how)
                yield from self._make("superlative", word, objs, obj, adjective=said)
                if len(objs) == 2:
                    said = self.words.pick(self.rng, "superlatives", "big" if sign > 0 else "small")
                    yield from self._make("attribute", word, objs, obj, adjective=said)
        tall = np.argsort(-height)
        if height[tall[0]] >= LONGER * height[tall[1]]:
            yield from self._make("superlative", word, objs, objs[int(tall[0])], adjective="tallest")
        far = np.array([away(self.home.start_xy, obj) for obj in objs])
        for how, order in (("nearest", np.argsort(far)), ("farthest", np.argsort(-far))):
            a, b = sorted(far[order[:2]].tolist())
            if b >= max(a + FAR_APART_M, a * FAR_APART):
                said = self.words.pick(self.rng, "superlatives", how)
                tail = self.words.pick(self.rng, "superlatives", f"{how}_to")
                yield from self._make("superlative", word, objs, objs[int(order[0])], adjective=said, tail=tail)
