"""Look-ups by name and between two objects, for the operations ``find`` and ``relate``."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import NamedTuple

from cartier.errors import InputError
from cartier.home import Home
from cartier.spatial import relations
from cartier.spatial.relations import Relation
from cartier.types import MapObject

CLOSE, SPELT = 0.75, 3  # least similarity of spelling, and how many such names count
LIKELY = 0.5  # least probability of a relation that is told


class Named(NamedTuple):
    """The objects of a name: ``sure`` are shown, ``maybe`` are as many more; ``spelt`` are names of like spelling.

    ``weak`` says of an object by its id that the name is only a label that some detections gave it.
    """

    sure: list[MapObject]
    maybe: int
    spelt: list[str]
    weak: dict[int, str]


def named(objects: Sequence[MapObject], wanted: str) -> Named:
    """The objects of a name (in lower case), else of names of like spelling; the surest first."""
    names = {obj.id: [n.casefold() for n in (*obj.names, obj.label)] for obj in objects}
    labels = {obj.id: [n.casefold() for n, _ in obj.labels] for obj in objects}
    hits, close = [t for t in objects if any(wanted in n for n in names[t.id] + labels[t.id])], list[str]()
    if not hits:
        known = sorted({n for t in objects for n in names[t.id] + labels[t.id]})
        close = get_close_matches(wanted, known, SPELT, CLOSE)
        hits = [t for t in objects if set(close) & {*names[t.id], *labels[t.id]}]
    hits.sort(key=lambda t: (wanted not in names[t.id], not t.confirmed, -t.probability, t.id))
    own = [t for t in hits if any(word in n for n in names[t.id] for word in (wanted, *close))]
    confirmed, sure_names = [t for t in hits if t.confirmed], [t for t in own if t.confirmed]
    sure = sure_names or own or confirmed or hits
    weak = {t.id: _weak(t, wanted, close) for t in sure if t not in own}
    return Named(sure, len(hits) - len(sure), close, weak)


def _weak(obj: MapObject, wanted: str, close: Sequence[str]) -> str:
    """By which label, and by how much of its evidence, an object matches that is called otherwise."""
    label, weight = max(
        ((n, w) for n, w in obj.labels if wanted in n.casefold() or n.casefold() in close), key=lambda row: row[1]
    )
    share = weight / max(sum(w for _, w in obj.labels), 1e-9)
    return f"is no {label} by its name: {label} is {share:.0%} of its labels"


def placed(
    a: MapObject, b: MapObject, confirmed: Sequence[MapObject], seen_from: Sequence[float]
) -> tuple[list[Relation], str | None]:
    """How two objects stand to each other: one of on, in, under, next to, left and right of; and which is bigger.

    The second value is the side of ``b`` that ``a`` is on, "left" or "right", from ``seen_from``; None where neither,
    and where one bears or covers the other: what lies on a table is not left of it.
    """
    held = relations.supports(confirmed)
    bearing = [r for k, r in held.items() if {k, r.object} == {a.id, b.id}]
    bearing = _likeliest(bearing) or _likeliest([*relations.under(b, [a]), *relations.under(a, [b])])
    sides = [*relations.left_of(b, [a], seen_from), *relations.right_of(b, [a], seen_from)]
    beside = [] if bearing else _likeliest(sides)
    placement = bearing or _likeliest(relations.next_to(b, [a])) or beside
    side = beside[0].kind.partition(" ")[0] if beside else None
    return placement + _likeliest([relations.bigger(a, b), relations.bigger(b, a)]), side


def _likeliest(found: Sequence[Relation]) -> list[Relation]:
    """The most probable relation, if it is probable enough."""
    best = max(found, key=lambda r: r.probability, default=None)
    return [best] if best is not None and best.probability >= LIKELY else []


def start_of(here_xy: Sequence[float], from_x: float | None, from_y: float | None) -> Sequence[float]:
    """Where a drive begins, by default ``here_xy``. Raises InputError for half a place."""
    if (from_x is None) != (from_y is None):
        raise InputError("a start needs both from_x and from_y, in metres of the map")
    return here_xy if from_x is None or from_y is None else (from_x, from_y)


def confirmed_of(home: Home, *more: MapObject) -> list[MapObject]:
    """The confirmed objects of a home, and some more of it."""
    return [t for t in home.objects if t.confirmed or t in more]
