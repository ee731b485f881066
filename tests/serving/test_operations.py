"""Operations: flat arguments in, plain values out, evidence and a reachable pose with each."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cartier
from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.home import Home
from cartier.serving import homes
from cartier.serving.homes import Homes
from cartier.serving.lookup import placed
from cartier.serving.operations import Operations
from cartier.serving.page import view
from cartier.types import Fact, Inventory, MapObject, Selection
from synthetic import CHAIR, MUG


class Echo:
    """A reasoner that takes the listed name that was said, and tells how many turns came before."""

    name = "echo"

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        name = next((n for n in inventory.names if n in query), None)
        return Selection("found" if name else "not_found", name, reason=f"{len(dialogue)} turns")

    def propose(self, query: str) -> list[str]:
        return []


@pytest.fixture
def ops(home: Path) -> Operations:
    return Operations(Homes([home]), Echo())


CALLS: dict[str, Callable[[Operations], Any]] = {
    "ask": lambda ops: ops.ask("the mug"),
    "find": lambda ops: ops.find("mug"),
    "describe": lambda ops: ops.describe("mug"),
    "describe room": lambda ops: ops.describe("room:0"),
    "list_objects": lambda ops: ops.list_objects(),
    "list_rooms": lambda ops: ops.list_rooms(),
    "relate": lambda ops: ops.relate("mug", "table"),
    "goal_for": lambda ops: ops.goal_for("chair"),
    "look_at": lambda ops: ops.look_at("chair")[0],
    "correct": lambda ops: ops.correct("name", "mug", "Ayo's mug"),
    "undo": lambda ops: (ops.correct("forget", "mug"), ops.undo())[1],
}


@pytest.mark.parametrize("call", CALLS)
def test_every_answer_is_plain_and_says_of_which_map_it_is(ops: Operations, call: str) -> None:
    told = CALLS[call](ops)
    assert told["home"] == "room" and len(told["home_id"]) == 12 and told["age_h"] is None
    assert json.loads(json.dumps(told, allow_nan=False)) == told


def test_age_is_that_of_the_recording(home: Path) -> None:
    mapped, now_s = Home.load(home), time.time()
    for last_s, age_h in ((now_s - 7200, 2.0), (2.5, None), (now_s + 1e6, None)):
        objects = tuple(replace(t, first_seen_s=0, last_seen_s=1, last_looked_s=last_s) for t in mapped.objects)
        replace(mapped, objects=objects, corrected=None).save(home)
        assert Operations(Homes([home]), Echo()).list_rooms()["age_h"] == (age_h and pytest.approx(age_h, abs=0.05))


def test_ask_tells_certainty_evidence_and_a_pose_near_it(ops: Operations) -> None:
    told = ops.ask("bring me the mug")
    assert told["status"] == "found" and 0.5 < told["certainty"] <= 1 and told["evidence"].startswith("seen ")
    goal = told["goal"]
    assert box_distance((goal["x"], goal["y"], 0.8), MUG.box_min, MUG.box_max) < 1.5
    assert goal["path"][-1] == [goal["x"], goal["y"]]
    ends = sum(
        ((a - c) ** 2 + (b - d) ** 2) ** 0.5 for (a, b), (c, d) in zip(goal["path"], goal["path"][1:], strict=False)
    )
    assert ends == pytest.approx(goal["length_m"], abs=0.02), "the corners of a path are the whole path"


def test_talks_are_kept_apart(ops: Operations) -> None:
    for turn in range(3):
        for talk in ("a", "b"):
            assert ops.ask("the mug", conversation=talk)["reason"] == f"{turn} turns"
    assert ops.ask("the mug")["reason"] == "0 turns"


def test_find_knows_names_close_spellings_and_what_to_do_next(ops: Operations) -> None:
    assert [row["label"] for row in ops.find("MUG")["objects"]] == ["mug"]
    assert ops.find("tabel")["spelt"] == ["table"]
    assert "list_objects" in ops.find("zebra")["next"]
    ops.correct("name", "chair", "Grandpa's throne")
    assert ops.find("throne")["objects"][0]["name"] == "Grandpa's throne"


def test_find_keeps_apart_what_is_only_maybe_so(home: Path) -> None:
    about = json.loads((home / "home.json").read_text())
    mapped = Home.load(home)
    objects = [
        replace(t, confirmed=False) if t.label == "mug"
        else replace(t, labels=((t.label, 2.0), ("mug", 0.1))) if t.label == "chair"
        else replace(t, label="mug table")
        for t in mapped.objects
    ]  # fmt: skip
    replace(mapped, objects=tuple(objects), corrected=None).save(home)
    assert json.loads((home / "home.json").read_text())["sha256"] != about["sha256"]
    told = Operations(Homes([home]), Echo()).find("mug")
    assert [row["label"] for row in told["objects"]] == ["mug table"] and (told["total"], told["maybe"]) == (1, 2)


def test_find_says_that_only_a_weak_label_matched(home: Path) -> None:
    mapped = Home.load(home)

    def find(**tentative: bool) -> dict[str, Any]:
        objects = [
            replace(t, labels=(("chair", 1.9), ("kettle", 0.1)) if t.label == "chair" else t.labels,
                    confirmed=tentative.get(t.label, t.confirmed))
            for t in mapped.objects
        ]  # fmt: skip
        replace(mapped, objects=tuple(objects), corrected=None).save(home)
        return Operations(Homes([home]), Echo()).find("kettle" if not tentative else "mug")

    (row,) = find()["objects"]
    assert row["label"] == "chair" and row["matched"] == "is no kettle by its name: kettle is 5% of its labels"
    (mug,) = find(mug=False)["objects"]
    assert mug["confirmed"] is False and "matched" not in mug, "a tentative one of the name is one"


def test_tentative_objects_are_listed_on_demand_and_last(home: Path) -> None:
    mapped = Home.load(home)
    objects = tuple(replace(t, confirmed=t.label != "chair") for t in mapped.objects)
    replace(mapped, objects=objects, corrected=None).save(home)
    ops = Operations(Homes([home]), Echo())
    sure, every = ops.list_objects(), ops.list_objects(tentative=True)
    assert (sure["total"], sure["maybe"]) == (2, 1) and all("confirmed" not in row for row in sure["objects"])
    assert [row["label"] for row in every["objects"]] == ["mug", "table", "chair"] and "maybe" not in every
    assert every["objects"][-1]["confirmed"] is False


def test_a_place_is_told_the_same_wherever_it_is_told(ops: Operations, home: Path) -> None:
    asked, described = ops.ask("mug"), ops.describe("mug")
    obj = next(t for t in Home.load(home).objects if t.label == "mug")
    answer = cartier.ask(Home.load(home), "mug", Echo()).to_dict()
    assert answer["object_id"] == answer["place"]["object_id"] == asked["id"] == obj.id
    told = [asked["x"], asked["y"], asked["z"]], [described[axis] for axis in "xyz"], answer["place"]["position"]
    for at in told:
        assert at == pytest.approx(list(obj.position), abs=0.006)
    assert answer["place"]["index_position"] != answer["place"]["position"], "a point of the surface that was seen"


def test_a_move_to_nowhere_says_what_it_needs(ops: Operations) -> None:
    with pytest.raises(InputError, match=r"needs x and y.*describe"):
        ops.correct("move", "mug")


def test_nothing_is_said_twice(home: Path) -> None:
    asks = Selection(
        "clarify", question="Which?", text="Which?", reason="2 fit", candidates=(("mug", 0.9), ("chair", 0.001))
    )
    told = Operations(Homes([home]), Asks(asks)).ask("it")
    assert (told["question"], told["reason"], told["candidates"]) == (
        "Which?",
        "2 fit",
        [["mug", 0.9]],
    ) and "text" not in told
    told = Operations(Homes([home]), Asks(Selection("answered", text="Two.", reason="Two."))).ask("it")
    assert told["text"] == "Two." and "reason" not in told


def test_a_list_is_paged_and_says_so(ops: Operations, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.serving.operations.PAGE", 2)
    pages = [ops.list_objects(page=page) for page in (1, 2)]
    assert [row["label"] for page in pages for row in page["objects"]] == ["chair", "mug", "table"]
    assert all(page["total"] == 3 and page["pages"] == 2 for page in pages)
    with pytest.raises(InputError, match="page 1 to 2"):
        ops.list_objects(page=3)


def test_relations_are_told_both_ways(ops: Operations) -> None:
    one = ops.relate("mug", "table")
    assert one["side"] is None and not any("left" in line or "right" in line for line in one["relations"])
    assert any(line.startswith("mug") and " on table" in line for line in one["relations"]) and one["apart_m"] < 0.1
    assert any("table" in line and "bigger than mug" in line for line in ops.relate("table", "mug")["relations"])
    with pytest.raises(InputError, match="relate needs two"):
        ops.relate("mug", "mug")


def test_of_left_on_and_beside_one_holds() -> None:
    def standing(number: int, x: float, low: float, high: float, label: str = "table") -> MapObject:
        side = 0.05 if label == "mug" else 0.4
        at, box_min, box_max = (x, 0.0, (low + high) / 2), (x - side, -side, low), (x + side, side, high)
        return MapObject(number, label, ((label, 1.0),), at, box_min, box_max, 0.9, True, 5, 5, 0.0, 1.0, 1.0, ())

    table, mug = standing(1, 0.0, 0.0, 0.7), standing(2, -0.3, 0.7, 0.8, "mug")
    near, far, before = standing(3, -0.9, 0.0, 0.7), standing(4, -3.0, 0.0, 0.7), (0.0, -2.0)
    for other, kind, side in ((mug, "on", None), (near, "next to", "left"), (far, "left of", "left")):
        found, told = placed(other, table, [table, other], before)
        assert ([r.kind for r in found if r.kind != "bigger"], told) == ([kind], side)


def test_a_crop_shows_the_box(ops: Operations) -> None:
    from io import BytesIO

    from PIL import Image

    told, jpeg = ops.look_at("chair")
    x1, y1, x2, y2 = told["box_in_picture"]
    picture = Image.open(BytesIO(jpeg))
    assert 0 <= x1 < x2 <= picture.width and 0 <= y1 < y2 <= picture.height
    with pytest.raises(InputError, match="views 1 to"):
        ops.look_at("chair", view=99)


def test_the_goal_starts_where_the_robot_says_it_is(ops: Operations) -> None:
    there = ops.goal_for("chair", from_x=3.0, from_y=3.0)["goal"]
    assert abs(there["path"][0][0] - 3.0) < 0.2
    assert box_distance((there["x"], there["y"], 0.4), CHAIR.box_min, CHAIR.box_max) < 1.0
    with pytest.raises(InputError, match="both"):
        ops.goal_for("chair", from_x=3.0)


def test_which_home_is_asked_with_the_names(home: Path, tmp_path: Path) -> None:
    shutil.copytree(home, tmp_path / "other" / "room")
    many = Homes([home, tmp_path / "other" / "room"])
    assert many.names == ["room", "room-2"]
    for wrong in ("", "attic", "../room"):
        with pytest.raises(InputError, match="pass home as one of room, room-2"):
            many.get(wrong)
    assert many.get(f"room@{many.get('room').id}") is many.get("room")
    with pytest.raises(InputError, match="mapped again"):
        many.get("room@000000000000")


def test_a_home_is_read_again_when_somebody_else_corrected_it(home: Path) -> None:
    served = Homes([home])
    before = served.get()
    cartier.Home.load(home).correct("forget", "mug")
    assert "mug" in before.names and "mug" not in served.get().names
    assert served.get() is served.get()


def test_memory_is_bounded_by_putting_homes_away(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [home, *(shutil.copytree(home, tmp_path / f"home-{k}") for k in range(4))]
    served = Homes(folders, max_bytes=1)
    loads: list[Path] = []
    real = homes.Home.load.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(homes.Home, "load", classmethod(lambda cls, at: (loads.append(at), real(cls, at))[1]))
    for name in served.names * 2:
        served.get(name)
        assert sum(slot.home is not None for slot in served._slots.values()) == 1
    assert len(loads) == 10
    roomy = Homes(folders)
    for name in roomy.names * 2:
        roomy.get(name)
    assert len(loads) == 15


def test_a_slow_load_of_one_home_holds_up_no_other(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    served = Homes([home, Path(shutil.copytree(home, tmp_path / "slow"))])
    served.get("room")
    go, real = threading.Event(), homes.Home.load.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(homes.Home, "load", classmethod(lambda cls, at: (go.wait(10), real(cls, at))[1]))
    waiting = threading.Thread(target=served.get, args=("slow",))
    waiting.start()
    assert served.get("room").name and waiting.is_alive()
    go.set()
    waiting.join(10)


def test_forty_threads_get_their_own_answers(ops: Operations) -> None:
    wrong: list[Any] = []

    def client(name: str) -> None:
        for _ in range(5):
            told = ops.ask(f"the {name}", conversation=str(threading.get_ident()))
            if told["object"] != name:
                wrong.append((name, told))

    clients = [threading.Thread(target=client, args=(("mug", "chair", "table")[k % 3],)) for k in range(40)]
    for each in clients:
        each.start()
    for each in clients:
        each.join()
    assert not wrong


class Asks(Echo):
    """A reasoner that asks back, or tells."""

    def __init__(self, chosen: Selection) -> None:
        self.chosen = chosen

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        return self.chosen


@pytest.mark.parametrize(
    ("chosen", "labels"),
    [
        (Selection("clarify", question="Which mug: the red one or the blue one?"), {"mug"}),
        (
            Selection("clarify", question="Do you mean the CHAIR or the table?", candidates=(("mug", 0.4),)),
            {"chair", "table"},
        ),
        (Selection("clarify", question="What do you need?"), set()),
        (Selection("clarify", question="Which carpet, and what for?"), set()),
    ],
)  # fmt: skip
def test_what_a_question_names_can_be_pointed_at(home: Path, chosen: Selection, labels: set[str]) -> None:
    told = Operations(Homes([home]), Asks(chosen)).ask("that one")
    objects = {t.id: t.label for t in Home.load(home).objects if t.confirmed}
    assert {objects[k] for k in told.get("ids", [])} == labels


def test_what_an_answer_in_words_is_about_can_be_shown(home: Path) -> None:
    some = tuple(t.id for t in Home.load(home).objects[:2])
    told = Operations(Homes([home]), Asks(Selection("answered", text="Two.", fact=Fact("count", 2, some)))).ask(
        "how many?"
    )
    assert told["ids"] == list(some)


def test_the_page_s_data_has_the_rules_with_their_sentences(home: Path) -> None:
    chair = next(t for t in Home.load(home).objects if t.label == "chair")
    mapped, _ = Home.load(home).correct("rule", f"keep-away object:{chair.id} hard standing")
    (row,) = view(mapped)["rules"]
    assert row["id"] and row["rule"] == f"keep-away object:{chair.id} hard standing" and row["holds"] == "now"
    assert row["words"].startswith("keep away from")
    mapped, _ = mapped.correct("lift", row["id"])
    assert view(mapped)["rules"] == []
