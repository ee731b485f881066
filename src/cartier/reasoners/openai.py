"""Any OpenAI-compatible server (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …) through the official SDK."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import openai

from cartier.errors import ReasonerError
from cartier.prompts import (
    Messages,
    cartier_prompt,
    choice_schema,
    parse_list,
    parse_object,
    propose_prompt,
    to_selection,
)
from cartier.types import Selection

EXTRA = "llm"
DEFAULT_MODEL = "gpt-4o"
MAX_TOKENS = 256  # some grammars allow white space without end
FINAL = (401, 403, 404, 429)  # asking in another way does not mend these
_works: dict[tuple[str, str], str] = {}  # (server, model) → the first way of asking that it honoured


def make(
    model: str | None = None,
    base_url: str | None = None,
    api_key: str | None = None,
    timeout_s: float = 30.0,
    temperature: float = 0.0,
    cache: str | Path | None = None,
) -> OpenAIReasoner:
    """``OPENAI_API_KEY`` and ``OPENAI_BASE_URL`` are read; a server of one's own needs no key. ``cache`` is an SQLite file."""
    return OpenAIReasoner(model, base_url, api_key, timeout_s, temperature, cache)


def _json_schema(schema: dict[str, Any]) -> dict[str, Any]:
    return {
        "response_format": {"type": "json_schema", "json_schema": {"name": "choice", "strict": True, "schema": schema}}
    }


def _json_object(schema: dict[str, Any]) -> dict[str, Any]:
    return {"extra_body": {"response_format": {"type": "json_object", "schema": schema}}}


def _tool(schema: dict[str, Any]) -> dict[str, Any]:
    function = {"name": "go_to", "description": "Drive to an object.", "parameters": schema}
    return {
        "tools": [{"type": "function", "function": function}],
        "tool_choice": {"type": "function", "function": {"name": "go_to"}},
    }


LADDER: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "json_schema": _json_schema,
    "json_object": _json_object,
    "tool": _tool,
    "text": lambda schema: {},
}


