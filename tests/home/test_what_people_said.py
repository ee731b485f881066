"""Laws of corrections: undone, each leaves the home as it was; saved, grown or mapped again, each still holds."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cartier
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.corrected import FIRST_MADE, apply
from cartier.home.correction_log import LOG, Correction, CorrectionKind, Subject, read_log
from cartier.home.corrections import find
from cartier.pipeline import map_home
from cartier.types import MapObject, Selection
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk

Wish = tuple[CorrectionKind, str, dict[str, Any]]
WISHES: list[Wish] = [
    ("name", "mug", {"name": "Ayo's mug"}),
    ("name", "room:0", {"name": "Ben's room"}),
    ("name", "home", {"name": "Ben's flat"}),
    ("confirm", "chair", {}),
    ("relabel", "mug", {"name": "pencil box"}),
    ("add", "", {"name": "vase", "to_xy": (0.5, 2.5)}),
    ("add", "table", {"name": "vase"}),
    ("add", "room:0", {"name": "vase"}),
    ("merge", "table", {"other": "mug"}),
    ("split", "table", {}),
    ("split", "table", {"name": "desk"}),
    ("move", "chair", {"to_xy": (1.0, 1.0)}),
    ("forget", "chair", {}),
]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home of every other frame of a walk, to be grown by the others."""
    folder = tmp_path_factory.mktemp("said") / "home"
    map_home(half(0), TrueBoxes(THINGS)).save(folder)
    return folder


@pytest.fixture
def home(kept: Path, tmp_path: Path) -> Home:
    return Home.load(shutil.copytree(kept, tmp_path / "home"))


def half(number: int) -> RoomRecording:
    poses = walk().poses
    parts = (poses[::2], poses[1::2])
    return RoomRecording(parts[number], THINGS, name="ab"[number])


def folder(home: Home) -> Path:
    assert home.store is not None
    return home.store.folder


def the(home: Home, entity: str) -> MapObject:
    found = find(entity, home.objects)
    assert isinstance(found, MapObject)
    return found


def told(home: Home) -> str:
    """Everything that a home says of itself, indexes included."""
    indexes = {name: index.names() for name, index in home.indexes.items()}
    return json.dumps([home.to_dict(), indexes], sort_keys=True)


def weakened(home: Home, label: str) -> Home:
    """The home as if its objects of a label were hardly ever detected, in the state that growing goes on from, too."""
    import numpy as np

    from cartier.io.files import npz_bytes, read_npz

    ids = [obj.id for obj in home.objects if obj.label == label]
    arrays = read_npz(home.growth["object_map.npz"])
    row = np.isin(arrays["id"], ids)
    arrays["n_detected"] = np.where(row, 1, arrays["n_detected"])
    arrays["n_observable"] = np.where(row, 40, arrays["n_observable"])
    arrays["detected"][row] *= 0.02
    objects = tuple(
        replace(obj, probability=0.05, confirmed=False, n_detected=1) if obj.id in ids else obj for obj in home.objects
    )
    growth = {**home.growth, "object_map.npz": npz_bytes(**arrays)}
    replace(home, objects=objects, growth=growth, corrected=None).save(folder(home))
    return Home.load(folder(home))


@pytest.mark.parametrize("wish", WISHES, ids=lambda wish: f"{wish[0]} {wish[1]}")
def test_undone_it_leaves_the_home_bit_for_bit(home: Home, wish: Wish) -> None:
    what, entity, more = wish
    changed, done = home.correct(what, entity, **more, who="Ben")
    assert told(changed) != told(home) and done
    again, undone = changed.correct("undo", who="Ben")
    assert told(again) == told(home) and again.objects == home.objects and undone == f"undone: {done}"


