"""Run of ``cartier bench --suite look``: each question by the list, blind, by whole frames, by a look, and mirrored."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import VisionModel
from cartier.errors import InputError
from cartier.home import Home
from cartier.io.atomic import locked
from cartier.llm.batch import save_requests
from cartier.llm.client import server_asked
from cartier.pipeline import map_home
from cartier.vision.views import apparent_px
from cartier_bench.llm_match import Judge, judged, requests_of
from cartier_bench.look_items import CANNOT_TELL, LookItem, items, scene_of, walk
from cartier_bench.look_modes import MODES, Given, answer
from cartier_bench.look_report import keep_pictures, write_report
from cartier_bench.run import Progress, claim

LIST_ONLY = MODES[:1]
MATCH_PROMPTS = "match-prompts.jsonl"
VERSION = 2
"""Of what a map of a room holds; a change in mapping that older maps must not survive raises it."""


@dataclass(frozen=True)
class LookSettings:
    """What is asked, and how; the run folder keeps it, and goes on only with the same."""

    rooms: tuple[str, ...]
    modes: tuple[str, ...] = MODES
    suite: str = "look"
    detector: str = "ground_truth"


def questions(rooms: Sequence[str] = ()) -> list[LookItem]:
    """All questions, or those of some rooms. Raises InputError for an unknown room."""
    every = items()
    known = list(dict.fromkeys(each.room for each in every))
    if unknown := [room for room in rooms if room not in known]:
        raise InputError(f"suite look has no room {unknown[0]!r}; it has {', '.join(known)}")
    return [each for each in every if not rooms or each.room in rooms]


def run(
    folder: Path,
    asked: Sequence[LookItem],
    model: VisionModel | None,
    maps_folder: Path,
    progress: Progress | None = None,
    judge: Judge | None = None,
) -> list[dict[str, Any]]:
    """Ask everything in every mode and write the report; without a model only the list answers.

    ``judge`` scores the answers for the second column; its requests are written as a batch file in any case. Raises
    InputError for a run folder of other settings.
    """
    rooms = tuple(dict.fromkeys(each.room for each in asked))
    settings = LookSettings(rooms, MODES if model is not None else LIST_ONLY)
    who = model.name if model is not None else "nobody looks"
    with locked(folder):
        claim(folder, settings, asked, who)
        rows, done = list[dict[str, Any]](), 0
        for room in rooms:
            home = room_map(room, maps_folder, progress)
            for item in (each for each in asked if each.room == room):
                for mode in settings.modes:
                    begin = time.perf_counter()
                    given = answer(home, item, mode, model)
                    row = _row(home, item, mode, given) | {"seconds": round(time.perf_counter() - begin, 4)}
                    rows.append(row)
                    keep_pictures(folder, row, given)
                done += 1
                if progress:
                    progress("asking", done, len(asked))
        requests = requests_of(rows, asked)
        save_requests(folder / MATCH_PROMPTS, {r.id: r for r in requests if r is not None}, server_asked()[1])
        for row, score in zip(rows, judged(requests, judge), strict=True):
            row["llm_match"] = score
        write_report(folder, rows, who)
    return rows


def write_prompts(
    asked: Sequence[LookItem], writer: VisionModel, maps_folder: Path, progress: Progress | None = None
) -> None:
    """Let a writer see all that a run would ask a vision model."""
    for room in dict.fromkeys(each.room for each in asked):
        home = room_map(room, maps_folder, progress)
        for item in (each for each in asked if each.room == room):
            for mode in MODES[1:]:
                answer(home, item, mode, writer)


def room_map(room: str, folder: Path, progress: Progress | None = None) -> Home:
    """The map of a room by its true instances, made once and kept."""
    asked = questions([room])
    scene = scene_of(room, asked)
    recording = walk(scene, asked)
    kept = folder / f"look-{room}-{hashlib.sha256(f'{VERSION} {recording.fingerprint()}'.encode()).hexdigest()[:10]}"
    if not kept.exists():
        detector = plugins.make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
        step = (lambda done, total: progress(room, done, total)) if progress else None
        map_home(recording, detector, ("object_depth",), every=1, progress=step).save(kept)
    return Home.load(kept)


def _row(home: Home, item: LookItem, mode: str, given: Given) -> dict[str, Any]:
    return {
        "id": item.id, "kind": item.kind, "mode": mode, "words": item.words, "truth": item.truth,
        "answer": given.answer, "right": given.answer == item.truth, "cannot_tell": given.answer == CANNOT_TELL,
        "unanswered": given.unanswered, "calls": given.asked, "apparent_px": _apparent_px(home, item),
        "pictures": [picture.to_dict() for picture in given.pictures],
        "image_tokens": sum(picture.tokens for picture in given.pictures), "why": given.why, "text": given.text,
    }  # fmt: skip


def _apparent_px(home: Home, item: LookItem) -> float:
    """The shorter side (px) of the largest view of what is asked about, at its place."""
    label = item.label
    size = (home.camera.width, home.camera.height)
    views = [view for obj in home.objects if obj.label == label for view in obj.all_views]
    return round(max((apparent_px(view, size) for view in views), default=0.0), 1)


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """The rows of a finished run."""
    return [json.loads(line) for line in (folder / "results.jsonl").read_text("utf-8").splitlines()]
