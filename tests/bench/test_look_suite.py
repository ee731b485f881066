"""Suite look: rooms whose truth is known, asked in every mode, with a stand-in that sees and with batch files."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import cartier
from cartier.errors import InputError
from cartier.io.images import decode_jpeg
from cartier.vision.attributes import CLOSED
from cartier.vision.batch import PictureWriter
from cartier_bench import llm_match, look_run, suite
from cartier_bench.look_items import CANNOT_TELL, KINDS, PLACES_X, items, scene_of
from cartier_bench.look_modes import MODES, grey, mirrored
from cartier_bench.look_report import results
from vision.seeing_server import serving
from vision.staged_photos import photo

ROOM = "birch"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, list[dict], int]]:
    """A run over one room with a stand-in that tells colours and brightness from the pixels."""
    folder, asked = tmp_path_factory.mktemp("look"), look_run.questions([ROOM])
    with serving() as (url, calls), pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder))
        model = cartier.make("vision", "openai", model="sees", base_url=url)
        judge = llm_match.judge("openai:sees", url)
        run = folder / "run"
        rows = suite.run(run, look_run.look(run, asked, model, folder / "maps", judge))
        yield folder, rows, len(calls)


def row(rows: list[dict], id: str, mode: str) -> dict:
    return next(row for row in rows if (row["id"], row["mode"]) == (id, mode))


def test_questions_have_closed_answers_and_no_two_ids() -> None:
    every = items()
    assert len({each.id for each in every}) == len(every) >= 40
    assert {each.kind for each in every} == set(KINDS)
    assert max(Counter(each.room for each in every).values()) == len(PLACES_X)
    for each in every:
        assert each.truth in (*each.choices, CANNOT_TELL) and each.truth not in each.id
        assert (each.truth == CANNOT_TELL) == (each.kind == "hidden side")
    states = Counter(each.truth for each in every if each.kind == "state")
    assert states["on"] and states["off"] and states["open"] and states["closed"] and states["full"] and states["dirty"]


def test_closed_answers_are_those_of_the_product() -> None:
    """The bench has its own sets; a question that the product would answer in other words is a finding."""
    for each in items():
        assert each.kind in ("which", "exists on") or each.choices == CLOSED[each.attribute]


def test_each_room_can_be_built() -> None:
    for room in dict.fromkeys(each.room for each in items()):
        asked = [each for each in items() if each.room == room]
        assert len(scene_of(room, asked).things) >= len(asked)


def test_modes_differ_as_they_should(ran: tuple[Path, list[dict], int]) -> None:
    _, rows, _ = ran
    assert len(rows) == 4 * len(MODES) and not any(row["unanswered"] for row in rows)
    pillow = f"{ROOM}-4"
    assert row(rows, pillow, "list + look")["answer"] == "green"  # the stand-in's own pixels
    assert row(rows, pillow, "mirrored")["answer"] == "green"
    for state in (f"{ROOM}-1", f"{ROOM}-3"):
        assert row(rows, state, "list only")["answer"] == CANNOT_TELL
        assert row(rows, state, "blind")["answer"] == CANNOT_TELL  # it sees no box in grey
        assert row(rows, state, "list + look")["answer"] != CANNOT_TELL
    television = row(rows, f"{ROOM}-1", "list + look")
    assert television["right"] and len(television["pictures"]) == 3 and television["image_tokens"] <= 1200


def test_a_server_counts_one_call_a_question(ran: tuple[Path, list[dict], int]) -> None:
    _, rows, calls = ran
    assert max(row["calls"] for row in rows) == 1
    compared = {r.id for r in llm_match.requests_of(rows, look_run.questions([ROOM])) if r is not None}
    assert calls == sum(row["calls"] for row in rows) + len(compared) and len(compared) < len(rows)


def test_report_has_tables_failures_and_photographs(ran: tuple[Path, list[dict], int]) -> None:
    folder, rows, _ = ran
    said = (folder / "run" / "report.md").read_text()
    assert "changed by mirroring" in said and "| which | 1 |" in said and "LLM-Match" in said
    told = results(rows)["by_kind"]["list + look"]
    assert told["attribute"]["llm_match"] == told["attribute"]["right"] == 1
    assert "100 (0) / 100" in said  # right, wrong, and what the judge made of the words
    assert len(list((folder / "run" / "looks").glob("*.jpg"))) == 6 * 4
    trace = json.loads((folder / "run" / "looks" / f"{ROOM}-1.json").read_text())
    assert trace["look"]["sent"] is True and len(trace["look"]["photos"]) == 3
    assert [json.loads(line) for line in (folder / "run" / "results.jsonl").read_text().splitlines()] == rows


def test_prompts_are_written_and_replies_read_back(ran: tuple[Path, list[dict], int], tmp_path: Path) -> None:
    folder, _, _ = ran
    asked, writer = look_run.questions([ROOM]), PictureWriter("m")
    suite.show(look_run.look(None, asked, writer, folder / "maps"))
    photos = writer.save(tmp_path / "prompts.jsonl")
    lines = [json.loads(line) for line in (tmp_path / "prompts.jsonl").read_text().splitlines()]
    assert len(lines) == 4 * 4 and len(list(photos.glob("*.txt"))) == len(lines)
    assert all(line["body"]["messages"][0]["content"][0]["type"] == "image_url" for line in lines)
    on = {f"picture_{k}": {"answer": "on", "certainty": 0.9} for k in (1, 2, 3)}
    replies = [{"custom_id": line["custom_id"], "reply": json.dumps(on)} for line in lines[:-4]]
    (tmp_path / "replies.jsonl").write_text("".join(json.dumps(reply) + "\n" for reply in replies))
    model = cartier.make("vision", "replay", model=tmp_path / "replies.jsonl")
    rows = suite.run(tmp_path / "run", look_run.look(None, asked, model, folder / "maps"))
    assert row(rows, f"{ROOM}-1", "frames only")["answer"] == "on"
    assert row(rows, f"{ROOM}-3", "list + look")["answer"] == CANNOT_TELL  # "on" is no answer to it
    assert sum(each["unanswered"] for each in rows) == 4 == results(rows)["unanswered"]
    replies += [{"custom_id": line["custom_id"], "reply": json.dumps(on)} for line in lines[-4:]]
    (tmp_path / "replies.jsonl").write_text("".join(json.dumps(reply) + "\n" for reply in replies))
    model = cartier.make("vision", "replay", model=tmp_path / "replies.jsonl")
    rows = suite.run(tmp_path / "run", look_run.look(None, asked, model, folder / "maps"))
    assert not any(each["unanswered"] for each in rows), "what had no reply is asked for again"


def test_pictures_are_mirrored_or_made_grey() -> None:
    left = photo(((0.0, 0.0, 320.0, 480.0), (235, 235, 230)))
    light = decode_jpeg(left, "left")[240, [100, 540]].mean(-1)
    turned = decode_jpeg(mirrored(left), "turned")[240, [100, 540]].mean(-1)
    assert light[0] > light[1] + 50 and turned[1] > turned[0] + 50
    assert np.ptp(decode_jpeg(grey(left), "grey")) <= 2


def test_unknown_rooms_and_damaged_replies_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no room 'attic'"):
        look_run.questions(["attic"])
    (tmp_path / "bad.jsonl").write_text('{"custom_id": 7}\n')
    with pytest.raises(InputError, match="line 1: expected"):
        cartier.make("vision", "replay", model=tmp_path / "bad.jsonl")
