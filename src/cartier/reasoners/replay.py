"""Recorded replies from a JSON-lines file, {"query": …, "reply": …}: a model's answers without the model."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from cartier.errors import InputError, ReasonerError
from cartier.prompts import parse_list, parse_object, to_selection
from cartier.types import Selection

MAX_BYTES = 256 * 1024 * 1024


def make(path: str | Path) -> Replay:
    """``path`` holds one {"query": words, "reply": text} a line; the last line of a query counts."""
    return Replay(Path(path))


class Replay:
    """Replies are read exactly as the openai reasoner reads a server's."""

    def __init__(self, path: Path) -> None:
        self.name = f"replay {path.name}"
        self._path, self._replies = path, _read(path)

    def select(self, query: str, objects: Sequence[str], dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        reply = self._reply(query)
        return to_selection(parse_object(reply, objects), objects, reply=reply, model=self.name)

    def propose(self, query: str) -> list[str]:
        return parse_list(self._reply(query))

    def _reply(self, query: str) -> str:
        if query not in self._replies:
            raise ReasonerError(f"{self._path} holds no reply to “{query[:80]}”: record one, or ask another reasoner")
        return self._replies[query]


def _read(path: Path) -> dict[str, str]:
    replies: dict[str, str] = {}
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path} is larger than {MAX_BYTES // 2**20} MiB")
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text") from error
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
            replies[str(row["query"])] = str(row["reply"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f'{path} line {number}: expected {{"query": …, "reply": …}}') from error
    return replies
