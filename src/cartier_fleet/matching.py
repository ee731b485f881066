"""Objects of many homes that a phrase means: by SQL where ``compiling`` has it, else by ``spatial.query`` per home.

What has no SQL is resolved over the catalog's rows by the code that resolves it in one home, for the homes that have an
object of each name at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cartier.labels import name_key
from cartier.spatial.expressions import ReferringExpression
from cartier.spatial.query import Scene
from cartier.types import Inventory, MapObject, Room
from cartier_fleet.compiling import Compiler, NoSql, named
from cartier_fleet.database import Database
from cartier_fleet.reading import with_rooms

MAX_FOUND = 1_000_000  # rows of one question
MEASURES = {
    "biggest": "greatest(x_max - x_min, 0.02) * greatest(y_max - y_min, 0.02) * greatest(z_max - z_min, 0.02)",
    "tallest": "greatest(z_max - z_min, 0.02)", "highest": "z_max", "lowest": "-z_min",
    "widest": "greatest(x_max - x_min, y_max - y_min)",
    "longest": "greatest(x_max - x_min, y_max - y_min, z_max - z_min)",
}  # fmt: skip
MEASURES |= {"smallest": f"-({MEASURES['biggest']})", "shortest": f"-({MEASURES['tallest']})"}
"""What the largest value of ranks first; as ``Scene.measure`` does."""


def find(database: Database, phrase: ReferringExpression, kinds: Sequence[str]) -> dict[str, list[int]]:
    """The ids of the objects that a phrase means, by home; rooms are places in ``kinds``."""
    try:
        return database.by_home(Compiler(kinds, database.unsure_labels)(phrase))
    except NoSql:
        scenes = _scenes(database, phrase, database.unsure_labels)
    found = dict[str, list[int]]()
    for home, scene in scenes.items():
        if met := scene.meant(with_rooms(phrase, _rooms_by_kind(scene, kinds)))[0]:
            found[home] = [obj.id for obj in met]
    return found


def find_tentative(database: Database, phrase: ReferringExpression) -> set[str]:
    """The homes in which an object of the name may be, though it was hardly seen."""
    return set[str]().union(*(database.unsure.get(name, ()) for name in (*phrase.labels, *phrase.similar)))


def extreme(database: Database, found: Mapping[str, Sequence[int]], wish: str) -> tuple[str, int] | None:
    """The home and the id of the object that is the biggest … of those found."""
    numbers = {home: number for number, home in enumerate(database.names)}
    homes = [numbers[home] for home, ids in found.items() for _ in ids]
    sql = (
        "select home, object from placed semi join (select unnest($1) as home, unnest($2) as object) "
        f"using (home, object) order by {MEASURES[wish]} desc, home, object limit 1"
    )
    rows = database.query(sql, [homes, [number for ids in found.values() for number in ids]]).rows
    return (database.names[rows[0][0]], rows[0][1]) if rows else None


def _scenes(database: Database, phrase: ReferringExpression, unsure: Sequence[str]) -> dict[str, Scene]:
    """The homes where a phrase may mean something: those with an object of each name that it takes.

    Where no landmark is told, these have the named objects alone.
    """
    alone = all(r.target is None or r.target.rooms is not None for r in phrase.relations)
    condition = f"confirmed and {named({*phrase.labels, *phrase.similar})}"
    needed = [condition, *(named(labels) for labels in _landmarks(phrase, unsure))]
    within = " and ".join(f"home in (select home from objects where {each})" for each in needed)
    objects, rooms = dict[str, list[MapObject]](), dict[str, list[Room]]()
    which = condition if alone else within
    table = database.query(f"select * from objects where {which} order by home, object", (), MAX_FOUND)
    for values in table.rows:
        row = dict(zip(table.columns, values, strict=True))
        objects.setdefault(row["home"], []).append(_object(row))
    none = np.zeros((1, 2), np.int32)
    for home, number, name, kind in database.query(
        f"select home, room, name, kind from rooms where {within} order by home, room", (), MAX_FOUND
    ).rows:
        rooms.setdefault(home, []).append(Room(number, name, kind, none))
    starts = f"select home, start_x, start_y from homes where {within}"
    return {
        home: Scene(Inventory(tuple(objects[home]), tuple(rooms.get(home, ())), from_xy=(x, y)))
        for home, x, y in database.query(starts, (), MAX_FOUND).rows
    }


def _landmarks(phrase: ReferringExpression, unsure: Sequence[str]) -> list[set[str]]:
    """The names of each landmark without which a phrase means nothing."""
    ends = [r.target for r in phrase.relations if not r.kind.startswith("not ")]
    return [
        {*end.labels, *end.similar, *(label for label in unsure if name_key(label) == name_key(end.said))}
        for end in ends
        if end is not None and end.rooms is None and not end.generic and end.obj is None
    ]


def _object(row: Mapping[str, Any]) -> MapObject:
    box = {end: tuple(row[f"{axis}{end}"] for axis in "xyz") for end in ("", "_min", "_max")}
    return MapObject(
        row["object"], row["label"], ((row["label"], 1.0),), box[""], box["_min"], box["_max"], row["probability"],
        row["confirmed"], row["n_detected"], row["n_observable"], row["first_seen_s"], row["last_seen_s"],
        row["last_looked_s"], (), tuple((c["name"], c["share"]) for c in row["colours"]), row["room"],
        names=tuple(row["names"]), by_person=row["by_person"],
    )  # fmt: skip


def _rooms_by_kind(scene: Scene, kinds: Sequence[str]) -> dict[int, tuple[int, ...]]:
    return {
        place: tuple(number for number, room in scene.rooms.items() if room.kind == kind)
        for place, kind in enumerate(kinds)
    }


def without_extreme(phrase: ReferringExpression) -> ReferringExpression:
    """The phrase without its superlative, which is to hold over all homes and not in each."""
    return replace(phrase, most="")
