"""Questions over many homes: three values, the same objects as in one home, and SQL that reaches nothing else."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")
pytest.importorskip("duckdb", reason="needs pip install '.[fleet]'")

import cartier_fleet
from cartier.blob_stores import open_store
from cartier.errors import InputError
from cartier.spatial.query import Scene
from cartier_fleet import answer as reasons
from cartier_fleet.answering import Loaded
from cartier_fleet.catalog import read_catalog
from cartier_fleet.compiling import Compiler, NoSql
from cartier_fleet.database import OPTIONS, Database
from cartier_fleet.matching import find
from cartier_fleet.questions import FleetQuestion, read_question
from cartier_fleet.reading import Vocabulary, read_phrase, with_rooms
from flat import FLAT, obj
from fleet.catalogued import KNOWS, enter, home

table = pytest.mark.parametrize
SOFA = obj(40, "sofa", (8.0, 1.0, 0.4), (2.0, 0.9, 0.8), 2)
HUGE = obj(41, "sofa", (5.0, 5.0, 0.5), (3.0, 1.2, 1.0), 1)
RED = obj(42, "fire extinguisher", (0.3, 0.3, 0.4), (0.2, 0.2, 0.5), 0, ["red"])
MAYBE = replace(RED, id=43, probability=0.4, confirmed=False)
HOMES = {
    "has": home((*FLAT.objects, RED, SOFA)),
    "none": home((*FLAT.objects, HUGE)),
    "blind": home(knows=("cup", "bed")),
    "open": home(seen=0.5),
    "flat-world": home(depth=False),
    "maybe": home((*FLAT.objects, MAYBE)),
    "unknown": home(knows=()),
    "empty": home(FLAT.objects[:1], FLAT.rooms[1:2]),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = str(tmp_path_factory.mktemp("fleet") / "store")
    for name, made in HOMES.items():
        enter(open_store(folder), name, replace(made, objects=tuple(
            replace(o, room=None) if name == "empty" else o for o in made.objects
        )))  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def fleet(place: str) -> cartier_fleet.Fleet:
    return cartier_fleet.Fleet(place)


def test_three_values(fleet: cartier_fleet.Fleet) -> None:
    answer = fleet.ask("Which flats have no fire extinguisher?")
    assert answer.has == ("has",) and set(answer.has_none) == {"none", "empty"} == set(answer.value)
    assert answer.cannot_tell == {
        "blind": reasons.UNNAMED, "open": reasons.UNSEEN, "flat-world": reasons.NO_FLOOR, "maybe": reasons.TENTATIVE,
        "unknown": reasons.UNKNOWN_NAMES,
    }  # fmt: skip
    assert "2 homes have not (looked for): empty, none" in answer.text
    assert "cannot tell in 5 homes" in answer.text and f"1: {reasons.UNNAMED}" in answer.text
    assert answer.objects == {"has": [42]}


def test_ground_truth_can_name_anything(tmp_path: Path) -> None:
    store = str(tmp_path / "store")
    enter(open_store(store), "true", replace(home(knows=()), detector="ground truth (flat)"))
    for words in ("which homes have a fire extinguisher?", "which homes have a helicopter?"):
        assert cartier_fleet.Fleet(store).ask(words).has_none == ("true",)


def test_a_room_that_is_not_known_is_a_doubt(fleet: cartier_fleet.Fleet) -> None:
    answer = fleet.ask("which homes have a cup in the kitchen?")
    assert answer.cannot_tell == {"empty": reasons.NO_ROOM}
    assert set(answer.has) == HOMES.keys() - {"empty"}


def test_more_than_the_most_is_certain_whatever_was_not_seen(fleet: cartier_fleet.Fleet) -> None:
    answer = fleet.ask("how many homes have at most two cups?")
    assert answer.has == ("empty",) and answer.cannot_tell == {}
    assert set(answer.has_none) == HOMES.keys() - {"empty"}


def test_what_no_detector_can_name_nobody_can_tell(fleet: cartier_fleet.Fleet) -> None:
    answer = fleet.ask("how many homes have a helicopter?")
    assert answer.value == 0 and answer.has_none == ()
    assert answer.cannot_tell["has"] == reasons.UNNAMED


@table(
    ("words", "value"),
    [
        ("how many cups are there in all homes?", 21),
        ("how many sofas per home?", {**dict.fromkeys(HOMES, 0), "has": 1, "none": 1}),
        ("which home has the most sofas?", ["has", "none"]),
        ("which home has the fewest cups?", ["empty"]),
        ("where is the biggest sofa?", ("none", 41)),
        ("where is the smallest sofa?", ("has", 40)),
        ("which home has the tallest sofa?", ("none", 41)),
        ("which homes have at least three cups?", sorted(HOMES.keys() - {"empty"})),
        ("which homes have more than three cups?", []),
        ("how many homes have exactly three cups?", 0),  # a fourth may be there in each
        ("how many homes have exactly 1 sofa?", 2),
        ("how many homes have fewer than two cups?", 1),
        ("list the sofas", {"has": 1, "none": 1}),
        ("which homes have a sofa in the bedroom?", ["has", "none"]),
        ("which homes have a red cup?", sorted(HOMES.keys() - {"empty"})),
        ("how many cups on a table are there?", 7),
        ("how many cups not in the kitchen are there?", 7),
    ],
)
def test_answers(fleet: cartier_fleet.Fleet, words: str, value: object) -> None:
    assert fleet.ask(words).value == value


@table(
    "about",
    [
        "cup", "cups in the kitchen", "cups not in the kitchen", "red cups", "cups on the table", "biggest cup",
        "cups in the bedroom", "sofas next to the bed", "beds", "cups under the table",
    ],
)  # fmt: skip
def test_objects_are_those_that_one_home_means(fleet: cartier_fleet.Fleet, about: str) -> None:
    """What SQL and the catalog's rows give is what the scene of each home itself gives."""
    kinds = ("bedroom", "kitchen")
    vocabulary = Vocabulary(KNOWS, frozenset(), kinds)
    phrase = read_phrase(about, [vocabulary], vocabulary)[vocabulary]
    found = find(fleet._catalog().database, phrase, kinds)
    for name, made in HOMES.items():
        rooms = {k: tuple(room.id for room in made.rooms if room.kind == kind) for k, kind in enumerate(kinds)}
        objects = tuple(replace(o, room=None) for o in made.objects) if name == "empty" else made.objects
        scene = Scene(replace(FLAT, objects=objects, rooms=made.rooms))
        expected = [o.id for o in scene.meant(with_rooms(phrase, rooms))[0]]
        assert sorted(found.get(name, [])) == sorted(expected), name


