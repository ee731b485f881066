"""Run of ``cartier bench``: it maps the homes and asks every method every request; a killed run can be resumed."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from cartier.contracts import Reasoner
from cartier.errors import InputError
from cartier.home import Home
from cartier.io.atomic import append_line, locked, sweep_parts, write_file, write_json
from cartier.io.files import read_json, read_rows
from cartier.labels import display_name
from cartier.models.minilm import TextEncoder
from cartier.types import Answer, TrueObject
from cartier_bench.asked import Asked
from cartier_bench.baselines import nlmap
from cartier_bench.batch import PromptWriter
from cartier_bench.maps import Maps, MapSettings
from cartier_bench.methods import ASKING, METHODS, Bench
from cartier_bench.metrics import distances, matches
from cartier_bench.queries import Query, cases

GENERATED = (
    "1001",
    "1002",
    "1003",
)  # homes of the dollhouse that NLMap's threshold is chosen on: nothing is asked there
SECONDS = 4  # decimals
MAPS = "maps"
"""The mapped homes in a run folder, where they are kept nowhere else."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class BenchSettings:
    """What is asked, of whom, where; the run folder keeps it, and goes on only with the same."""

    homes: tuple[str, ...]
    methods: tuple[str, ...] = tuple(METHODS)
    queries: str = "paper"
    maps: MapSettings = field(default_factory=MapSettings)
    seed: int = 0
    prompt: str | None = None


