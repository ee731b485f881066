"""Suite look: each question by the list, blind, by whole frames, by a look, and mirrored."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from cartier import plugins
from cartier.contracts import VisionModel
from cartier.errors import InputError
from cartier.home import Home
from cartier.io.atomic import write_file, write_json
from cartier.llm.batch import save_requests
from cartier.llm.client import server_asked
from cartier.pipeline import map_home
from cartier.vision.batch import PictureWriter
from cartier.vision.views import apparent_px
from cartier_bench.llm_match import Judge, judged, requests_of
from cartier_bench.look_items import CANNOT_TELL, LookItem, items, scene_of, walk
from cartier_bench.look_modes import MODES, Given, answer
from cartier_bench.look_report import report
from cartier_bench.suite import Case, Progress, Row, Suite, silent

MATCH_PROMPTS = "match-prompts.jsonl"
VERSION = 2
"""Of what a map of a room holds; a change in mapping that older maps must not survive raises it."""


@dataclass(frozen=True)
class LookSettings:
    """What is asked, and how."""

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


def look(
    folder: Path | None, asked: Sequence[LookItem], model: VisionModel | None, maps_folder: Path,
    judge: Judge | None = None,
) -> Suite:  # fmt: skip
    """The suite: each question by the list, blind, by whole frames, by a look, and mirrored; without a model by the
    list alone. The photographs of a look are kept in ``folder``, if there is one.

    ``judge`` scores the answers for the second column; its requests are written as a batch file in any case.
    """
    modes = MODES[:1] if model is None else MODES[1:] if isinstance(model, PictureWriter) else MODES
    settings = LookSettings(tuple(dict.fromkeys(each.room for each in asked)), modes)
    who = model.name if model is not None else "nobody looks"

    def judge_rows(folder: Path, rows: list[Row]) -> list[Row]:
        requests = requests_of(rows, asked)
        save_requests(folder / MATCH_PROMPTS, {r.id: r for r in requests if r is not None}, server_asked()[1])
        return [row | {"llm_match": score} for row, score in zip(rows, judged(requests, judge), strict=True)]

    return Suite(
        who=who, settings=settings, items=asked, keys=("id", "mode"),
        cases=[Case((each.id, mode), each.room, each, mode) for each in asked for mode in settings.modes],
        open=lambda room, progress: room_map(room, maps_folder, progress),
        row=lambda home, case: _row(home, case.item, case.method, model, folder),
        judge=judge_rows, report=lambda rows: report(rows, who),
    )  # fmt: skip


def room_map(room: str, folder: Path, progress: Progress = silent) -> Home:
    """The map of a room by its true instances, made once and kept."""
    asked = questions([room])
    scene = scene_of(room, asked)
    recording = walk(scene, asked)
    kept = folder / f"look-{room}-{hashlib.sha256(f'{VERSION} {recording.fingerprint()}'.encode()).hexdigest()[:10]}"
    if not kept.exists():
        detector = plugins.make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
        step = partial(progress, room)
        map_home(recording, detector, ("object_depth",), every=1, progress=step).save(kept)
    return Home.load(kept)


def _row(home: Home, item: LookItem, mode: str, model: VisionModel | None, folder: Path | None) -> Row:
    begin = time.perf_counter()
    given = answer(home, item, mode, model)
    if folder is not None and mode == "list + look":
        _keep_pictures(folder / "looks", item.id, given)
    return {
        "id": item.id, "kind": item.kind, "mode": mode, "words": item.words, "truth": item.truth,
        "answer": given.answer, "right": given.answer == item.truth, "cannot_tell": given.answer == CANNOT_TELL,
        "unanswered": given.unanswered, "calls": given.asked, "apparent_px": _apparent_px(home, item),
        "pictures": [picture.to_dict() for picture in given.pictures],
        "image_tokens": sum(picture.tokens for picture in given.pictures), "why": given.why, "text": given.text,
        "seconds": round(time.perf_counter() - begin, 4),
    }  # fmt: skip


def _keep_pictures(folder: Path, key: str, given: Given) -> None:
    """Keep the photographs of a look, and the whole answer as ``cartier ask --json`` prints it."""
    for k, picture in enumerate(given.pictures, start=1):
        write_file(folder / f"{key}-{k}-crop.jpg", picture.crop_jpeg)
        write_file(folder / f"{key}-{k}-context.jpg", picture.context_jpeg)
    if given.pictures and given.whole is not None:
        write_json(folder / f"{key}.json", given.whole.to_dict())


def _apparent_px(home: Home, item: LookItem) -> float:
    """The shorter side (px) of the largest view of what is asked about, at its place."""
    label = item.label
    size = (home.camera.width, home.camera.height)
    views = [view for obj in home.objects if obj.label == label for view in obj.all_views]
    return round(max((apparent_px(view, size) for view in views), default=0.0), 1)
