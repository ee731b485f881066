"""Metrics of an answer: whether it names an accepted object, and the distance from its place to one."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from cartier.geometry import box_distance
from cartier.labels import display_name
from cartier.types import TrueObject


@cache
def _table() -> tuple[dict[str, str], frozenset[frozenset[str]]]:
    table = tomllib.loads((Path(__file__).parent / "matching.toml").read_text(encoding="utf-8"))
    same = {_key(name): _key(group[0]) for group in table["synonyms"] for name in group}
    return same, frozenset(frozenset(map(_key, pair)) for pair in table["together"])


def canonical(name: str) -> str:
    """One name for all synonyms of an object, as published in ``matching.toml``."""
    return _table()[0].get(_key(name), _key(name))


def matches(named: str | None, accept: Iterable[str]) -> bool:
    """Whether a name is one of the acceptable ones, a synonym of one, or of an object that always comes with one."""
    if named is None:
        return False
    mine = canonical(named)
    others = {canonical(name) for name in accept}
    return mine in others or any(frozenset((mine, other)) in _table()[1] for other in others)


def listed_as(name: str, objects: Sequence[str]) -> str | None:
    """The object of a list that a free name means, if any."""
    by_key = {_key(listed): listed for listed in reversed(objects)}
    by_meaning = {canonical(listed): listed for listed in reversed(objects)}
    return by_key.get(_key(name)) or by_meaning.get(canonical(name))


def distances(
    position: Sequence[float] | None, truth: Iterable[TrueObject], accept: Collection[str]
) -> tuple[float | None, float | None]:
    """Metres from a position to the nearest acceptable true box, in space and on the floor plan; None without a
    position."""
    boxes = [obj for obj in truth if display_name(obj.label) in accept]
    if position is None or not boxes:
        return None, None
    low, high = np.array([b.box_min for b in boxes]), np.array([b.box_max for b in boxes])
    here = np.asarray(position)
    in_space = float(box_distance(here, low, high).min())
    return in_space, float(box_distance(here[:2], low[:, :2], high[:, :2]).min())


def _key(name: str) -> str:
    words = display_name(name).split()
    if words and len(words[-1]) > 3 and words[-1].endswith("s") and not words[-1].endswith("ss"):
        words[-1] = words[-1][:-1]
    return " ".join(words)