@pytest.mark.parametrize("wish", WISHES, ids=lambda wish: f"{wish[0]} {wish[1]}")
def test_it_holds_when_saved_elsewhere_and_its_log_reads_as_it_was_written(
    home: Home, wish: Wish, tmp_path: Path
) -> None:
    what, entity, more = wish
    changed, _ = home.correct(what, entity, **more)
    changed.save(tmp_path / "copy")
    assert told(Home.load(tmp_path / "copy")) == told(changed) == told(Home.load(folder(home)))
    assert changed.corrected is not None
    assert read_log(folder(home)) == (changed.corrected.log, ())


HOLDS: dict[str, Callable[[Home], bool]] = {
    "name mug": lambda home: the(home, "Ayo's mug").label == "mug",
    "name room:0": lambda home: home.rooms[0].name == "Ben's room",
    "name home": lambda home: home.name == "Ben's flat",
    "confirm chair": lambda home: the(home, "chair").by_person and the(home, "chair").confirmed,
    "relabel mug": lambda home: "mug" not in home.names and the(home, "pencil box").confirmed,
    "add ": lambda home: the(home, "vase").position[:2] == (0.5, 2.5),
    "add table": lambda home: the(home, "vase").box_min[2] > 0.5,
    "add room:0": lambda home: the(home, "vase").room == home.rooms[0].id,
    "merge table": lambda home: "mug" not in home.names and bool(the(home, "table").aliases),
    "split table": lambda home: len([obj for obj in home.objects if obj.label in ("table", "desk")]) == 2,
    "move chair": lambda home: the(home, "chair").position[:2] == (1.0, 1.0),
    "forget chair": lambda home: "chair" not in home.names,
}


@pytest.mark.parametrize("wish", WISHES, ids=lambda wish: f"{wish[0]} {wish[1]}")
def test_it_holds_in_a_grown_home_before_and_after_it_is_saved(home: Home, wish: Wish, tmp_path: Path) -> None:
    what, entity, more = wish
    holds = HOLDS[f"{what} {entity}"]
    changed, _ = home.correct(what, entity, **more)
    grown = map_home(half(1), TrueBoxes(THINGS), onto=changed)
    grown.save(tmp_path / "grown")
    loaded = Home.load(tmp_path / "grown")
    assert holds(changed) and holds(grown) and holds(loaded)
    assert grown.corrected is not None and not grown.corrected.notes
    assert told(loaded) == told(grown) and loaded.id != home.id


@pytest.mark.parametrize("what", ["confirm", "name", "relabel", "move"])
def test_what_a_person_spoke_of_is_neither_doubted_nor_pruned(home: Home, what: CorrectionKind) -> None:
    more = {"name": {"name": "mine"}, "relabel": {"name": "mug"}, "move": {"to_xy": (2.0, 2.0)}}.get(what, {})
    weak = weakened(home, "mug")
    assert not the(weak, "mug").confirmed
    said, _ = weak.correct(what, "mug", **more)  # type: ignore[arg-type]
    mug = the(said, "mug")
    assert mug.confirmed and mug.probability == 1.0 and mug.by_person and "mug" in said.names
    assert mug.n_detected == 1, "the evidence stays as it is"

    class Blind(TrueBoxes):
        def detect(self, frame: cartier.Frame) -> cartier.Detections:
            found = super().detect(frame)
            return found.keep([k for k, label in enumerate(found.labels) if label != "mug"])  # type: ignore[arg-type]

    pruned = map_home(half(1), Blind(THINGS), onto=replace(said, objects=weak.objects, corrected=None))
    assert not [obj for obj in pruned.objects if obj.label == "mug"], "what nobody spoke of is pruned"
    grown = map_home(half(1), Blind(THINGS), onto=said)
    assert the(grown, "mug").id == mug.id and the(grown, "mug").confirmed and the(grown, "mug").views
    grown.save(folder(home))
    assert the(Home.load(folder(home)), "mug").confirmed


