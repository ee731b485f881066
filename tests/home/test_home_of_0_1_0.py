"""Homes of cartier 0.1.0: ``tests/data/home_0_1_0`` was written by that version from the first half of a walk.

It holds a floor plan, the index object_depth, growth state, photos, and a correction: the chair is Grandpa's chair.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import cartier
from cartier.home.store import Store
from synthetic import THINGS, RoomRecording, TrueBoxes, box
from synthetic import small_walk as walk

SAVED = Path(__file__).parents[1] / "data" / "home_0_1_0"
OBJECTS = (*THINGS, box(4, "vase", (2.9, 0.2, 0.0), (3.2, 0.5, 0.6)))
POSES = walk(OBJECTS).poses
FIRST, SECOND = (
    RoomRecording(part, OBJECTS, name=name) for part, name in ((POSES[:12], "first walk"), (POSES[12:], "second walk"))
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(SAVED, tmp_path / "home"))


def table(home: cartier.Home) -> list[tuple[str, int, int, bool, float]]:
    rows = [(o.label, o.n_detected, o.n_observable, o.confirmed, round(o.probability, 6)) for o in home.objects]
    return sorted(rows)


def test_it_loads_whole(folder: Path) -> None:
    home = cartier.Home.load(folder)
    assert Store(folder).faults() == []
    assert [obj.label for obj in home.objects] == ["chair", "vase", "table", "mug", "table"]
    assert home.objects[0].names == ("Grandpa's chair",) and home.objects[0].n_detected == 3
    assert home.rooms[0].kind == "room" and home.grid is not None and home.cloud() is not None
    log = home.detections()
    assert log is not None and len(log.looked()) == 12
    assert home.evidence(cartier.Place("chair", (0, 0, 0), 1.0, 3)) is not None  # type: ignore[arg-type]


def test_its_map_is_the_one_made_today(folder: Path) -> None:
    """But for boxes, which are fitted to all views today, the names of colours, and earlier frames as evidence."""
    home, anew = cartier.Home.load(folder), cartier.map_home(FIRST, TrueBoxes(OBJECTS), ["object_depth"])
    assert home.corrected is not None
    for old, new in zip(home.corrected.mapped_objects, anew.objects, strict=True):
        known = ("label", "labels", "confirmed", "n_detected", "n_observable", "views", "first_seen_s")
        assert all(getattr(new, name) == getattr(old, name) for name in known)
        assert old.probability - 0.1 < new.probability <= old.probability
        assert np.linalg.norm(np.subtract(old.position, new.position)) < 0.1
    assert home.grid is not None and anew.grid is not None
    assert np.array_equal(home.grid.cells, anew.grid.cells)


def test_it_answers_by_label_and_by_the_corrected_name(folder: Path) -> None:
    home = cartier.Home.load(folder)
    for words, label in (("bring me to Grandpa's chair", "chair"), ("go to the vase", "vase")):
        answer = cartier.ask(home, words)
        assert answer.place is not None and answer.place.label == label
        assert answer.goal is not None and answer.goal.line_of_sight


def test_it_grows_as_a_home_of_today_and_is_saved(folder: Path, tmp_path: Path) -> None:
    grown = cartier.map_home(SECOND, TrueBoxes(OBJECTS), onto=cartier.Home.load(folder))
    today = cartier.map_home(FIRST, TrueBoxes(OBJECTS), ["object_depth"])
    assert table(grown) == table(cartier.map_home(SECOND, TrueBoxes(OBJECTS), onto=today))
    assert table(grown) != table(today)
    grown.save(folder)
    again = cartier.Home.load(folder)
    assert table(again) == table(grown) and Store(folder).faults() == []
    assert [row["recording"] for row in again.settings["recordings"]] == ["first walk", "second walk"]
    assert "Grandpa's chair" in again.names


def test_a_correction_today_is_added_to_its_log(folder: Path) -> None:
    home = cartier.Home.load(folder)
    home, _ = home.correct("forget", "vase", who="Bob")
    assert "vase" not in home.names and "Grandpa's chair" in home.names
    assert len((folder / "corrections.jsonl").read_text().splitlines()) == 2
