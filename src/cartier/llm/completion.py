"""Chat completions as servers really answer: the text of a reply apart from its thoughts, or why there is none.

Content comes as a text, as parts or as an object, the arguments of a tool as a text or as an object, thoughts in fields
of their own, in parts or in marks, and an error in a body of status 200.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from cartier.llm.thoughts import without_thoughts

MAX_TOKENS = 2**20  # that one reply may claim to have used
WHOLE = frozenset(
    ["stop", "eos", "eos_token", "end_turn", "stop_sequence", "tool_calls", "function_call", "tool_use", "completed"]
)
CUT = frozenset(["length", "max_tokens", "max_output_tokens", "model_length"])
DECLINED = frozenset(["content_filter", "refusal", "safety"])
THOUGHT_FIELDS = ("reasoning_content", "reasoning", "thinking", "reasoning_details", "thinking_blocks")
THOUGHT_PARTS = frozenset(["thinking", "reasoning", "redacted_thinking", "reasoning_content", "thought"])
TEXT_FIELDS = ("text", "content", "refusal", "thinking", "summary")
MAX_DEPTH = 8  # of parts in parts
Ended = Literal["whole", "cut off", "empty", "declined", "failed"]


class NotACompletion(ValueError):
    """A body that is no chat completion."""


@dataclass(frozen=True)
class Completion:
    """A model's reply.

    Args:
        ended: "whole"; "cut off" where the limit of tokens ended it, in the middle of thoughts, and where it neither
            says that it is whole nor ends as JSON does; "empty", for all of its thoughts; "declined" by the model or a
            filter; "failed" behind the server.
        text: What the model says, with marked thoughts as they are; empty unless whole.
        thought: Whether it came with thoughts.
        tokens: As the server counts them; 0 if it does not.
        said: Of what was declined or failed, the server's words.
        status: Of what failed, an HTTP status; 400 if none is told.
    """

    ended: Ended
    text: str = ""
    thought: bool = False
    tokens: int = 0
    said: str = ""
    status: int = 400


def parsed(body: bytes) -> Any:
    """A body as JSON values; that of a server which streams unasked as the completion that its events make up.

    Raises ValueError or RecursionError.
    """
    if not body.lstrip().startswith((b"data:", b"event:", b":")):
        return json.loads(body)
    said, finish, last = "", None, dict[str, Any]()
    for line in body.split(b"\n"):
        event = line.removeprefix(b"data:").strip() if line.startswith(b"data:") else b""
        if event in (b"", b"[DONE]"):
            continue
        last = json.loads(event)
        if not isinstance(last, dict) or last.get("error"):
            return last
        for choice in (each for each in last.get("choices") or () if isinstance(each, dict)):
            delta = choice.get("delta")
            said += _content(delta)[0] if isinstance(delta, dict) else ""
            finish = choice.get("finish_reason") or finish
    return {**last, "choices": [{"message": {"content": said}, "finish_reason": finish or "length"}]}


def read_completion(body: Any) -> Completion:
    """The reply in a body that was parsed as JSON. Raises NotACompletion."""
    reply = body if isinstance(body, dict) else {}
    choices = reply.get("choices")
    choice = choices[0] if isinstance(choices, list) and choices and isinstance(choices[0], dict) else {}
    for error in (reply.get("error"), choice.get("error")):
        if error:
            return Completion("failed", said=_text(error), status=_status(error))
    message = choice.get("message")
    if not isinstance(message, dict):
        raise NotACompletion("no message")
    spoken, thoughts, refusal = _content(message)
    for field in THOUGHT_FIELDS:
        thoughts = thoughts or _text(message.get(field))
    said = without_thoughts(spoken)
    thought = bool(thoughts) or said != spoken.strip()
    if said == "" and thoughts.lstrip().startswith("{"):  # where vLLM puts the JSON of a model that thinks
        spoken = said = thoughts.strip()
    about: dict[str, Any] = {"thought": thought, "tokens": _tokens(reply.get("usage"))}
    finish = str(choice.get("finish_reason") or "").lower()
    if refusal or finish in DECLINED:
        return Completion("declined", said=refusal or spoken, **about)
    if finish == "error":
        return Completion("failed", said=spoken, **about)
    if said is None or finish in CUT or (said and finish not in WHOLE and not said.rstrip("` \n").endswith("}")):
        return Completion("cut off", **about)
    if not said:
        return Completion("empty", **about)
    return Completion("whole", spoken, **about)


def _content(message: dict[str, Any]) -> tuple[str, str, str]:
    """What a message says, in its tool call if it has one, its thoughts and its refusal."""
    parts = list(_parts(message.get("content")))
    said = "".join(text for kind, text in parts if kind not in THOUGHT_PARTS and kind != "refusal")
    thoughts = "".join(text for kind, text in parts if kind in THOUGHT_PARTS)
    refusal = _text(message.get("refusal")) or "".join(text for kind, text in parts if kind == "refusal")
    calls = message.get("tool_calls") or message.get("function_call")
    given = {_arguments(call) for call in (calls if isinstance(calls, list) else [calls])} - {"", "{}"}
    if given:  # several that differ: none is the answer
        said = given.pop() if len(given) == 1 else ""
    return _clean(_unquoted(said)), _clean(thoughts), _clean(refusal)


def _parts(content: Any, kind: str = "text", depth: int = 0) -> Iterator[tuple[str, str]]:
    """The kind and the text of each part of a content; an object that is no part is an answer in itself."""
    if isinstance(content, str):
        yield kind, content
    elif isinstance(content, list) and depth < MAX_DEPTH:
        for part in content:
            yield from _parts(part, kind, depth + 1)
    elif isinstance(content, dict) and depth < MAX_DEPTH:
        own = content.get("type")
        inner = own.partition(".")[0] if isinstance(own, str) and kind not in THOUGHT_PARTS else kind
        told = [content[field] for field in TEXT_FIELDS if isinstance(content.get(field), str | list)]
        if told and not {"status", "object"} & content.keys():
            yield from _parts(told[0], inner, depth + 1)
        elif not isinstance(own, str):
            yield kind, _dumped(content)


def _arguments(call: Any) -> str:
    function = call.get("function", call) if isinstance(call, dict) else None
    given = function.get("arguments") if isinstance(function, dict) else None
    return given.strip() if isinstance(given, str) else _dumped(given) if isinstance(given, dict) else ""


def _unquoted(text: str) -> str:
    """The text of a text that was written as JSON twice."""
    if text.lstrip().startswith('"{'):
        try:
            return str(json.loads(text))
        except ValueError:
            return text
    return text


def _text(value: Any) -> str:
    """All text of a field of any form."""
    if isinstance(value, dict) and isinstance(message := value.get("message"), str):
        return _clean(message)
    return _clean("".join(text for _, text in _parts(value)))


def _status(error: Any) -> int:
    code = str(error.get("code", "")) if isinstance(error, dict) else ""
    return int(code) if code.isascii() and code.isdigit() and len(code) == 3 else 400


def _tokens(usage: Any) -> int:
    used = usage.get("total_tokens") if isinstance(usage, dict) else None
    return used if type(used) is int and 0 < used < MAX_TOKENS else 0


def _dumped(value: Any) -> str:
    try:
        return json.dumps(value, ensure_ascii=False)
    except (ValueError, RecursionError):
        return ""


def _clean(text: str) -> str:
    """Text that can be encoded: JSON may hold halves of a character."""
    return text.encode("utf-8", "replace").decode()
