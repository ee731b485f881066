"""What every language model has in common: the prompt, the check against the list, the cache and the totals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from cartier.language.prompts import Messages, Schema, check_query, prompt_named, propose_prompt
from cartier.language.replies import no_answer, parse_list, read_reply
from cartier.reasoners._cache import Cache, digest
from cartier.types import Inventory, Selection

PROPOSE_TOKENS = 256


class Engine(Protocol):
    """What runs a language model. ``identity`` (JSON values) tells apart what may answer differently."""

    name: str
    identity: Any
    calls: int
    tokens: int

    def complete(
        self, messages: Messages, schema: Schema | None, max_tokens: int, is_answer: Callable[[str], bool]
    ) -> str:
        """One raw reply, structured as well as the engine can. Raises ReasonerError if there is none."""
        ...


class LanguageModel:
    """A reasoner: one call per request, and none for what the cache holds.

    A reply that names nothing in the list is no answer: the person is asked to say it differently.
    """

    def __init__(self, engine: Engine, prompt: str, cache: str | Path | None) -> None:
        self.name = engine.name
        self._engine, self._prompt = engine, prompt_named(prompt)
        self._prompt_name = prompt
        self._cache = Cache(cache) if cache else None

    @property
    def calls(self) -> int:
        """How often the model was asked; what came from the cache does not count."""
        return self._engine.calls

    @property
    def tokens(self) -> int:
        """Tokens in all, of prompts and replies, as the engine counts them."""
        return self._engine.tokens

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The object that the model picks. Raises InputError for an unusable query, ReasonerError if nobody answers."""
        query, objects = check_query(query), inventory.names
        if not objects:
            return Selection("absent", reason="nothing was detected in this home", model=self.name)
        messages = self._prompt.messages(query, objects, dialogue)
        asked = "\n".join(f"{message['role']}: {message['content']}" for message in messages)

        def read(reply: str) -> Selection | None:
            return read_reply(reply, objects, model=self.name, prompt=asked)

        reply = self._reply(
            self._prompt_name, messages, self._prompt.schema(objects), self._prompt.max_tokens, lambda r: bool(read(r))
        )
        return read(reply) or no_answer(reply, model=self.name, prompt=asked)

    def propose(self, query: str) -> list[str]:
        """At most five names of things, the best first. Raises as ``select`` does."""
        messages = propose_prompt(check_query(query))
        return parse_list(self._reply("propose", messages, None, PROPOSE_TOKENS, lambda r: bool(parse_list(r))))

    def _reply(
        self, prompt: str, messages: Messages, schema: Schema | None, limit: int, is_answer: Callable[[str], bool]
    ) -> str:
        """The reply to these messages; only what is an answer is kept in the cache."""
        key = digest(self._engine.identity, prompt, messages, limit)
        reply = self._cache.get(key) if self._cache else None
        if reply is None:
            reply = self._engine.complete(messages, schema, limit, is_answer)
            if self._cache and is_answer(reply):
                self._cache.put(key, reply)
        return reply
