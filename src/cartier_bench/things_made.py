"""Requests and questions generated from the ground truth of a home; the same home and seed give the same lines."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from random import Random
from typing import Any

from cartier.types import MapObject
from cartier_bench.metrics import canonical
from cartier_bench.predicates import away, gap, sizes
from cartier_bench.statements import (
    FAR_APART_M,
    FIXTURES,
    LARGER,
    LONGER,
    NOT_NEXT_M,
    ONE_ROOM,
    SAME_PLACE,
    Statement,
    Statements,
    Words,
)
from cartier_bench.things import Item
from cartier_bench.true_home import TrueHome

EACH = 8  # of a kind in a home, at most
EASY = 2  # finds of a kind in a home may be of what is alone of its name
SINGLE, NONE = 1, 1  # objects that are alone of their name, or that are not there, are counted in a home
MOST = {"closest": 3, "between": 1}  # of these relations there are so many that they would leave no room for others
SPREAD_M = 1.5  # two of a name are so far apart, or nobody minds which
TYPOS, TERSE = 0.04, 0.06  # shares of texts
LIKE = 40  # times the volume: nobody compares an egg with a bed
MOST_LISTED = 12  # names in a list that anybody would want to hear


def make_items(home: TrueHome, seed: int = 0, each: int = EACH) -> list[Item]:
    """The requests of a home, ``each`` of a kind at most; ids are unique over homes."""
    words, made = Words(), list[Item]()
    for kind in ("relation", "room", "attribute", "superlative", "need", "follow_up", "bare", "count", "exists",
                 "where", "list", "compare", "nothing"):  # fmt: skip
        rng = Random(f"{home.name} {kind} {seed}")
        making = _Making(home, words, rng)
        found = list(making.finds(kind) if kind in _STATED else getattr(making, kind)())
        chosen = _spread(rng, found, each)
        made += [replace(item, id=f"{home.name}-{kind}-{number}") for number, item in enumerate(chosen, start=1)]
    return made


_STATED = ("relation", "room", "attribute", "superlative")


def _spread(rng: Random, items: list[Item], each: int) -> list[Item]:
    """Some of many, about as many objects and answers as there are: none comes twice before every other came once."""
    rng.shuffle(items)
    turn, order = Counter[Hashable](), list[tuple[int, int, Item]]()
    for item in items:
        about: Hashable = (item.accept_ids or item.turns, item.answer)
        order.append((turn[about], len(order), item))
        turn[about] += 1
    return [item for _, _, item in sorted(order, key=lambda row: row[:2])[:each]]


class _Making(Statements):
    """One method a kind; each yields requests without an id."""

    def _item(self, kind: str, text: str | Sequence[str], **true: Any) -> Item:
        turns = (text,) if isinstance(text, str) else tuple(text)
        return Item("", self.home.name, kind, tuple(self._typed(turn) for turn in turns), **true)

    def _typed(self, text: str) -> str:
        """A text as somebody types it: rarely with two letters swapped, or without articles."""
        if self.rng.random() < TERSE:
            text = re.sub(r"\b(the|a|an) ", "", text)
        words = text.split(" ")
        long = [k for k, word in enumerate(words) if len(word) > 5 and word.isalpha()]
        if long and self.rng.random() < TYPOS:
            k = self.rng.choice(long)
            at = self.rng.randrange(1, len(words[k]) - 2)
            words[k] = words[k][:at] + words[k][at + 1] + words[k][at] + words[k][at + 2 :]
        return " ".join(words)

    def _say(self, *path: str, **words: str) -> str:
        return self.words.pick(self.rng, *path).format(**words)

    def finds(self, kind: str) -> Iterator[Item]:
        """Relations, rooms, attributes and superlatives: mostly where there are several of the name."""
        stated = self.every()[kind]
        for how, most in MOST.items():
            some = [statement for statement in stated if statement.how == how]
            dropped = self.rng.sample(some, max(0, len(some) - most))
            stated = [statement for statement in stated if statement not in dropped]
        several = [statement for statement in stated if statement.others]
        alone = [statement for statement in stated if not statement.others]
        for statement in several + self.rng.sample(alone, min(len(alone), EASY)):
            yield self._item(kind, self._say("find", "texts", x=statement.phrase()), accept_ids=(statement.obj,))

    def need(self) -> Iterator[Item]:
        """A need and a room: whatever serves it there."""
        for need, (number, kind) in itertools.product(self.words.texts["need"]["needs"], self.rooms.items()):
            here = [obj for obj in self.home.objects if obj.room == number]
            strict = [obj for obj in here if obj.label in need["strict"] and obj.id in self.shown]
            if strict:
                accept = [obj.id for obj in here if obj.label in (*need["strict"], *need["loose"])]
                tail = self._tail("room", self.words.pick(self.rng, "rooms", kind))
                what = f"{self.rng.choice(need['texts'])} {tail}"
                yield self._item("need", self._say("need", "texts", x=what), accept_ids=tuple(accept))

    def follow_up(self) -> Iterator[Item]:
        """A bare name, and which one in the next turn; or the other one of two."""
        stated = self.every()
        for statement in itertools.chain(*stated.values()):
            objs = self.meant(statement.word)
            if not statement.others or not _apart(objs) or not self.so_called(statement.word, objs):
                continue
            if not statement.adjective or not statement.tail:
                how = "adjective" if statement.adjective else "second"
                first = self._first(statement.word)
                second = self._say("follow_up", how, t=statement.adjective or statement.tail)
                yield self._item("follow_up", (first, second), accept_ids=(statement.obj,))
            if statement.others == 1:
                other = next(obj.id for obj in objs if obj.id != statement.obj)
                if other in self.shown:
                    first = self._say("find", "texts", x=statement.phrase())
                    second = self._say("follow_up", "other", x=statement.word)
                    yield self._item("follow_up", (first, second), accept_ids=(other,))
        for word, objs in self._several():
            if len(objs) == 2:
                turns = self._first(word), self._say("follow_up", "other", x=word)
                yield self._item("follow_up", turns, accept_ids=tuple(t.id for t in objs), rejects=True)

    def _first(self, word: str) -> str:
        return self._say("follow_up", "first", x=word, a=_a(word))

    def _several(self) -> Iterator[tuple[str, list[MapObject]]]:
        """Words for two or more shown objects that do not stand together."""
        for word in sorted({word for label in self.labels - SAME_PLACE for word in self.names(label)}):
            objs = self.meant(word)
            if len(objs) > 1 and self.so_called(word, objs) and _apart(objs) and {t.id for t in objs} <= self.shown:
                yield word, objs

    def bare(self) -> Iterator[Item]:
        """A name of several, and nothing else: the nearest is accepted, where it is taken without a question."""
        for word, objs in self._several():
            far = {obj.id: away(self.home.start_xy, obj) for obj in objs}
            accept = tuple(i for i, metres in far.items() if metres <= min(far.values()) + FAR_APART_M)
            yield self._item("bare", self._say("bare", "texts", x=word, a=_a(word)), accept_ids=accept)

    def _exactly(self) -> Iterator[tuple[str, list[MapObject]]]:
        """Words that mean one type alone in this home, every object of which was shown."""
        for label in sorted(self.labels):
            objs = [obj for obj in self.home.objects if obj.label == label]
            sole = [word for word in self.names(label) if self.words.meant(word) & self.labels == {label}]
            if sole and {obj.id for obj in objs} <= self.shown:
                yield self.rng.choice(sole), objs

    def _absent(self) -> list[str]:
        """Names of what this home has nothing of, not by another name either."""
        here = {canonical(name) for label in self.labels for name in (label, *self.names(label))}
        return [
            name for name in self.words.texts["absent"]["names"]
            if canonical(name) not in here and not self.words.meant(name) & self.labels
        ]  # fmt: skip

    def count(self) -> Iterator[Item]:
        known = list(self._exactly())
        alone = [word for word, objs in known if len(objs) == 1]
        left_out = set(alone) - set(self.rng.sample(alone, min(len(alone), SINGLE)))
        for word, objs in known:
            n, ids = len(objs), tuple(obj.id for obj in objs)
            if word not in left_out:
                yield self._item("count", self._say("count", "texts", xs=plural(word)), accept_ids=ids, answer=n)
            for number, kind in self.rooms.items():
                inside = tuple(obj.id for obj in objs if obj.room == number)
                if inside and n > 1:
                    tail = _where(self._tail("room", self.words.pick(self.rng, "rooms", kind)))
                    yield self._item(
                        "count", self._say("count", "placed", xs=plural(word), t=tail), accept_ids=inside,
                        answer=len(inside)
                    )  # fmt: skip
        for name in self.rng.sample(self._absent(), NONE):
            yield self._item("count", self._say("count", "texts", xs=plural(name)), answer=0)

    def exists(self) -> Iterator[Item]:
        """As many that are true as are false, as far as there are."""
        true = [self._exists(word, True, tuple(t.id for t in objs)) for word, objs in self._exactly()]
        false = [self._exists(word, False) for word in self._absent()]
        for word, objs in self._exactly():
            for number, kind in self.rooms.items():
                inside = tuple(obj.id for obj in objs if obj.room == number)
                tail = _where(self._tail("room", self.words.pick(self.rng, "rooms", kind)))
                (true if inside else false).append(self._exists(word, bool(inside), inside, tail))
        for said in self.every()["relation"]:
            if said.how not in ("between", "closest"):
                true.append(self._exists(said.word, True, (said.obj,), _where(said.tail)))
        false += [self._exists(word, False, (), tail) for word, tail in self._untrue()]
        true, false = (_spread(self.rng, some, EACH // 2) for some in (true, false))
        yield from itertools.chain(*zip(true, false, strict=False))

    def _exists(self, word: str, true: bool, ids: tuple[int, ...] = (), tail: str = "") -> Item:
        words = {"a": _a(word), "xs": plural(word), "t": tail}
        return self._item(
            "exists", self._say("exists", "placed" if tail else "texts", **words), accept_ids=ids, answer=true
        )

    def _untrue(self) -> Iterator[tuple[str, str]]:
        """A word and where nothing that it means is, nor nearly: on an object, by one, or in a room."""
        for word, objs in self._exactly():
            if FIXTURES & {obj.label for obj in objs}:
                continue
            for place, landmark in self.furniture:
                if landmark not in objs and all(gap(obj, landmark) >= NOT_NEXT_M for obj in objs):
                    held = any(holder == landmark.id for holder, _ in self.home.holder.values())
                    carried = all(obj.id in self.home.holder for obj in objs)
                    yield word, _where(self._tail("on" if held and carried else "next to", place))

    def where(self) -> Iterator[Item]:
        """Its room, or all that it stands on; not in a home of one room, where nobody asks for the room."""
        for word, objs in self._exactly() if len(self.home.rooms) > 1 else ():
            if len(objs) != 1 or objs[0].room is None:
                continue
            obj, (_, kind) = objs[0], self.home.rooms[objs[0].room]
            held, ids = tuple(other.label for other in self.below(obj)), (obj.id,)
            if obj.room in self.rooms:
                rooms = tuple(self.words.texts["rooms"][kind])
                yield self._item("where", self._say("where", "room", x=word), accept_ids=ids, answer=rooms)
                yield self._item("where", self._say("where", "texts", x=word), accept_ids=ids, answer=(*rooms, *held))
            elif held:
                text = self._say("where", "texts", x=word)
                yield self._item("where", text, accept_ids=ids, answer=(*ONE_ROOM, *held))

    def list(self) -> Iterator[Item]:
        for place, landmark in self.landmarks:
            held = [self.by_id[i] for i, (holder, _) in self.home.holder.items() if holder == landmark.id]
            sure = [obj for obj in held if obj.id in self.shown and obj.label not in FIXTURES]
            if sure:
                _, chain = self.held_by(self.home.objects, place)
                how = {self.home.holder[obj.id][1] for obj in sure}
                ways = ("on", "in") if landmark.label == "shelving unit" else ("on",) if how == {"on"} else ("in",)
                if len(how) == 1 or landmark.label == "shelving unit":
                    yield self._listed(self._say("list", self.rng.choice(ways), y=place), sure, chain)
        for number, kind in self.rooms.items():
            inside = [obj for obj in self.home.objects if obj.room == number]
            sure = [obj for obj in inside if obj.id in self.shown and obj.id not in self.home.holder]
            if len({obj.label for obj in sure}) <= MOST_LISTED:
                name = self.words.pick(self.rng, "rooms", kind)
                yield self._listed(self._say("list", "room", y=name), sure, inside)

    def _listed(self, text: str, sure: Sequence[MapObject], maybe: Sequence[MapObject]) -> Item:
        names = tuple(sorted({obj.label for obj in sure}))
        others = tuple(sorted({obj.label for obj in maybe} - set(names)))
        return self._item("list", text, accept_ids=tuple(t.id for t in sure), answer=names, maybe=others)

    def compare(self) -> Iterator[Item]:
        """Which of two objects of different names has more of it, or is nearer, clearly."""
        sole = list(self.landmarks)
        for (one, a), (other, b) in itertools.permutations(sole, 2):
            volume, longest, height = sizes((a, b))
            if LARGER**2 * volume[1] <= volume[0] <= LIKE * volume[1] and longest[0] >= LONGER * longest[1]:
                yield self._compared("bigger", (one, a), (other, b), a)
            built_in = FIXTURES & {a.label, b.label}  # is it high because it hangs high?
            alike = volume[1] / LIKE <= volume[0] <= LIKE * volume[1] and a.box_max[2] > b.box_max[2]
            if height[0] >= LONGER * height[1] and alike and not built_in:
                yield self._compared("taller", (one, a), (other, b), a)
            if away(self.home.start_xy, a) + FAR_APART_M <= away(self.home.start_xy, b):
                yield self._compared("me", (one, a), (other, b), a)
            third, c = self.rng.choice(sole)
            if c not in (a, b) and a.room == b.room == c.room and gap(a, c) + FAR_APART_M <= gap(b, c):
                yield self._compared("nearer", (one, a), (other, b), a, third)

    def _compared(
        self, how: str, a: tuple[str, MapObject], b: tuple[str, MapObject], more: MapObject, place: str = ""
    ) -> Item:
        (one, first), (other, second) = self.rng.sample((a, b), 2)
        text = self._say("compare", how, a=one, b=other, y=place)
        return self._item("compare", text, accept_ids=(first.id, second.id), answer=(more.label,))

    def nothing(self) -> Iterator[Item]:
        """What this home has not, and what it has not there."""
        for need in self.words.texts["nothing"]["needs"]:
            if not {canonical(name) for name in need["unless"]} & {canonical(label) for label in self.labels}:
                yield self._item("nothing", self.rng.choice(need["texts"]))
        untrue = list(self._untrue())
        for number, kind in self.rooms.items():
            name = self.words.pick(self.rng, "rooms", kind)
            untrue += [
                (word, self._tail("room", name))
                for word, objs in self._exactly() if all(t.room != number for t in objs)
            ]  # fmt: skip
        for word, tail in self.rng.sample(untrue, min(len(untrue), len(self.words.texts["nothing"]["needs"]))):
            phrase = Statement("nothing", word, 0, 0, tail=tail).phrase()
            yield self._item("nothing", self._say("find", "texts", x=phrase))


def _apart(objs: Sequence[MapObject]) -> bool:
    """Whether every two of some objects are so far from each other that it matters which."""
    return all(gap(a, b) >= SPREAD_M for a, b in itertools.combinations(objs, 2))


def _where(tail: str) -> str:
    """A tail for "is there a …"."""
    return tail.removeprefix("that's ").removeprefix("that is ")


def _a(word: str) -> str:
    if word.endswith("s") and not word.endswith("ss"):
        return word if word in ("boots", "curtains") else f"some {word}" if word == "keys" else f"a {word}"
    return f"an {word}" if word[0] in "aeiou" else f"a {word}"


def plural(word: str) -> str:
    """The plural of an English noun phrase."""
    head, of, rest = word.partition(" of ")
    if head.endswith("s") and not head.endswith("ss"):
        return word
    if head.endswith(("ife", "lf", "af")):
        head = head.removesuffix("e")[:-1] + "ves"
    elif head.endswith(("s", "x", "ch", "sh", "to")):
        head += "es"
    elif head.endswith("y") and head[-2] not in "aeiou":
        head = head[:-1] + "ies"
    else:
        head += "s"
    return head + of + rest
