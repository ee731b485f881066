"""The one runner of all suites: it asks what a suite holds, goes on where a run stopped, and writes rows and report.

A suite is a value: what is asked where and by which method, how an answer becomes a row, and what the rows come to.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from cartier.errors import CartierError, InputError, brief
from cartier.io.atomic import append_line, locked, sweep_parts, write_file, write_json
from cartier.io.files import read_json, read_rows

ROWS, SETTINGS = "results.jsonl", "settings.json"
MAPS = "maps"
"""The mapped homes in a run folder, where they are kept nowhere else."""
PARTS = ".parts"
Progress = Callable[[str, int, int], None]
Row = dict[str, Any]


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody sees."""


class Case(NamedTuple):
    """One question: ``key`` are the values of the suite's ``keys`` in its row, ``place`` what is opened to ask it."""

    key: tuple[str, ...]
    place: Any
    item: Any
    method: str = ""


@dataclass(frozen=True)
class Suite:
    """What is asked, of whom, and what becomes of it.

    Args:
        who: The name of what is tested.
        settings: A dataclass: a run folder goes on only with the same, and with the same ``items``.
        items: What is asked, dataclasses.
        keys: The fields of a row that say which case it answers.
        cases: All that is asked, in the order of the rows.
        open: What a place is asked with, such as its mapped home.
        row: The row of a case. A row that is ``unanswered`` is asked for again when the run goes on.
        settle: Gets what the run folder keeps of the settings, and adds what is found out once before anybody is asked.
        judge: The rows with what is scored when all are there, and files that this needs in the run folder.
        report: The files of the run folder, by name: texts, and tables that are written as JSON.
        beside: Further files of the run folder to which rows of JSON are appended, with the keys of each.
    """

    who: str
    settings: Any
    items: Sequence[Any]
    keys: tuple[str, ...]
    cases: Sequence[Case]
    open: Callable[[Any, Progress], Any]
    row: Callable[[Any, Case], Row]
    settle: Callable[[Row, Progress], None] = lambda kept, progress: None
    judge: Callable[[Path, list[Row]], list[Row]] = lambda folder, rows: rows
    report: Callable[[list[Row]], Mapping[str, Any]] = lambda rows: {}
    beside: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def run(folder: Path, suite: Suite, progress: Progress = silent) -> list[Row]:
    """Ask all that is not answered yet, write rows and report, and return all rows in the order of the cases.

    Raises InputError for a run folder of other settings; what was answered before an error stays.
    """
    with locked(folder):
        _claim(folder, suite, progress)
        rows = suite.judge(folder, _answered(folder, suite, suite.cases, progress))
        lines = "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows)
        for name, content in {ROWS: lines, **suite.report(rows)}.items():
            if isinstance(content, str):
                write_file(folder / name, content.encode())
            else:
                write_json(folder / name, content)
    return rows


def show(suite: Suite, progress: Progress = silent) -> None:
    """Let a suite whose reasoner or vision model only writes prompts see all of its cases; no run folder is made."""
    suite.settle({}, progress)
    for place, cases in _by_place(suite.cases).items():
        there = suite.open(place, progress)
        for case in cases:
            suite.row(there, case)


def share(
    folder: Path, suite: Suite, about: Mapping[str, Any], module: str, *, runner: str, workers: int,
    progress: Progress = silent,
) -> None:  # fmt: skip
    """Answer all that is not answered yet by many workers, each place by one; ``run`` then finds every row.

    ``module`` has a ``serving`` for ``cartier_fleet.runners.work``, which gets ``about`` and calls ``answer_part``.
    Raises InputError as ``run`` does, and with the line of a place that failed; what was answered before stays.
    """
    from cartier_fleet import runners
    from cartier_fleet.jobs import Task

    runners.check_workers(runner, workers)
    with locked(folder):
        kept = _claim(folder, suite, progress)
        done = _done(folder, suite)
        places = [p for p, cases in _by_place(suite.cases).items() if any(case.key not in done for case in cases)]
        tasks = [Task(str(folder / PARTS / place), place) for place in places]
        outcomes = runners.work(
            tasks, {**about, "kept": kept}, module=module, runner=runner, workers=workers,
            told=lambda task, outcome, done, total: progress("asking", done, total),
        )  # fmt: skip
        for place, outcome in outcomes.items():
            if outcome.state != "finished":
                raise InputError(f"{place}: {outcome.line}")
        for name, keys in {ROWS: suite.keys, **suite.beside}.items():
            for task in tasks:
                for row in read_rows(Path(task.path) / name, keys):
                    append_line(folder / name, json.dumps(row, ensure_ascii=False))
        shutil.rmtree(folder / PARTS, ignore_errors=True)


