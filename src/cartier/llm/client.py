"""Language-model reasoner: what all engines share, namely prompt, check against the list, cache and totals."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from cartier.errors import ReasonerError
from cartier.llm.cache import Cache, digest
from cartier.llm.prompts import Messages, Request, Schema, check_query, prompt_named, propose_request
from cartier.llm.reply_parser import no_answer, parse_list, read_reply
from cartier.types import Inventory, Selection

MAX_SAID = 300  # characters of a sentence that are kept with its rules
DEFAULT_SERVER, DEFAULT_MODEL = "https://api.openai.com/v1", "gpt-4o"


def server_asked(model: str | None = None, base_url: str | None = None) -> tuple[str, str]:
    """The server's URL and the model's name: as given, else OPENAI_BASE_URL and OPENAI_MODEL, else OpenAI's own."""
    server = base_url or os.environ.get("OPENAI_BASE_URL") or DEFAULT_SERVER
    return server, model or os.environ.get("OPENAI_MODEL") or DEFAULT_MODEL


def without_credentials(url: str) -> str:
    """A base URL as it may be printed: without a user, a password or a query. Raises ReasonerError if it is no URL."""
    try:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("it must begin with http:// or https://")
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    except ValueError as error:
        raise ReasonerError(f"the base URL is not usable ({error}); an example is http://127.0.0.1:11434/v1") from error


class Engine(Protocol):
    """An engine that runs a language model. ``identity`` (JSON) separates engines that may answer differently."""

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
    """A reasoner with one call per request, and none for requests in the cache.

    A reply that names nothing in the list is no answer: the person is asked to rephrase.
    """

    def __init__(self, engine: Engine, prompt: str, cache: str | Path | None) -> None:
        self.name = engine.name
        self._engine, self._prompt = engine, prompt_named(prompt)
        self._prompt_name = prompt
        self._cache = Cache(cache) if cache else None

    @property
    def calls(self) -> int:
        """How often the model was asked; replies from the cache do not count."""
        return self._engine.calls

    @property
    def tokens(self) -> int:
        """Tokens in all, of prompts and replies, as the engine counts them."""
        return self._engine.tokens

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The object that the model picks. Raises InputError for an unusable query, ReasonerError without a reply."""
        query = check_query(query)
        if not inventory.names:
            return Selection("not_found", reason="nothing was detected in this home", model=self.name)
        request = self._prompt.request(query, inventory, dialogue)

        def read(reply: str) -> Selection | None:
            chosen = read_reply(reply, inventory, model=self.name, prompt=request.text)
            if chosen is None or not chosen.rules:
                return chosen
            return replace(chosen, rules=tuple(replace(rule, said=query[:MAX_SAID]) for rule in chosen.rules))

        reply = self._reply(self._prompt_name, request, lambda r: bool(read(r)))
        return read(reply) or no_answer(reply, model=self.name, prompt=request.text)

    def propose(self, query: str) -> list[str]:
        """At most five names of objects, the best first. Raises as ``select`` does."""
        return parse_list(self._reply("propose", propose_request(check_query(query)), lambda r: bool(parse_list(r))))

    def _reply(self, prompt: str, request: Request, is_answer: Callable[[str], bool]) -> str:
        """The reply to a request; the cache keeps only replies that are answers."""
        key = digest(self._engine.identity, prompt, request.messages, request.max_tokens)
        reply = self._cache.get(key) if self._cache else None
        if reply is None:
            reply = self._engine.complete(request.messages, request.schema, request.max_tokens, is_answer)
            if self._cache and is_answer(reply):
                self._cache.put(key, reply)
        return reply
