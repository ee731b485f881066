"""Laws of a log that is kept short: it gives the same home, its latest hundred are undone one by one, and it ends."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import pytest

from cartier.errors import InputError
from cartier.home import Home, compaction, correction_log, corrections
from cartier.home.compaction import compacted
from cartier.home.corrected import FIRST_MADE, Corrected, apply
from cartier.home.correction_log import LOG, Correction, in_force
from cartier.home.corrections import Wish
from cartier.mapping.rooms import find_rooms
from cartier.pipeline import map_home
from cartier.types import MapObject
from plans import flat
from synthetic import THINGS, RoomRecording, TrueBoxes, small_walk

GRID = flat().grid()
ROOMS = find_rooms(GRID, ())
LABELS = ("chair", "chair", "mug", "bed", "lamp", "table", "vase")
OBJECTS = tuple(
    MapObject(k, label, ((label, 1.0),), (x, 1.5, 0.5), (x - 0.2, 1.3, 0.0), (x + 0.2, 1.7, 1.0), 0.9, True, 5, 9, 0.0,
              1.0, 1.0, ())
    for k, label in enumerate(LABELS)
    for x in [0.5 + 0.9 * k]
)  # fmt: skip


def known(log: list[Correction] | tuple[Correction, ...]) -> Corrected:
    return apply(log, OBJECTS, ROOMS, GRID, "home", "frame")


def given(wishes: random.Random, count: int) -> list[Correction]:
    """A log of random corrections, each made as people make them."""
    log = list[Correction]()
    while len(log) < count:
        now = known(log)
        ids = [str(obj.id) for obj in now.objects] or ["0"]
        entity, other, name = wishes.choice(ids), wishes.choice(ids), f"n{wishes.randrange(9)}"
        place, room = (wishes.uniform(0.3, 6.5), wishes.uniform(0.3, 2.7)), f"room:{wishes.choice(now.rooms).id}"
        rule = f"avoid room:{wishes.choice(now.rooms).name} hard standing"
        wish = wishes.choice([
            Wish("name", entity, name), Wish("name", room, name), Wish("name", "home", name), Wish("confirm", entity),
            Wish("relabel", entity, wishes.choice(LABELS)), Wish("move", entity, to_xy=place), Wish("rule", rule),
            wishes.choice([Wish("merge", room, other="room:0"), Wish("split", room, to_xy=place), *[Wish("undo")] * 9]),
            Wish("lift", now.rules[0].id if now.rules else "none"), Wish("undo"), Wish("split", entity),
            Wish("add", "", "vase", place), Wish("forget", max(ids, key=int)),
            wishes.choice([Wish("merge", entity, other=other), Wish("forget", entity), Wish("name", entity, name)]),
        ])  # fmt: skip
        try:
            log.append(corrections.make(now, GRID, wish, "frame"))
        except InputError:
            continue
        if now.objects and wishes.random() < 0.1:
            log.append(
                corrections.evidence(now.objects[0], now, "there", wishes.choice([0.5, 2.0]), "a model", "frame")
            )
    return log


def result(log: list[Correction] | tuple[Correction, ...]) -> object:
    now = known(log)
    rooms = [(room.id, room.name, room.cells.tolist()) for room in now.rooms]
    return now.objects, rooms, now.name, now.rules, now.looked_at & {obj.id for obj in now.objects}


@pytest.mark.parametrize("seed", range(8))
def test_a_compacted_log_gives_the_same_home(seed: int) -> None:
    log = given(random.Random(seed), 50)
    short, left = [*compacted(log, undoable=4)], [*log]
    assert result(short) == result(left)
    for _ in range(4):
        for each in (short, left):
            each.append(corrections.make(known(each), GRID, Wish("undo")))
        assert result(short) == result(left)
    assert len(in_force(short)) < len(in_force(left)) or len(in_force(left)) < 20


def test_no_id_is_given_twice() -> None:
    log = list[Correction]()
    for wish in (Wish("add", "", "sofa", (0.4, 2.6)), Wish("undo"), *[Wish("confirm", "1")] * 9):
        log.append(corrections.make(known(log), GRID, wish, "frame"))
    short = compacted(log, undoable=4)
    added = corrections.make(known(short), GRID, Wish("add", "", "sofa", (0.4, 2.6)))
    assert len(short) == 7 and added.subject is not None and added.subject.id == FIRST_MADE + 2


def test_what_was_merged_where_it_stood_stays_as_large() -> None:
    log = list[Correction]()
    for wish in (
        Wish("move", "3", to_xy=(0.5, 2.5)), Wish("merge", "3", other="4"), Wish("move", "3", to_xy=(5.0, 1.0)),
        *[Wish("confirm", "1")] * 4,
    ):  # fmt: skip
        log.append(corrections.make(known(log), GRID, wish, "frame"))
    assert result(compacted(log, undoable=1)) == result(log)


@pytest.fixture
def home(tmp_path: Path) -> Home:
    map_home(RoomRecording(small_walk().poses[::3], THINGS), TrueBoxes(THINGS)).save(tmp_path / "home")
    return Home.load(tmp_path / "home")


def test_a_log_that_is_used_stays_short(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    assert home.store is not None
    monkeypatch.setattr(compaction, "STEP_BYTES", 2000)
    monkeypatch.setattr(compaction, "UNDOABLE", 5)
    monkeypatch.setattr(compacted, "__defaults__", (5,))
    log, sizes = home.store.folder / LOG, []
    stranger = "a line of a later cartier"
    log.write_text(stranger + "\n")
    for number in range(60):
        home, _ = home.correct("name", str(home.objects[number % 2].id), name=f"n{number}")
        sizes.append(log.stat().st_size)
    again = Home.load(home.store.folder)
    assert max(sizes) < 6000 and min(sizes[20:]) < 3000
    assert stranger in log.read_text()
    assert [obj.names for obj in again.objects[:2]] == [("n58",), ("n59",)]
    assert again.objects == home.objects
    for _ in range(5):
        again, _ = again.correct("undo")
    assert [obj.names for obj in again.objects[:2]] == [("n54",), ("n53",)]


def test_a_log_that_was_written_by_hand_is_read_anew(home: Home) -> None:
    assert home.store is not None
    first, second = (str(obj.id) for obj in home.objects[:2])
    home, _ = home.correct("name", first, name="aa")
    log = home.store.folder / LOG
    log.write_text(log.read_text().replace('"aa"', '"bb"') + "{}\n")
    home, _ = home.correct("name", second, name="cc")
    assert [obj.names for obj in home.objects[:2]] == [("bb",), ("cc",)]


def test_a_log_at_its_limit_loads_and_takes_corrections(home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
    assert home.store is not None
    home, _ = home.correct("name", str(home.objects[0].id), name="n" * 60, who="w" * 60)
    log = home.store.folder / LOG
    row = json.loads(log.read_text())
    lines = [json.dumps(row | {"id": f"{number:012x}"}) for number in range(400)]
    log.write_text("".join(f"{line}\n" for line in lines))
    monkeypatch.setattr(correction_log, "MAX_BYTES", log.stat().st_size - 50)
    monkeypatch.setattr(compaction, "MAX_BYTES", log.stat().st_size - 50)
    home, _ = Home.load(home.store.folder).correct("name", str(home.objects[0].id), name="last")
    assert log.stat().st_size < 60_000
    assert Home.load(home.store.folder).objects[0].names == ("last",)
    shutil.copyfile(log, log.with_suffix(".old"))
    monkeypatch.setattr(compaction, "MAX_BYTES", log.stat().st_size)
    with pytest.raises(InputError, match="as many corrections as a home can have"):
        home.correct("name", str(home.objects[0].id), name="more")
    assert log.read_bytes() == log.with_suffix(".old").read_bytes()