def answer_part(given: Mapping[str, Any], kept: Row, made: Callable[[Path], Suite]) -> dict[str, Any]:
    """A worker's answer to a task of ``share``: the rows of one place go to a folder of their own."""
    from cartier_fleet.jobs import Task
    from cartier_fleet.worker import Outcome

    task = Task(**given["task"])
    try:
        Path(task.path).mkdir(parents=True, exist_ok=True)
        suite = made(Path(task.path))
        suite.settle(kept, silent)
        _answered(Path(task.path), suite, _by_place(suite.cases)[task.name], silent)
        return asdict(Outcome("finished"))
    except Exception as error:  # what a world from elsewhere raises would end each worker
        line = str(error) if isinstance(error, CartierError) else f"{type(error).__name__}: {brief(error)}"
        return asdict(Outcome("stopped", f"{task.name}: {line}"))


def _answered(folder: Path, suite: Suite, cases: Sequence[Case], progress: Progress) -> list[Row]:
    """The rows of some cases; each that is missing is asked for and appended to the folder's rows."""
    done = _done(folder, suite)
    for place, here in _by_place(cases).items():
        missing = [case for case in here if case.key not in done]
        there = suite.open(place, progress) if missing else None
        for case in missing:
            done[case.key] = suite.row(there, case)
            append_line(folder / ROWS, json.dumps(done[case.key], ensure_ascii=False))
            progress("asking", len(done), len(cases))
    return [done[case.key] for case in cases]


def _done(folder: Path, suite: Suite) -> dict[tuple[str, ...], Row]:
    rows = read_rows(folder / ROWS, suite.keys)
    return {tuple(row[key] for key in suite.keys): row for row in rows if not row.get("unanswered")}


def _by_place(cases: Sequence[Case]) -> dict[Any, list[Case]]:
    found = dict[Any, list[Case]]()
    for case in cases:
        found.setdefault(case.place, []).append(case)
    return found


def _claim(folder: Path, suite: Suite, progress: Progress) -> Row:
    """Make the run folder, or see that it is of the same settings; what it keeps of them. Raises InputError if not."""
    asked = json.dumps([asdict(item) for item in suite.items], sort_keys=True)
    mine = asdict(suite.settings) | {
        "reasoner": suite.who, "queries_sha256": hashlib.sha256(asked.encode()).hexdigest()
    }  # fmt: skip
    mine = json.loads(json.dumps(mine))  # tuples become lists, as in the file
    file = folder / SETTINGS
    sweep_parts(file)
    sweep_parts(folder / ROWS)
    if file.exists():
        kept: Row = read_json(file)
        other = [name for name, value in mine.items() if kept.get(name) != value]
        if other:
            raise InputError(
                f"{folder} holds a run of other settings ({', '.join(other)}): choose another folder, or delete that "
                "one"
            )
    else:
        there = folder.iterdir() if folder.exists() else ()
        if any(path.name != MAPS and not path.name.startswith(".") for path in there):  # prompts and kills leave such
            raise InputError(f"{folder} is not empty and holds no bench (no settings.json): choose another folder")
        packages = {name: version(name) for name in ("cartier", "numpy", "scipy", "onnxruntime")}
        kept = mine | {"versions": packages | {"python": platform.python_version()}}
        folder.mkdir(parents=True, exist_ok=True)
        write_json(file, kept)
    before = dict(kept)
    suite.settle(kept, progress)
    if kept != before:
        write_json(file, kept)
    return kept
