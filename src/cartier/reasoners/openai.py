"""Any OpenAI-compatible server (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …) through the official SDK."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import openai

from cartier.errors import ReasonerError
from cartier.prompts import (
    Messages,
    cartier_prompt,
    check_query,
    choice_schema,
    parse_list,
    parse_object,
    propose_prompt,
    to_selection,
)
from cartier.reasoners._cache import Cache, digest
from cartier.types import Selection

EXTRA = "llm"
DEFAULT_MODEL = "gpt-4o"
MAX_TOKENS = 256  # some grammars allow white space without end
MAX_REPLY_BYTES = 2**20
PAUSES_S = (0.5, 1.5)
_works: dict[tuple[str, str], str] = {}  # (server, model) → the first way of asking that it honoured

HINTS = {
    401: "the key is missing or wrong (OPENAI_API_KEY)",
    403: "this key may not use this model",
    404: "no such model or URL; try --model, and a base URL that ends in /v1",
    429: "too many requests, or no credit left",
}
"""Statuses that asking in another form does not mend."""


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
        base_url = base_url or os.environ.get("OPENAI_BASE_URL") or None
        self._key = (api_key or os.environ.get("OPENAI_API_KEY") or ("none" if base_url else "")).strip()
        if not self._key:
            raise ReasonerError(
                "the openai reasoner needs OPENAI_API_KEY, or a server of your own in OPENAI_BASE_URL (--base-url)"
            )
        if not (self._key.isascii() and self._key.isprintable()):
            raise ReasonerError("the API key holds characters that no key has: copy it again (OPENAI_API_KEY)")
        if not timeout_s > 0:
            raise ReasonerError(f"timeout_s must be positive, got {timeout_s}")
        self.server = base_url or "https://api.openai.com/v1"
        self.where = _without_credentials(self.server)
        self.client = openai.OpenAI(
            api_key=self._key,
            base_url=self.server,
            timeout=timeout_s,
            max_retries=0,
            default_headers={"Accept-Encoding": "identity"},  # so that a small reply cannot unpack to a huge one
        )
        self.model = model or os.environ.get("OPENAI_MODEL") or DEFAULT_MODEL
        self.name = f"openai {self.model} @ {urlsplit(self.server).hostname}"
        self.timeout_s = timeout_s
        self._options: dict[str, Any] = {"temperature": temperature, "max_tokens": MAX_TOKENS}
        self._refused: set[str] = set()
        self._cache = Cache(cache) if cache else None

    def select(self, query: str, objects: Sequence[str], dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The object that the model picks. Raises ReasonerError if the server cannot be reached or refuses."""
        query = check_query(query)
        if not objects:
            return Selection("absent", reason="nothing was detected in this home", model=self.name)
        messages = cartier_prompt(query, objects, dialogue)
        key = digest(self.server, self.model, messages, self._options)
        reply = self._cache.get(key) if self._cache else None
        if reply is None:
            reply = self._choose(messages, objects)
        chosen = parse_object(reply, objects)
        if chosen is not None and self._cache:
            self._cache.put(key, reply)
        prompt = "\n".join(f"{message['role']}: {message['content']}" for message in messages)
        return to_selection(chosen, objects, reply=reply, model=self.name, prompt=prompt)

    def propose(self, query: str) -> list[str]:
        """At most five names of things, the best first. Raises ReasonerError as ``select`` does."""
        messages = propose_prompt(check_query(query))
        key = digest(self.server, self.model, messages, self._options)
        reply = self._cache.get(key) if self._cache else None
        if reply is None:
            try:
                reply = self._request(messages, {}, PAUSES_S)
            except openai.APIStatusError as error:
                raise self._refusal(error) from error
            if self._cache:
                self._cache.put(key, reply)
        return parse_list(reply)

    def _choose(self, messages: Messages, objects: Sequence[str]) -> str:
        """The raw reply of the first form of asking that brings a listed name, else of the last one that was tried."""
        schema, key = choice_schema(objects), (self.server, self.model)
        known, reply = _works.get(key), ""
        refusal: openai.APIStatusError | None = None
        for mode in dict.fromkeys([*([known] if known else []), *LADDER]):
            try:
                reply = self._request(messages, LADDER[mode](schema), PAUSES_S if mode == known else ())
            except openai.APIStatusError as error:
                refusal = error  # perhaps the server does not know this form
                continue
            refusal = None
            if parse_object(reply, objects) is not None:
                _works[key] = mode
                break
            if mode == known:
                break  # a form that has worked: this reply is rubbish, not the form
        if refusal is not None:
            raise self._refusal(refusal) from refusal
        return reply

    def _request(self, messages: Messages, form: dict[str, Any], pauses_s: Sequence[float]) -> str:
        """The text of one reply, all within ``timeout_s``; ``pauses_s`` before each repetition of what may pass.

        Raises ReasonerError, or APIStatusError where another form of asking may be understood.
        """
        deadline, pauses = time.monotonic() + self.timeout_s, list(pauses_s)
        while True:
            options = {name: value for name, value in self._options.items() if name not in self._refused}
            try:
                return self._exchange({"model": self.model, "messages": messages, **options, **form}, deadline)
            except openai.APITimeoutError as error:
                raise self._too_late() from error
            except (openai.APIConnectionError, openai.APIStatusError) as error:
                status = getattr(error, "status_code", None)
                refused = {name for name in options if name in str(error)} if status in (400, 422) else set()
                passing = status is None or status in (408, 429) or status >= 500
                if refused:  # some models take no temperature, or another name for the limit
                    self._refused |= refused
                elif passing and pauses and time.monotonic() + pauses[0] < deadline:
                    time.sleep(pauses.pop(0))
                elif isinstance(error, openai.APIConnectionError):
                    raise ReasonerError(
                        f"cannot reach {self.where} ({self._brief(error.__cause__ or error)}): is the server running?"
                    ) from error
                elif status in HINTS:
                    raise self._refusal(error) from error
                else:
                    raise

    def _exchange(self, asked: dict[str, Any], deadline: float) -> str:
        """One request over the wire, bounded in time and size however the server dawdles."""
        body = bytearray()
        try:
            with self.client.chat.completions.with_streaming_response.create(
                **asked, timeout=max(0.001, deadline - time.monotonic())
            ) as response:
                for chunk in response.iter_bytes():
                    body += chunk
                    if len(body) > MAX_REPLY_BYTES:
                        raise ReasonerError(
                            f"{self.where} answered more than {MAX_REPLY_BYTES} bytes: is it a language model?"
                        )
                    if time.monotonic() > deadline:
                        raise self._too_late()
        except (openai.OpenAIError, ReasonerError):
            raise
        except Exception as error:  # while a body is read the SDK lets the errors of its transport through
            if not type(error).__module__.startswith("httpx"):
                raise
            if time.monotonic() >= deadline or "Timeout" in type(error).__name__:
                raise self._too_late() from error
            raise ReasonerError(
                f"{self.where} broke off in the middle of its answer ({self._brief(error)}): ask again"
            ) from error
        return self._text(bytes(body))

    def _text(self, body: bytes) -> str:
        try:
            message = json.loads(body)["choices"][0]["message"]
            calls = message.get("tool_calls")
            return str(calls[0]["function"]["arguments"] if calls else message.get("content") or "")
        except (ValueError, RecursionError, LookupError, TypeError, AttributeError) as error:
            begin = self._brief(body[:200].decode(errors="replace"))
            raise ReasonerError(
                f"{self.where} answered something that is no chat completion: {begin!r}; does the base URL end in /v1?"
            ) from error

    def _refusal(self, error: openai.APIStatusError) -> ReasonerError:
        status = error.status_code
        return ReasonerError(f"{self.where} answered {status}: {HINTS.get(status) or self._brief(error)}")

    def _too_late(self) -> ReasonerError:
        return ReasonerError(
            f"{self.where} did not answer within {self.timeout_s:g} s: is the model loaded? (or raise timeout_s)"
        )

    def _brief(self, fault: object) -> str:
        """One short printable line that does not hold the key, even where the server repeats it."""
        text = str(fault).strip() or type(fault).__name__
        text = text.replace(self._key, "…") if self._key != "none" else text
        return "".join(c if c.isprintable() else " " for c in text)[:160]


def _without_credentials(url: str) -> str:
    """A base URL as it may be printed: without a user, a password or a query. Raises ReasonerError if it is no URL."""
    try:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("it must begin with http:// or https://")
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    except ValueError as error:
        raise ReasonerError(f"the base URL is not usable ({error}); an example is http://127.0.0.1:11434/v1") from error