def test_both_ways_are_taken() -> None:
    vocabulary = Vocabulary(KNOWS, frozenset(), ("bedroom", "kitchen"))
    taken = ("cups in the kitchen", "cups on the table", "red cups by the sink", "cups near the bed not in the bedroom")
    for about in taken:
        assert Compiler(vocabulary.kinds, ())(read_phrase(about, [vocabulary], vocabulary)[vocabulary])
    with pytest.raises(NoSql):
        Compiler(vocabulary.kinds, ())(read_phrase("cups under the table", [vocabulary], vocabulary)[vocabulary])


@table(
    ("words", "question"),
    [
        ("Which flats have no fire extinguisher?", FleetQuestion("which", "fire extinguisher", True)),
        ("what homes don't have a piano", FleetQuestion("which", "piano", True)),
        ("which houses lack a bed?", FleetQuestion("which", "bed", True)),
        ("list all the apartments without any mugs", FleetQuestion("which", "mugs", True)),
        ("which homes have a bed", FleetQuestion("which", "bed")),
        ("is there a sofa in any home?", FleetQuestion("which", "sofa")),
        ("does any flat have a red sofa?", FleetQuestion("which", "red sofa")),
        ("which homes have two beds", FleetQuestion("which", "beds", least=2)),
        ("which homes have at most 2 beds", FleetQuestion("which", "beds", least=0, most=2)),
        ("how many flats have no bed", FleetQuestion("count_homes", "bed", True)),
        ("how many mugs per home?", FleetQuestion("per_home", "mugs")),
        ("how many mugs does each home have?", FleetQuestion("per_home", "mugs")),
        ("how many mugs in the kitchen are there in total?", FleetQuestion("total", "mugs in the kitchen")),
        ("which home has the most chairs", FleetQuestion("most", "chairs")),
        ("where is the biggest bed of all homes?", FleetQuestion("extreme", "the biggest bed")),
        ("where are the lamps?", FleetQuestion("list", "lamps")),
    ],
)  # fmt: skip
def test_frames(words: str, question: FleetQuestion) -> None:
    assert read_question(words) == question


@table("words", ["what is love", "", "which homes", "bring me a cup", "which homes have a bed, then bring me a cup?"])
def test_other_words_are_refused(fleet: cartier_fleet.Fleet, words: str) -> None:
    with pytest.raises(InputError):
        fleet.ask(words)


def test_a_new_home_is_seen_at_once(tmp_path: Path) -> None:
    store = str(tmp_path / "store")
    fleet = cartier_fleet.Fleet(store)
    with pytest.raises(InputError, match="holds no homes"):
        fleet.ask("how many cups are there?")
    enter(open_store(store), "a", home())
    assert fleet.ask("how many cups are there?").value == 3
    enter(open_store(store), "b", home())
    assert fleet.ask("how many cups are there?").value == 6


