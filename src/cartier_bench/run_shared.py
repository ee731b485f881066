"""Bench by the runner of fleets: a worker maps and asks one home with every method; their rows become one run's.

All methods of a home stay with one worker, for they share its map and what the reasoner was asked already.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cartier import specs
from cartier.errors import CartierError, InputError, brief
from cartier.io.atomic import append_line, locked, write_json
from cartier.io.files import read_json, read_rows, typed
from cartier_bench.maps import Maps
from cartier_bench.queries import Query
from cartier_bench.run import BenchSettings, Progress, claim, find_cases, threshold_of
from cartier_fleet import runners
from cartier_fleet.jobs import Task
from cartier_fleet.worker import Outcome

PARTS = ".parts"
ROWS, ASKED = "results.jsonl", "asked.jsonl"


@dataclass(frozen=True)
class ReasonerSpec:
    """A reasoner as the command line writes it; what is None is left to it."""

    name: str
    model: str | None = None
    base_url: str | None = None
    prompt: str | None = None
    path: str | None = None

    def make(self) -> Any:
        """The reasoner. Raises what ``specs.reasoner`` raises."""
        options = {name: value for name, value in asdict(self).items() if name != "name"}
        return specs.reasoner(self.name, **options)


def share(
    folder: Path, settings: BenchSettings, queries: Sequence[Query], reasoner: ReasonerSpec, maps_folder: Path,
    *, runner: str, workers: int, progress: Progress | None = None,
) -> None:  # fmt: skip
    """Answer all that is not answered yet, by many workers; ``run`` then finds every row in the run folder.

    Raises InputError as ``run`` does, and with the line of a home that failed; what was answered before stays.
    """
    runners.check_workers(runner, workers)
    maps, name = Maps(maps_folder, settings.maps), reasoner.make().name
    _, asked = find_cases(settings, queries, maps)
    of_home = dict[str, list[Query]]()
    for home, query in asked:
        of_home.setdefault(home, []).append(query)
    with locked(folder):
        claim(folder, settings, queries, name)
        chosen = threshold_of(folder, maps, settings.homes, progress) if "nlmap" in settings.methods else None
        keys = ("home", "query_id", "method")
        done = {tuple(row[key] for key in keys) for row in read_rows(folder / ROWS, keys)}
        tasks = []
        for home, here in of_home.items():
            if all((home, query.id, method) in done for query in here for method in settings.methods):
                continue
            part = folder / PARTS / home
            claim(part, replace(settings, homes=(home,)), here, name)
            write_json(part / "settings.json", read_json(part / "settings.json") | {"nlmap_threshold": chosen})
            tasks.append(Task(str(part), home))
        about = {
            "settings": asdict(settings), "reasoner": asdict(reasoner), "maps": str(maps_folder),
            "queries": {home: [asdict(query) for query in here] for home, here in of_home.items()},
        }  # fmt: skip

        def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
            if progress:
                progress("asking", done, total)

        outcomes = runners.work(tasks, about, module=__name__, runner=runner, workers=workers, told=told)
        for home, outcome in outcomes.items():
            if outcome.state != "finished":
                raise InputError(f"{home}: {outcome.line}")
        _join(folder, [Path(task.path) for task in tasks])


def serving(about: dict[str, Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A worker that asks one home after another, as plain values."""
    from cartier_bench.run import run

    plain = json.loads(json.dumps(about))
    settings: BenchSettings = typed(plain["settings"], BenchSettings)
    reasoner = ReasonerSpec(**plain["reasoner"]).make()

    def serve(given: dict[str, Any]) -> dict[str, Any]:
        task = Task(**given["task"])
        here = [Query(**query | {"accept": tuple(query["accept"])}) for query in plain["queries"][task.name]]
        try:
            run(Path(task.path), replace(settings, homes=(task.name,)), here, reasoner, Path(plain["maps"]))
            return asdict(Outcome("finished"))
        except Exception as error:  # what a world from elsewhere raises would end each worker
            line = str(error) if isinstance(error, CartierError) else f"{type(error).__name__}: {brief(error)}"
            return asdict(Outcome("stopped", f"{task.name}: {line}"))

    return serve


def _join(folder: Path, parts: Sequence[Path]) -> None:
    """Add the rows of the parts to those of the run, and what the reasoner was asked."""
    for file, keys in ((ROWS, ("home", "query_id", "method")), (ASKED, ("asked", "reply", "cost"))):
        for part in parts:
            for row in read_rows(part / file, keys):
                append_line(folder / file, json.dumps(row, ensure_ascii=False))
    shutil.rmtree(folder / PARTS, ignore_errors=True)
