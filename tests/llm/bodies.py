"""Bodies of chat completions as servers write them: the same reply in many forms, and replies that are cut off."""

from __future__ import annotations

import json
from random import Random
from typing import Any

THOUGHTS = [
    "The user is tired. The tv?", 'Maybe {"status": "found", "object": "tv"}, or not.', "Not the wine glass.",
    "a <think> mark, and {", "",
]  # fmt: skip
MARKS = [
    ("<think>", "</think>"), ("<thinking>\n", "\n</thinking>\n\n"), ("", "</think>"), ("[THINK]", "[/THINK]"),
    ("◁think▷", "◁/think▷"), ("<seed:think>", "</seed:think>"), ("<reasoning>", "</reasoning>"),
    ("<|channel|>analysis<|message|>", "<|end|><|start|>assistant<|channel|>final<|message|>"),
    ("<|channel>thought\n", "<channel|>"), ("<|START_THINKING|>", "<|END_THINKING|>"),
]  # fmt: skip
FIELDS = ["reasoning_content", "reasoning", "thinking"]
ENDS = ["", "<|return|>", "<|im_end|>", "\n", " \n</s>"]
GOOD = ["stop", "STOP", "end_turn", "eos_token"]


def body_of(reply: str, rng: Random) -> dict[str, Any]:
    """A whole reply in some form: in content or in a tool's arguments, as text, parts or object, after thoughts."""
    row = _object(reply)
    carrier = rng.choice(["text", "parts", "strings", *(["object", "arguments", "call", "twice"] if row else [])])
    message: dict[str, Any] = {"role": "assistant", "content": None}
    if rng.random() < 0.4:
        message |= _thoughts_beside(rng)
    if carrier in ("arguments", "call"):
        given = reply if rng.random() < 0.5 else row
        function = {"name": "go_to", "arguments": given}
        calls = [{"id": "1", "type": "function", "function": function}]
        message |= {"tool_calls": calls} if carrier == "arguments" else {"function_call": function}
        message["content"] = rng.choice([None, "", "I call the tool for the tv."])
        return completion(message, rng.choice([*GOOD, "tool_calls", "function_call"]))
    if carrier == "object":
        message["content"] = row
        return completion(message, rng.choice(GOOD))
    text = json.dumps(reply) if carrier == "twice" else reply
    if carrier != "twice" and rng.random() < 0.5:
        begin, end = rng.choice(MARKS)
        text = begin + rng.choice(THOUGHTS) + end + text + rng.choice(ENDS)
    if carrier in ("text", "twice"):
        message["content"] = text
    else:
        pieces = _split(text, rng)
        parts: list[Any] = pieces if carrier == "strings" else [{"type": "text", "text": piece} for piece in pieces]
        if rng.random() < 0.5:
            thought = rng.choice(THOUGHTS)
            parts.insert(
                0, {"type": "thinking", "thinking": rng.choice([thought, [{"type": "text", "text": thought}]])}
            )
        message["content"] = parts
    return completion(message, rng.choice(GOOD))


def cut_of(reply: str, rng: Random) -> dict[str, Any]:
    """A reply that its server did not finish: it says so, or it stops before the last brace of its JSON."""
    end = rng.randrange(len(reply) + 1)
    text = rng.choice(["", "<think>", "Well. "]) + reply[:end]
    if rng.random() < 0.5 or _object(reply) is None:
        finish: Any = rng.choice(["length", "max_tokens", "LENGTH"])
    else:
        text, finish = reply[: rng.randrange(reply.rindex("}") + 1)], rng.choice([*GOOD, None, "unknown"])
    carrier = rng.choice(["content", "parts", "arguments", "reasoning"])
    message: dict[str, Any] = {"role": "assistant", "content": text if carrier == "content" else None}
    if carrier == "parts":
        message["content"] = [{"type": "text", "text": piece} for piece in _split(text, rng)]
    elif carrier == "arguments":
        message["tool_calls"] = [{"id": "1", "type": "function", "function": {"name": "go_to", "arguments": text}}]
    elif carrier == "reasoning":
        message["reasoning"] = text
    return completion(message, finish)


def completion(message: dict[str, Any], finish: Any = "stop", **more: Any) -> dict[str, Any]:
    choice = {"index": 0, "message": message, "finish_reason": finish}
    return {"id": "c", "object": "chat.completion", "choices": [choice], "usage": {"total_tokens": 9}} | more


def _object(reply: str) -> dict[str, Any] | None:
    try:
        row = json.loads(reply)
    except ValueError:
        return None
    return row if isinstance(row, dict) else None


def _thoughts_beside(rng: Random) -> dict[str, Any]:
    thought = rng.choice(THOUGHTS)
    if rng.random() < 0.3:
        return {"reasoning_details": [{"type": "reasoning.text", "text": thought}], "refusal": None}
    if rng.random() < 0.2:
        return {"thinking_blocks": [{"type": "thinking", "thinking": thought, "signature": "x"}]}
    return {rng.choice(FIELDS): thought}


def _split(text: str, rng: Random) -> list[str]:
    cuts = sorted(rng.randrange(len(text) + 1) for _ in range(rng.randrange(4)))
    return [text[a:b] for a, b in zip([0, *cuts], [*cuts, len(text)], strict=True)]
