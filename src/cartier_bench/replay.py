"""Recorded replies of a model, from a JSON-lines file {"query": …, "reply": …} or from the output of a batch."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from cartier.errors import InputError, ReasonerError
from cartier.io.files import read_text
from cartier.llm.batch import answered
from cartier.llm.prompts import PROMPTS, Request, check_query, propose_request
from cartier.llm.reply_parser import no_answer, parse_list, read_reply
from cartier.types import Inventory, Selection

MAX_BYTES = 256 * 1024 * 1024
FORM = '{"query": "…", "reply": "…"}, or a line of a batch\'s output, {"custom_id": "…", "response": {…}}'
Key = tuple[str, frozenset[str] | None]


def make(path: str | Path) -> Replay:
    """``path`` holds one {"query": words, "reply": text} a line; the last line of a query counts.

    A line with "objects": [names] is the reply to that list alone. A query with such lines gets no reply to another
    list, and its line without "objects" is only the proposal made without a list. A line with "custom_id" comes from
    OpenAI's Batch API for the prompts of ``cartier bench … --write-prompts``: it is the reply to that very prompt and
    takes precedence. Raises InputError if the file is missing, too large, or has an invalid line.
    """
    return Replay(Path(path))


class Replay:
    """Replies are read exactly as the openai reasoner reads a server's."""

    def __init__(self, path: Path) -> None:
        self.name = f"replay {path.name}"
        self._path = path
        self._replies, self._batch = _read(path)
        self._to_lists = {query for query, objects in self._replies if objects is not None}

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """What the recorded reply picks from the list. Raises ReasonerError if none is recorded for the query."""
        query = check_query(query)
        if not inventory.names:
            return Selection("not_found", reason="nothing was detected in this home", model=self.name)
        objects = frozenset(inventory.names) if query in self._to_lists else None
        reply = self._reply(
            (query, objects), lambda: [prompt.request(query, inventory, dialogue) for prompt in PROMPTS.values()]
        )
        return read_reply(reply, inventory, model=self.name) or no_answer(reply, model=self.name)

    def propose(self, query: str) -> list[str]:
        """The names in the recorded reply. Raises ReasonerError if none is recorded for the query."""
        query = check_query(query)
        return parse_list(self._reply((query, None), lambda: [propose_request(query)]))

    def _reply(self, key: Key, requests: Callable[[], list[Request]]) -> str:
        for request in requests() if self._batch else []:
            if request.id in self._batch:
                return self._batch[request.id]
        if key in self._replies:
            return self._replies[key]
        raise ReasonerError(
            f"{self._path} holds no reply to “{key[0][:80]}”{' with this list' if key[1] else ''}: "
            "record one, or ask another reasoner"
        )


def _read(path: Path) -> tuple[dict[Key, str], dict[str, str]]:
    """The recorded replies, and those of a batch by their request ids."""
    replies: dict[Key, str] = {}
    batch: dict[str, str] = {}
    for number, line in enumerate(read_text(path, MAX_BYTES).split("\n"), start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
            if "custom_id" in row:
                batch |= answered(row)
                continue
            query, reply, objects = row["query"], row["reply"], row.get("objects")
            if not isinstance(query, str) or not isinstance(reply, str) or not isinstance(objects, list | None):
                raise TypeError("query and reply must be text, objects a list")
            replies[check_query(query), None if objects is None else frozenset(map(str, objects))] = reply
        except InputError as error:
            raise InputError(f"{path} line {number}: {error}") from error
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"{path} line {number}: expected {FORM}") from error
    return replies, batch
