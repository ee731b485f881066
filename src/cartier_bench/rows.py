"""Rows of a run folder's ``results.jsonl``, checked: one answer of one method to one request in one home."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from cartier.errors import InputError
from cartier_bench.lines import Line, Name, Text, parsed, read_lines
from cartier_bench.queries import TYPES, QueryType

MAX_ROWS = 1_000_000

GROUPS = {
    "the paper's method": {
        "object_depth": "CARTIER, ObjectDepth",
        "object_depth_paper": "CARTIER, plain ObjectDepth",
        "object_viewpoint": "CARTIER, ObjectViewpoint",
        "vlmaps": "CARTIER, VLMaps",
    },
    "its baselines": {"nlmap": "NLMap", "vlmaps_query": "VLMaps, words alone"},
    "yardsticks": {
        "random": "random object",
        "nearest_name": "nearest name",
        "llm_without_list": "LLM without the list",
        "true_object": "true object",
    },
}
"""The methods and their names for people, in the order of every table and picture."""
TITLES = {name: words for group in GROUPS.values() for name, words in group.items()}


PARTS = ("detector", "encoder", "reasoner")
Metres = Annotated[float, Field(ge=0, le=1e6)]


class Row(Line):
    """One answer. Distances in metres, ``position`` is (x, y, z) in the world; null where the method gave no place."""

    model_config = ConfigDict(extra="ignore")

    home: Name
    query_id: Name
    type: QueryType
    method: Annotated[str, Field(pattern=r"^[a-z0-9_]{1,40}$")]
    status: Annotated[Text, Field(max_length=40)]
    object: Annotated[Text, Field(max_length=10_000)] | None
    match: bool
    distance_m: Metres | None
    distance_floor_m: Metres | None
    goal_reachable: bool | None
    seconds: Annotated[float, Field(ge=0, le=1e9)]
    llm_calls: Annotated[int, Field(ge=0, le=10**9)]
    tokens: Annotated[int, Field(ge=0, le=10**12)]
    detector: Text | None
    encoder: Text | None
    reasoner: Text | None
    text: Text = ""
    target: Text = ""
    accept: Annotated[tuple[Text, ...], Field(strict=False, max_length=1000)] = ()
    position: Annotated[tuple[float, float, float], Field(strict=False)] | None = None
    frame: Annotated[int, Field(ge=0)] | None = None
    note: Text = ""

    @property
    def case(self) -> tuple[str, str]:
        """(home, request): what all methods are asked alike."""
        return self.home, self.query_id

    def made_by(self, part: str) -> str:
        """The detector, encoder or reasoner, without the home that a ground truth's name ends in: "ground truth
        (dollhouse)"."""
        name: str = getattr(self, part) or "none"
        whole = name.removesuffix(f" {self.home})")
        return name if whole == name else f"{whole})"


def read_rows(file: Path) -> list[Row]:
    """Every row of a ``results.jsonl``. Raises InputError with the number of the first broken line, or if it is
    empty."""
    rows = [row for _, row in read_lines(file, Row, MAX_ROWS, max_bytes=None)]
    if not rows:
        raise InputError(f"{file} holds no answer yet: run cartier bench to its end")
    return rows


def check_rows(rows: Iterable[Mapping[str, Any] | Row]) -> list[Row]:
    """The rows as ``Row``, in the order of method, type, request and home, whatever order they came in.

    Raises InputError if a row is not one, a (home, request, method) comes twice, or a method was run in one home with
    two detectors, encoders or reasoners: such rows are of two runs and must not share a table.
    """
    checked = [row if isinstance(row, Row) else parsed(row, Row, f"result {n}") for n, row in enumerate(rows, start=1)]
    made_by: dict[tuple[str, ...], str] = {}
    seen: set[tuple[str, str, str]] = set()
    for row in checked:
        if (row.method, *row.case) in seen:
            raise InputError(
                f"{row.method} answered {row.query_id!r} in {row.home!r} twice: take one of the two rows out"
            )
        seen.add((row.method, *row.case))
        for part in PARTS if row.status != "alarm" else PARTS[:2]:  # the screen answers alarms before any reasoner
            first = made_by.setdefault((row.method, row.home, part), row.made_by(part))
            if first != row.made_by(part):
                raise InputError(
                    f"{row.method} was run in {row.home!r} with two {part}s, {first!r} and {row.made_by(part)!r}: "
                    "these are results of two runs, report each by itself"
                )
    places = {name: place for place, name in enumerate(ordered({row.method for row in checked}))}
    return sorted(checked, key=lambda row: (places[row.method], TYPES.index(row.type), row.query_id, row.home))


def objects_from(rows: Iterable[Row]) -> str:
    """Whether a run's objects were found in images or given away by a simulator; for every table to say."""
    given = {row.made_by("detector").startswith("ground truth") for row in rows}
    return " and ".join(
        words for is_given, words in ((False, "from pixels"), (True, "ground truth")) if is_given in given
    )


def ordered(methods: Iterable[str]) -> list[str]:
    """Method names in the fixed order; unknown ones last, by name."""
    known = list(TITLES)
    return sorted(methods, key=lambda name: (known.index(name) if name in known else len(known), name))


def title(method: str) -> str:
    """A method's name for people."""
    return TITLES.get(method, method.replace("_", " "))