def test_what_the_map_has_lost_is_made_anew_where_it_was_said_to_be(home: Home) -> None:
    said, _ = home.correct("confirm", "mug")
    said, _ = said.correct("name", "mug", name="mine")
    assert said.corrected is not None and said.corrected.log[0].origin
    left = tuple(obj for obj in home.objects if obj.label != "mug")
    origin = said.corrected.log[0].origin
    anew = apply(said.corrected.log, left, home.rooms, home.grid, "home", origin)
    mug = next(obj for obj in anew.objects if obj.label == "mug")
    assert mug.names == ("mine",) and mug.confirmed and mug.position == the(home, "mug").position
    assert anew.notes == (f"the map no longer shows mug {mug.id}; somebody said it is there",)
    elsewhere = apply(said.corrected.log, left, home.rooms, home.grid, "home", "another recording")
    assert elsewhere.objects == left and "fits nothing in this map" in elsewhere.notes[0]


def obj(number: int, label: str, x: float, *, y: float = 1.0, half_m: float = 0.1) -> MapObject:
    low, high = (x - half_m, y - half_m, 0.0), (x + half_m, y + half_m, 0.2)
    votes = ((label, 1.0),)
    return MapObject(number, label, votes, (x, y, 0.1), low, high, 0.9, True, 3, 3, 0.0, 1.0, 1.0, ())


def entry(about: MapObject, what: CorrectionKind, newest: int, **more: Any) -> Correction:
    size = tuple(high - low for low, high in zip(about.box_min, about.box_max, strict=True))
    subject = Subject("object", about.id, about.label, about.position, size)
    return Correction(f"{what} {about.id}", "2026", "Ayo", what, subject, newest=newest, **more)


def test_what_was_forgotten_does_not_come_back_under_another_id() -> None:
    ghost, twin = obj(3, "cup", 1.0), obj(4, "cup", 1.2)
    log = [entry(ghost, "forget", 4)]
    assert apply(log, (ghost, twin), (), None).objects == (twin,), "its neighbour was never forgotten"
    returned, third = obj(9, "cup", 1.05), obj(10, "cup", 3.0)
    assert apply(log, (ghost, twin, returned, third), (), None).objects == (twin, third)


def test_forgetting_one_never_takes_what_somebody_said_is_there() -> None:
    ghost, real = obj(3, "cup", 1.0), obj(4, "cup", 1.4)
    log = [entry(ghost, "forget", 4), entry(real, "confirm", 4)]
    assert [t.id for t in apply(log, (real,), (), None).objects] == [4], "the ghost is gone from the map by itself"
    assert [t.id for t in apply(log[::-1], (real,), (), None).objects] == [4]
    mine = [entry(real, "confirm", 4), entry(replace(real, id=7), "forget", 7)]
    assert not apply(mine, (replace(real, id=7),), (), None).objects, "it was mapped again, and then forgotten"


def test_an_added_thing_that_the_map_shows_later_is_one_with_it() -> None:
    added = obj(FIRST_MADE + 1, "vase", 1.0)
    log = [entry(added, "add", 4), entry(added, "name", 4, name="Ayo's")]
    alone = apply(log, (), (), None)
    assert [(t.id, t.names) for t in alone.objects] == [(FIRST_MADE + 1, ("Ayo's",))]
    assert alone.objects[0].box_max == pytest.approx(added.box_max)
    shown = apply(log, (obj(8, "vase", 1.1),), (), None)
    assert [(t.id, t.names, t.confirmed) for t in shown.objects] == [(8, ("Ayo's",), True)]
    assert find(str(FIRST_MADE + 1), shown.objects) == shown.objects[0], "its old id is still good"


