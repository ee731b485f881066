"""Recorded replies from a JSON-lines file, {"query": …, "reply": …}: a model's answers without the model."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from cartier.errors import InputError, ReasonerError
from cartier.files import read_text
from cartier.language.prompts import check_query
from cartier.language.replies import no_answer, parse_list, read_reply
from cartier.types import Inventory, Selection

MAX_BYTES = 256 * 1024 * 1024
Key = tuple[str, frozenset[str] | None]


def make(path: str | Path) -> Replay:
    """``path`` holds one {"query": words, "reply": text} a line; the last line of a query counts.

    A line that also has "objects": [names] is the reply to that list alone, and comes before one for any list.
    Raises InputError if the file is missing, too large, or has a line that is not of this form.
    """
    return Replay(Path(path))


class Replay:
    """Replies are read exactly as the openai reasoner reads a server's."""

    def __init__(self, path: Path) -> None:
        self.name = f"replay {path.name}"
        self._path, self._replies = path, _read(path)

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """What the recorded reply picks from the list. Raises ReasonerError if none is recorded for the query."""
        query = check_query(query)
        objects = inventory.names
        if not objects:
            return Selection("absent", reason="nothing was detected in this home", model=self.name)
        reply = self._reply(query, (frozenset(objects), None))
        return read_reply(reply, objects, model=self.name) or no_answer(reply, model=self.name)

    def propose(self, query: str) -> list[str]:
        """The names in the recorded reply. Raises ReasonerError if none is recorded for the query."""
        return parse_list(self._reply(check_query(query), (None,)))

    def _reply(self, query: str, lists: Sequence[frozenset[str] | None]) -> str:
        for objects in lists:
            if (query, objects) in self._replies:
                return self._replies[query, objects]
        raise ReasonerError(f"{self._path} holds no reply to “{query[:80]}”: record one, or ask another reasoner")


def _read(path: Path) -> dict[Key, str]:
    replies: dict[Key, str] = {}
    for number, line in enumerate(read_text(path, MAX_BYTES).split("\n"), start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
            query, reply, objects = row["query"], row["reply"], row.get("objects")
            if not isinstance(query, str) or not isinstance(reply, str) or not isinstance(objects, list | None):
                raise TypeError("query and reply must be text, objects a list")
            replies[check_query(query), None if objects is None else frozenset(map(str, objects))] = reply
        except InputError as error:
            raise InputError(f"{path} line {number}: {error}") from error
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f'{path} line {number}: expected {{"query": "…", "reply": "…"}}') from error
    return replies
