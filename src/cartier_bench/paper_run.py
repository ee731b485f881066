"""Suite paper: every method is asked every request in every home that holds its target."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cartier import specs
from cartier.contracts import Reasoner
from cartier.errors import InputError
from cartier.home import Home
from cartier.io.files import typed
from cartier.labels import display_name
from cartier.models.minilm import TextEncoder
from cartier.types import TrueObject
from cartier_bench.asked import Asked
from cartier_bench.baselines import nlmap
from cartier_bench.batch import PromptWriter
from cartier_bench.maps import Maps, MapSettings
from cartier_bench.methods import ASKING, METHODS, Bench
from cartier_bench.metrics import distances, matches
from cartier_bench.queries import Query, cases
from cartier_bench.suite import MAPS, Case, Progress, Row, Suite, answer_part, silent
from cartier_bench.suite import share as share_suite

GENERATED = ("1001", "1002", "1003")
"""Homes of the dollhouse that NLMap's threshold is chosen on: nothing is asked there."""
ASKED = "asked.jsonl"
SECONDS = 4  # decimals


@dataclass(frozen=True)
class BenchSettings:
    """What is asked, of whom, where."""

    homes: tuple[str, ...]
    methods: tuple[str, ...] = tuple(METHODS)
    queries: str = "paper"
    maps: MapSettings = field(default_factory=MapSettings)
    seed: int = 0
    prompt: str | None = None


@dataclass(frozen=True)
class ReasonerSpec:
    """A reasoner as the command line writes it; what is None is left to it."""

    name: str
    model: str | None = None
    base_url: str | None = None
    prompt: str | None = None
    path: str | None = None

    def make(self) -> Reasoner:
        """The reasoner. Raises what ``specs.reasoner`` raises."""
        options = {name: value for name, value in asdict(self).items() if name != "name"}
        return specs.reasoner(self.name, **options)


def paper(
    folder: Path | None, settings: BenchSettings, queries: Sequence[Query], reasoner: Reasoner,
    maps_folder: Path | None = None,
) -> Suite:  # fmt: skip
    """The suite; what the reasoner was asked is kept in ``folder``, if there is one, and no question is asked twice.

    ``maps_folder`` may be shared between runs; by default it is in the run folder. Raises InputError for an unknown
    home or method, and for requests that can be asked nowhere.
    """
    unknown = [method for method in settings.methods if method not in METHODS]
    if unknown:
        raise InputError(f"there is no method {unknown[0]!r}; there are {', '.join(METHODS)}")
    maps = Maps(maps_folder or (folder or Path()) / MAPS, settings.maps)
    truth = {home: maps.world.objects(home) for home in settings.homes}
    asked = cases(queries, {home: {display_name(obj.label) for obj in objs} for home, objs in truth.items()})
    if not asked:
        raise InputError(f"none of the {len(queries)} requests can be asked in {', '.join(settings.homes)}")
    writes = isinstance(reasoner, PromptWriter)
    memory = Asked(reasoner, None if folder is None else folder / ASKED)
    bench = Bench(memory, TextEncoder(), 0.0, settings.seed)
    methods = [method for method in settings.methods if not writes or method in ASKING]

    def settle(kept: Row, progress: Progress) -> None:
        if "nlmap" not in methods or (isinstance(reasoner, PromptWriter) and reasoner.replies is None):
            return  # it chooses among what came back at first
        if kept.get("nlmap_threshold") is None:
            kept["nlmap_threshold"], kept["nlmap_calibrated_on"] = _calibrated(maps, settings.homes, progress)
        bench.nlmap_threshold = float(kept["nlmap_threshold"])

    return Suite(
        who=reasoner.name, settings=settings, items=queries, keys=("home", "query_id", "method"),
        cases=[Case((home, query.id, m), home, query, m) for home, query in asked for m in methods],
        open=maps.get, settle=settle, beside={ASKED: ("asked", "reply", "cost")},
        row=lambda home, case: _row(home, case, bench, memory, truth[case.place]),
    )  # fmt: skip


def share(
    folder: Path, settings: BenchSettings, queries: Sequence[Query], reasoner: ReasonerSpec, maps_folder: Path,
    *, runner: str, workers: int, progress: Progress = silent,
) -> None:  # fmt: skip
    """Answer all that is not answered yet by many workers; all methods of a home stay with one, for they share its map
    and what the reasoner was asked already."""
    suite = paper(folder, settings, queries, reasoner.make(), maps_folder)
    about = {
        "settings": asdict(settings), "reasoner": asdict(reasoner), "maps": str(maps_folder),
        "queries": [asdict(query) for query in queries],
    }  # fmt: skip
    share_suite(folder, suite, about, __name__, runner=runner, workers=workers, progress=progress)


def serving(about: dict[str, Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A worker that asks one home after another, as plain values."""
    plain = json.loads(json.dumps(about))
    settings: BenchSettings = typed(plain["settings"], BenchSettings)
    queries = [Query(**query | {"accept": tuple(query["accept"])}) for query in plain["queries"]]
    reasoner, maps = ReasonerSpec(**plain["reasoner"]).make(), Path(plain["maps"])
    return lambda given: answer_part(
        given, plain["kept"], lambda folder: paper(folder, settings, queries, reasoner, maps)
    )


def _row(home: Home, case: Case, bench: Bench, memory: Asked, truth: Sequence[TrueObject]) -> Row:
    before, query = dict(memory.spent), case.item
    answer = METHODS[case.method](home, query, bench)
    cost: Mapping[str, Any] = {what: memory.spent[what] - before[what] for what in before}
    there = {display_name(obj.label) for obj in truth}
    accept = [name for name in query.accept if name in there]
    position = None if answer.place is None else [round(v, 4) for v in answer.place.position]
    in_space, on_floor = distances(position, truth, accept)
    after_choice = sum(ms for step, ms in answer.timing_ms.items() if step != "select") / 1e3
    return {
        "home": case.place, "query_id": query.id, "type": query.type, "method": case.method,
        "status": answer.selection.status, "object": answer.selection.object,
        "match": matches(answer.selection.object, accept), "distance_m": _rounded(in_space),
        "distance_floor_m": _rounded(on_floor),
        "goal_reachable": None if answer.place is None else answer.goal is not None,
        "seconds": round(cost["seconds"] + after_choice, SECONDS), "llm_calls": cost["calls"], "tokens": cost["tokens"],
        "detector": answer.detector, "encoder": answer.encoder, "reasoner": answer.reasoner, "target": query.target,
        "accept": accept, "text": query.text, "position": position,
        "frame": None if answer.place is None else answer.place.frame, "note": answer.selection.reason,
    }  # fmt: skip


def _rounded(metres: float | None) -> float | None:
    return None if metres is None else round(metres, 4)


def _calibrated(maps: Maps, asked: Sequence[str], progress: Progress) -> tuple[float, list[str]]:
    """NLMap's threshold and the homes that it is chosen on, of which nothing is asked."""
    all_homes = maps.world.homes()
    others = GENERATED if maps.settings.world == "dollhouse" else [home for home in all_homes if home not in asked][:3]
    if not others:
        raise InputError("nlmap's threshold is chosen on homes that are not asked about: leave some out of --homes")
    known = {display_name(t.label) for home in {*others, *all_homes} for t in maps.world.objects(home)}
    homes = [(home := maps.get(name, progress), set(home.names)) for name in others]
    return nlmap.calibrate(homes, sorted(known)), [f"{maps.settings.world}:{name}" for name in others]
