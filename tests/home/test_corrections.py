"""Corrections: they hold whenever the home is loaded, whatever is mapped meanwhile, and the log only grows."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cartier
from cartier import cli
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.corrected import apply
from cartier.home.correction_log import LOG, Correction, CorrectionKind, Subject, line_of, read_log
from cartier.home.corrections import find
from cartier.pipeline import map_home
from cartier.types import Inventory, MapObject, Selection
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk


class Says:
    """A reasoner that always gives one answer: what is tested here is the line around it."""

    name = "test"

    def __init__(self, choice: str) -> None:
        self.choice = choice

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        assert self.choice in inventory.names
        return Selection("found", self.choice)

    def propose(self, query: str) -> list[str]:
        return []


@pytest.fixture(scope="module")
def mapped() -> Home:
    return map_home(walk(), TrueBoxes(THINGS))


@pytest.fixture
def home(mapped: Home, tmp_path: Path) -> Home:
    mapped.save(tmp_path / "home")
    return Home.load(tmp_path / "home")


def folder(home: Home) -> Path:
    assert home.store is not None
    return home.store.folder


def obj(id: int, label: str, x: float, *, aliases: tuple[int, ...] = (), labels: tuple[str, ...] = ()) -> MapObject:
    votes = tuple((name, 1.0) for name in (label, *labels))
    low, high = (x - 0.1, 0.9, 0.0), (x + 0.1, 1.1, 0.2)
    return MapObject(id, label, votes, (x, 1.0, 0.1), low, high, 0.9, True, 3, 3, 0.0, 1.0, 1.0, (), aliases=aliases)


def entry(about: MapObject, what: CorrectionKind = "name") -> Correction:
    subject = Subject("object", about.id, about.label, about.position)
    return Correction("1", "2026", "Ayo", what, subject, name="Ayo's" if what == "name" else None)


def test_a_named_thing_is_asked_for_by_its_name_and_by_what_it_is(home: Home) -> None:
    named, told = home.correct("name", "mug", name="  Ayo's   mug ", who="Ayo")
    mug = find("mug", named.objects)
    assert isinstance(mug, MapObject) and mug.names == ("Ayo's mug",) and mug.label == "mug"
    assert told == f"mug ({mug.id}) is called Ayo's mug"
    for words in ("Ayo's mug", "mug"):
        answer = cartier.ask(named, "where is it", Says(words))
        assert answer.place is not None and answer.place.object_id == mug.id and answer.goal is not None
    assert "mug" in home.names and "Ayo's mug" not in home.names, "nobody changes a home"


def test_the_embedded_reasoner_understands_the_name(home: Home) -> None:
    named, _ = home.correct("name", "chair", name="Grandpa's throne")
    assert cartier.ask(named, "take me to Grandpa's throne").selection.object == "Grandpa's throne"


def test_a_room_is_named_by_id_or_name_and_no_two_alike(home: Home) -> None:
    room = home.rooms[0]
    named, _ = home.correct("name", f"room:{room.id}", name="Ayo's room")
    assert named.rooms[0].name == "Ayo's room" and named.rooms[0].kind == room.kind
    named, _ = named.correct("name", "ayo's ROOM", name="Ada's room")
    assert [room.name for room in Home.load(folder(home)).rooms] == ["Ada's room"]
    with pytest.raises(InputError, match="only objects can be moved"):
        named.correct("forget", "Ada's room")


def test_what_is_forgotten_is_neither_found_nor_listed(home: Home) -> None:
    gone, told = home.correct("forget", "table")
    assert told.endswith("is forgotten") and "table" not in gone.names
    assert all("table" not in index.names() for index in gone.indexes.values())


def test_what_is_moved_is_where_it_was_moved_to(home: Home) -> None:
    before = find("chair", home.objects)
    moved, _ = home.correct("move", "chair", to_xy=(1.5, 1.25))
    after = find("chair", moved.objects)
    assert isinstance(before, MapObject) and isinstance(after, MapObject)
    assert after.position == (1.5, 1.25, before.position[2])
    by = np.subtract(after.position, before.position)
    np.testing.assert_allclose(np.subtract(after.box_min, before.box_min), by, atol=1e-3)
    surface = [(view.surface, old.surface) for view, old in zip(after.views, before.views, strict=True)]
    np.testing.assert_allclose(
        [np.subtract(new, old) for new, old in surface], np.tile(by, (len(surface), 1)), atol=1e-3
    )
    place = cartier.ask(moved, "sit", Says("chair")).place
    assert place is not None and place.box_min == after.box_min


def test_undo_takes_back_the_latest_that_holds(home: Home) -> None:
    now, _ = home.correct("name", "mug", name="first")
    now, _ = now.correct("move", "mug", to_xy=(2.0, 2.0))
    now, _ = now.correct("forget", "first")
    assert "mug" not in now.names
    now, told = now.correct("undo")
    assert told.startswith("undone: mug") and "forgotten" in told
    assert find("first", now.objects).position[:2] == (2.0, 2.0)  # type: ignore[union-attr]
    now, _ = now.correct("undo")
    now, _ = now.correct("undo")
    assert now.objects == home.objects and now.to_dict() == home.to_dict()
    with pytest.raises(InputError, match="no correction to undo"):
        now.correct("undo")


def test_each_entry_says_who_when_and_what_and_stays_as_it_is(home: Home) -> None:
    written = b""
    for what, about in (("name", {"name": "Mo's"}), ("move", {"to_xy": (2, 2)}), ("forget", {}), ("undo", {})):
        home, _ = home.correct(what, "mug", **about, who="Ayo")  # type: ignore[arg-type]
        log = (folder(home) / LOG).read_bytes()
        assert log.startswith(written) and log.count(b"\n") == written.count(b"\n") + 1
        written = log
        row = json.loads(log.splitlines()[-1])
        assert row["who"] == "Ayo" and row["what"] == what and row["when"].endswith("+00:00")


def test_corrections_outlive_growing_and_mapping_again(tmp_path: Path) -> None:
    poses = walk().poses
    first, second = (RoomRecording(part, THINGS, name=name) for name, part in (("a", poses[:14]), ("b", poses[14:])))
    map_home(first, TrueBoxes(THINGS)).save(tmp_path)
    home, _ = Home.load(tmp_path).correct("name", "mug", name="Ayo's mug")
    home, _ = home.correct("move", "mug", to_xy=(3.0, 3.0))
    home, _ = home.correct("forget", "chair")
    grown = map_home(second, TrueBoxes(THINGS), onto=home)
    again = map_home(walk([*THINGS[::-1]]), TrueBoxes(THINGS[::-1]))  # other ids
    for other in (grown, again):
        other.save(tmp_path)
        loaded = Home.load(tmp_path)
        mug = find("Ayo's mug", loaded.objects)
        assert mug.label == "mug" and mug.position[:2] == (3.0, 3.0)  # type: ignore[union-attr]
        assert "chair" not in loaded.names and loaded.corrected is not None and not loaded.corrected.notes


def test_saving_a_corrected_home_keeps_the_map_as_it_was_made(home: Home, tmp_path: Path) -> None:
    before = home.objects
    corrected, _ = home.correct("forget", "mug")
    corrected.save(folder(home))
    corrected.save(tmp_path / "copy")
    for place in (folder(home), tmp_path / "copy"):
        loaded = Home.load(place)
        assert "mug" not in loaded.names
        assert loaded.correct("undo")[0].objects == before


def test_a_home_that_was_not_saved_says_so(mapped: Home) -> None:
    with pytest.raises(InputError, match="save it"):
        mapped.correct("forget", "mug")


def test_ids_of_merged_objects_are_followed() -> None:
    old, now = obj(3, "mug", 1.0), obj(9, "cup", 1.2, aliases=(3,), labels=("mug",))
    fixed = apply([entry(old)], (now,), (), None)
    assert fixed.objects[0].names == ("Ayo's",) and not fixed.notes


def test_what_swallowed_a_forgotten_duplicate_stays() -> None:
    ghost, real = obj(3, "fridge", 1.0), obj(2, "fridge", 1.1, aliases=(3,))
    fixed = apply([entry(ghost, "forget")], (real,), (), None)
    assert fixed.objects == (real,) and "part of object 2" in fixed.notes[0]


def test_in_a_map_made_anew_the_place_decides_and_not_the_number() -> None:
    chairs = [obj(k, "chair", 1.0 + 0.6 * k) for k in range(5)]
    shuffled = tuple(replace(chair, id=(chair.id + 1) % 5) for chair in chairs)
    for chair in chairs:
        named = [t for t in apply([entry(chair)], shuffled, (), None).objects if t.names]
        assert [t.position for t in named] == [chair.position]


def test_what_is_nowhere_near_is_left_out_and_said() -> None:
    fixed = apply([entry(obj(3, "mug", 1.0))], (obj(3, "mug", 4.0), obj(4, "lamp", 1.0)), (), None)
    assert not any(t.names for t in fixed.objects) and "fits nothing in this map" in fixed.notes[0]


def test_which_one_is_asked_with_ids() -> None:
    two = (obj(3, "mug", 1.0), obj(5, "mug", 2.0))
    assert find("5", two) is two[1] and find("#5", two) is two[1]
    with pytest.raises(InputError, match=r"2 objects or rooms are called 'mug': say which by its id \(3, 5\)"):
        find("mug", two)
    with pytest.raises(InputError, match="nothing in this home is called 'sofa'"):
        find("sofa", two)


@pytest.mark.parametrize("name", ["", "   ", "a\nb\0", "x" * 61, "12", "#12", "room:1", "\u202egnp.exe"])
def test_unusable_names_are_refused(home: Home, name: str) -> None:
    with pytest.raises(InputError):
        home.correct("name", "mug", name=name)
    assert not (folder(home) / LOG).exists()


@pytest.mark.parametrize("to_xy", [(), (1.0,), (float("nan"), 1.0), (1e9, 0.0), (50.0, 0.0)])
def test_impossible_places_are_refused(home: Home, to_xy: tuple[float, ...]) -> None:
    with pytest.raises(InputError):
        home.correct("move", "mug", to_xy=to_xy)
    assert not (folder(home) / LOG).exists()


def test_a_log_cut_anywhere_holds_whole_corrections_only(home: Home) -> None:
    log = folder(home) / LOG
    home.correct("name", "mug", name="Ayo’s mug")[0].correct("forget", "chair")
    whole = log.read_bytes()
    entries, _ = read_log(folder(home))
    for cut in range(0, len(whole), 7):
        log.write_bytes(whole[:cut])
        left, _ = read_log(folder(home))
        assert left == entries[: len(left)] and len(left) in (whole[:cut].count(b"\n"), whole[: cut + 1].count(b"\n"))
    now, _ = Home.load(folder(home)).correct("forget", "table")  # after a cut line a new one is whole
    assert "table" not in now.names and now.corrected is not None and len(now.corrected.notes) == 1


ROW = {"id": "1", "when": "2026", "who": "x", "what": "move", "to_xy": [1, 2],
       "subject": {"kind": "object", "id": 1, "label": "mug", "position": [1, 2, 3]}}  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [
        "[]", "3", "{}", "[" * 100_000, '{"id": 1' + "0" * 5000 + "}", "\udcff", json.dumps(ROW | {"what": "delete"}),
        json.dumps(ROW | {"to_xy": [1, float("nan")]}), json.dumps(ROW | {"to_xy": "12"}),
        json.dumps(ROW | {"who": ["x"]}), json.dumps(ROW | {"subject": {"kind": "home"}}),
        json.dumps(ROW | {"subject": ROW["subject"] | {"position": [1]}}),
        json.dumps(ROW | {"what": "name", "name": "x" * 1000}),
        json.dumps(ROW | {"subject": ROW["subject"] | {"kind": "room"}}),
    ],
)  # fmt: skip
def test_a_strangers_line_is_left_out_and_said(home: Home, line: str) -> None:
    (folder(home) / LOG).write_bytes(line.encode(errors="surrogateescape") + b"\n")
    loaded = Home.load(folder(home))
    assert loaded.objects == home.objects
    assert loaded.to_dict()["notes"][-1] == f"{LOG} line 1 is damaged: this correction is left out"


def test_a_log_that_is_a_link_is_not_followed(home: Home, tmp_path: Path) -> None:
    (folder(home) / LOG).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError):
        home.correct("forget", "mug")
    (tmp_path / "elsewhere").write_text(json.dumps(ROW))
    with pytest.raises(InputError, match=LOG):
        Home.load(folder(home))


def test_from_the_command_line(home: Home, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def run(*words: object) -> str:
        monkeypatch.setattr(sys, "argv", ["cartier", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
            raise SystemExit(0)
        out, err = capsys.readouterr()
        assert not ended.value.code, err
        return out.strip()

    at = folder(home)
    assert run("name", at, "mug", "Ayo's mug", "--who", "Ayo").endswith("is called Ayo's mug")
    assert run("move", at, "Ayo's mug", "-0.5,2").endswith("stands at x -0.50 y 2.00 m")
    assert "Ayo's mug, mug" in run("show", at)
    assert run("forget", at, "mug").endswith("is forgotten")
    assert run("undo", at).startswith("undone: mug")
    assert run("name", at, "--home", "Ayo's flat").endswith("is called Ayo's flat")
    assert run("confirm", at, "chair").endswith("is there")
    assert run("relabel", at, "chair", "throne").endswith("is labelled throne")
    assert run("add", at, "vase", "-0.5,2").endswith("is added at x -0.50 y 2.00 m")
    assert run("add", at, "lamp", "table").startswith("lamp (10000")
    assert run("merge", at, "vase", "lamp").endswith("are one")
    assert run("split", at, "table", "--label", "desk").endswith(")")
    assert run("undo", at).startswith("undone: table")
    table = find("table", Home.load(at).objects)
    assert run("split", at, "table", f"{table.position[0] - 0.1},{table.position[1]}").startswith("table")
    for words in (
        ("name", at),
        ("name", at, "mug"),
        ("name", at, "mug", "x", "--home", "y"),
        ("add", at, "vase", "1,x"),
    ):
        monkeypatch.setattr(sys, "argv", ["cartier", *map(str, words)])
        with pytest.raises(SystemExit):
            cli.main()
        told = capsys.readouterr().err
        assert told.startswith("cartier: ") and told.count("\n") == 1
    kinds = "name move forget undo name confirm relabel add add merge split undo split"
    assert " ".join(json.loads(line)["what"] for line in (at / LOG).read_text().splitlines()) == kinds


def test_the_paper_s_grid_finds_a_named_thing_as_what_it_is(tmp_path: Path) -> None:
    map_home(walk(), TrueBoxes(THINGS), ["vlmaps"]).save(tmp_path)
    home, _ = Home.load(tmp_path).correct("name", "mug", name="Grandpa's treasure")
    index = home.index("vlmaps")[1]
    named, mug = index.locate("Grandpa's treasure"), index.locate("mug")
    assert named is not None and mug is not None and named.position == mug.position
    assert "Grandpa's treasure" in home.inventory("vlmaps").names


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_log_broken_anyhow_is_read_or_its_lines_are_left_out(tmp_path: Path, data: st.DataObject) -> None:
    good = "".join(line_of(entry(obj(k, "mug", 1.0), what)) + "\n" for k, what in enumerate(("name", "forget")))
    broken = bytearray(good.encode() + json.dumps(ROW).encode())
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(broken) - 1))
        broken[at : at + data.draw(st.integers(0, 9))] = data.draw(
            st.binary(max_size=9) | st.sampled_from([b"1e999", b"null", b"\\ud800", b"-9" * 30])
        )
        broken = broken or bytearray(b"x")
    (tmp_path / LOG).write_bytes(bytes(broken))
    log, notes = read_log(tmp_path)
    fixed = apply(log, (obj(1, "mug", 1.0), obj(2, "mug", 1.2)), (), None)
    assert len(log) + len(notes) == sum(bool(line.strip()) for line in bytes(broken).split(b"\n"))
    json.dumps([line_of(each) for each in log] + [*notes, *fixed.notes], ensure_ascii=False).encode()
