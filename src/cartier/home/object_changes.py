"""Changes of single objects by corrections: confirmed, relabelled, moved, merged, halved, or made from words alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cartier.types import MapObject, View
from cartier.understanding.tentative import CONFIRMED_PROBABILITY

MAX_VIEWS = 16  # of merged objects, best first
SUREST = 1e-4  # a map's probabilities are rounded: none is nearer to 0 or 1


def affirmed(obj: MapObject) -> MapObject:
    """The object of which a person says that it is there, which outweighs any score."""
    known = obj.by_person and obj.confirmed and obj.probability == 1
    return obj if known else replace(obj, confirmed=True, probability=1.0, by_person=True)


def weighed(obj: MapObject, factor: float, label: str = "") -> MapObject:
    """The object with the odds that it exists multiplied by a factor, and with them the evidence for one of its labels,
    if one is given; what a person said of it stays."""
    if obj.by_person or factor == 1:
        return obj
    before = min(max(obj.probability, SUREST), 1 - SUREST)
    odds = factor * before / (1 - before)
    likely = round(odds / (1 + odds), 4)
    heavier = [(name, round(weight * factor, 4) if name == label else weight) for name, weight in obj.labels]
    labels = tuple(sorted(heavier, key=lambda each: -each[1]))
    best = labels[0][0] if label and labels else obj.label
    return replace(obj, label=best, labels=labels, probability=likely, confirmed=likely >= CONFIRMED_PROBABILITY)


def relabelled(obj: MapObject, label: str) -> MapObject:
    """The object with the label that a person gives it; what detectors called it no longer counts."""
    return replace(obj, label=label, labels=((label, 1.0),))


def moved(obj: MapObject, to_xy: tuple[float, float], room: int | None) -> MapObject:
    """The object with its middle elsewhere, and the cameras of its views moved along."""
    by = (to_xy[0] - obj.position[0], to_xy[1] - obj.position[1], 0.0)
    box = obj.oriented and replace(obj.oriented, middle=_shifted(obj.oriented.middle, by))
    return replace(
        obj, position=_shifted(obj.position, by), box_min=_shifted(obj.box_min, by), box_max=_shifted(obj.box_max, by),
        oriented=box, room=room, views=tuple(_shifted_view(view, by) for view in obj.views),
        side_views=tuple(_shifted_view(view, by) for view in obj.side_views),
    )  # fmt: skip


def made(number: int, label: str, position: Sequence[float], size: Sequence[float], time_s: float) -> MapObject:
    """An object that only a person knows of."""
    low, high = (
        tuple(round(middle + sign * side / 2, 4) for middle, side in zip(position, size, strict=True))
        for sign in (-1, 1)
    )
    times = dict.fromkeys(("first_seen_s", "last_seen_s", "last_looked_s"), time_s)
    return affirmed(MapObject.of_box(number, label, low, high, position=tuple(position), **times))


def merged(one: MapObject, other: MapObject) -> MapObject:
    """Two objects that are one: the first, with the box, the evidence and the ids of both."""
    low = tuple(map(min, one.box_min, other.box_min))
    high = tuple(map(max, one.box_max, other.box_max))
    weights: dict[str, float] = {}
    for label, weight in (*one.labels, *other.labels):
        weights[label] = weights.get(label, 0.0) + weight
    labels = sorted(weights.items(), key=lambda each: (each[0] != one.label, -each[1]))
    views = sorted((*one.views, *other.views), key=lambda view: -view.score * view.size_px2**0.5)
    sides = sorted((*one.side_views, *other.side_views), key=lambda view: -view.size_px2)
    return replace(
        one, labels=tuple(labels), position=_middle(low, high), box_min=low, box_max=high, oriented=None,
        n_detected=max(one.n_detected, other.n_detected), n_observable=max(one.n_observable, other.n_observable),
        first_seen_s=min(one.first_seen_s, other.first_seen_s), last_seen_s=max(one.last_seen_s, other.last_seen_s),
        last_looked_s=max(one.last_looked_s, other.last_looked_s), views=tuple(views[:MAX_VIEWS]),
        side_views=tuple(sides[:MAX_VIEWS]),
        aliases=(*one.aliases, other.id, *other.aliases), names=tuple(dict.fromkeys((*one.names, *other.names))),
    )  # fmt: skip


def halves(obj: MapObject, xy: Sequence[float]) -> tuple[MapObject, MapObject]:
    """The halves of an object, cut across the side along which ``xy`` (m) is off its middle; there lies the second.

    Each has the views that show its own half, or all where none does. The second has neither names nor aliases.
    """
    off = [xy[axis] - obj.position[axis] for axis in (0, 1)]
    axis = int(abs(off[1]) > abs(off[0]))
    cut = round((obj.box_min[axis] + obj.box_max[axis]) / 2, 4)
    low, high = _part(obj, axis, cut, upper=False), _part(obj, axis, cut, upper=True)
    first, second = (low, high) if off[axis] >= 0 else (high, low)
    return first, replace(second, names=(), aliases=())


def _part(obj: MapObject, axis: int, cut: float, upper: bool) -> MapObject:
    side = [*(obj.box_min if upper else obj.box_max)]
    side[axis] = cut
    low, high = (tuple(side), obj.box_max) if upper else (obj.box_min, tuple(side))
    shown, sides = (
        tuple(v for v in views if v.surface is not None and (v.surface[axis] >= cut) is upper)
        for views in (obj.views, obj.side_views)
    )
    return replace(
        obj, position=_middle(low, high), box_min=low, box_max=high, oriented=None, views=shown or obj.views,
        side_views=sides or obj.side_views,
    )  # fmt: skip


def _middle(low: Sequence[float], high: Sequence[float]) -> tuple[float, ...]:
    return tuple(round((a + b) / 2, 4) for a, b in zip(low, high, strict=True))


def _shifted_view(view: View, by: Sequence[float]) -> View:
    surface = None if view.surface is None else _shifted(view.surface, by)
    return replace(view, camera=_shifted(view.camera, by), surface=surface)


def _shifted(point: Sequence[float], by: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(value + step, 4) for value, step in zip(point, by, strict=True))
