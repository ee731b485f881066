"""Recorded replies: read as a server's are, and a broken file is named by its line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cartier import plugins
from cartier.errors import InputError, ReasonerError
from cartier.llm.prompts import PROMPTS, propose_request
from cartier.types import Inventory
from cartier_bench.batch import PromptWriter
from flat import FLAT

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


def test_the_last_line_counts_and_a_reply_to_a_list_is_for_that_list_alone(tmp_path: Path) -> None:
    """What was proposed without sight of a list was taken for a choice from one, as "bed, sofa" is."""
    lines = [
        ("tired", "mug", None),
        ("tired", "bed", None),
        ("sit", "coffee machine", OBJECTS),
        ("sit", "bed, sofa", None),
    ]
    mind = replay(tmp_path, *({"query": query, "reply": reply, "objects": which} for query, reply, which in lines))
    assert mind.select("tired", Inventory.of(["mug", "bed"])).object == "bed"
    assert mind.select("sit", Inventory.of(list(reversed(OBJECTS)))).object == "coffee machine"
    with pytest.raises(ReasonerError, match="holds no reply to “sit” with this list"):
        mind.select("sit", Inventory.of(["mug", "bed"]))
    assert mind.propose("sit") == ["bed", "sofa"]


def test_proposals_are_recorded_replies_too(tmp_path: Path) -> None:
    assert replay(tmp_path, {"query": "tired", "reply": "Bed, sofa"}).propose("tired") == ["bed", "sofa"]


def test_a_request_that_was_never_recorded_is_one_clear_line(tmp_path: Path) -> None:
    mind = replay(tmp_path, {"query": "tired", "reply": "bed", "objects": OBJECTS})
    for ask in (
        lambda: mind.select("hungry", Inventory.of(OBJECTS)),
        lambda: mind.select("tired", Inventory.of(["bed"])),
        lambda: mind.propose("x"),
    ):
        with pytest.raises(
            ReasonerError, match=r"replies\.jsonl holds no reply to “\w+”( with this list)?: record one"
        ):
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


def answered(key: str, content: Any, status: int = 200) -> dict[str, Any]:
    """A line of a batch's output, as the Batch API documents it."""
    body = {
        "id": "c",
        "object": "chat.completion",
        "choices": [{"index": 0, "message": {"role": "assistant", "content": content}, "finish_reason": "stop"}],
    }
    response = {
        "status_code": status,
        "request_id": "r",
        "body": body if status == 200 else {"error": {"message": "busy"}},
    }
    return {"id": "batch_req_1", "custom_id": key, "response": response, "error": None}


def test_what_a_batch_brought_back_is_the_reply_to_that_very_prompt(tmp_path: Path) -> None:
    talk = [("a cup", "cup #12")]
    lines = [
        answered(PROMPTS["rich"].request("the other one", FLAT, talk).id, '{"status": "found", "object": "cup #14"}'),
        answered(PROMPTS["paper"].request("tired", FLAT).id, '{"object": "bed"}'),
        answered(propose_request("tired").id, "Bed, sofa"),
        answered(PROMPTS["rich"].request("busy", FLAT).id, None, 503),
        answered(PROMPTS["rich"].request("silent", FLAT).id, None),
        answered(PROMPTS["rich"].request("failed", FLAT).id, "x") | {"error": {"code": "x"}},
        answered("somebody else's", '{"object": "bed"}'),
        {"query": "busy", "reply": "the sink"},
    ]
    mind = replay(tmp_path, *lines)
    chosen = mind.select("the other one", FLAT, talk)
    assert (chosen.object, chosen.object_id, chosen.model) == ("cup", 14, mind.name)
    assert mind.select("tired", FLAT).object == "bed" and mind.propose("tired") == ["bed", "sofa"]
    assert mind.select("busy", FLAT).object == "sink"
    for words, inventory, dialogue in (
        ("the other one", FLAT, []),
        ("tired", Inventory.of(["bed"]), []),
        ("silent", FLAT, []),
        ("failed", FLAT, []),
    ):
        with pytest.raises(ReasonerError, match="holds no reply"):
            mind.select(words, inventory, dialogue)


@pytest.mark.parametrize(
    "line",
    [
        '{"custom_id": "x"}',
        '{"custom_id": "x", "response": null}',
        '{"custom_id": "x", "response": {"status_code": 200, "body": {"choices": []}}}',
        '{"custom_id": "x", "response": {"status_code": 200, "body": {"choices": [{"message": "bed"}]}}}',
        '{"custom_id": 7, "response": {"status_code": 200, "body": {"choices": [{"message": {"content": "bed"}}]}}}',
    ],
)
def test_a_broken_line_of_a_batch_is_named_by_its_number(line: str, tmp_path: Path) -> None:
    (tmp_path / "r.jsonl").write_text("\n" + line)
    with pytest.raises(InputError, match=r"r\.jsonl line 2: expected .*custom_id"):
        plugins.make("reasoners", "replay", path=tmp_path / "r.jsonl")


def test_prompts_are_written_once_each_and_what_has_a_reply_is_not_written(tmp_path: Path) -> None:
    def written(writer: PromptWriter) -> list[dict[str, Any]]:
        for words in ("tired", "tired ", "thirsty"):
            writer.select(words, FLAT)
        assert writer.select("tired", Inventory.of([])).object is None and writer.propose("tired") == []
        writer.save(tmp_path / "batch.jsonl")
        lines = [json.loads(line) for line in (tmp_path / "batch.jsonl").read_text(encoding="utf-8").splitlines()]
        assert len(lines) == len(writer.requests)
        return lines

    lines = written(PromptWriter("some-model"))
    request = PROMPTS["rich"].request("tired", FLAT)
    first = lines[0]
    assert [len(lines), first["custom_id"], first["method"], first["url"]] == [
        3,
        request.id,
        "POST",
        "/v1/chat/completions",
    ]
    assert first["body"]["messages"] == request.messages and first["body"]["model"] == "some-model"
    assert first["body"]["response_format"]["json_schema"]["strict"] and "maxLength" not in json.dumps(first)
    assert "response_format" not in lines[2]["body"] and len({line["custom_id"] for line in lines}) == 3
    back = replay(tmp_path, answered(first["custom_id"], '{"object": "bed"}'))
    assert [line["custom_id"] for line in written(PromptWriter("m", "rich", back))] == [
        lines[1]["custom_id"],
        lines[2]["custom_id"],
    ]
    assert PromptWriter("m", "rich", back).select("tired", FLAT).object == "bed"
