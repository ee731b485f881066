"""What ``cartier check-model`` found out about a model on a server, kept with a person's settings."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cartier.errors import InputError, brief
from cartier.io.atomic import write_file
from cartier.io.files import read_text

MAX_BYTES = 2**20


@dataclass(frozen=True)
class Capabilities:
    """What one model on one server can do.

    Args:
        server: The server's URL, without credentials.
        model: The model's name.
        form: The strictest form of structured output that worked, None if none did.
        keeps_schema: Whether its replies were of the schema.
        sees: Whether it read a number in a picture; None if the server takes no pictures.
        knows_mirrored: Whether it told the picture from its mirror image.
        thinking: "off" (none was seen), "on" (it thinks in spite of being told not to).
        seconds: The median time of a reply.
        tokens_per_s: Tokens of replies and prompts together in a second; 0 if the server does not count.
        checked: The day, YYYY-MM-DD.
        bare_urls: Whether it takes pictures as bare URLs only.
        leaves_out: Members of a request that the server refuses; None of a check that did not look for them.
    """

    server: str
    model: str
    form: str | None
    keeps_schema: bool
    sees: bool | None
    knows_mirrored: bool | None
    thinking: str
    seconds: float
    tokens_per_s: float
    checked: str
    bare_urls: bool = False
    leaves_out: tuple[str, ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Its fields as plain JSON values."""
        return asdict(self)


def settings_file() -> Path:
    """Where the results are kept: models.json in XDG_CONFIG_HOME/cartier, by default in ~/.config/cartier."""
    base = os.environ.get("XDG_CONFIG_HOME")
    return (Path(base) if base else Path.home() / ".config") / "cartier" / "models.json"


def known(server: str, model: str) -> Capabilities | None:
    """What an earlier check found, or None. Raises InputError if the file is damaged."""
    row = _rows().get(_key(server, model))
    if row is None:
        return None
    try:
        left = row.get("leaves_out")
        return Capabilities(**row | {"leaves_out": None if left is None else tuple(map(str, left))})
    except TypeError as error:
        raise _damaged(error) from error


def keep(found: Capabilities) -> Path:
    """Keep the result of a check; returns the file. Raises InputError if it cannot be written."""
    rows, file = _rows() | {_key(found.server, found.model): found.to_dict()}, settings_file()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{file.parent} cannot be made ({error.strerror})") from error
    write_file(file, (json.dumps(rows, indent=1) + "\n").encode())
    return file


def _rows() -> dict[str, Any]:
    file = settings_file()
    if not file.is_file():
        return {}
    try:
        rows = json.loads(read_text(file, MAX_BYTES))
    except (ValueError, RecursionError) as error:
        raise _damaged(error) from error
    if not isinstance(rows, dict) or not all(isinstance(row, dict) for row in rows.values()):
        raise _damaged("it holds something else")
    return rows


def _damaged(error: object) -> InputError:
    return InputError(f"{settings_file()} is damaged ({brief(error)}): delete it and run cartier check-model again")


def _key(server: str, model: str) -> str:
    return f"{model} @ {server.rstrip('/')}"