def test_halves_that_the_map_tells_apart_later_are_two_and_not_three() -> None:
    pair = obj(3, "chair", 2.0, half_m=1.0)
    other = Subject("object", FIRST_MADE + 1, "chair", (2.5, 1.0, 0.1), (1.0, 2.0, 0.2))
    log = [entry(pair, "split", 3, other=other)]
    first, second = apply(log, (pair,), (), None).objects
    assert (first.box_max[0], second.box_min[0], second.id) == (2.0, 2.0, FIRST_MADE + 1)
    left, right = obj(3, "chair", 1.6), obj(9, "chair", 2.5)
    assert [t.id for t in apply(log, (left, right), (), None).objects] == [3, 9]


def test_the_half_that_is_pointed_at_is_the_second(home: Home) -> None:
    table = the(home, "table")
    x, y = table.box_min[0] + 0.05, table.position[1]
    two, done = home.correct("split", "table", name="desk", to_xy=(x, y))
    desk, rest = the(two, "desk"), the(two, "table")
    assert desk.box_max[0] == rest.box_min[0] == pytest.approx(table.position[0], abs=1e-3)
    assert desk.id == FIRST_MADE + 1 and done == f"table ({table.id}) is two: the other is desk ({desk.id})"
    with pytest.raises(InputError, match="point at one of the two"):
        home.correct("split", "table", to_xy=(table.box_max[0] + 0.3, y))


def test_a_relabelled_thing_takes_in_what_is_found_there_under_its_right_name() -> None:
    wrong, right = obj(3, "telephone", 1.0), obj(9, "pencil box", 1.05)
    log = [entry(wrong, "relabel", 4, label="pencil box")]
    fixed = apply(log, (wrong, right), (), None).objects
    assert [(t.id, t.label, t.labels, t.aliases) for t in fixed] == [
        (3, "pencil box", (("pencil box", 1.0),), (9,))
    ]  # fmt: skip


def test_two_that_are_one_keep_the_evidence_and_the_ids_of_both(home: Home) -> None:
    table, mug = the(home, "table"), the(home, "mug")
    one, _ = home.correct("merge", "table", other="mug")
    both = the(one, str(mug.id))
    assert both.id == table.id and both.label == "table" and {"mug", "table"} == {name for name, _ in both.labels}
    assert both.box_max[2] == max(table.box_max[2], mug.box_max[2])
    assert len(both.views) == min(16, len(table.views) + len(mug.views))
    with pytest.raises(InputError, match="are one object"):
        one.correct("merge", "table", other=str(mug.id))


def test_an_added_thing_is_asked_for_described_and_driven_to(home: Home) -> None:
    added, done = home.correct("add", "table", name="Pencil_Box", who="Ben")
    box = the(added, "pencil box")
    assert done.startswith(f"pencil box ({box.id}) is added at x ") and box.box_min[2] == the(home, "table").box_max[2]
    for index in added.indexes:
        place = added.locate(Selection("found", "pencil box", object_id=box.id), index)
        assert place is not None and place.object_id == box.id and place.position == box.position
    answer = cartier.ask(added, "where is the pencil box?")
    assert answer.selection.object_id == box.id and box.room == the(home, "table").room
    x, y = (low + 0.05 for low in the(home, "table").box_min[:2])
    clicked, _ = home.correct("add", "", name="vase", to_xy=(x, y))
    assert the(clicked, "vase").box_min[2] == the(home, "table").box_max[2], "a click on the table is on it"


def test_adding_what_the_map_only_suspects_confirms_it_and_what_it_has_is_refused(home: Home) -> None:
    weak = weakened(home, "mug")
    mug = the(weak, "mug")
    said, done = weak.correct("add", "", name="mug", to_xy=mug.position[:2])
    assert done == f"mug ({mug.id}) is there" and the(said, "mug").confirmed and len(said.objects) == len(weak.objects)
    with pytest.raises(InputError, match=f"mug {mug.id} is there already"):
        said.correct("add", "", name="mug", to_xy=mug.position[:2])


def test_ids_of_what_was_added_are_never_given_again(home: Home) -> None:
    now, _ = home.correct("add", "", name="vase", to_xy=(0.5, 2.5))
    now, _ = now.correct("undo")
    now, _ = now.correct("add", "", name="lamp", to_xy=(0.5, 2.5))
    assert the(now, "lamp").id == FIRST_MADE + 2


