"""Recorded replies: read as a server's are, and a broken file is named by its line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cartier import plugins
from cartier.errors import InputError, ReasonerError
from cartier.types import Inventory

OBJECTS = ["bed", "coffee machine"]


def replay(folder: Path, *rows: dict[str, Any]) -> Any:
    file = folder / "replies.jsonl"
    file.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n\n" for row in rows), encoding="utf-8")
    return plugins.make("reasoners", "replay", path=file)


def test_a_recorded_reply_is_checked_against_the_list(tmp_path: Path) -> None:
    row = {"query": "so\u2028sleepy", "reply": "… the object called `Bed'."}
    mind = replay(tmp_path, row, {"query": "fly", "reply": '{"object": "helicopter"}'})
    chosen = mind.select("so\u2028sleepy ", Inventory.of(OBJECTS))
    assert (chosen.status, chosen.object, chosen.reply, chosen.model) == ("found", "bed", row["reply"], mind.name)
    assert mind.select("fly", Inventory.of(OBJECTS)).status == "clarify"
    assert mind.select("fly", Inventory.of(["helicopter"])).object == "helicopter"


def test_the_last_line_counts_and_one_for_this_very_list_before_it(tmp_path: Path) -> None:
    lines = [("mug", None), ("coffee machine", OBJECTS), ("bed", None)]
    mind = replay(tmp_path, *({"query": "tired", "reply": reply, "objects": which} for reply, which in lines))
    assert mind.select("tired", Inventory.of(list(reversed(OBJECTS)))).object == "coffee machine"
    assert mind.select("tired", Inventory.of(["mug", "bed"])).object == "bed"


def test_proposals_are_recorded_replies_too(tmp_path: Path) -> None:
    assert replay(tmp_path, {"query": "tired", "reply": "Bed, sofa"}).propose("tired") == ["bed", "sofa"]


def test_a_request_that_was_never_recorded_is_one_clear_line(tmp_path: Path) -> None:
    mind = replay(tmp_path, {"query": "tired", "reply": "bed", "objects": OBJECTS})
    for ask in (
        lambda: mind.select("hungry", Inventory.of(OBJECTS)),
        lambda: mind.select("tired", Inventory.of(["bed"])),
        lambda: mind.propose("x"),
    ):
        with pytest.raises(ReasonerError, match=r"replies\.jsonl holds no reply to “\w+”: record one"):
            ask()


@pytest.mark.parametrize(
    "line",
    [
        "{",
        "[]",
        "7",
        '{"query": "x"}',
        '{"query": "x", "reply": null}',
        '{"query": "x", "reply": {"object": "bed"}}',
        '{"query": "x", "reply": "bed", "objects": "bed"}',
        '{"query": "", "reply": "bed"}',
        "[" * 100_000,
    ],
)
def test_a_broken_line_is_named_by_its_number(line: str, tmp_path: Path) -> None:
    (tmp_path / "r.jsonl").write_text('{"query": "x", "reply": "bed"}\n\n' + line + "\n")
    with pytest.raises(InputError, match=r"r\.jsonl line 3: ") as caught:
        plugins.make("reasoners", "replay", path=tmp_path / "r.jsonl")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_no_text_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "b.jsonl").write_bytes(b"\xff\xfe\x00")
    for name, message in (("a.jsonl", "is missing"), ("b.jsonl", "line 1: not UTF-8"), (".", "is a folder")):
        with pytest.raises(InputError, match=message):
            plugins.make("reasoners", "replay", path=tmp_path / name)