@table(
    "sql",
    [
        "select * from read_text('/etc/passwd')", "from '/etc/passwd'", "select * from read_csv('/etc/passwd')",
        "select * from glob('/*')", "select * from read_parquet('s3://x/y')", "copy objects to '/tmp/x.csv'",
        "attach '/tmp/x.db'", "install httpfs", "load httpfs", "set memory_limit='99GB'", "export database '/tmp/x'",
        "drop table objects", "delete from objects", "create table x as select 1", "select 1; select 2", "",
        "pragma database_list", "select nothing from objects", "insert into rooms from rooms", "x" * 30_000,
    ],
)  # fmt: skip
def test_sql_reads_the_catalog_alone(fleet: cartier_fleet.Fleet, sql: str) -> None:
    before = fleet.query("select count(*) from objects")
    with pytest.raises(InputError) as told:
        fleet.query(sql)
    assert "\n" not in str(told.value)
    assert fleet.query("select count(*) from objects") == before
    assert not Path("/tmp/x.csv").exists()


def test_variables_of_python_are_no_tables(fleet: cartier_fleet.Fleet) -> None:
    import pyarrow

    secret = pyarrow.table({"a": [1]})
    assert secret.num_rows
    with pytest.raises(InputError):
        fleet.query("select * from secret")


def test_sql_is_bounded(fleet: cartier_fleet.Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    columns, rows = fleet.query("select label, count(*) n from objects group by label order by n desc", limit=2)
    assert columns == ("label", "n") and len(rows) == 2 and rows[0][0] == "cup"
    database: Database = fleet._catalog().database
    with pytest.raises(InputError, match="more than 0\\.2 s"):
        database.query("select sum(a.range * b.range) from range(10000000) a, range(1000000) b", most_s=0.2)
    assert database.query("select 1").rows == ((1,),), "it goes on"
    monkeypatch.setitem(OPTIONS, "memory_limit", "64MB")
    small = Database(read_catalog(fleet.store))
    with pytest.raises(InputError, match="SQL: "):
        small.query("select list(range) from range(200000000)")
    assert small.query("select 1").rows == ((1,),), "it goes on"


def test_a_catalog_that_does_not_fit_is_one_line(fleet: cartier_fleet.Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(OPTIONS, "memory_limit", "100KB")
    with pytest.raises(InputError, match="the catalog cannot be asked"):
        Database(read_catalog(fleet.store))


def test_commands(place: str, tmp_path: Path) -> None:
    def ran(*words: str) -> str:
        command = [sys.executable, "-m", "cartier", "fleet", *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert json.loads(ran("ask", place, "which homes have a sofa?", "--json"))["value"] == ["has", "none"]
    rows = json.loads(ran("query", place, "select home, floor_seen from homes where home = 'has'", "--json"))
    assert rows == [{"home": "has", "floor_seen": 1.0}]
    assert "8 homes" in ran("compact", place)
    assert "2 homes have it" in ran("ask", place, "which homes have a sofa?")


def test_who_can_name_anything_takes_no_table_for_another() -> None:
    """Ground truth lists all that is there: without a dining table, a coffee table is none."""
    anything = Vocabulary(("*",), frozenset({"coffee table", "side table"}), ("kitchen",))
    phrase = read_phrase("dining table", [anything], anything)[anything]
    assert phrase.labels == {"dining table"} and anything.could_name(phrase)


def test_who_sees_one_home_learns_no_word_of_another(tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"))
    enter(store, "mine", home())
    named = [replace(obj, names=("aunt mathilda insulin",)) if obj.id == 3 else obj for obj in FLAT.objects]
    panic = [replace(room, kind="panic room") if room.id == 0 else room for room in FLAT.rooms]
    enter(store, "theirs", home(named, panic))
    fleet = cartier_fleet.Fleet(str(tmp_path / "store"))

    def told(words: str) -> str:
        try:
            return fleet.ask(words, lambda name: name == "mine").text
        except InputError as error:
            return str(error)

    secret, made_up = (f"which homes have an {name}?" for name in ("aunt mathilda insulin", "aunt bernhard insulin"))
    assert told(secret).replace("mathilda", "bernhard") == told(made_up)
    alone = Loaded.of(read_catalog(store)).only(lambda name: name == "mine")
    assert "aunt mathilda insulin" not in alone.vocabulary.seen and "panic room" not in alone.vocabulary.kinds
    mine, theirs = (fleet.ask("which homes have a cup in the kitchen?", lambda name, one=one: name == one)  # type: ignore[misc]
                    for one in ("mine", "theirs"))  # fmt: skip
    assert mine.value == ["mine"] and theirs.value != ["theirs"]
    assert fleet.ask(secret).value == ["theirs"]