class OpenAIReasoner:
    """One call per request, once it is known which form of structured output the server honours.

    The forms are tried from the strictest to free text; whatever comes back is checked against the list on our side.
    A reply that names nothing in the list is no answer: the person is asked to say it differently.
    """

    def __init__(
        self,
        model: str | None,
        base_url: str | None,
        api_key: str | None,
        timeout_s: float,
        temperature: float,
        cache: str | Path | None,
    ) -> None:
        base_url = base_url or os.environ.get("OPENAI_BASE_URL")
        api_key = api_key or os.environ.get("OPENAI_API_KEY") or ("none" if base_url else None)
        if api_key is None:
            raise ReasonerError(
                "the openai reasoner needs OPENAI_API_KEY, or a server of your own in OPENAI_BASE_URL (--base-url)"
            )
        if base_url is not None and urlsplit(base_url).scheme not in ("http", "https"):
            raise ReasonerError(f"base URL {base_url!r} must begin with http:// or https://")
        self.client = openai.OpenAI(api_key=api_key, base_url=base_url, timeout=timeout_s)
        self.model = model or os.environ.get("OPENAI_MODEL") or DEFAULT_MODEL
        self.server = str(self.client.base_url)
        self.name = f"openai {self.model} @ {urlsplit(self.server).hostname}"
        self.timeout_s = timeout_s
        self._options: dict[str, Any] = {"temperature": temperature, "max_tokens": MAX_TOKENS}
        self._cache = _Cache(cache) if cache else None

    def select(self, query: str, objects: Sequence[str], dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The object that the model picks. Raises ReasonerError if the server cannot be reached or refuses."""
        if not objects:
            return Selection("absent", reason="nothing was detected in this home", model=self.name)
        messages = cartier_prompt(query, objects, dialogue)
        chosen, reply = self._choose(messages, objects)
        prompt = "\n".join(f"{message['role']}: {message['content']}" for message in messages)
        return to_selection(chosen, objects, reply=reply, model=self.name, prompt=prompt)

    def propose(self, query: str) -> list[str]:
        return parse_list(self._call(propose_prompt(query), {}, retries=2))

    def _choose(self, messages: Messages, objects: Sequence[str]) -> tuple[str | None, str]:
        """The parsed choice and the raw reply, by the first form of asking that brings a listed name."""
        schema, key = choice_schema(objects), (self.server, self.model)
        known, reply = _works.get(key), ""
        for mode in dict.fromkeys([*([known] if known else []), *LADDER]):
            try:
                reply = self._call(messages, LADDER[mode](schema), retries=2 if mode in (known, "text") else 0)
            except openai.APIStatusError as error:
                if mode == "text":
                    raise ReasonerError(f"{self.server} answered {error.status_code}: {_brief(error)}") from error
                continue  # the server does not know this form
            chosen = parse_object(reply, objects)
            if chosen is not None:
                _works[key] = mode
                return chosen, reply
            if mode == known:
                break  # a form that has worked: this reply is rubbish, not the form
        return None, reply

    def _call(self, messages: Messages, form: dict[str, Any], retries: int) -> str:
        key = _digest(self.server, self.model, messages, form, self._options)
        if self._cache and (kept := self._cache.get(key)) is not None:
            return kept
        reply = self._request(messages, form, retries)
        if self._cache:
            self._cache.put(key, reply)
        return reply

    def _request(self, messages: Messages, form: dict[str, Any], retries: int) -> str:
        create: Any = self.client.with_options(max_retries=retries).chat.completions.create
        try:
            try:
                done = create(model=self.model, messages=messages, **self._options, **form)
            except openai.BadRequestError as error:
                refused = [name for name in self._options if name in str(error)]
                if not refused:
                    raise
                for name in refused:  # some models take no temperature, or another name for the limit
                    del self._options[name]
                done = create(model=self.model, messages=messages, **self._options, **form)
            message = done.choices[0].message
            calls = message.tool_calls or []
            return str(calls[0].function.arguments if calls else message.content or "")
        except openai.APITimeoutError as error:
            raise ReasonerError(
                f"{self.server} did not answer within {self.timeout_s:g} s: is the model loaded? (or raise timeout_s)"
            ) from error
        except openai.APIConnectionError as error:
            raise ReasonerError(f"cannot reach {self.server} ({_brief(error)}): is the server running?") from error
        except openai.APIStatusError as error:
            if error.status_code in FINAL:
                raise ReasonerError(
                    f"{self.server} answered {error.status_code}: {_hint(error.status_code)}"
                ) from error
            raise
        except (openai.OpenAIError, ValueError, TypeError, AttributeError, IndexError) as error:
            raise ReasonerError(
                f"{self.server} answered something that is no chat completion ({_brief(error)})"
            ) from error


def _hint(status: int) -> str:
    return {
        401: "the key is missing or wrong (OPENAI_API_KEY)",
        403: "this key may not use this model",
        404: "no such model or URL; try --model, and a base URL that ends in /v1",
        429: "too many requests, or no credit left",
    }[status]


def _brief(error: Exception) -> str:
    cause = error.__cause__ or error
    return (str(cause).strip() or type(cause).__name__).splitlines()[0][:160]


def _digest(*parts: Any) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class _Cache:
    """Replies by what was asked, in one SQLite file."""

    def __init__(self, file: str | Path) -> None:
        try:
            self._rows = sqlite3.connect(file, isolation_level=None)
            self._rows.execute("create table if not exists replies(key text primary key, reply text)")
        except sqlite3.Error as error:
            raise ReasonerError(f"cannot use {file} as a cache of replies: {error}") from error

    def get(self, key: str) -> str | None:
        row = self._rows.execute("select reply from replies where key = ?", (key,)).fetchone()
        return None if row is None else str(row[0])

    def put(self, key: str, reply: str) -> None:
        self._rows.execute("insert or replace into replies values (?, ?)", (key, reply))
