"""Requests about particular objects: statements that are true of one object, exact scores, strict files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from cartier.contracts import Reasoner
from cartier.errors import InputError
from cartier.types import Fact, Inventory, MapObject, Room, Selection, TrueObject
from cartier_bench import suite, things_made, things_run
from cartier_bench.maps import Maps, MapSettings
from cartier_bench.statements import Statements, Words
from cartier_bench.things import KINDS, WRITTEN, Given, Item, load_answers, load_items, score
from cartier_bench.things_made import make_items, plural
from cartier_bench.things_run import HOMES, NamesOnly, ThingsSettings
from cartier_bench.true_home import TrueHome, true_home, true_objects
from cartier_dollhouse.contacts import Contacts
from cartier_dollhouse.scene import load_home, load_scene
from cartier_dollhouse.trace import available

WORLD = str(Path(__file__).parent / "room_world.py")


def obj(
    id: int, label: str, x: float, y: float, z: float, size: Sequence[float], room: int, colour: str = ""
) -> MapObject:
    low = np.array([x, y, z])
    high = low + size
    colours = ((colour, 1.0),) if colour else ()
    middle = tuple(((low + high) / 2).tolist())
    return MapObject(
        id, label, ((label, 1.0),), middle, tuple(low.tolist()), tuple(high.tolist()), 1.0, True, 1, 1, 0, 0, 0, (),
        colours, room
    )  # fmt: skip


CUP, SEAT = (0.1, 0.1, 0.1), (0.5, 0.5, 0.9)
OBJECTS = (
    obj(1, "dining table", 1, 1, 0, (1.2, 0.8, 0.75), 0),
    obj(2, "cup", 1.2, 1.2, 0.75, CUP, 0, "red"),
    obj(3, "chair", 1.2, 2.0, 0, SEAT, 0, "white"),
    obj(4, "sink", 3.5, 3.0, 0.8, (0.5, 0.4, 0.2), 0),
    obj(5, "cup", 3.6, 2.6, 0.9, CUP, 0, "blue"),
    obj(6, "sofa", 6, 1, 0, (2.0, 0.9, 0.8), 1, "green"),
    obj(7, "chair", 8.5, 3.0, 0, SEAT, 1, "brown"),
    obj(8, "book", 6.2, 1.3, 0.8, (0.2, 0.3, 0.03), 1),
    obj(9, "pen", 6.8, 1.3, 0.8, (0.1, 0.02, 0.01), 1),
    obj(10, "floor lamp", 8.5, 0.2, 0, (0.4, 0.4, 1.6), 1),
    obj(11, "vase", 4.2, 0.2, 0, (0.2, 0.2, 0.3), 0, "red"),
    obj(12, "vase", 4.5, 0.2, 0, (0.2, 0.2, 0.3), 0, "blue"),
)
HOME = TrueHome(
    "toy", OBJECTS, (("kitchen", "kitchen"), ("living room", "living room")), (0.5, 0.5),
    {2: (1, "on"), 8: (6, "on"), 9: (6, "on")}, frozenset(), {t.id: 20 if t.label == "pen" else 4000 for t in OBJECTS},
)  # fmt: skip
BY_ID = {t.id: t for t in OBJECTS}
TRUTH = {t.id: TrueObject(t.id, t.label, t.box_min, t.box_max) for t in OBJECTS}


def apart(a: MapObject, b: MapObject) -> float:
    return float(
        np.linalg.norm(
            np.maximum(0, np.maximum(np.subtract(a.box_min, b.box_max), np.subtract(b.box_min, a.box_max)))[:2]
        )
    )


WORDS = Words()


def every(seed: int = 0) -> dict[str, list[Any]]:
    return Statements(HOME, WORDS, Random(seed)).every()


def test_what_is_stated_is_true_of_one_thing_alone() -> None:
    said = 0
    for seed in range(30):
        for statement in [s for some in every(seed).values() for s in some]:
            named = [t for t in OBJECTS if statement.word in WORDS.called.get(t.label, [t.label])]
            one = BY_ID[statement.obj]
            words = statement.phrase()
            assert one in named and statement.others == len(named) - 1
            place = next(
                (t for t in OBJECTS if t != one and any(words.endswith(f"the {w}") for w in WORDS.called[t.label])),
                None,
            )
            if statement.how == "on":
                assert place is not None and [t for t in named if HOME.holder.get(t.id, (0,))[0] == place.id] == [one]
            elif statement.how in ("next to", "closest"):
                assert (
                    place is not None
                    and one == min(named, key=lambda t: apart(t, place))
                    and apart(one, place) < 1.5
                    and one.room == place.room
                )
                assert all(apart(t, place) - apart(one, place) >= 0.3 for t in named if t != one)
            elif statement.how == "room":
                assert [t for t in named if t.room == one.room] == [one]
            elif statement.adjective in WORDS.texts["colours"]:
                assert [t for t in named if t.colours and t.colours[0][0] == statement.adjective] == [one]
            elif statement.adjective in ("nearest", "closest", "farthest", "furthest"):
                far = [np.linalg.norm(np.subtract(t.position, (0.5, 0.5, 0))[:2]) for t in named]
                pick = np.argmin if statement.adjective in ("nearest", "closest") else np.argmax
                assert named[int(pick(far))] == one
            said += 1
    assert said > 300


def test_the_statements_that_people_would_make_are_there() -> None:
    found = {(s.kind, s.obj, s.how or s.adjective) for seed in range(10) for some in every(seed).values() for s in some}
    assert {
        ("relation", 2, "on"), ("relation", 5, "next to"), ("relation", 3, "next to"), ("room", 3, "room"),
        ("room", 7, "room"), ("attribute", 5, "blue"), ("superlative", 3, "nearest"), ("superlative", 7, "farthest"),
        ("relation", 8, "on"),
    } <= found  # fmt: skip


def test_nothing_is_said_where_an_answer_could_stand_for_two_or_of_what_was_hardly_shown() -> None:
    stated = {s.obj for seed in range(10) for some in every(seed).values() for s in some}
    assert not stated & {11, 12}, "the two vases are 30 cm apart"
    assert 9 not in stated, "the pen was shown with 20 pixels"
    items = [item for seed in range(5) for item in make_items(HOME, seed)]
    assert all(9 not in item.accept_ids for item in items)
    assert not any(item.kind == "count" and "pen" in item.turns[0].split() for item in items)


def test_what_is_made_agrees_with_closed_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(things_made, "TYPOS", 0)
    items = [item for seed in range(10) for item in make_items(HOME, seed)]
    assert {item.kind for item in items} == set(KINDS)
    for item in items:
        words = " ".join(item.turns).lower()
        objs = [BY_ID[i] for i in item.accept_ids]
        if item.kind == "count":
            assert item.answer == len(objs)
            assert "chair" not in words or item.answer == (
                1 if "room" in words or "kitchen" in words or "lounge" in words else 2
            )
        elif item.kind == "exists":
            assert item.answer is bool(objs)
        elif item.kind == "where":
            room = HOME.rooms[objs[0].room or 0][1]
            holder = HOME.holder.get(objs[0].id)
            assert isinstance(item.answer, tuple) and (room in item.answer or BY_ID[holder[0]].label in item.answer)  # type: ignore[index]
        elif item.kind == "list" and "sofa" in words.replace("couch", "sofa").replace("settee", "sofa"):
            assert item.answer == ("book",) and item.maybe == ("pen",)
        elif item.kind == "nothing":
            assert not item.accept_ids
        elif item.kind == "bare" and "chair" in words:
            assert item.accept_ids == (3,)
    assert [i.to_dict() for i in make_items(HOME, 3)] == [i.to_dict() for i in make_items(HOME, 3)]
    assert len({item.id for item in make_items(HOME)}) == len(make_items(HOME))


def test_plurals() -> None:
    words = ["knife", "shelf", "box", "loaf of bread", "potato", "bench", "key", "pouffe", "TV", "boots", "dish"]
    assert [plural(w) for w in words] == [
        "knives", "shelves", "boxes", "loaves of bread", "potatoes", "benches", "keys", "pouffes", "TVs", "boots",
        "dishes"
    ]  # fmt: skip


FIND = Item("f", "toy", "relation", ("the cup by the sink",), (5,))


@pytest.mark.parametrize(
    ("at", "right"),
    [
        ((3.65, 2.65, 0.95), True), ((3.9, 2.65), True), ((4.0, 2.65), True), ((4.01, 2.65), False),
        ((3.65, 2.65, 0.55), False), (5, True), (2, False), (None, False),
    ],
)  # fmt: skip
def test_a_find_is_right_within_thirty_centimetres(at: Any, right: bool) -> None:
    assert score(FIND, Given("f", "found", at), TRUTH).right is right
    assert score(FIND, Given("f", "likely_near", at), TRUTH).right is right
    for status in ("clarify", "not_found", "answered"):
        assert not score(FIND, Given("f", status, at), TRUTH).right, "that leads nowhere"


def test_what_was_turned_down_is_wrong_and_the_other_one_right() -> None:
    item = Item("o", "toy", "follow_up", ("a chair", "no, the other one"), (3, 7), rejects=True)
    first, other = (1.4, 2.2), (8.7, 3.2)
    assert score(item, Given("o", "found", other, before=first), TRUTH).right
    assert not score(item, Given("o", "found", first, before=first), TRUTH).right
    assert score(item, Given("o", "found", first), TRUTH).right, "it had asked back before"


def test_a_bare_name_is_asked_about_or_the_nearest_taken_with_a_word() -> None:
    item = Item("b", "toy", "bare", ("bring me to the chair",), (3,))
    asked = lambda question: score(item, Given("b", "clarify", question=question), TRUTH).right  # noqa: E731
    assert asked("Which one, the one at the table or the one by the lamp?") and asked("The chair in the kitchen?")
    assert not asked("Which chair do you mean?") and not asked("Shall I go to the sofa?") and not asked("")
    near, far = (1.4, 2.2), (8.7, 3.2)
    assert score(item, Given("b", "found", near, text="I take the nearest of two."), TRUTH).right
    assert not score(item, Given("b", "found", near), TRUTH).right
    assert not score(item, Given("b", "found", far, text="the nearest"), TRUTH).right


def test_answers_to_questions_are_compared_exactly() -> None:
    def right(kind: str, truth: Any, answer: Any, status: str = "answered", maybe: tuple[str, ...] = ()) -> bool:
        return score(Item("q", "toy", kind, ("?",), (), truth, maybe), Given("q", status, answer=answer), TRUTH).right

    assert (
        right("count", 2, 2) and not right("count", 2, 3) and not right("count", 1, True) and not right("count", 2, "2")
    )
    assert not right("count", 2, 2, "found"), "nobody was told"
    assert right("exists", False, False) and not right("exists", False, 0) and not right("exists", True, False)
    assert right("where", ("kitchen", "dining table"), "kitchen 2") and right(
        "where", ("kitchen", "dining table"), ["table"]
    )
    assert not right("where", ("kitchen",), "hall") and not right("where", ("kitchen",), [])
    assert right("compare", ("sofa",), "couch") and not right("compare", ("sofa",), "bed")
    assert right("list", ("book", "cup"), ["mug", "book", "pen"], maybe=("pen",)) and right(
        "list", ("cup",), ["cup", "cup"]
    )
    assert (
        not right("list", ("book", "cup"), ["cup"])
        and not right("list", ("cup",), ["cup", "pen"])
        and right("list", (), [])
    )
    half = score(Item("q", "toy", "list", ("?",), (), ("book", "cup")), Given("q", "answered", answer=["cup"]), TRUTH)
    assert half.f1 == pytest.approx(2 / 3, abs=1e-4)
    nothing = Item("n", "toy", "nothing", ("the piano",))
    assert [
        score(nothing, Given("n", s, 3), TRUTH).right for s in ("found", "likely_near", "not_found", "clarify")
    ] == [False, False, True, True]


GOOD = {"id": "a", "home": "toy", "kind": "relation", "text": "the cup", "accept_ids": [5], "answer": None}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"home": ...}, "'home' is missing; a line looks like"),
        ({"colour": "red"}, "'colour' is no key here"),
        ({"kind": "riddle"}, "kind: input should be"),
        ({"accept_ids": []}, "accept_ids: the kind relation needs"),
        ({"accept_ids": ["5"]}, r"accept_ids.0: input should be a valid integer"),
        ({"accept_ids": [0]}, "accept_ids.0"),
        ({"answer": 3}, "answer: the kind relation needs null"),
        ({"kind": "count", "answer": "3"}, "answer: the kind count needs a whole number"),
        ({"kind": "count", "answer": True}, "answer: the kind count needs a whole number"),
        ({"kind": "exists", "answer": 1}, "answer: the kind exists needs true or false"),
        ({"kind": "where", "answer": []}, "answer: the kind where needs names"),
        ({"kind": "nothing"}, "accept_ids: what nothing serves has none"),
        ({"turns": ["a", "b"]}, "either text or turns"),
        ({"text": ...}, "either text or turns"),
        ({"text": " "}, "the request is empty"),
        ({"id": ""}, "id: "),
    ],
)
def test_each_fault_of_a_file_of_requests_has_one_line(tmp_path: Path, change: dict[str, Any], told: str) -> None:
    row = {key: value for key, value in (GOOD | change).items() if value is not ...}
    (tmp_path / "mine.jsonl").write_text(json.dumps(GOOD | {"id": "first"}) + "\n\n" + json.dumps(row) + "\n")
    with pytest.raises(InputError, match=f"mine.jsonl line 3: .*{told}") as caught:
        load_items(tmp_path / "mine.jsonl")
    assert "\n" not in str(caught.value)


def test_files_that_are_no_such_files_are_told(tmp_path: Path) -> None:
    file = tmp_path / "mine.jsonl"
    for text, told in (
        ("", "holds no request"),
        ("{", "not valid JSON"),
        ("[1]", "the line"),
        (f"{json.dumps(GOOD)}\n" * 2, "used before"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=told):
            load_items(file)
    asked = [FIND]
    for row, told in (
        ({"id": "x", "status": "found"}, "no request of this run"), ({"id": "f", "status": "sure"}, "status: "),
        ({"id": "f"}, "'status' is missing"),
        ({"id": "f", "status": "found", "xy": [1, 2], "object_id": 3}, "is enough"),
        ({"id": "f", "status": "found", "xy": [1]}, "xy"), ({"id": "f", "status": "found", "where": 3}, "no key here"),
    ):  # fmt: skip
        file.write_text(json.dumps(row))
        with pytest.raises(InputError, match=told):
            load_answers(file, asked)
    file.write_text('{"id": "f", "status": "found", "xy": [3.6, 2.7]}\n' * 2)
    with pytest.raises(InputError, match="answered on a line before"):
        load_answers(file, asked)
    file.write_text('{"id": "f", "status": "found", "xy": [3.6, 2.7]}')
    assert score(FIND, load_answers(file, asked)["f"], TRUTH).right


def test_a_file_of_requests_is_read_as_it_was_written(tmp_path: Path) -> None:
    items = make_items(HOME)
    (tmp_path / "made.jsonl").write_text("".join(json.dumps(item.to_dict()) + "\n" for item in items))
    assert load_items(tmp_path / "made.jsonl") == items


def test_what_was_written_by_hand_is_about_things_that_are_there() -> None:
    items = load_items(WRITTEN)
    assert (
        len(items) >= 300
        and {item.home for item in items} == set(HOMES)
        and {item.kind for item in items} == set(KINDS)
    )
    assert len({item.turns for item in items}) == len(items)
    assert things_run.requests(ThingsSettings(HOMES[:2], queries="written"), Path()) == [
        i for i in items if i.home in HOMES[:2]
    ]


@pytest.mark.skipif(not available(), reason="contacts are traced with embreex")
def test_contacts_and_colours_come_from_the_triangles() -> None:
    scene = load_scene("""\
