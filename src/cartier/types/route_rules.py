"""Route rules: what a person wants of the way, as typed values with one exact text form.

The text form is ``KIND TARGET STRENGTH SCOPE``, such as ``avoid floor:carpet hard drive`` or
``via room:living room soft standing``; ``shortest`` has no target. Every writer and reader of rules uses it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, time, timedelta
from typing import Literal, get_args

from cartier.errors import MAX_FAR_M, InputError, brief, need

RuleKind = Literal["avoid", "keep-away", "slow-near", "prefer", "only-through", "via", "shortest"]
TargetKind = Literal["room", "floor", "object", "door", "zone", "none"]
Strength = Literal["hard", "soft"]

FLOOR_KINDS = ("unknown", "tiles", "planks", "carpet", "rug")
"""Values of ``OccupancyGrid.floor_kinds`` are indices into this."""
MORNING = time(6)
"""When a night ends: "until tomorrow" holds until then."""
MAX_TARGETS, MAX_TARGET_CHARS, MAX_CORNERS = 200, 4000, 64
SCOPE = re.compile(r"drive|standing|until:(?P<until>tomorrow|HH)|daily:(?P<begin>HH)-(?P<end>HH)".replace(
    "HH", r"(?:[01]\d|2[0-3]):[0-5]\d")
)  # fmt: skip
UNDERSTOOD = "Understood: "
OWN_ARTICLES = ("the", "my", "your", "our", "object")
ESCAPED = {"%": "%25", ",": "%2C", "|": "%7C", ";": "%3B", "=": "%3D"}


@dataclass(frozen=True)
class RouteTarget:
    """What a route rule is about.

    Args:
        kind: "room", "floor" (a kind of floor), "object", "door" (a passage between two rooms), "zone" (a polygon), or
            "none": the words mean nothing that the home has.
        names: Names of rooms, kinds of floor, ``("hall", "kitchen")`` for each door in turn, the name of a zone, or
            the words that mean nothing.
        ids: The ids of the objects.
        polygon_xy: The corners of the zone (m).
        said: What the person called it, for sentences; it does not count in comparisons.
    """

    kind: TargetKind
    names: tuple[str, ...] = ()
    ids: tuple[int, ...] = ()
    polygon_xy: tuple[tuple[float, float], ...] = ()
    said: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        need(self.kind in get_args(TargetKind), f"a rule's target is no {brief(self.kind, 40)!r}")
        need(max(len(self.names), len(self.ids)) <= MAX_TARGETS, f"a rule has at most {MAX_TARGETS} targets")
        if self.kind == "object":
            need(bool(self.ids) and not self.names, "a rule about objects needs their ids")
        elif self.kind == "zone":
            far = [abs(v) for xy in self.polygon_xy for v in xy]
            inside = 3 <= len(self.polygon_xy) <= MAX_CORNERS and all(v <= MAX_FAR_M for v in far)
            need(inside, f"a zone has 3 to {MAX_CORNERS} corners x,y in metres")
            need(len(self.names) <= 1, "a zone has one name")
        else:
            need(bool(self.names), f"a rule about a {self.kind} must name it")
        if self.kind == "floor":
            wrong = [name for name in self.names if name not in FLOOR_KINDS[1:]]
            need(not wrong, f"a floor is {', '.join(FLOOR_KINDS[1:])}, not {brief(wrong[:1], 40)}")
        need(self.kind != "door" or len(self.names) % 2 == 0, "a door is named by the two rooms that it joins")

    @property
    def text(self) -> str:
        """``room:NAME``, ``floor:KIND``, ``object:ID,ID``, ``door:ROOM|ROOM``, ``zone:NAME=X,Y;X,Y;X,Y``;
        ``none:WORDS``; several names have commas between them."""
        names = [_escaped(name) for name in self.names]
        if self.kind == "object":
            told = ",".join(map(str, self.ids))
        elif self.kind == "door":
            told = ",".join(f"{one}|{other}" for one, other in zip(names[::2], names[1::2], strict=True))
        elif self.kind == "zone":
            corners = ";".join(f"{x:.10g},{y:.10g}" for x, y in self.polygon_xy)
            told = f"{names[0]}={corners}" if names else corners
        else:
            told = ",".join(names)
        return f"{self.kind}:{told}"

    @classmethod
    def parse(cls, text: str) -> RouteTarget:
        """A target from its text form.

        Args:
            text: What ``text`` gives.

        Returns:
            The target.

        Raises:
            InputError: It has another form.
        """
        need(len(text) <= MAX_TARGET_CHARS, f"a rule's target has at most {MAX_TARGET_CHARS} characters")
        kind, colon, told = text.partition(":")
        if not colon or kind not in get_args(TargetKind) or not told.strip():
            kinds = ", ".join(f"{name}:…" for name in get_args(TargetKind))
            raise InputError(f"a rule's target is one of {kinds}, not {brief(text, 60)!r}")
        try:
            return cls(kind, **_parts(kind, told.strip()))  # type: ignore[arg-type]  # checked above
        except (ValueError, OverflowError) as error:
            raise InputError(f"a rule's target cannot be read: {brief(text, 60)!r}") from error


def _parts(kind: str, told: str) -> dict[str, tuple[object, ...]]:
    if kind == "object":
        return {"ids": tuple(dict.fromkeys(int(part.strip().removeprefix("#")[:18]) for part in told.split(",")))}
    if kind == "zone":
        name, equals, corners = told.rpartition("=")
        pairs = [tuple(map(float, corner.split(","))) for corner in corners.split(";")]
        if any(len(pair) != 2 or not all(map(math.isfinite, pair)) for pair in pairs):
            raise ValueError(told)
        return {"names": (_plain(name),) if equals else (), "polygon_xy": tuple(pairs)}
    if kind == "door":
        names = [part.split("|") for part in told.split(",")]
        if any(len(pair) != 2 for pair in names):
            raise ValueError(told)
        return {"names": tuple(_plain(name) for pair in names for name in pair)}
    return {"names": tuple(_plain(name) for name in told.split(","))}


def _escaped(name: str) -> str:
    return "".join(ESCAPED.get(letter, letter) for letter in " ".join(name.split()))


def _plain(text: str) -> str:
    for letter, code in reversed(ESCAPED.items()):  # % last
        text = text.replace(code, letter)
    if not text.strip():
        raise ValueError(text)
    return text.strip()


@dataclass(frozen=True)
class RouteRule:
    """One rule for the way. Rules that say the same are equal, whoever said them.

    Args:
        kind: "avoid" (do not cross), "keep-away" (keep a distance), "slow-near" (be slow at it), "prefer" (rather go
            there), "only-through" (go nowhere else on the way there), "via" (pass it; in the order said) or "shortest"
            (no detour for a wish).
        target: What it is about; None for "shortest".
        strength: "hard" is obeyed, or the robot asks; "soft" is a wish, weighed against the detour.
        scope: How long it holds: "drive" (one drive; never stored), "standing" (until said otherwise), "until:HH:MM",
            "until:tomorrow", or "daily:HH:MM-HH:MM".
        said: The sentence that made it.
        made: When, in ISO 8601 with an offset; empty for now.
        id: The id of its entry in the home's log, empty if it is in none.
    """

    kind: RuleKind
    target: RouteTarget | None = None
    strength: Strength = "hard"
    scope: str = "drive"
    said: str = field(default="", compare=False)
    made: str = field(default="", compare=False)
    id: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        kinds = get_args(RuleKind)
        need(self.kind in kinds, f"a route rule is one of {', '.join(kinds)}, not {brief(self.kind, 40)!r}")
        need((self.target is None) == (self.kind == "shortest"), f"{self.kind}: only shortest has no target")
        need(self.strength in get_args(Strength), f"a rule is hard or soft, not {brief(self.strength, 40)!r}")
        scopes = "drive, standing, until:HH:MM, until:tomorrow or daily:HH:MM-HH:MM"
        need(SCOPE.fullmatch(self.scope) is not None, f"a rule holds for {scopes}, not {brief(self.scope, 40)!r}")

    @property
    def text(self) -> str:
        """The exact text form: ``avoid floor:carpet hard drive``."""
        target = [] if self.target is None else [self.target.text]
        return " ".join([self.kind, *target, self.strength, self.scope])

    @classmethod
    def parse(cls, text: str, said: str = "", made: str = "") -> RouteRule:
        """A rule from its text form.

        Args:
            text: What ``text`` gives. Strength and scope may be left out: "hard" and "drive".
            said: The sentence that made it.
            made: When, in ISO 8601.

        Returns:
            The rule.

        Raises:
            InputError: It has another form.
        """
        need(bool(text.strip()), "a route rule is KIND TARGET STRENGTH SCOPE: 'avoid floor:carpet hard drive'")
        kind, *told = text.split()
        scope = told.pop() if told and SCOPE.fullmatch(told[-1]) else "drive"
        strength = told.pop() if told and told[-1] in get_args(Strength) else "hard"
        target = RouteTarget.parse(" ".join(told)) if told else None
        return cls(kind, target, strength, scope, said, made)  # type: ignore[arg-type]  # checked when it is made

    @property
    def stays(self) -> bool:
        """Whether it holds beyond one drive."""
        return self.scope != "drive"

    def expired(self, now: datetime) -> bool:
        """Whether it will never hold again.

        Args:
            now: The time, with a time zone.

        Returns:
            True for a rule "until" a time that has passed.
        """
        until = SCOPE.fullmatch(self.scope)
        if until is None or until["until"] is None or not self.made:
            return False
        made = datetime.fromisoformat(self.made).astimezone(now.tzinfo)
        if until["until"] == "tomorrow":  # a night belongs to the day before
            day = (made - timedelta(hours=MORNING.hour)).date() + timedelta(days=1)
            return now >= datetime.combine(day, MORNING, now.tzinfo)
        end = datetime.combine(made.date(), time.fromisoformat(until["until"]), now.tzinfo)
        return now >= (end if end > made else end + timedelta(days=1))

    def holds(self, now: datetime) -> bool:
        """Whether it holds at a time.

        Args:
            now: The time, with the time zone of the home.

        Returns:
            False if it has expired, or outside of its daily hours.
        """
        daily = SCOPE.fullmatch(self.scope)
        if daily is not None and daily["begin"]:
            begin, end = time.fromisoformat(daily["begin"]), time.fromisoformat(daily["end"])
            at = now.time()
            return begin <= at < end if begin < end else at >= begin or at < end
        return not self.expired(now)

    def ends(self, other: RouteRule) -> bool:
        """Whether taking this rule back takes another back: the same kind and target.

        Args:
            other: A rule that holds.

        Returns:
            True if it ends. A target of several objects or rooms ends the rules about any of them.
        """
        if self.target is None or other.target is None:
            return self.kind == other.kind and self.target is other.target
        mine, others = self.target, other.target
        if self.kind != other.kind or mine.kind != others.kind:
            return False
        if mine.kind == "object":
            return not set(mine.ids).isdisjoint(others.ids)
        if mine.kind == "zone" and mine.names != others.names:
            return mine.polygon_xy == others.polygon_xy
        return not set(mine.names).isdisjoint(others.names) if mine.kind != "door" else _pairs(mine) <= _pairs(others)

    def in_words(self) -> str:
        """The rule in a few words.

        Returns:
            Such as "keep off the carpet, for this drive".
        """
        return f"{self.wish}, {_scope_in_words(self.scope)}"

    @property
    def wish(self) -> str:
        """The rule without how long it holds: "keep off the carpet", "rather go over the tiles"."""
        if self.target is None:
            return "take the shortest way"
        it, inside = called(self.target), self.target.kind in ("room", "zone")
        told = {
            "avoid": f"{'stay out of' if inside else 'do not use' if self.target.kind == 'door' else 'keep off'} {it}",
            "keep-away": f"keep away from {it}",
            "slow-near": f"go slowly {'in' if inside else 'on' if self.target.kind == 'floor' else 'near'} {it}",
            "prefer": f"go {'over' if self.target.kind == 'floor' else 'by'} {it}",
            "only-through": f"go only {'over' if self.target.kind == 'floor' else 'through'} {it}",
            "via": f"go {'through' if inside or self.target.kind == 'door' else 'past'} {it}",
        }[self.kind]
        return told if self.strength == "hard" else f"{told} if that is no great detour"


def echo(rules: Iterable[RouteRule], ended: Iterable[RouteRule] = ()) -> str:
    """What a robot says to words that only say how to drive.

    Args:
        rules: The rules that it understood.
        ended: Those that it takes back.

    Returns:
        One sentence, which begins with ``UNDERSTOOD``.
    """
    told = [rule.in_words() for rule in rules] + [f"no longer {rule.wish}" for rule in ended]
    return f"{UNDERSTOOD}{'; '.join(told)}."


def called(target: RouteTarget) -> str:
    """What a target is called in a sentence: "the carpet", "the hall and the kitchen".

    Args:
        target: The target of a rule.

    Returns:
        A noun phrase with its article; a name with an owner in it has none.
    """
    if target.kind == "none":
        return " ".join(target.names)
    if target.said:
        names: Iterable[str] = [target.said]
    elif target.kind == "object":
        names = [f"object {', '.join(map(str, target.ids))}"]
    elif target.kind == "door":
        joined = zip(target.names[::2], target.names[1::2], strict=True)
        names = [f"the door between {with_article(one)} and {with_article(other)}" for one, other in joined]
    else:
        names = target.names or ("zone",)
    return " and ".join(map(with_article, names))


def with_article(name: str) -> str:
    """A name in a sentence: "the kitchen", "bedroom 2", "Ben's room".

    Args:
        name: The name of a room, an object or a floor.

    Returns:
        The name with its article, where it takes one.
    """
    first = name.split(" ", 1)[0].lower()
    return name if name[-1:].isdigit() or first.endswith(("'s", "’s")) or first in OWN_ARTICLES else f"the {name}"


def _pairs(target: RouteTarget) -> set[frozenset[str]]:
    return {frozenset(pair) for pair in zip(target.names[::2], target.names[1::2], strict=True)}


def _scope_in_words(scope: str) -> str:
    if scope == "drive":
        return "for this drive"
    if scope == "standing":
        return "until you say otherwise"
    if scope.startswith("until:"):
        return f"until {scope[6:]}"
    begin, _, end = scope[6:].partition("-")
    return f"daily from {begin} to {end}"
