"""Forms of structured output, from the strictest to free text, and which of them each server supports."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

from cartier.errors import ReasonerError
from cartier.llm.prompts import Schema, json_schema, without_bounds
from cartier.llm.thoughts import without_thoughts

Form = dict[str, Any]
_works: dict[tuple[str, str], str] = {}  # (server, model) → the first form that worked


class Refused(ReasonerError):
    """A server understands the request in none of its forms."""


class NotUnderstood(Exception):
    """A server refused a request, and another form may succeed; ``error`` is for the person."""

    def __init__(self, error: ReasonerError) -> None:
        super().__init__(str(error))
        self.error = error


def _json_object(schema: Schema) -> Form:
    return {"extra_body": {"response_format": {"type": "json_object", "schema": schema}}}


def _tool(schema: Schema) -> Form:
    function = {"name": "go_to", "description": "Drive to an object.", "parameters": schema}
    return {
        "tools": [{"type": "function", "function": function}],
        "tool_choice": {"type": "function", "function": {"name": "go_to"}},
    }


LADDER: dict[str, Callable[[Schema], Form]] = {
    "json_schema": json_schema,
    "json_schema without bounds": lambda schema: json_schema(without_bounds(schema)),
    "json_object": _json_object,
    "tool": lambda schema: _tool(without_bounds(schema)),
    "text": lambda schema: {},
}


def _rungs(schema: Schema, known: str | None) -> Iterator[tuple[str, Form]]:
    """The form that has worked, then the others from the strictest down, each once."""
    tried: list[Form] = []
    for name in dict.fromkeys([*([known] if known else []), *LADDER]):
        if (form := LADDER[name](schema)) not in tried:
            tried.append(form)
            yield name, form


def request_with_fallback(
    server: str, model: str, schema: Schema, ask: Callable[[Form, bool], str], is_answer: Callable[[str], bool]
) -> str:
    """The raw reply of the first form that gives an answer, else of the last one tried.

    ``ask(form, sure)`` raises NotUnderstood where another form may succeed; ``sure``: this one has worked.
    """
    known, reply = _works.get((server, model)), ""
    refusal: NotUnderstood | None = None
    for name, form in _rungs(schema, known):
        try:
            reply = ask(form, name == known)
        except NotUnderstood as error:
            refusal = error
            continue
        refusal = None
        if is_answer(reply):
            if name == "text" or _is_one_object(reply):  # an answer that was found in words says nothing of the form
                _works[server, model] = name
            break
        if name == known:
            break  # this form has worked before, so the reply is at fault
    if refusal is not None:
        raise refusal.error from refusal
    return reply


def _is_one_object(reply: str) -> bool:
    try:
        return isinstance(json.loads(without_thoughts(reply) or ""), dict)
    except (ValueError, RecursionError):
        return False


def form_of(server: str, model: str) -> str | None:
    """The form that has worked with a model, or None if none has."""
    return _works.get((server, model))


def remember_form(server: str, model: str, form: str) -> None:
    """Begin with a form that an earlier process found (``cartier check-model``); an unknown one is left aside."""
    if form in LADDER:
        _works.setdefault((server, model), form)