name: toy
start: [0.5, 0.5]
rooms:
  - {name: big, kind: living room, box: [0, 0, 5, 4], floor: oak, walls: "paint:cream"}
things:
  - {type: DiningTable, at: [2.5, 2], things: [{type: Mug, at: [0.2, 0]}]}
  - {type: ShelvingUnit, at: [4.7, 2], face: west, size: [1.0, 0.34, 1.4], things: [{type: Book}]}
  - {type: Sofa, at: [1, 3.4], size: [1.7, 0.9, 0.85], colour: petrol}
""")
    contacts = Contacts(scene)
    labels = {t.id: t.type for t in scene.things}
    assert {(labels[a], labels[b], how) for a, (b, how) in contacts.holder.items()} == {
        ("Mug", "DiningTable", "on"), ("Book", "ShelvingUnit", "in")
    }  # fmt: skip
    sofa = next(t for t in true_objects(scene) if t.label == "sofa")
    assert sofa.colours[0][0] == "blue" and sofa.colours[0][1] > 0.9 and sofa.room == 0


@pytest.mark.parametrize(("home", "ring"), [("kitchen_diner", {31, 33}), ("family_flat", {35, 36})])
def test_no_two_objects_hold_each_other(home: str, ring: set[int]) -> None:
    """A cabinet over a bowl, and two plates in a pile: requests were made from such a home without an end."""
    holder = Contacts(load_home(home)).holder
    assert sum(holder.get(i, (0, ""))[0] in ring for i in ring) == 1
    for first in holder:
        seen, held = {first}, holder.get(first)
        while held:
            assert held[0] not in seen
            seen.add(held[0])
            held = holder.get(held[0])


class Counts:
    """Tells how many things there are of the first name in the words; it goes to others, and keeps what it was
    shown."""

    name = "counts (test)"

    def __init__(self) -> None:
        self.seen: list[Inventory] = []

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        self.seen.append(inventory)
        name = next(name for name in inventory.names if name in query)
        ids = tuple(t.id for t in inventory.objects if t.label == name)
        if "how many" in query:
            return Selection("answered", text="so many", fact=Fact("count", len(ids), ids))
        return Selection("found", name, object_id=ids[0])

    def propose(self, query: str) -> list[str]:
        return []


OWN = [
    {"id": "c", "home": "south", "kind": "count", "text": "how many mug are there", "accept_ids": [], "answer": 1},
    {"id": "m", "home": "south", "kind": "relation", "text": "the mug on the table", "accept_ids": [], "answer": None},
    {"id": "s", "home": "east", "kind": "relation", "text": "the bed", "accept_ids": [8], "answer": None},
]


@pytest.fixture
def own(tmp_path: Path) -> str:
    mug = next(t.id for t in Maps(tmp_path, MapSettings(WORLD)).world.objects("south") if t.label.lower() == "mug")
    rows = [row | ({"accept_ids": [mug]} if row["id"] in "cm" else {}) for row in OWN]
    (tmp_path / "own.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    return str(tmp_path / "own.jsonl")


def test_a_run_asks_with_the_map_with_names_and_blindly_and_goes_on_where_it_stopped(own: str, tmp_path: Path) -> None:
    settings = ThingsSettings(things_run.homes_of(own), ("ground_truth",), own, WORLD)
    items = things_run.requests(settings, tmp_path / "maps")
    reasoner = Counts()

    def ran(reasoner: Reasoner, items: list[Item] = items) -> list[dict[str, Any]]:
        return suite.run(tmp_path / "run", things_run.things(settings, items, reasoner, tmp_path / "maps"))

    rows = ran(reasoner)
    right = {(row["id"], row["run"]): row["right"] for row in rows}
    assert len(rows) == 9 and all(right[i, "map"] and right[i, "names only"] for i in "cms")
    assert "written by hand" not in (tmp_path / "run" / "report.md").read_text()
    lines = (tmp_path / "run" / "results.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "run" / "results.jsonl").write_text("".join(lines[:5]) + lines[5][:20])
    again = Counts()
    rest = ran(again)
    assert [r | {"seconds": 0} for r in rest] == [r | {"seconds": 0} for r in rows] and len(again.seen) < len(
        reasoner.seen
    )
    with pytest.raises(InputError, match="other settings"):
        ran(reasoner, items[:1])


def test_any_systems_answers_are_scored_and_what_it_left_out_is_wrong(own: str, tmp_path: Path) -> None:
    settings = ThingsSettings(things_run.homes_of(own), queries=own, world=WORLD)
    items = things_run.requests(settings, tmp_path)
    (tmp_path / "theirs.jsonl").write_text(
        '{"id": "c", "status": "answered", "answer": 1}\n{"id": "s", "status": "found", "xy": [1.0, 3.0]}'
    )
    given = load_answers(tmp_path / "theirs.jsonl", items)
    rows = suite.run(tmp_path / "scored", things_run.answered(settings, items, given, "theirs", tmp_path))
    assert {row["id"]: row["right"] for row in rows} == {"c": True, "m": False, "s": True}
    assert json.loads((tmp_path / "scored" / "results.json").read_text())["made from the truth"]["count"]["n"] == 1


def test_with_names_only_no_room_and_no_place_is_seen() -> None:
    room = Room(0, "kitchen", "kitchen", np.zeros((1, 2), np.int32))
    reasoner = Counts()
    chosen = NamesOnly(reasoner).select("the chair", Inventory(OBJECTS, (room,), from_xy=(0.0, 0.0)))
    assert not reasoner.seen[0].rooms and len(reasoner.seen[0].objects) == len({t.label for t in OBJECTS})
    assert (chosen.object, chosen.object_id) == ("chair", None)


def test_requests_are_made_only_where_all_is_known(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="in the dollhouse, not in rooms"):
        true_home(Maps(tmp_path, MapSettings(WORLD)).world, "south", 0, tmp_path)
    (tmp_path / "far.jsonl").write_text(json.dumps(GOOD | {"home": "south", "accept_ids": [999]}))
    with pytest.raises(InputError, match="'a': south has no object with the id 999"):
        things_run.requests(ThingsSettings(("south",), queries=str(tmp_path / "far.jsonl"), world=WORLD), tmp_path)
    with pytest.raises(InputError, match="is about south: add that to --homes"):
        things_run.requests(ThingsSettings(("east",), queries=str(tmp_path / "far.jsonl"), world=WORLD), tmp_path)