def run(
    folder: Path,
    settings: BenchSettings,
    queries: Sequence[Query],
    reasoner: Reasoner,
    maps_folder: Path | None = None,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Ask everything that is not answered yet and return all rows, in order of home, request and method.

    ``maps_folder`` may be shared between runs; by default it is in the run folder. Raises InputError for an unknown
    home or method, or a run folder of other settings; what was answered before an error stays.
    """
    maps = Maps(maps_folder or folder / MAPS, settings.maps)
    truth, asked = find_cases(settings, queries, maps)
    with locked(folder):
        return _run(folder, settings, queries, asked, truth, reasoner, maps, progress)


def write_prompts(
    writer: PromptWriter,
    settings: BenchSettings,
    queries: Sequence[Query],
    maps_folder: Path,
    progress: Progress | None = None,
) -> None:
    """Let the writer see all that a run would ask a language model. Raises InputError as ``run`` does; no run folder is
    made."""
    maps = Maps(maps_folder, settings.maps)
    _, asked = find_cases(settings, queries, maps)
    depends = "nlmap" in settings.methods and writer.replies is not None  # its choice is among what came back at first
    threshold = _calibrated(maps, settings.homes, progress)[0] if depends else 0.0
    bench = Bench(writer, TextEncoder(), threshold, settings.seed)
    for home_name in settings.homes:
        home = maps.get(home_name, progress)
        for query in [query for name, query in asked if name == home_name]:
            for method in [method for method in settings.methods if method in ASKING]:
                METHODS[method](home, query, bench)


def find_cases(
    settings: BenchSettings, queries: Sequence[Query], maps: Maps
) -> tuple[dict[str, list[TrueObject]], list[tuple[str, Query]]]:
    """The true objects of each home, and every (home, request) to be asked."""
    unknown = [method for method in settings.methods if method not in METHODS]
    if unknown:
        raise InputError(f"there is no method {unknown[0]!r}; there are {', '.join(METHODS)}")
    truth = {home: maps.world.objects(home) for home in settings.homes}
    names = {home: {display_name(obj.label) for obj in objs} for home, objs in truth.items()}
    asked = cases(queries, names)
    if not asked:
        raise InputError(f"none of the {len(queries)} requests can be asked in {', '.join(settings.homes)}")
    return truth, asked


def _run(
    folder: Path,
    settings: BenchSettings,
    queries: Sequence[Query],
    asked: Sequence[tuple[str, Query]],
    truth: Mapping[str, Sequence[TrueObject]],
    reasoner: Reasoner,
    maps: Maps,
    progress: Progress | None,
) -> list[dict[str, Any]]:
    """The rows of a run folder that is ours alone."""
    claim(folder, settings, queries, reasoner.name)
    file = folder / "results.jsonl"
    done = {
        (row["home"], row["query_id"], row["method"]): row for row in read_rows(file, ("home", "query_id", "method"))
    }
    memory = Asked(reasoner, folder / "asked.jsonl")
    threshold = threshold_of(folder, maps, settings.homes, progress) if "nlmap" in settings.methods else None
    bench = Bench(memory, TextEncoder(), threshold, settings.seed)
    total = len(asked) * len(settings.methods)
    for home_name in settings.homes:
        here = [(query, method) for home, query in asked if home == home_name for method in settings.methods]
        missing = [(q, m) for q, m in here if (home_name, q.id, m) not in done]
        if not missing:
            continue
        home = maps.get(home_name, progress)
        for query, method in missing:
            row = _row(home, home_name, query, method, bench, memory, truth[home_name])
            done[home_name, query.id, method] = row
            append_line(file, json.dumps(row, ensure_ascii=False))
            if progress:
                progress("asking", len(done), total)
    rows = [done[home, query.id, method] for home, query in asked for method in settings.methods]
    write_file(file, "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows).encode())
    return rows


def _row(
    home: Home, home_name: str, query: Query, method: str, bench: Bench, memory: Asked, truth: Sequence[TrueObject]
) -> dict[str, Any]:
    before = dict(memory.spent)
    answer: Answer = METHODS[method](home, query, bench)
    cost = {what: memory.spent[what] - before[what] for what in before}
    there = {display_name(obj.label) for obj in truth}
    accept = [name for name in query.accept if name in there]
    position = None if answer.place is None else [round(v, 4) for v in answer.place.position]
    in_space, on_floor = distances(position, truth, accept)
    after_choice = sum(ms for step, ms in answer.timing_ms.items() if step != "select") / 1e3
    return {
        "home": home_name, "query_id": query.id, "type": query.type, "method": method,
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


def threshold_of(folder: Path, maps: Maps, asked: Sequence[str], progress: Progress | None) -> float:
    """NLMap's threshold, chosen on homes of which nothing is asked; kept in the run's settings."""
    kept = read_json(folder / "settings.json")
    if kept.get("nlmap_threshold") is None:
        kept["nlmap_threshold"], kept["nlmap_calibrated_on"] = _calibrated(maps, asked, progress)
        write_json(folder / "settings.json", kept)
    return float(kept["nlmap_threshold"])


def _calibrated(maps: Maps, asked: Sequence[str], progress: Progress | None) -> tuple[float, list[str]]:
    """NLMap's threshold and the homes that it is chosen on."""
    all_homes = maps.world.homes()
    others = GENERATED if maps.settings.world == "dollhouse" else [home for home in all_homes if home not in asked][:3]
    if not others:
        raise InputError("nlmap's threshold is chosen on homes that are not asked about: leave some out of --homes")
    known = {display_name(t.label) for home in {*others, *all_homes} for t in maps.world.objects(home)}
    homes = [(home := maps.get(name, progress), set(home.names)) for name in others]
    return nlmap.calibrate(homes, sorted(known)), [f"{maps.settings.world}:{name}" for name in others]


def claim(folder: Path, settings: Any, queries: Iterable[Any], reasoner: str) -> None:
    """Make the run folder, or see that it is of the same settings (a dataclass, as each query is). Raises InputError if
    not."""
    import hashlib

    asked = json.dumps([asdict(query) for query in queries], sort_keys=True)
    mine = asdict(settings) | {"reasoner": reasoner, "queries_sha256": hashlib.sha256(asked.encode()).hexdigest()}
    mine = json.loads(json.dumps(mine))  # tuples become lists, as in the file
    packages = {name: version(name) for name in ("cartier", "numpy", "scipy", "onnxruntime")}
    file = folder / "settings.json"
    sweep_parts(file)
    sweep_parts(folder / "results.jsonl")
    if file.exists():
        kept = read_json(file)
        other = [name for name, value in mine.items() if kept.get(name) != value]
        if other:
            raise InputError(
                f"{folder} holds a run of other settings ({', '.join(other)}): choose another folder, or delete that "
                "one"
            )
        return
    strange = (
        (file for file in folder.iterdir() if file.name != MAPS and not file.name.startswith("."))
        if folder.exists()
        else ()
    )
    if any(strange):  # maps are made first by whoever writes prompts, and a kill leaves temporary files
        raise InputError(f"{folder} is not empty and holds no bench (no settings.json): choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_json(file, mine | {"versions": packages | {"python": platform.python_version()}})
