"""Bodies of chat completions: any form of a reply is the same reply, and no incomplete one is ever a goal."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.llm.completion import Completion, NotACompletion, parsed, read_completion
from cartier.llm.reply_parser import read_reply
from cartier.types import CandidateView, Inventory, Selection, VisualQuestion
from cartier.vision import prompt
from llm.bodies import body_of, completion, cut_of

HOME = ["chair", "coffee machine", "tv", "bed", "wine glass"]
LISTED = Inventory.of(HOME)
NEED = {"reason": "It is soft.", "status": "found", "object": "bed", "question": "", "say": "", "answer": None}
TOLD = NEED | {"status": "told", "object": "nothing", "say": "Two – “ü”.", "answer": {"kind": "exists", "value": True}}
REPLIES = [
    json.dumps(NEED | {"then": []}), json.dumps(NEED | {"then": [NEED | {"object": "chair"}]}, indent=1),
    json.dumps(TOLD, ensure_ascii=False), json.dumps(NEED | {"status": "absent", "object": "nothing"}),
    json.dumps(NEED | {"status": "clarify", "object": "nothing", "question": "The bed or the chair?"}),
    '{"object": "coffee machine"}', "Go to the bed.", "The best place is the object called `Chair'.", "wine glass",
]  # fmt: skip
QUESTION = VisualQuestion("Is this cup clean or dirty?", "clean", ("clean", "dirty"))
PICTURES = [CandidateView(k, "cup", k, (0.0, 0.0, 9.0, 9.0), 9.0, b"", b"", 1) for k in (1, 2)]
LOOKS = json.dumps({f"picture_{k}": {"answer": "dirty", "certainty": 0.9} for k in (1, 2)})
seeds = st.integers(0, 2**32)


def read(body: dict[str, Any]) -> Completion:
    return read_completion(json.loads(json.dumps(body)))


def chosen(body: dict[str, Any]) -> Selection | None:
    """What a body selects, without the raw reply."""
    reply = read(body)
    found = read_reply(reply.text, LISTED) if reply.ended == "whole" else None
    return None if found is None else replace(found, reply="")


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(REPLIES), seeds)
def test_any_form_of_a_reply_selects_the_same(reply: str, seed: int) -> None:
    plain = read_reply(reply, LISTED)
    assert isinstance(plain, Selection)
    assert chosen(body_of(reply, Random(seed))) == replace(plain, reply="")


def streamed(reply: str, seed: int, finish: str | None) -> bytes:
    """A reply as events, split anywhere."""
    rng, ends = Random(seed), "\r\n" if seed % 2 else "\n"
    cuts = [0, *sorted(rng.randrange(len(reply) + 1) for _ in range(rng.randrange(6))), len(reply)]
    pieces = [reply[a:b] for a, b in pairwise(cuts)]
    deltas = [{"choices": [{"delta": {"content": piece}, "finish_reason": None}]} for piece in pieces]
    deltas += [{"choices": [{"delta": {}, "finish_reason": finish}], "usage": {"total_tokens": 9}}] if finish else []
    lines = [": PROCESSING", *(f"data: {json.dumps(each, ensure_ascii=False)}" for each in deltas), "data: [DONE]"]
    return "".join(f"{line}{ends}{ends}" for line in lines).encode()


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(REPLIES), seeds)
def test_unasked_stream_selects_the_same(reply: str, seed: int) -> None:
    whole = read_completion(parsed(streamed(reply, seed, "stop")))
    assert (whole.ended, whole.text, whole.tokens) == ("whole", reply, 9)
    for finish in (None, "length"):
        assert read_completion(parsed(streamed(reply, seed, finish))).ended == "cut off"


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(REPLIES), seeds)
def test_no_incomplete_reply_is_found(reply: str, seed: int) -> None:
    assert chosen(cut_of(reply, Random(seed))) is None


@settings(max_examples=200, deadline=None)
@given(seeds, st.booleans())
def test_looks_are_read_as_words_are(seed: int, whole: bool) -> None:
    reply = read((body_of if whole else cut_of)(LOOKS, Random(seed)))
    answers = prompt.read(reply.text, QUESTION, PICTURES)
    assert answers == (prompt.read(LOOKS, QUESTION, PICTURES) if whole else None)


SAID = {"role": "assistant", "content": REPLIES[0]}


@pytest.mark.parametrize(
    ("body", "ended", "said", "status"),
    [
        ({"error": {"message": "Provider returned error", "code": 502}}, "failed", "Provider returned error", 502),
        (completion(SAID, error={"message": "overloaded", "code": "429"}), "failed", "overloaded", 429),
        ({"choices": [{"message": SAID, "error": "no ²", "finish_reason": "error"}]}, "failed", "no ²", 400),
        (completion(SAID, "error"), "failed", REPLIES[0], 400),
        (completion(SAID | {"content": None, "refusal": "I cannot help."}), "declined", "I cannot help.", 400),
        (completion(SAID | {"content": [{"type": "refusal", "refusal": "No."}]}), "declined", "No.", 400),
        (completion(SAID, "content_filter"), "declined", REPLIES[0], 400),
        (completion(SAID | {"content": None}), "empty", "", 400),
        (completion(SAID | {"content": [], "tool_calls": []}), "empty", "", 400),
        (completion(SAID | {"content": "", "reasoning_content": "Let me see."}), "empty", "", 400),
        (completion(SAID, "length"), "cut off", "", 400),
        (completion(SAID | {"content": "<think>the bed"}), "cut off", "", 400),
        (completion(SAID | {"content": "Go to the bed"}, None), "cut off", "", 400),
    ],
)
def test_what_is_no_whole_reply_says_why(body: dict[str, Any], ended: str, said: str, status: int) -> None:
    reply = read(body)
    assert (reply.ended, reply.said, reply.status, reply.text) == (ended, said, status, "")


@pytest.mark.parametrize("body", [None, [], {}, {"choices": []}, {"choices": [{"message": "bed"}]}, {"choices": 7}])
def test_what_is_no_completion_is_told(body: Any) -> None:
    with pytest.raises(NotACompletion):
        read_completion(body)


def test_two_calls_of_a_tool_are_no_answer() -> None:
    calls = [{"function": {"name": "go_to", "arguments": {"object": name}}} for name in ("bed", "chair")]
    assert read(completion({"content": None, "tool_calls": calls})).ended == "empty"
    assert chosen(completion({"content": None, "tool_calls": [calls[0], calls[0]]})) is not None


def test_half_a_character_can_be_kept() -> None:
    text = read(json.loads('{"choices": [{"message": {"content": "bed \\ud83d"}, "finish_reason": "stop"}]}')).text
    assert text.encode() and text.startswith("bed")
