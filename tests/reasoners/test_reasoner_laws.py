"""The laws of every reasoner: nothing anybody says brings an object out of the list, and nothing said means no goal."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cartier import plugins
from cartier.contracts import Reasoner
from cartier.errors import InputError, ReasonerError
from cartier.testing import REQUESTS, check_reasoner
from cartier.types import Inventory
from flat import FLAT

NAMES = [b.name for b in plugins.backends("reasoners")]
ANSWERS = [
    '{"object": "helicopter"}',
    '{"object": "bed"}',
    "the object called `Chair'",
    "chair or machine",
    "nothing",
    "",
    "\x00{",
    "…",
]


@pytest.fixture(params=NAMES)
def make(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Reasoner]:
    """Makes one of every kind, that can be asked the requests of the laws."""
    options: dict[str, Any] = {}
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "CARTIER_MODEL"):
        monkeypatch.delenv(name, raising=False)
    if request.param == "local":
        options = {"model": request.getfixturevalue("tiny_model"), "prompt": "paper"}
    if request.param == "openai":
        options = {"base_url": f"{request.getfixturevalue('server')}/v1", "model": "lawful"}
    if request.param == "replay":
        rows = [{"query": q, "reply": a} for q, a in zip(REQUESTS, ANSWERS, strict=True)]
        options = {"path": tmp_path / "replies.jsonl"}
        options["path"].write_text("\n".join(map(json.dumps, rows)))
    return lambda **more: plugins.make("reasoners", request.param, **options, **more)


def test_no_answer_leaves_the_list(make: Callable[..., Reasoner]) -> None:
    if "openai" in make().name:  # the rich prompt, whose replies take long, is asked for a home of objects and rooms
        check_reasoner(lambda: make(prompt="paper"), REQUESTS[::2])
    else:
        check_reasoner(make)


def test_no_answer_leaves_a_home_of_objects_and_rooms(make: Callable[..., Reasoner]) -> None:
    reasoner = make()
    for request in REQUESTS[::2] if "openai" in reasoner.name else REQUESTS:
        try:
            chosen = reasoner.select(request, FLAT, [("a cup", "cup #12"), ("where are the plates?", "I saw none.")])
        except ReasonerError as error:  # random weights mostly ramble until the limit of tokens
            assert "openai" in reasoner.name and "broke off its answer" in str(error)
            continue
        assert all(FLAT.contains(need) for need in (chosen, *chosen.next))
        assert chosen.status != "answered" or chosen.text


def test_a_request_without_end_is_refused_in_one_line(make: Callable[..., Reasoner]) -> None:
    try:
        assert make().select("x" * 1_000_000, Inventory.of(["bed"])).object is None
    except InputError as error:
        assert len(str(error)) < 200 and "\n" not in str(error)
