"""Any OpenAI-compatible server (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …) through the official SDK."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import openai

from cartier.errors import ReasonerError
from cartier.language.prompts import Messages, Schema
from cartier.reasoners._asking import LanguageModel
from cartier.reasoners._ladder import Form, NotUnderstood, climb

EXTRA = "llm"
DEFAULT_MODEL = "gpt-4o"
MAX_REPLY_BYTES = 2**20
PAUSES_S = (0.5, 1.5)
BUSY = (408, 429, 503, 529)
"""Statuses that pass, whatever was asked for."""

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
    prompt: str = "rich",
    timeout_s: float = 30.0,
    temperature: float = 0.0,
    cache: str | Path | None = None,
) -> LanguageModel:
    """``OPENAI_API_KEY``, ``OPENAI_BASE_URL`` and ``OPENAI_MODEL`` are read; a server of one's own needs no key.

    ``prompt`` is one of cartier.language.prompts.PROMPTS, ``cache`` an SQLite file, ``timeout_s`` the limit for one request in all.
    """
    return LanguageModel(Server(model, base_url, api_key, timeout_s, temperature), prompt, cache)


class CutOff(ReasonerError):
    """A connection that ended in the middle of an answer."""


class Server:
    """An engine for ``LanguageModel``: one call per request, once it is known which form of asking the server honours."""

    def __init__(
        self, model: str | None, base_url: str | None, api_key: str | None, timeout_s: float, temperature: float
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
        self.identity = (self.server, self.model, {"temperature": temperature})
        self.calls = self.tokens = 0
        self._temperature = temperature
        self._refused: set[str] = set()

    def complete(
        self, messages: Messages, schema: Schema | None, max_tokens: int, is_answer: Callable[[str], bool]
    ) -> str:
        """One raw reply, all within ``timeout_s``. Raises ReasonerError if the server cannot be reached or refuses."""
        deadline = time.monotonic() + self.timeout_s
        options = {"temperature": self._temperature, "max_tokens": max_tokens}
        asked = {"model": self.model, "messages": messages}
        try:
            if schema is None:
                return self._request(asked, options, {}, True, deadline)
            return climb(
                self.server, self.model, schema,
                lambda form, sure: self._request(asked, options, form, sure, deadline), is_answer,
            )  # fmt: skip
        except NotUnderstood as error:
            raise error.error from error

    def _request(self, asked: dict[str, Any], options: dict[str, Any], form: Form, sure: bool, deadline: float) -> str:
        """The text of one reply, asked for again where a fault may pass. ``sure`` says that the form is not at fault.

        Raises ReasonerError, or NotUnderstood where another form may be understood.
        """
        pauses = list(PAUSES_S)
        while True:
            kept = {name: value for name, value in options.items() if name not in self._refused}
            try:
                return self._exchange({**asked, **kept, **form}, deadline)
            except openai.APITimeoutError as error:
                raise self._too_late() from error
            except openai.APIConnectionError as error:
                if not (sure and _paused(pauses, deadline)):
                    raise ReasonerError(
                        f"cannot reach {self.where} ({self._brief(error.__cause__ or error)}): is the server running?"
                    ) from error
            except openai.APIStatusError as error:
                status = error.status_code
                refused = {name for name in kept if name in str(error)} if status in (400, 422) else set()
                passing = status in BUSY or (sure and status >= 500)
                if refused:  # some models take no temperature, or another name for the limit
                    self._refused |= refused
                elif passing and _paused(pauses, deadline, error.response.headers.get("retry-after")):
                    pass
                elif passing or status in HINTS:
                    raise self._refusal(error) from error
                else:
                    raise NotUnderstood(self._refusal(error)) from error
            except CutOff:
                if not _paused(pauses, deadline):
                    raise

    def _exchange(self, asked: dict[str, Any], deadline: float) -> str:
        """One request over the wire, bounded in time and size however the server dawdles."""
        body = bytearray()
        self.calls += 1
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
            raise CutOff(
                f"{self.where} broke off in the middle of its answer ({self._brief(error)}): ask again"
            ) from error
        return self._text(bytes(body))

    def _text(self, body: bytes) -> str:
        try:
            reply = json.loads(body)
            message = reply["choices"][0]["message"]
            calls = message.get("tool_calls")
            text = str(calls[0]["function"]["arguments"] if calls else message.get("content") or "")
        except (ValueError, RecursionError, LookupError, TypeError, AttributeError) as error:
            begin = self._brief(body[:200].decode(errors="replace"))
            raise ReasonerError(
                f"{self.where} answered something that is no chat completion: {begin!r}; does the base URL end in /v1?"
            ) from error
        used = usage.get("total_tokens") if isinstance(usage := reply.get("usage"), dict) else None
        self.tokens += used if isinstance(used, int) and 0 < used < MAX_REPLY_BYTES else 0
        return text

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


def _paused(pauses_s: list[float], deadline: float, retry_after: str | None = None) -> bool:
    """Wait as long as it is the turn to, or as the server asks for; False if there is no turn or no time left."""
    if not pauses_s:
        return False
    try:
        pause = max(pauses_s.pop(0), float(retry_after or 0))
    except ValueError:  # a date
        return False
    if time.monotonic() + pause >= deadline:
        return False
    time.sleep(pause)
    return True


def _without_credentials(url: str) -> str:
    """A base URL as it may be printed: without a user, a password or a query. Raises ReasonerError if it is no URL."""
    try:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("it must begin with http:// or https://")
        return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    except ValueError as error:
        raise ReasonerError(f"the base URL is not usable ({error}); an example is http://127.0.0.1:11434/v1") from error
