"""Requests of the evaluation with the objects that serve each one: the built-in set, or a user's JSON lines.

``query_texts/*.toml`` holds 40 AI2-THOR object types (*targets*), each asked for in three ways as in the paper
(arXiv 2307.11865): explicit, implicit and conversational. ``docs/queries.md`` tells how they were written.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from cartier.errors import InputError, brief
from cartier.io.files import read_text
from cartier.labels import display_name
from cartier.llm.prompts import check_query

QueryType = Literal["explicit", "implicit", "conversational"]
TYPES: tuple[QueryType, ...] = get_args(QueryType)
SPLITS = ("paper", "extended")
OWN = "own"  # the split of requests from a user's file

FOLDER = Path(__file__).parent / "query_texts"
FIELDS = ("id", "type", "target", "accept", "text")
FORM = '{"id": "…", "type": "implicit", "target": "sofa", "accept": ["sofa", "arm chair"], "text": "…"}'
MAX_BYTES = 16 * 2**20
MAX_QUERIES = 10_000
MAX_ACCEPTED = 200
MAX_NAME_CHARS = 100


@dataclass(frozen=True)
class Query:
    """One request. ``target`` is the object it was written for, ``accept`` every object name that serves it.

    Names are display names ("coffee machine"); in a home, the objects there that are in ``accept`` are right answers.
    """

    id: str
    type: QueryType
    target: str
    accept: tuple[str, ...]
    text: str
    split: str


def load_queries(split: str = "paper") -> list[Query]:
    """The built-in requests of a split: ``paper`` has one of each type per target, ``extended`` two others."""
    if split not in SPLITS:
        raise InputError(f"there is no split {split!r} of the built-in requests; there are {' and '.join(SPLITS)}")
    queries = []
    for target in targets():
        for kind in TYPES:
            for number, entry in enumerate(target[kind], start=1):
                key = f"{target['name'].replace(' ', '-')}-{kind}-{number}"
                text = " ".join(entry["text"].split())
                queries.append(Query(key, kind, target["name"], tuple(entry["accept"]), text, entry["split"]))
    return [q for q in queries if q.split == split]


def targets() -> list[dict[str, Any]]:
    """The targets as they stand in the files: name, synonyms, giveaways, and three lists of requests."""
    return [
        target
        for file in sorted(FOLDER.glob("*.toml"))
        for target in tomllib.loads(file.read_text(encoding="utf-8"))["target"]
    ]


def cases(queries: Sequence[Query], homes: Mapping[str, Set[str]]) -> list[tuple[str, Query]]:
    """Every (home, request) to be asked: a request is asked in each home that holds its target.

    ``homes`` has the display names of the objects in each home. A built-in request whose target is in none of them is
    left out; one of a user's own raises InputError, for it would never be asked and nobody would know.
    """
    found = [(home, query) for home, names in homes.items() for query in queries if query.target in names]
    asked = {query.id for _, query in found}
    lost = [query for query in queries if query.split == OWN and query.id not in asked]
    if lost:
        first, more = lost[0], f" (and {len(lost) - 1} more such)" if len(lost) > 1 else ""
        held = set().union(*homes.values())
        elsewhere = [name for name in first.accept if name in held]
        why = f"; it accepts {elsewhere[0]!r}, which they hold: make that its target" if elsewhere else ""
        raise InputError(
            f"request {first.id!r} can be asked nowhere{more}: no home of {', '.join(homes)} holds its target "
            f"{first.target!r}{why}"
        )
    return found


def load_file(path: str | Path) -> list[Query]:
    """A user's own requests, one JSON object a line with the keys id, type, target, accept and text.

    Names may be written as detectors write them (``CoffeeMachine``). Raises InputError with the number of the first
    broken line, or if the file is missing, too large or empty.
    """
    path = Path(path)
    queries: dict[str, Query] = {}
    lines: dict[str, int] = {}
    for number, line in enumerate(_lines(path), start=1):
        if not line.strip():
            continue
        try:
            query = _own(line)
            if query.id in lines:
                raise InputError(f"the id {query.id!r} was used on line {lines[query.id]}: give each request its own")
        except InputError as error:
            raise InputError(f"{path} line {number}: {error}") from error
        queries[query.id], lines[query.id] = query, number
        if len(queries) > MAX_QUERIES:
            raise InputError(f"{path} line {number}: more than {MAX_QUERIES} requests; split the file")
    if not queries:
        raise InputError(f"{path} holds no request; a line looks like {FORM}")
    return list(queries.values())


def _lines(path: Path) -> list[str]:
    return read_text(path, MAX_BYTES).split("\n")


def _own(line: str) -> Query:
    try:
        row = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not valid JSON ({brief(error)}); a line looks like {FORM}") from error
    if not isinstance(row, dict):
        raise InputError(f"not a JSON object; a line looks like {FORM}")
    missing = [field for field in FIELDS if field not in row]
    if missing:
        raise InputError(f"{missing[0]!r} is missing; a line looks like {FORM}")
    strange = [key for key in row if key not in FIELDS]
    if strange:
        raise InputError(f"{brief(strange[0], 40)!r} is no key of a request; the keys are {', '.join(FIELDS)}")
    if not isinstance(row["type"], str) or row["type"] not in TYPES:
        shown = f"{brief(row['type'], 40)!r} is unknown" if isinstance(row["type"], str) else "must be a word"
        raise InputError(f"the type {shown}; the types are {', '.join(TYPES)}")
    if not isinstance(row["accept"], list) or not 1 <= len(row["accept"]) <= MAX_ACCEPTED:
        raise InputError(f"'accept' must be a list of 1 to {MAX_ACCEPTED} object names")
    target = _name(row, "target", row["target"])
    accept = tuple(dict.fromkeys(_name(row, "accept", name) for name in row["accept"]))
    if target not in accept:
        raise InputError(f"'accept' lacks the target {target!r}: the object that a request is about must serve it")
    if not isinstance(row["text"], str):
        raise InputError("'text' must be the words of the request")
    key = _words("id", row["id"])
    return Query(key, row["type"], target, accept, check_query(row["text"]), OWN)


def _name(row: Mapping[str, Any], field: str, value: Any) -> str:
    return _words(field, display_name(value) if isinstance(value, str) else value)


def _words(field: str, value: Any) -> str:
    if not isinstance(value, str) or not value.strip() or len(value) > MAX_NAME_CHARS or not value.isprintable():
        raise InputError(f"{field!r} must be text of 1 to {MAX_NAME_CHARS} characters in one line")
    return value
