"""SQL of phrases against ``Scene.meant``, home by home, over drawn homes and phrases."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")
pytest.importorskip("duckdb", reason="needs pip install '.[fleet]'")

from cartier.blob_stores import open_store
from cartier.home import Home
from cartier.spatial.expressions import ReferringExpression, SpatialRelation
from cartier.spatial.query import Scene
from cartier.types import MapObject
from cartier_fleet.catalog import read_catalog
from cartier_fleet.compiling import Compiler
from cartier_fleet.database import Database
from cartier_fleet.matching import find
from cartier_fleet.reading import with_rooms
from flat import FLAT, obj
from fleet.catalogued import enter, home

KINDS = ("bedroom", "kitchen")
LABELS = ("cup", "mug", "table", "plate", "bed")
SIZES = {"cup": 0.1, "mug": 0.1, "plate": 0.3, "table": 1.0, "bed": 1.6}
COLOURS = ("red", "orange", "blue", "brown")
steps = st.integers(0, 6).map(lambda k: k * 0.35)


@st.composite
def objects(draw: st.DrawFn, number: int) -> MapObject:
    label = draw(st.sampled_from(LABELS))
    side, height = SIZES[label], 0.1 if SIZES[label] < 0.5 else 0.7
    z = draw(st.sampled_from((height / 2, 0.7 + height / 2, 0.8 + height / 2)))
    made = obj(number, label, (draw(steps), draw(steps), z), (side, side, height), draw(st.sampled_from((0, 1, None))))
    shares = draw(st.lists(st.sampled_from((0.05, 0.1, 0.15, 0.2, 0.3, 0.5)), max_size=3))
    colours = tuple(zip(draw(st.permutations(COLOURS)), shares, strict=False))
    names = ("Ben's",) if draw(st.integers(0, 9)) == 0 else ()
    sure = draw(st.integers(0, 5)) > 0
    return replace(made, colours=colours, names=names, confirmed=sure, probability=0.9 if sure else 0.4)


@st.composite
def homes(draw: st.DrawFn) -> Home:
    return home([draw(objects(number)) for number in range(draw(st.integers(1, 12)))])


@st.composite
def phrases(draw: st.DrawFn, deep: int = 2) -> ReferringExpression:
    label = draw(st.sampled_from(LABELS))
    similar = frozenset({"mug"}) if label == "cup" and draw(st.booleans()) else frozenset[str]()
    labels = frozenset({label, "Ben's"}) if draw(st.integers(0, 4)) == 0 else frozenset({label})
    colours = tuple(draw(st.lists(st.sampled_from(COLOURS), max_size=1 if draw(st.booleans()) else 0, unique=True)))
    told = tuple(draw(relations(deep)) for _ in range(draw(st.integers(0, min(deep, 2)))))
    return ReferringExpression(label, labels, similar, colours=colours, relations=told)


@st.composite
def relations(draw: st.DrawFn, deep: int) -> SpatialRelation:
    no = draw(st.sampled_from(("", "", "not ")))
    if draw(st.integers(0, 3)) == 0:
        rooms = draw(st.sampled_from(((0,), (1,), (0, 1), ())))
        kind = draw(st.sampled_from(("in", "near", "farthest")))
        return SpatialRelation(f"{no}{kind}", ReferringExpression("room", rooms=rooms))
    kind = draw(st.sampled_from(("on", "in", "from", "near", "of", "next to")))
    return SpatialRelation(f"{no}{kind}", draw(phrases(deep - 1)))


@contextmanager
def catalogued(made: dict[str, Home], folder: Path) -> Iterator[Database]:
    store = open_store(str(folder))
    for name, one in made.items():
        enter(store, name, one)
    yield Database(read_catalog(store))


def means(one: Home, phrase: ReferringExpression) -> list[int]:
    """What the scene of a home says itself."""
    rooms = {k: tuple(room.id for room in one.rooms if room.kind == kind) for k, kind in enumerate(KINDS)}
    scene = Scene(replace(FLAT, objects=one.objects, rooms=one.rooms, doors=()))
    return sorted(found.id for found in scene.meant(with_rooms(phrase, rooms))[0])


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_sql_means_what_each_home_means(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    made = {f"home-{k}": data.draw(homes()) for k in range(4)}
    asked = [data.draw(phrases()) for _ in range(6)]
    with catalogued(made, tmp_path_factory.mktemp("store")) as database:
        for phrase in asked:
            assert Compiler(KINDS, ())(phrase), "it has SQL"
            found = find(database, phrase, KINDS)
            assert {name: sorted(found.get(name, [])) for name in made} == {
                name: means(one, phrase) for name, one in made.items()
            }, phrase
