"""A whole bench in three tiny rooms: complete, resumable, asking nobody twice, and strict about its folder."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier import specs
from cartier.contracts import Reasoner
from cartier.errors import InputError, ReasonerError
from cartier.types import DetectorScoreModel, Fact, Inventory, Selection
from cartier_bench import suite
from cartier_bench.asked import Asked
from cartier_bench.baselines import nlmap
from cartier_bench.maps import Maps, MapSettings
from cartier_bench.methods import METHODS
from cartier_bench.paper_run import BenchSettings, paper
from cartier_bench.queries import OWN, Query
from cartier_dollhouse import network as dollhouse_detector

WORLD = str(Path(__file__).parent / "room_world.py")
SEATS = ("chair", "sofa")
QUERIES = [
    Query("sit-1", "explicit", "chair", SEATS, "please go to the chair", OWN),
    Query("sit-2", "implicit", "chair", SEATS, "my feet hurt", OWN),
    Query("drink-1", "implicit", "mug", ("mug",), "I could do with something hot to hold", OWN),
    Query("sleep-1", "conversational", "bed", ("bed",), "What a day. The table is full of papers. I am so tired.", OWN),
]
SETTINGS = BenchSettings(("north", "east"), maps=MapSettings(WORLD))
ROWS = 3 * 2 + 1  # (home, request) pairs: the bed is in one home only


class Words:
    """A reasoner by words in the request; it counts its calls, and can break off as a server does."""

    name = "words (test)"

    def __init__(self, dies_after: int = 10**9) -> None:
        self.calls, self.tokens, self.dies_after = 0, 0, dies_after
        self.heard: list[Any] = []

    def _call(self, *question: Any) -> None:
        if self.calls == self.dies_after:
            raise ReasonerError("the server went away")
        self.calls += 1
        self.tokens += 10
        self.heard.append(question)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        self._call("select", query, tuple(inventory.names))
        wanted = "chair" if "chair" in query or "feet" in query else "bed" if "tired" in query else "mug"
        return (
            Selection("found", wanted, "heard it")
            if wanted in inventory.names
            else Selection("not_found", reason="not here")
        )

    def propose(self, query: str) -> list[str]:
        self._call("propose", query)
        return ["chair", "mug", "bed"]


def run(
    folder: Path, settings: BenchSettings, queries: Sequence[Query], reasoner: Reasoner, maps: Path | None = None
) -> list[dict[str, Any]]:
    return suite.run(folder, paper(folder, settings, queries, reasoner, maps))


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("maps")


def without_times(folder: Path) -> list[dict[str, Any]]:
    rows = [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


Whole = tuple[Path, list[dict[str, Any]], Words]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, maps: Path) -> Whole:
    """A run in one go: its folder, its rows and its reasoner."""
    folder, reasoner = tmp_path_factory.mktemp("whole"), Words()
    return folder, run(folder, SETTINGS, QUERIES, reasoner, maps), reasoner


def test_every_method_answers_every_request_without_a_gap(whole: Whole) -> None:
    _, rows, reasoner = whole
    assert len(rows) == ROWS * len(METHODS)
    assert len({(row["home"], row["query_id"], row["method"]) for row in rows}) == len(rows)
    assert len(reasoner.heard) == len(set(reasoner.heard)), "nobody is asked the same thing twice"
    by_method = {m: [row for row in rows if row["method"] == m] for m in METHODS}
    for row in by_method["true_object"]:
        assert row["match"] and row["distance_m"] < 0.05 and row["llm_calls"] == 0
    depth, viewpoint = ([row["distance_m"] for row in by_method[m]] for m in ("object_depth", "object_viewpoint"))
    assert np.mean(depth) < 0.05 < np.mean(viewpoint)
    assert all(row["llm_calls"] == 1 and row["tokens"] == 10 for row in by_method["object_depth"])
    assert all(row["llm_calls"] == 0 for row in by_method["vlmaps_query"] + by_method["random"])
    assert all(row["encoder"] for row in by_method["vlmaps"]) and not by_method["object_depth"][0]["encoder"]
    assert all(row["detector"].startswith("ground truth") for row in rows)


def test_the_same_seed_gives_the_same_rows_and_another_draws_otherwise(
    tmp_path: Path, maps: Path, whole: Whole
) -> None:
    run(tmp_path / "b", SETTINGS, QUERIES, Words(), maps)
    assert without_times(whole[0]) == without_times(tmp_path / "b")
    only = [BenchSettings(("north",), ("random",), maps=MapSettings(WORLD), seed=seed) for seed in range(9)]
    drawn = {run(tmp_path / f"s{one.seed}", one, QUERIES[:1], Words(), maps)[0]["object"] for one in only}
    assert len(drawn) > 1


def test_a_run_that_died_twice_goes_on_and_equals_one_in_one_go(tmp_path: Path, maps: Path, whole: Whole) -> None:
    folder, _, reasoner = whole
    for calls in (2, 5):
        with pytest.raises(ReasonerError, match="went away"):
            run(tmp_path / "broken", SETTINGS, QUERIES, Words(calls), maps)
        with (tmp_path / "broken" / "results.jsonl").open("a") as file:
            file.write('{"home": "north", "query_')  # what a kill leaves
    last = Words()
    run(tmp_path / "broken", SETTINGS, QUERIES, last, maps)
    assert without_times(tmp_path / "broken") == without_times(folder)
    assert last.calls == reasoner.calls - 2 - 5, "what was answered before is not asked again"
    run(tmp_path / "broken", SETTINGS, QUERIES, Words(0), maps)  # nothing is left to ask


def test_a_run_folder_of_other_settings_is_refused(tmp_path: Path, maps: Path, whole: Whole) -> None:
    shutil.copytree(whole[0], tmp_path / "run")
    before = (tmp_path / "run" / "results.jsonl").read_bytes()
    for other in (
        BenchSettings(("east",), maps=MapSettings(WORLD)),
        BenchSettings(("north", "east"), maps=MapSettings(WORLD), seed=1),
    ):
        with pytest.raises(InputError, match="other settings"):
            run(tmp_path / "run", other, QUERIES, Words(), maps)
    with pytest.raises(InputError, match="queries_sha256"):
        run(tmp_path / "run", SETTINGS, QUERIES[:2], Words(), maps)
    assert (tmp_path / "run" / "results.jsonl").read_bytes() == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match="not empty"):
        run(tmp_path / "mine", SETTINGS, QUERIES, Words(), maps)


def test_mistakes_are_told_before_anything_is_mapped(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no method 'telepathy'"):
        run(tmp_path / "run", BenchSettings(("north",), ("telepathy",), maps=MapSettings(WORLD)), QUERIES, Words())
    with pytest.raises(InputError, match="no room 'west'"):
        run(tmp_path / "run", BenchSettings(("west",), maps=MapSettings(WORLD)), QUERIES, Words())
    with pytest.raises(InputError, match="leave some out"):
        run(
            tmp_path / "run",
            BenchSettings(("north", "south", "east"), ("nlmap",), maps=MapSettings(WORLD)),
            QUERIES,
            Words(),
        )


def test_a_damaged_map_is_made_again(tmp_path: Path) -> None:
    maps = Maps(tmp_path, MapSettings(WORLD))
    first = maps.get("south")
    assert first.store is not None
    (first.store.folder / "home.json").write_text("{")
    assert maps.get("south").names == first.names == ["chair", "mug", "sofa", "table"]


def test_nlmap_keeps_what_the_map_holds(maps: Path) -> None:
    made = Maps(maps, MapSettings(WORLD))
    homes = [(made.get(name), {t.label.lower() for t in made.world.objects(name)}) for name in ("south", "east")]
    threshold = nlmap.calibrate(homes, ["chair", "mug", "sofa", "bed", "toaster", "bicycle"])
    assert 0.5 < threshold < 1
    south = homes[0][0]
    assert nlmap.ask(south, "my feet hurt", Words(), threshold=threshold).selection.object == "chair"
    assert nlmap.ask(south, "I am so tired", Words(), threshold=threshold).selection.status == "not_found", (
        "the bed is in the east"
    )
    nothing = nlmap.ask(south, "my feet hurt", Words(), threshold=2.0)
    assert nothing.selection.status == "not_found" and nothing.goal is None


def test_ground_truth_may_be_told_to_err(tmp_path: Path) -> None:
    recording = Maps(tmp_path, MapSettings(WORLD)).world.explore("south")
    assert "misses 0.5" in specs.detector("ground_truth:misses=0.5,seed=3", recording).name
    with pytest.raises(InputError, match="after the colon"):
        specs.detector("ground_truth:lots", recording)


@pytest.mark.parametrize("change", [{"sha256": "0" * 64}, {"score_model": DetectorScoreModel(threshold=0.9)}])
def test_another_detector_makes_another_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]
) -> None:
    told, seen = (
        Maps(tmp_path, MapSettings(WORLD, *by)) for by in (("ground_truth",), ("embedded", "embedded:pixels"))
    )
    before = [maps._folder_of("south") for maps in (told, seen)]
    other = replace(dollhouse_detector.load(), **change)
    monkeypatch.setattr(dollhouse_detector, "load", lambda: other)
    after = [maps._folder_of("south") for maps in (told, seen)]
    assert after[0] == before[0] and after[1] != before[1]


def test_what_was_answered_is_remembered_whole_and_for_its_own_home(tmp_path: Path) -> None:
    class Telling(Words):
        def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
            self._call("select", query)
            ids = tuple(obj.id for obj in inventory.objects)
            return Selection(
                "answered", text="two", fact=Fact("list", ("chair", "mug"), ids), next=(Selection("not_found"),)
            )

    here = Inventory.of(["chair", "mug"])
    there = replace(here, objects=tuple(replace(obj, id=obj.id + 7) for obj in here.objects))
    reasoner = Telling()
    first = [Asked(reasoner, tmp_path / "asked.jsonl").select("how many?", home) for home in (here, there)]
    again = [Asked(reasoner, tmp_path / "asked.jsonl").select("how many?", home) for home in (here, there)]
    assert again == first and reasoner.calls == 2
    assert all(home.contains(chosen) for home, chosen in zip((here, there), first, strict=True))