@pytest.mark.parametrize(
    ("what", "entity", "more"),
    [
        ("confirm", "", {}), ("confirm", "room:0", {}), ("confirm", "sofa", {}), ("relabel", "mug", {}),
        ("relabel", "mug", {"name": "12"}), ("relabel", "room:0", {"name": "vase"}), ("name", "mug", {"name": "Home"}),
        ("add", "", {"name": "vase"}), ("add", "", {"name": "vase", "to_xy": (50.0, 0.0)}), ("add", "table", {}),
        ("add", "sofa", {"name": "vase"}), ("merge", "mug", {}), ("merge", "mug", {"other": "mug"}),
        ("merge", "mug", {"other": "room:0"}), ("split", "room:0", {}), ("split", "table", {"to_xy": (1.0,)}),
        ("name", "home", {"name": "  "}), ("forget", "home", {}), ("swap", "mug", {}),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_one_line_and_not_noted(
    home: Home, what: CorrectionKind, entity: str, more: dict[str, Any]
) -> None:
    with pytest.raises(InputError) as refused:
        home.correct(what, entity, **more)
    assert "\n" not in str(refused.value) and not (folder(home) / LOG).exists()


OBJECT = {"kind": "object", "id": 1, "label": "mug", "position": [1, 2, 3], "size": [1, 1, 1]}
ROW = {"id": "1", "when": "2026", "who": "x", "what": "confirm", "subject": OBJECT}


@pytest.mark.parametrize(
    "more",
    [
        {"what": "add", "subject": {**OBJECT, "size": [1, 1]}}, {"subject": {**OBJECT, "size": [1, 1, -1]}},
        {"what": "add", "subject": {k: v for k, v in OBJECT.items() if k != "size"}}, {"what": "relabel"},
        {"what": "relabel", "label": "x" * 61}, {"what": "merge"}, {"what": "split", "other": {**OBJECT, "id": -1}},
        {"what": "merge", "other": {"kind": "room", "id": 1, "label": "x", "position": [1, 2]}}, {"newest": 1.5},
        {"newest": -1}, {"newest": True}, {"origin": ""}, {"origin": 3}, {"subject": {**OBJECT, "id": 2**60}},
        {"subject": {"kind": "home", "id": 0, "label": "x", "position": []}},
        {"what": "name", "name": "y", "subject": {"kind": "home", "id": 0, "label": "x", "position": [1]}},
        {"subject": {**OBJECT, "size": [1, 1, 1e9]}}, {"subject": {**OBJECT, "size": "abc"}},
    ],
)  # fmt: skip
def test_a_strangers_entry_of_a_new_kind_is_left_out_and_said(home: Home, more: dict[str, Any]) -> None:
    log = folder(home) / LOG
    log.write_text(json.dumps(ROW) + "\n" + json.dumps(ROW | more) + "\n")
    entries, notes = read_log(folder(home))
    assert len(entries) == 1 and notes == (f"{LOG} line 2 is damaged: this correction is left out",)


def test_a_stranger_adds_no_more_than_a_home_can_hold(home: Home) -> None:
    rows = [ROW | {"id": str(k), "what": "add", "subject": {**OBJECT, "id": 10, "position": [k, 0, 0]}, "origin": "z"}
            for k in range(5)]  # fmt: skip
    (folder(home) / LOG).write_text("".join(json.dumps(row) + "\n" for row in rows))
    loaded = Home.load(folder(home))
    assert loaded.objects == home.objects and len(loaded.to_dict()["notes"]) == len(home.notes) + 5, "another frame"
    log = tuple(entry(obj(5, "mug", 2.0 * k), "add", 0) for k in range(1200))
    assert len(apply(log, (), (), None).objects) == 1000
