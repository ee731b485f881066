"""Laws of the executor: relations, superlatives, numbers, colours, rooms, doors, and what was listed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from homes import inventory

from cartier.reasoners import embedded
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation
from cartier.spatial.query import Scene
from cartier.types import Door, Inventory, Room, Selection
from cartier.understanding.answers import answer
from cartier.understanding.dialogue_state import DialogueState, resolve
from cartier.understanding.grounding import ReferenceGrounder
from cartier.understanding.owners import owner_told
from cartier.understanding.phrase_words import colours_said, in_words
from cartier.understanding.spoken_corrections import SpokenCorrection, spoken_correction
from cartier.understanding.tags import Clause, Span
from flat import cells, obj

RELATIONS = ("on", "in", "under", "above", "next to", "near", "with", "left of", "right of", "nearest", "farthest")
MEASURES = (
    "biggest", "smallest", "tallest", "shortest", "highest", "lowest", "widest", "longest", "nearest", "farthest",
)  # fmt: skip
STORED = Scene(inventory("house"))

OBJECTS = (
    obj(1, "table", (1.0, 1.0, 0.35), (1.0, 0.8, 0.7), 0, ["brown"]),
    obj(2, "table", (4.0, 1.0, 0.35), (1.6, 0.8, 0.7), 0, ["white"]),
    obj(3, "cup", (0.8, 1.0, 0.75), (0.08, 0.08, 0.1), 0, ["red"]),
    obj(4, "cup", (1.2, 1.0, 0.75), (0.08, 0.08, 0.1), 0, ["blue", "white"]),
    obj(5, "cup", (4.0, 1.0, 0.75), (0.08, 0.08, 0.1), 0, ["white"]),
    obj(6, "bed", (2.0, 6.0, 0.25), (2.0, 1.6, 0.5), 1, ["blue"]),
    obj(7, "side table", (3.3, 6.0, 0.3), (0.4, 0.4, 0.6), 1),
    obj(8, "side table", (6.0, 1.0, 0.3), (0.4, 0.4, 0.6), 0),
    obj(9, "chair", (9.0, 6.0, 0.4), (0.5, 0.5, 0.8), 2),
    obj(10, "ruler", (5.6, 6.0, 0.8), (0.1, 0.1, 1.6), 1),
    obj(11, "stove burner", (8.0, 1.0, 0.9), (0.3, 0.3, 0.04), 0),
    obj(12, "stove burner", (8.4, 1.0, 0.9), (0.3, 0.3, 0.04), 0),
    obj(13, "pot", (8.4, 1.0, 1.0), (0.25, 0.25, 0.16), 0),
)
ROOMS = (
    Room(0, "kitchen", "kitchen", cells()), Room(1, "bedroom 1", "bedroom", cells()),
    Room(2, "bedroom 2", "bedroom", cells()),
)  # fmt: skip
DOORS = (Door((2.0, 3.0), (0, 1), 0.8), Door((6.0, 6.0), (1, 2), 0.8))
HOME = Inventory(OBJECTS, ROOMS, from_xy=(0.0, 0.0), doors=DOORS)
SCENE = Scene(HOME)


def phrase(name: str, **told: object) -> ReferringExpression:
    return replace(ReferringExpression(name, frozenset({name})), **told)


def ids(found: ReferringExpression) -> list[int]:
    return [o.id for o in SCENE.meant(found)[0]]


@pytest.fixture(scope="module")
def reasoner() -> embedded.Embedded:
    return embedded.make()


def talk(reasoner: embedded.Embedded, *said: str) -> Selection:
    turns: list[tuple[str, str]] = []
    for words in said:
        chosen = reasoner.select(words, HOME, turns)
        assert HOME.contains(chosen), chosen
        name = f"{chosen.object} #{chosen.object_id}" if chosen.object_id is not None else chosen.object
        told = chosen.text if chosen.object_id is None else f"{chosen.text} (#{chosen.object_id})"
        turns.append((words, told if chosen.status == "answered" else chosen.question or name or "nothing"))
    return chosen


@pytest.mark.parametrize("kind", RELATIONS)
def test_relation_and_its_negation_part_the_objects(kind: str) -> None:
    labels = sorted({o.label for o in STORED.objects})
    for name in labels:
        for mark in labels[:12]:
            one = phrase(name, relations=(SpatialRelation(kind, phrase(mark)),))
            other = replace(one, relations=(SpatialRelation(f"not {kind}", phrase(mark)),))
            with_it, without = ([o.id for o in STORED.meant(each)[0]] for each in (one, other))
            assert not set(with_it) & set(without)
            assert {*with_it, *without} == {o.id for o in STORED.meant(phrase(name))[0]}


@pytest.mark.parametrize("wish", MEASURES)
def test_superlative_is_beaten_by_none_of_its_kind(wish: str) -> None:
    for name in {o.label for o in STORED.objects}:
        every = STORED.meant(phrase(name))[0]
        (best,) = STORED.meant(phrase(name, most=wish))[0]
        assert STORED.measure(best, wish) >= max(STORED.measure(o, wish) for o in every) - 1e-9


def test_wide_is_along_the_floor_and_long_is_any_side() -> None:
    assert SCENE.measure(OBJECTS[9], "widest") == pytest.approx(0.1)
    assert SCENE.measure(OBJECTS[9], "longest") == pytest.approx(1.6)


@pytest.mark.parametrize(("number", "table"), [(2, 1), (1, 2), (3, None)])
def test_number_of_what_stands_there_tells_which(number: int, table: int | None) -> None:
    cups = phrase("cup", number=number)
    found = ids(phrase("table", relations=(SpatialRelation("with", cups),)))
    assert found == [table] if table is not None else set(found) == {1, 2}  # the map may lack one


def test_second_colour_must_be_there_too() -> None:
    assert ids(phrase("cup", colours=("white",), also=("blue",))) == [4]
    assert colours_said(("blue", "and", "white")) == (("blue",), ("white",))
    assert colours_said(("cream",)) == (("white", "yellow"), ())


def test_support_of_a_thing_is_what_is_under_it() -> None:
    assert ids(phrase("stove burner", relations=(SpatialRelation("under", phrase("pot")),))) == [12]


def test_what_a_thing_stands_on_is_under_it_rather_than_what_lies_below() -> None:
    below = obj(22, "stove burner", (8.4, 1.0, 0.02), (0.3, 0.3, 0.04), 0)
    under = phrase("stove burner", relations=(SpatialRelation("under", phrase("pot")),))
    assert [o.id for o in Scene(Inventory((*OBJECTS, below))).meant(under)[0]] == [12]


def test_tentative_object_may_be_left_of_a_landmark() -> None:
    bed = obj(6, "bed", (8.0, 3.0, 0.25), (2.0, 1.6, 0.5), 1)
    lamps = (obj(31, "lamp", (8.0, 4.5, 0.5), (0.3, 0.3, 1.0), 1, probability=0.4),
             obj(32, "lamp", (8.0, 1.0, 0.5), (0.3, 0.3, 1.0), 1, probability=0.6))  # fmt: skip
    scene = Scene(Inventory((bed, *lamps)))
    for side, number in (("left of", 31), ("right of", 32)):
        found = scene.perhaps(phrase("lamp", relations=(SpatialRelation(side, phrase("bed")),)))
        assert found is not None and found.id == number


def test_list_of_a_room_is_what_stands_in_it() -> None:
    kitchen = ReferringExpression("kitchen", rooms=(0,))
    chosen = answer(ParsedUtterance("list", head=kitchen), SCENE, None, "")
    assert chosen is not None and chosen.fact is not None
    assert set(chosen.fact.objects) == {o.id for o in OBJECTS if o.room == 0}


def test_usual_place_narrows_and_never_excludes() -> None:
    near = SpatialRelation("near", phrase("bed"))
    assert ids(phrase("side table", usually=near)) == [7]
    assert ids(phrase("cup", usually=near)) == ids(phrase("cup"))


@pytest.mark.parametrize(
    ("words", "room"),
    [
        ("take me to the second bedroom", 2),
        ("go to bedroom two", 2),
        ("take me to the bigger bedroom", 1),
        ("go to the room with the bed in it", 1),
        ("take me to the room with the stove burner", 0),
    ],
)
def test_room_is_found_by_what_is_said_of_it(reasoner: embedded.Embedded, words: str, room: int) -> None:
    chosen = talk(reasoner, words)
    assert (chosen.status, chosen.room) == ("found", room), chosen


def test_other_room_is_not_that_of_the_last_object() -> None:
    asked = ParsedUtterance("go", ReferringExpression("bedroom", rooms=(1, 2), other=True))
    for last, room in ((OBJECTS[5], 2), (OBJECTS[8], 1)):
        head = SCENE.with_rooms(asked, last).head
        assert head is not None and head.rooms == (room,)


@pytest.mark.parametrize("words", ["take me to the third bedroom", "go to the room with the piano"])
def test_room_that_fits_nothing_is_told_with_the_rooms_there_are(reasoner: embedded.Embedded, words: str) -> None:
    chosen = talk(reasoner, words)
    assert chosen.room is None and chosen.text.startswith("I know no such "), chosen


@pytest.mark.parametrize(
    ("words", "door", "says"),
    [
        ("go to the door", 0, "There are 2; this is the nearest, between the kitchen and bedroom 1."),
        ("take me to the kitchen door", 0, "The passage between the kitchen and bedroom 1."),
        ("go to the door between the kitchen and bedroom 2", None, "I know no door between the kitchen and bedroom 2"),
        ("go to the front door", None, "I know no front door here; there are 2 passages: between the kitchen and"),
    ],
)
def test_door_is_a_goal(reasoner: embedded.Embedded, words: str, door: int | None, says: str) -> None:
    chosen = talk(reasoner, words)
    assert chosen.door == door and chosen.text.startswith(says), chosen


def test_unknown_door_is_in_no_inventory() -> None:
    assert not HOME.contains(Selection("found", "door", door=2))
    assert HOME.contains(Selection("found", "door", door=1))


@pytest.mark.parametrize("unknown", ["window", "door"])
def test_distance_from_what_is_not_there_is_not_that_from_here(unknown: str) -> None:
    scene = Scene(replace(HOME, doors=()))
    asked = ParsedUtterance("far", phrase("bed"), (ReferringExpression(unknown),))
    told = answer(asked, scene, None, "")
    assert told is not None and told.fact is not None
    assert told.fact.value is None and told.text == f"I have not seen a {unknown}."


def test_place_of_the_robot_is_a_landmark() -> None:
    near = replace(
        phrase(""), generic=True, relations=(SpatialRelation("near", ReferringExpression("you", generic=True)),)
    )
    told = answer(ParsedUtterance("list", near), SCENE, None, "")
    far = answer(ParsedUtterance("list", near), Scene(replace(HOME, from_xy=(20.0, 20.0))), None, "")
    assert told is not None and told.fact is not None and told.fact.objects[0] in (1, 3, 4)
    assert "near here" in told.text
    assert far is not None and far.text.startswith("Nothing is within reach; the nearest is the chair, ")


def test_robot_tells_where_it_is() -> None:
    for words in ("where are you", "where am i", "which room are we in"):
        told = answer(ParsedUtterance("where", None, need=words), SCENE, OBJECTS[5], "")
        assert told is not None and told.text.startswith("I am in the kitchen, 0."), told
    it = answer(ParsedUtterance("where", None, need="where"), SCENE, OBJECTS[5], "")
    assert it is not None and "bed" in it.text


@pytest.mark.parametrize(
    ("said", "spans", "act", "meant"),
    [
        ("the lamp next to me", [("t", 1, 2), ("next", 2, 3)], "go", [("t", "lamp"), ("s", "nearest")]),
        ("what is near you", [], "list", [("near", "near"), ("l", "you")]),
        ("what is in by here", [("in", 2, 3)], "list", [("in", "in")]),
        ("the second of them", [("p", 3, 4)], "go", [("o", "second"), ("p", "them")]),
        ("what is on it besides the cup", [("l", 3, 4), ("m", 6, 7)], "list", [("l", "it"), ("n", "cup")]),
        ("besides the cup go to it", [("t", 2, 3), ("p", 5, 6)], "go", [("t", "cup"), ("p", "it")]),
        ("between bed and desk", [("between", 0, 1), ("l", 1, 2), ("b", 3, 4)], "list",
         [("between", "between"), ("l", "bed"), ("l", "desk")]),
        ("how far is the hall from the bed", [("r", 4, 5), ("t", 7, 8)], "far", [("r", "hall"), ("b", "bed")]),
    ],
)  # fmt: skip
def test_words_around_the_marked_ones_count(
    said: str, spans: list[tuple[str, int, int]], act: str, meant: list[tuple[str, str]]
) -> None:
    tokens = tuple(said.split())
    told = tuple(Span(role, tokens[a:b], a, b) for role, a, b in spans)
    clause = in_words(Clause(act, 1.0, told, tokens))  # type: ignore[arg-type]
    assert [(span.role, " ".join(span.words)) for span in clause.spans] == meant


LISTED = DialogueState(last=OBJECTS[0], listed=(4, 3, 5))


@pytest.mark.parametrize(
    ("head", "found"),
    [
        (ReferringExpression("them", generic=True, order=2), [3]),
        (ReferringExpression("one", generic=True, order=-1), [5]),
        (ReferringExpression("one", generic=True, colours=("red",)), [3]),
        (ReferringExpression("them", generic=True), [4, 3, 5]),
        (ReferringExpression("that", generic=True), [4, 3, 5]),
        (ReferringExpression("there", generic=True), [1]),
    ],
)
def test_list_is_spoken_of_in_its_order(head: ReferringExpression, found: list[int]) -> None:
    asked = resolve(ParsedUtterance("go", head), LISTED).head
    assert asked is not None and ids(asked) == found


def test_listed_objects_are_compared() -> None:
    head = ReferringExpression("them", generic=True, size="widest")
    asked = resolve(ParsedUtterance("compare", head, by="widest"), replace(LISTED, listed=(1, 2)))
    told = answer(asked, SCENE, None, "")
    assert told is not None and told.object_id == 2 and told.text == "The table in the kitchen is wider."


def test_named_object_is_meant_rather_than_the_list() -> None:
    pointed = replace(LISTED, pointed=True)
    head = resolve(ParsedUtterance("go", ReferringExpression("that", generic=True)), pointed).head
    assert head is not None and ids(head) == [1]


@pytest.mark.parametrize(
    ("turns", "number"),
    [
        (("what is on the bed", "where are the cups", "take me to the second of them"), 4),
        (("is there a pot", "show me"), 13),
        (("bring me to the brown table", "and the white one?"), 2),
    ],
)
def test_talk_goes_on(reasoner: embedded.Embedded, turns: tuple[str, ...], number: int) -> None:
    chosen = talk(reasoner, *turns)
    assert chosen.object_id == number, chosen


def test_question_is_asked_of_another_place(reasoner: embedded.Embedded) -> None:
    told = talk(reasoner, "how many side tables are in the kitchen?", "and in bedroom 1?")
    assert told.fact is not None and (told.fact.kind, told.fact.value, told.fact.objects) == ("count", 1, (7,))


def test_request_after_a_question_is_no_choice(reasoner: embedded.Embedded) -> None:
    told = talk(reasoner, "the cup on the table", "how many chairs are there?")
    assert told.fact is not None and (told.fact.kind, told.fact.value) == ("count", 1)


def test_other_one_of_two_that_were_both_served_is_not_the_last() -> None:
    head = phrase("side table", other=True)
    state = DialogueState(served=(7, 8), last=OBJECTS[7])
    names = ReferenceGrounder(ParsedUtterance("go", head), SCENE, None, state, "")  # type: ignore[arg-type]
    chosen = names.answer(lambda text, among: Selection("not_found"))
    assert chosen is not None and chosen.object_id == 7


def test_whose_object_is_asked_about_and_remembered(reasoner: embedded.Embedded) -> None:
    asked = talk(reasoner, "take me to Ben's side table")
    question = asked.question or ""
    assert question == "Which side table is Ben's side table: the one in the kitchen or the one in bedroom 1?"
    meant = SpokenCorrection("name", "7", "Ben's side table", drive=True)
    turns = [("take me to Ben's side table", question)]
    assert spoken_correction("the one in bedroom 1", turns, HOME, None) == meant
    assert owner_told("what is in the kitchen and on which table is it", question, HOME) is None
    named = replace(HOME, objects=tuple(replace(o, names=("Ben's side table",)) if o.id == 7 else o for o in OBJECTS))
    assert reasoner.select("take me to Ben's side table", named).object_id == 7


@pytest.mark.parametrize("words", ["take me to my son's side table", "go to Ben's bed"])
def test_no_name_or_one_object_is_not_asked_about(reasoner: embedded.Embedded, words: str) -> None:
    assert talk(reasoner, words).status == "found"
