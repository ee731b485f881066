"""Transport to OpenAI-compatible servers (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …), through the official SDK.

It serves language models (``reasoners/openai.py``) and vision models (``vision/openai.py``), which alone import it.
"""

from __future__ import annotations

import json
import os
import queue
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urljoin, urlsplit

import openai

from cartier.errors import ReasonerError, brief
from cartier.llm.client import server_asked, without_credentials
from cartier.llm.deadline import Late, within
from cartier.llm.prompts import Messages, Schema
from cartier.llm.structured_output import Form, NotUnderstood, Refused, request_with_fallback

MAX_REPLY_BYTES = 2**20
PAUSES_S = (0.5, 1.5)
KEPT_HEADERS = ("content-type", "retry-after")
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


class CutOff(ReasonerError):
    """A connection that ended in the middle of an answer."""


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
        options = {"temperature": self._temperature, "max_tokens": max_tokens}
        asked = {"model": self.model, "messages": messages}
        try:
            if schema is None:
                return self._request(asked, options, {}, True, deadline)
            return request_with_fallback(
                self.server, self.model, schema,
                lambda form, sure: self._request(asked, options, form, sure, deadline), is_answer,
            )  # fmt: skip
        except NotUnderstood as error:
            raise error.error from error

    def _request(self, asked: dict[str, Any], options: dict[str, Any], form: Form, sure: bool, deadline: float) -> str:
        """The text of one reply, with retries where a fault may pass. ``sure`` says that the form is not at fault.

        Raises ReasonerError, or NotUnderstood where another form may succeed.
        """
        pauses = list(PAUSES_S)
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
                        f"cannot reach {self.where} ({self.brief(error.__cause__ or error)}): is the server running?"
                    ) from error
            except openai.APIStatusError as error:
                status = error.status_code
                refused = {name for name in (*kept, *extra) if name in _said(error)} if status in (400, 422) else set()
                passing = status in BUSY or (sure and status >= 500)
                if refused:  # some models take no temperature, or another name for the limit
                    self._refused |= refused
                elif passing and _paused(pauses, deadline, error.response.headers.get("retry-after")):
                    pass
                elif passing or status in HINTS:
                    raise self._refusal(error) from error
                else:
                    raise NotUnderstood(Refused(str(self._refusal(error)))) from error
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
        return openai.OpenAI(
            api_key=self._key, base_url=self.server, timeout=self.timeout_s, max_retries=0,
            http_client=_OneServer(self),
            default_headers={"Accept-Encoding": "identity"},  # so that a small reply cannot unpack to a huge one
        )  # fmt: skip

    def _text(self, body: bytes) -> str:
        try:
            reply = json.loads(body)
            message = reply["choices"][0]["message"]
            calls = message.get("tool_calls")
            text = str(calls[0]["function"]["arguments"] if calls else message.get("content") or "")
            thoughts = message.get("reasoning_content") or message.get("reasoning")
            self.thought |= bool(thoughts) or "<think>" in text
            text = text or _json_in(thoughts)
        except (ValueError, RecursionError, LookupError, TypeError, AttributeError) as error:
            begin = self.brief(body[:200].decode(errors="replace"))
            raise ReasonerError(
                f"{self.where} answered something that is no chat completion: {begin!r}; does the base URL end in /v1?"
            ) from error
        used = usage.get("total_tokens") if isinstance(usage := reply.get("usage"), dict) else None
        self.tokens += used if isinstance(used, int) and 0 < used < MAX_REPLY_BYTES else 0
        return text

    def _refusal(self, error: openai.APIStatusError) -> ReasonerError:
        status = error.status_code
        return ReasonerError(f"{self.where} answered {status}: {HINTS.get(status) or self.brief(_said(error))}")

    def _too_late(self) -> ReasonerError:
        return ReasonerError(
            f"{self.where} did not answer within {self.timeout_s:g} s: is the model loaded? (or raise timeout_s)"
        )

    def brief(self, fault: object) -> str:
        """One short printable line that does not hold the key, even where the server repeats it."""
        text = str(fault).strip() or type(fault).__name__
        return brief(text.replace(self._key, "…") if self._key != "none" else text, 160)


def _said(error: openai.APIStatusError) -> str:
    """What a server says of its refusal: newer SDKs print an ``error.message`` only, and FastAPI has a ``detail``."""
    text, body = str(error), error.body
    if not body or text != f"Error code: {error.status_code}":
        return text
    return f"{text} - {body.get('detail', body) if isinstance(body, dict) else body}"


def _json_in(thoughts: object) -> str:
    """The JSON that vLLM puts into the reasoning field of a model that thinks; thoughts in words are no answer."""
    text = str(thoughts or "").strip()
    return text if text.startswith("{") and text.endswith("}") else ""


class _OneServer(openai.DefaultHttpxClient):  # type: ignore[misc]
    """The SDK's transport, limited to the one server that the person named and to answers of bounded size."""

    def __init__(self, server: Server) -> None:
        super().__init__(follow_redirects=False, timeout=server.timeout_s)
        self._server = server

    def send(self, request: Any, **options: Any) -> Any:
        """A completely read response. Raises ReasonerError for a redirect, a broken connection or an endless body."""
        response = super().send(request, **(options | {"stream": True, "follow_redirects": False}))
        try:
            if 300 <= response.status_code < 400:
                raise ReasonerError(self._leads_elsewhere(response))
            body = self._body(response)
        finally:
            response.close()
        headers = {name: response.headers[name] for name in KEPT_HEADERS if name in response.headers}
        return type(response)(response.status_code, headers=headers, content=body, request=request)

    def _body(self, response: Any) -> bytes:
        body = bytearray()
        try:
            for chunk in response.iter_bytes():
                body += chunk
                if len(body) > MAX_REPLY_BYTES:
                    raise ReasonerError(
                        f"{self._server.where} answered more than {MAX_REPLY_BYTES} bytes: is it a language model?"
                    )
        except Exception as error:  # httpx's, by whatever name this SDK imports it
            if isinstance(error, ReasonerError) or "Timeout" in type(error).__name__:
                raise
            raise CutOff(
                f"{self._server.where} broke off in the middle of its answer ({self._server.brief(error)}): ask again"
            ) from error
        return bytes(body)

    def _leads_elsewhere(self, response: Any) -> str:
        """The error for a redirect, which is not followed: words and list go to the named server only."""
        said = f"{self._server.where} answered {response.status_code}"
        try:
            target = urljoin(str(response.request.url), response.headers["location"])
            target = self._server.brief(without_credentials(target))
        except (KeyError, ValueError, ReasonerError):
            return f"{said}, which leads nowhere: is the base URL right?"
        base = target.removesuffix("/chat/completions")
        trusted = f"if you trust it, the base URL is {base}"
        return f"{said}: it sends the request on to {target}, which is not followed; {trusted}"


def _paused(pauses_s: list[float], deadline: float, retry_after: str | None = None) -> bool:
    """Wait before the next retry, as long as the server asks for; False if no retry or no time is left."""
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
