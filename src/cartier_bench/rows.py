"""Rows of a run folder's ``results.jsonl``, checked: one answer of one method to one request in one home."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from cartier.errors import InputError, brief
from cartier.io.files import check_file
from cartier_bench.queries import TYPES, QueryType

MAX_ROWS = 1_000_000
MAX_LINE_BYTES = 2**20

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


def _writable(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError("half a character (a lone surrogate), which no file can hold") from error
    return text


PARTS = ("detector", "encoder", "reasoner")
Metres = Annotated[float, Field(ge=0, le=1e6)]
Text = Annotated[str, AfterValidator(_writable)]
Name = Annotated[Text, Field(min_length=1, max_length=200)]


class Row(BaseModel):
    """One answer. Distances in metres, ``position`` is (x, y, z) in the world; null where the method gave no place."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)

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
    rows = []
    check_file(file)
    try:
        with file.open("rb") as lines:
            for number in range(1, MAX_ROWS + 2):
                line = lines.readline(MAX_LINE_BYTES + 1)
                if not line:
                    break
                if line.strip():
                    rows.append(_parse(line, f"{file} line {number}"))
            else:
                raise InputError(f"{file} has more than {MAX_ROWS} lines; ask fewer requests at once")
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from error
    if not rows:
        raise InputError(f"{file} holds no answer yet: run cartier bench to its end")
    return rows


def check_rows(rows: Iterable[Mapping[str, Any] | Row]) -> list[Row]:
    """The rows as ``Row``, in the order of method, type, request and home, whatever order they came in.

    Raises InputError if a row is not one, a (home, request, method) comes twice, or a method was run in one home with
    two detectors, encoders or reasoners: such rows are of two runs and must not share a table.
    """
    checked = [row if isinstance(row, Row) else _row(row, f"result {n}") for n, row in enumerate(rows, start=1)]
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


def _parse(line: bytes, where: str) -> Row:
    if len(line) > MAX_LINE_BYTES:
        raise InputError(f"{where} is longer than {MAX_LINE_BYTES // 1024} KiB; that is no result of cartier's")
    try:
        value = json.loads(line.decode("utf-8"), parse_constant=_refuse)
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: not UTF-8 text") from error
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{where}: not valid JSON ({brief(error)}); delete the line and run the bench again"
        ) from error
    return _row(value, where)


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number in JSON")


def _row(value: Any, where: str) -> Row:
    try:
        return Row.model_validate(dict(value) if isinstance(value, Mapping) else value)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        at = ".".join(str(part) for part in first["loc"]) or "the whole line"
        raise InputError(f"{where}: {at}: {first['msg'].lower()[:120]}") from error
