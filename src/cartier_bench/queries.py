"""Requests of the evaluation with the objects that serve each one: the built-in set, or a user's JSON lines.

``query_texts/*.toml`` holds 40 AI2-THOR object types (*targets*), each asked for in three ways as in the paper
(arXiv 2307.11865): explicit, implicit and conversational. ``docs/queries.md`` tells how they were written.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Field

from cartier.errors import InputError
from cartier.labels import display_name
from cartier.llm.prompts import check_query
from cartier_bench.lines import Line, Name, Text, read_lines

QueryType = Literal["explicit", "implicit", "conversational"]
TYPES: tuple[QueryType, ...] = get_args(QueryType)
SPLITS = ("paper", "extended")
OWN = "own"  # the split of requests from a user's file

FOLDER = Path(__file__).parent / "query_texts"
FORM = '{"id": "…", "type": "implicit", "target": "sofa", "accept": ["sofa", "arm chair"], "text": "…"}'
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
    queries: dict[str, Query] = {}
    for where, row in read_lines(Path(path), _QueryLine, MAX_QUERIES, FORM):
        if row.id in queries:
            raise InputError(f"{where}: the id {row.id!r} was used before: give each request its own")
        if row.target not in row.accept:
            raise InputError(f"{where}: 'accept' lacks the target {row.target!r}, which must serve its own request")
        try:
            text = check_query(row.text)
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        queries[row.id] = Query(row.id, row.type, row.target, tuple(dict.fromkeys(row.accept)), text, OWN)
    if not queries:
        raise InputError(f"{path} holds no request; a line looks like {FORM}")
    return list(queries.values())


def _one_line(text: str) -> str:
    if not text.strip() or len(text) > MAX_NAME_CHARS or not text.isprintable():
        raise ValueError(f"must be text of 1 to {MAX_NAME_CHARS} characters in one line")
    return text


Object = Annotated[Name, AfterValidator(display_name), AfterValidator(_one_line)]


class _QueryLine(Line):
    id: Annotated[str, AfterValidator(_one_line)]
    type: QueryType
    target: Object
    accept: Annotated[tuple[Object, ...], Field(strict=False, min_length=1, max_length=MAX_ACCEPTED)]
    text: Text
