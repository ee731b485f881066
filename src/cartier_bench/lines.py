"""JSON lines from outside: each becomes what it should be, or is refused in one line that has its number."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NoReturn, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from cartier.errors import InputError, brief
from cartier.io.files import check_file

MAX_LINE_BYTES = 2**20
MAX_BYTES = 64 * 2**20


def _writable(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError("half a character (a lone surrogate), which no file can hold") from error
    return text


Text = Annotated[str, AfterValidator(_writable), Field(max_length=100_000)]
Name = Annotated[Text, Field(min_length=1, max_length=200)]


class Line(BaseModel):
    """A line without keys that nobody knows, and without numbers that are none."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


Kind = TypeVar("Kind", bound=BaseModel)


def read_lines(
    path: Path, kind: type[Kind], most: int, form: str = "", max_bytes: int | None = MAX_BYTES
) -> Iterator[tuple[str, Kind]]:
    """The lines of a file that are not blank, each with where it stands. ``form`` is what a line looks like.

    Raises InputError for the first broken line, or for a file that is missing, too large or longer than ``most`` lines.
    """
    check_file(path, max_bytes)
    try:
        with path.open("rb") as file:
            for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), start=1):
                where = f"{path} line {number}"
                if number > most:
                    raise InputError(f"{where}: more than {most} lines; split the file")
                if len(line) > MAX_LINE_BYTES:
                    raise InputError(f"{where} is longer than {MAX_LINE_BYTES // 1024} KiB")
                if line.strip():
                    yield where, parsed(_value(line, where, form), kind, where, form)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error


def parsed(value: Any, kind: type[Kind], where: str, form: str = "") -> Kind:
    """A value as what it should be. Raises InputError for its first fault."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
    at = ".".join(str(part) for part in first["loc"])
    fault = {"missing": f"{at!r} is missing", "extra_forbidden": f"{brief(at, 40)!r} is no key here"}.get(first["type"])
    if fault and form:
        raise InputError(f"{where}: {fault}; a line looks like {form}")
    told = first["msg"].removeprefix("Value error, ")
    raise InputError(f"{where}: {at or 'the line'}: {told[:1].lower()}{told[1:160]}")


def _value(line: bytes, where: str, form: str) -> Any:
    try:
        return json.loads(line.decode("utf-8-sig"), parse_constant=_refuse)
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: not UTF-8 text") from error
    except (ValueError, RecursionError) as error:
        mend = f"a line looks like {form}" if form else "delete the line and run the bench again"
        raise InputError(f"{where}: not valid JSON ({brief(error)}); {mend}") from error


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number in JSON")
