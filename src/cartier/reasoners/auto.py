"""Configured language model with the embedded reasoner as the fallback, also if the model does not answer in time.

The model is, in this order: ``model`` or ``base_url`` as given, a file in CARTIER_MODEL, or a server in OPENAI_BASE_URL
or OPENAI_API_KEY.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import Reasoner, ReasonerDefaults, optional
from cartier.errors import CartierError, InputError, ReasonerError
from cartier.llm.deadline import Late, Value, within
from cartier.llm.prompts import check_query, prompt_named
from cartier.types import Inventory, Selection

REST_S = 60.0
GRACE_S = 0.5  # so that the model's own, more precise timeout error comes first


def make(
    model: str | None = None,
    base_url: str | None = None,
    api_key: str | None = None,
    prompt: str = "rich",
    timeout_s: float = 20.0,
    cache: str | Path | None = None,
) -> Auto:
    """``model`` is a GGUF file or a model's name on its server; the rest as for the reasoners openai and local."""
    if not timeout_s > 0:
        raise InputError(f"timeout_s must be positive, got {timeout_s}")
    prompt_named(prompt)
    backend = configured(model, base_url, api_key)
    options: dict[str, Any] = {"prompt": prompt, "cache": cache}
    if backend == "local":  # it may go on after its time, so that the next request need not read the prompt again
        return Auto(backend, options | {"model": model or os.environ["CARTIER_MODEL"]}, timeout_s)
    server = {"model": model, "base_url": base_url, "api_key": api_key, "timeout_s": timeout_s}
    return Auto(backend, options | server if backend else {}, timeout_s)


def configured(model: str | None = None, base_url: str | None = None, api_key: str | None = None) -> str | None:
    """The first reasoner to ask, local or openai; None if no language model is configured."""
    if (model and model.lower().endswith(".gguf")) or (not (model or base_url) and os.environ.get("CARTIER_MODEL")):
        return "local"
    given = model or base_url or api_key or os.environ.get("OPENAI_BASE_URL") or os.environ.get("OPENAI_API_KEY")
    return "openai" if given else None


class Auto:
    """Asks a language model in its own thread for at most ``timeout_s``, and falls back to the embedded reasoner.

    The model is loaded with the first request, within its time. A model that was late is not asked again before it has
    finished, and a server that gave no answer at all is not asked for ``REST_S``.
    """

    def __init__(self, backend: str | None, options: dict[str, Any], timeout_s: float) -> None:
        self.name = f"auto ({backend}, else embedded)" if backend else "auto (embedded)"
        self._backend, self._options, self._timeout_s = backend, options, timeout_s
        self._embedded: Reasoner = plugins.make("reasoners", "embedded")
        self._model: Reasoner | None = None
        self._loading = threading.Lock()
        self._late: threading.Thread | None = None
        self._rest_until = 0.0
        self._here = threading.local()

    @property
    def notes(self) -> tuple[str, ...]:
        """Why the embedded reasoner gave this thread's latest answer, in one line; nothing where the model gave it."""
        return getattr(self._here, "notes", ())

    @property
    def calls(self) -> int:
        """How often the language model was asked."""
        return int(optional(self._model, ReasonerDefaults, "calls"))

    @property
    def tokens(self) -> int:
        """The tokens that these requests used."""
        return int(optional(self._model, ReasonerDefaults, "tokens"))

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """The model's choice, else the embedded reasoner's. ``Selection.model`` says whose it is, ``notes`` why."""
        query = check_query(query)
        return self._first(
            lambda model: model.select(query, inventory, dialogue),
            lambda: self._embedded.select(query, inventory, dialogue),
        )

    def propose(self, query: str) -> list[str]:
        """The model's proposals, else the embedded reasoner's."""
        query = check_query(query)
        return self._first(lambda model: model.propose(query), lambda: self._embedded.propose(query))

    def _first(self, ask: Callable[[Reasoner], Value], instead: Callable[[], Value]) -> Value:
        self._here.notes = ()
        try:
            return self._in_time(ask)
        except CartierError as error:
            self._here.notes = (f"the embedded reasoner answers: {error}",)
            return instead()

    def _in_time(self, ask: Callable[[Reasoner], Value]) -> Value:
        """The model's reply within its time. Raises CartierError if there is none, or if there is no model."""
        if self._backend is None:
            raise ReasonerError("no OPENAI_API_KEY, OPENAI_BASE_URL or CARTIER_MODEL is set")
        if self._late is not None and self._late.is_alive():
            raise ReasonerError(f"{self._backend} still thinks about an earlier request")
        if (rest_s := self._rest_until - time.monotonic()) > 0:
            raise ReasonerError(f"{self._backend} was late and is asked again in {rest_s:.0f} s")
        begin = time.monotonic()
        try:
            return within(self._timeout_s + GRACE_S, lambda: ask(self._loaded()))
        except Late as late:
            self._late = late.thread
            raise ReasonerError(f"{self._backend} did not answer within {self._timeout_s:g} s") from None
        except Exception:
            if time.monotonic() - begin >= self._timeout_s:
                self._rest_until = time.monotonic() + REST_S
            raise

    def _loaded(self) -> Reasoner:
        with self._loading:
            if self._model is None:
                self._model = plugins.make("reasoners", str(self._backend), **self._options)
            return self._model
