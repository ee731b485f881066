"""Transport to OpenAI-compatible servers (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …), through the official SDK.

It serves language models (``reasoners/openai.py``) and vision models (``vision/openai.py``), which alone import it.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from email.utils import parsedate_to_datetime
from typing import Any
from urllib.parse import urlsplit

import openai

from cartier.errors import ReasonerError, brief
from cartier.llm import capabilities
from cartier.llm.client import server_asked, without_credentials
from cartier.llm.completion import parsed, read_completion
from cartier.llm.deadline import Late, within
from cartier.llm.network import proxy_to
from cartier.llm.prompts import Messages, Schema
from cartier.llm.structured_output import (
    LADDER,
    Form,
    NotUnderstood,
    Refused,
    form_of,
    remember_form,
    request_with_fallback,
)
from cartier.llm.transport import CutOff, OneServer

PAUSES_S = (0.5, 1.5)
BUSY = (408, 429, 503, 529)
"""Statuses that may pass with a retry."""

THINKING_OFF: dict[str, Any] = {"chat_template_kwargs": {"enable_thinking": False}, "reasoning_effort": "none"}
"""What switches thinking off: the first in vLLM and llama.cpp, the second in Ollama and at OpenAI."""

HINTS = {
    401: "the key is missing or wrong (OPENAI_API_KEY)",
    403: "this key may not use this model",
    404: "no such model or URL; try --model, and a base URL that ends in /v1",
    429: "too many requests, or no credit left",
}
"""Statuses that another form of the request does not mend."""


NO_REPLY = {
    "cut off": "broke off its answer: raise its limit of tokens, or switch its thinking off",
    "empty": "answered nothing",
    "declined": "declines to answer",
}
"""What a server did that answered without a whole reply."""


class NoReply(ReasonerError):
    """A server that answered without a whole reply: it is cut off, empty or declined."""


class _Failed(Exception):
    """A failure that a server tells of, in the status of its answer or in its body."""

    def __init__(self, status: int, said: str, retry_after: str | None = None) -> None:
        super().__init__(said)
        self.status, self.said, self.retry_after = status, said, retry_after


class Server:
    """An engine for a model behind a URL: one call per request, once the form that the server supports is known."""

    def __init__(
        self,
        model: str | None,
        base_url: str | None,
        api_key: str | None,
        timeout_s: float,
        temperature: float,
        extra: Mapping[str, Any] | None = None,
    ) -> None:
        """``extra``: members of each request's body beyond the SDK's; one that the server refuses is left out."""
        own = base_url or os.environ.get("OPENAI_BASE_URL")
        self._key = (api_key or os.environ.get("OPENAI_API_KEY") or ("none" if own else "")).strip()
        if not self._key:
            raise ReasonerError(
                "the openai reasoner needs OPENAI_API_KEY, or a server of your own in OPENAI_BASE_URL (--base-url)"
            )
        if not (self._key.isascii() and self._key.isprintable()):
            raise ReasonerError("the API key holds characters that no key has: copy it again (OPENAI_API_KEY)")
        if not timeout_s > 0:
            raise ReasonerError(f"timeout_s must be positive, got {timeout_s}")
        self.server, self.model = server_asked(model, base_url)
        self.where = without_credentials(self.server)
        self.proxy = proxy_to(self.server)
        self.way = f"{self.where} through {self.proxy}" if self.proxy else self.where
        """Where requests go, as it may be printed."""
        self.name = f"openai {self.model} @ {urlsplit(self.server).hostname}"
        self.timeout_s = timeout_s
        self._idle: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._idle.put(self._connected())
        self.identity = (self.server, self.model, {"temperature": temperature})
        self.calls = self.tokens = 0
        self._temperature = temperature
        self.thought = False
        """Whether any reply came with thoughts."""
        self._extra = dict(extra or {})
        self._refused: set[str] = set()

    def complete(
        self, messages: Messages, schema: Schema | None, max_tokens: int, is_answer: Callable[[str], bool]
    ) -> str:
        """One raw reply within ``timeout_s``. Raises ReasonerError if the server cannot be reached or refuses."""
        deadline = time.monotonic() + self.timeout_s
        try:
            if schema is None:
                return self._request(messages, max_tokens, {}, True, deadline)
            return request_with_fallback(
                self.server, self.model, schema,
                lambda form, sure: self._request(messages, max_tokens, form, sure, deadline), is_answer,
            )  # fmt: skip
        except NotUnderstood as error:
            raise error.error from error

    def once(self, messages: Messages, schema: Schema, max_tokens: int) -> str:
        """The raw reply to one request that is never repeated, in the form that has worked, else the strictest."""
        form = LADDER[form_of(self.server, self.model) or "json_schema"](schema)
        try:
            return self._request(messages, max_tokens, form, True, time.monotonic() + self.timeout_s, repeats=False)
        except NotUnderstood as error:
            raise error.error from error

    def as_checked(self) -> capabilities.Capabilities | None:
        """Begin with what ``cartier check-model`` found out; returns it, or None if it was never run."""
        found = capabilities.known(self.where, self.model)
        if found is not None:
            self._refused |= set(found.leaves_out or ())
            if found.form is not None:
                remember_form(self.server, self.model, found.form)
        return found

    @property
    def leaves_out(self) -> tuple[str, ...]:
        """Members of a request that the server has refused."""
        return tuple(sorted(self._refused))

    def _request(
        self, messages: Messages, max_tokens: int, form: Form, sure: bool, deadline: float, repeats: bool = True
    ) -> str:
        """The text of one reply, with retries where a fault may pass. ``sure`` says that the form is not at fault.

        Raises ReasonerError, or NotUnderstood where another form may succeed.
        """
        asked = {"model": self.model, "messages": messages}
        options = {"temperature": self._temperature, "max_tokens": max_tokens}
        pauses = list(PAUSES_S) if repeats else []
        while True:
            kept = {name: value for name, value in options.items() if name not in self._refused}
            extra = {name: value for name, value in self._extra.items() if name not in self._refused}
            body = {"extra_body": {**extra, **form.get("extra_body", {})}} if extra else {}
            try:
                return self._exchange({**asked, **kept, **form, **body}, deadline)
            except openai.APITimeoutError as error:
                raise self._too_late() from error
            except openai.APIConnectionError as error:
                if not (sure and _paused(pauses, deadline)):
                    raise ReasonerError(
                        f"cannot reach {self.way} ({self.brief(error.__cause__ or error)}): is the server running?"
                    ) from error
            except UnicodeError as error:  # a name that no host can have, by the codec of names
                raise ReasonerError(f"cannot reach {self.way} ({self.brief(error)}): is its URL right?") from error
            except _Failed as failed:
                status = failed.status
                refused = {name for name in (*kept, *extra) if name in failed.said} if status in (400, 422) else set()
                passing = status in BUSY or (sure and status >= 500)
                self._refused |= refused  # some models take no temperature, or another name for the limit
                told = f"{self.where} answered {status}: {HINTS.get(status) or self.brief(failed.said)}"
                if (refused and repeats) or (passing and _paused(pauses, deadline, failed.retry_after)):
                    continue
                if passing or status in HINTS:
                    raise ReasonerError(told) from failed
                raise NotUnderstood(Refused(told)) from failed
            except CutOff:
                if not _paused(pauses, deadline):
                    raise

    def _exchange(self, asked: dict[str, Any], deadline: float) -> str:
        """One HTTP request that ends at the deadline, however slow the server is."""
        self.calls += 1
        left_s = max(0.001, deadline - time.monotonic())
        with self._client() as client:
            ask = client.chat.completions.with_raw_response.create
            try:
                body = within(left_s, lambda: ask(**asked, timeout=left_s).http_response.content)
            except Late as late:
                client.close()  # closing the connection ends the exchange
                raise self._too_late() from late
            except openai.APIStatusError as error:
                raise _Failed(error.status_code, _said(error), error.response.headers.get("retry-after")) from error
            except openai.APIConnectionError as error:
                if isinstance(error.__cause__, ReasonerError):  # older SDKs wrap what their transport raises
                    raise error.__cause__ from None
                raise
        return self._text(body)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """The SDK's client with its open connection, for one request at a time."""
        try:
            client = self._idle.get_nowait()
        except queue.Empty:
            client = self._connected()
        try:
            yield client
        finally:
            if not client.is_closed():
                self._idle.put(client)

    def _connected(self) -> Any:
        """A client of the SDK. Raises ReasonerError where the environment names what it cannot use."""
        try:
            return openai.OpenAI(
                api_key=self._key, base_url=self.server, timeout=self.timeout_s, max_retries=0,
                http_client=OneServer(self.server, self.where, self.proxy, self.timeout_s, self.brief),
                default_headers={"Accept-Encoding": "identity"},  # so that a small reply cannot unpack to a huge one
            )  # fmt: skip
        except ReasonerError:
            raise
        except Exception as error:  # ValueError, ImportError and more, by the kind of proxy
            mend = f"{self.proxy} cannot be used: mend or unset it" if self.proxy else "is its URL right?"
            raise ReasonerError(f"cannot connect to {self.where} ({self.brief(error)}): {mend}") from error

    def _text(self, body: bytes) -> str:
        """The text of a whole reply. Raises _Failed, NoReply, or NotUnderstood where another form may have one."""
        try:
            reply = read_completion(parsed(body))
        except (ValueError, RecursionError) as error:
            begin = self.brief(body[:200].decode(errors="replace"))
            raise ReasonerError(
                f"{self.where} answered something that is no chat completion: {begin!r}; does the base URL end in /v1?"
            ) from error
        self.tokens += reply.tokens
        self.thought |= reply.thought
        if reply.ended == "whole":
            return reply.text
        if reply.ended == "failed":
            raise _Failed(reply.status, reply.said)
        said = f" ({self.brief(reply.said)})" if reply.said else ""
        fault = NoReply(f"{self.where} {NO_REPLY[reply.ended]}{said}")
        raise NotUnderstood(fault) if reply.ended == "empty" else fault

    def _too_late(self) -> ReasonerError:
        return ReasonerError(
            f"{self.where} did not answer within {self.timeout_s:g} s: is the model loaded? (or raise timeout_s)"
        )

    def brief(self, fault: object) -> str:
        """One short printable line that does not hold the key, even where the server repeats it."""
        text = str(fault).strip() or type(fault).__name__
        return brief(text.replace(self._key, "…") if self._key != "none" else text, 160)


def seconds_of(retry_after: str | None) -> float:
    """The seconds to wait that a header names by a number or a date; 0 for what is neither."""
    try:
        return float(retry_after or 0)
    except ValueError:
        pass
    try:
        return parsedate_to_datetime(retry_after or "").timestamp() - time.time()
    except (ValueError, OverflowError):
        return 0.0


def _said(error: openai.APIStatusError) -> str:
    """What a server says of its refusal: newer SDKs print an ``error.message`` only, and FastAPI has a ``detail``."""
    text, body = str(error), error.body
    if not body or text != f"Error code: {error.status_code}":
        return text
    return f"{text} - {body.get('detail', body) if isinstance(body, dict) else body}"


def _paused(pauses_s: list[float], deadline: float, retry_after: str | None = None) -> bool:
    """Wait before the next retry, as long as the server asks for; False if no retry or no time is left."""
    if not pauses_s:
        return False
    pause = max(pauses_s.pop(0), seconds_of(retry_after))
    if time.monotonic() + pause >= deadline:
        return False
    time.sleep(pause)
    return True
