"""The straight line of the paper (CARTIER, arXiv 2307.11865): recording → map → words → a place → a goal.

Offline, ``map_home``: detect the objects of every frame, build the spatial language indices, and a floor plan from depth.
Online, ``ask``: show the words and the list of objects to a reasoner, look its choice up in an index, plan a pose there.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import Detector, Encoder, Glimpsing, Reasoner, Recording, SpatialIndex
from cartier.errors import BackendError, InputError
from cartier.home import DetectionLog, Home
from cartier.language.prompts import check_query
from cartier.mapping.detection_cache import remembering
from cartier.mapping.occupancy import OccupancyMapper
from cartier.planning import plan
from cartier.types import Answer, Detections, Goal, Place, Selection

DEFAULT_INDEXES = ("object_depth", "object_viewpoint")
GLIMPSE_HOLDS = (
    0.4  # of a glimpse's score is the chance that the thing is there (tools/train_dollhouse_detector.py choose)
)


def map_home(
    recording: Recording,
    detector: Detector,
    indexes: Sequence[str] | None = None,
    *,
    encoder: str | Encoder = "embedded",
    min_views: int | None = None,
    robot_radius_m: float = 0.2,
    onto: Home | None = None,
    resume: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Home:
    """Map a recording, one frame in memory at a time.

    ``indexes`` are names; by default those that need no encoder and that the recording allows. ``encoder``, for those that
    need one, is NAME, NAME:MODEL or an Encoder. An object counts where ``min_views`` frames agree on it; by default as
    many as the detector asks for (``Detector.min_views``). ``onto`` is a home that the recording is added to, with poses in
    that home's frame and by the same detector; its indices and settings stay, and one that holds the recording already is given back. ``resume`` is a file that keeps the detections
    of finished frames, so that a killed run does not detect twice. ``progress`` is told (frames done, frames in all).
    Raises InputError if the recording is empty or broken, if nothing was detected in it, or if it does not go with ``onto``.
    """
    if not len(recording):
        raise InputError(f"recording {recording.name} holds no frames")
    if onto is not None and recording.fingerprint() in _recordings_of(onto):
        return onto
    if onto is None:
        views = detector.min_views if min_views is None else min_views
        built = {name: _index(name, views, encoder) for name in indexes or DEFAULT_INDEXES}
        settings = _settings(recording, detector) | {"indexes": list(built), "encoder": None, "min_views": views}
        settings |= {"robot_radius_m": robot_radius_m}
        mapper, first = OccupancyMapper(robot_radius_m=robot_radius_m), 0
    else:
        built, settings, mapper, first = _grown(onto, recording, detector)
    log: list[Detections] = []
    start_xy = onto.start_xy if onto else None

    with ExitStack() as stack:
        made_by = _settings(recording, detector)
        detect = stack.enter_context(remembering(detector, resume, made_by)) if resume else detector.detect
        for number in range(len(recording)):
            frame = recording[number]
            detections = detect(frame)
            if first:
                frame, detections = replace(frame, index=first + number), replace(detections, frame=first + number)
            for index in built.values():
                index.add(frame, detections)
            if frame.depth_m is not None:
                mapper.add(frame)
            start_xy = start_xy or (float(frame.world_from_camera[0, 3]), float(frame.world_from_camera[1, 3]))
            log.append(_without_masks(detections))
            if progress:
                progress(number + 1, len(recording))
    assert start_xy is not None

    if not any(map(len, log)):
        raise InputError(
            f"{detector.name} found nothing in the {len(recording)} frames of {recording.name}: "
            + (
                "; ".join(getattr(detector, "notes", ()))
                or "is the threshold too high, or are these not the things that it knows?"
            )
        )
    grid = mapper.grid()
    notes = [*(onto.notes if onto else ()), *recording.notes, *getattr(detector, "notes", ())]
    if grid is None:
        notes.append("the recording has no depth: no occupancy grid, and so no goals")
    for made_with in dict.fromkeys(filter(None, (getattr(index, "encoder", "") for index in built.values()))):
        settings["encoder"] = made_with
        notes.append(f"image features: {made_with}")
    usable = _usable(built, explicit=indexes is not None, notes=notes)
    keyframes = (dict(onto.keyframes) if onto else {}) | _keyframes(recording, usable, first)
    detected = DetectionLog.of(log)
    return Home(
        onto.name if onto else recording.name, detector.name, recording.camera,
        onto.detections.followed_by(detected) if onto else detected,
        usable, grid, start_xy, mapper.robot_radius_m, settings, keyframes, tuple(dict.fromkeys(notes)), mapper.counts(),
    )  # fmt: skip


def _settings(recording: Recording, detector: Detector) -> dict[str, Any]:
    made_of = {"recording": recording.name, "sha256": recording.fingerprint(), "frames": len(recording)}
    return made_of | {"detector": detector.name, "detector_sha256": getattr(detector, "sha256", "")}


def _recordings_of(home: Home) -> list[str]:
    """The fingerprints of all recordings that a home was made from."""
    return [home.settings["sha256"], *(row["sha256"] for row in home.settings.get("added", []))]


def _grown(
    home: Home, recording: Recording, detector: Detector
) -> tuple[dict[str, SpatialIndex], dict[str, Any], OccupancyMapper, int]:
    """What a home goes on from: its indices, its settings with one recording more, its floor plan's counts, the next frame."""
    made_by = _settings(recording, detector)
    for what in ("detector", "detector_sha256"):
        if home.settings.get(what) != made_by[what]:
            raise InputError(
                f"{home.name} was mapped by {home.detector}, not by {detector.name}: add with the same detector"
            )
    added = list(home.settings.get("added", []))
    if home.grid is not None and home.counts is None:
        raise InputError(f"{home.name} keeps no counts of its floor plan (an older cartier made it): map it again")
    mapper = OccupancyMapper(robot_radius_m=home.robot_radius_m)
    if home.counts:
        mapper.restore(home.counts)
    first = int(home.settings["frames"]) + sum(int(row["frames"]) for row in added)
    row = {name: made_by[name] for name in ("recording", "sha256", "frames")}
    return deepcopy(dict(home.indexes)), dict(home.settings) | {"added": [*added, row]}, mapper, first


def ask(
    home: Home,
    query: str,
    reasoner: Reasoner | None = None,
    *,
    index: str | None = None,
    from_xy: Sequence[float] | None = None,
    dialogue: Sequence[tuple[str, str]] = (),
) -> Answer:
    """Answer one request: the object that serves it, its place, and a reachable pose that faces it.

    ``reasoner`` is by default the embedded one. ``index`` is one of the home's, by default its first; ``from_xy`` is where
    the robot stands, by default where the recording began. Raises InputError for an unusable query, ReasonerError if a language model cannot be reached.
    """
    query = check_query(query)
    reasoner = reasoner or _embedded()
    home.index(index)  # a name that is not there is said before anybody is asked
    timing_ms: dict[str, float] = {}
    with _timed(timing_ms, "select"):
        selection = _second_look(home, query, reasoner, dialogue, reasoner.select(query, home.objects, dialogue))
    known = {*home.objects, *home.glimpsed}
    for chosen in (selection, *selection.then):
        if chosen.object is not None and chosen.object not in known:
            raise BackendError(
                f"reasoner {reasoner.name} chose {chosen.object!r}, which is not in the list it was given"
            )
    who = selection.model or reasoner.name  # of a reasoner that hands over to another, the one that answered
    answer = serve(home, query, selection, who, index=index, from_xy=from_xy, timing_ms=timing_ms)
    return replace(answer, notes=(*getattr(reasoner, "notes", ()), *answer.notes))


@cache
def _embedded() -> Reasoner:
    return plugins.make("reasoners", "embedded")


def _second_look(
    home: Home, query: str, reasoner: Reasoner, dialogue: Sequence[tuple[str, str]], first: Selection
) -> Selection:
    """The choice among glimpsed things, too, where one serves better even though it is there but by chance; else ``first``.

    Who asks for a knife that no list holds is better served by where one was glimpsed than by nothing. A reasoner that
    weighs nothing (a language model) is asked again only where nothing listed served.
    """
    glimpsed = home.glimpsed
    weighs = first.status != "found" or len(first.candidates) > 1
    if not glimpsed or not weighs or first.then or first.status == "clarify":
        return first
    more = reasoner.select(query, sorted({*home.objects, *glimpsed}), dialogue)
    if more.status != "found" or more.object not in glimpsed or more.then:
        return first
    share = dict(more.candidates) or {more.object: 1.0}
    listed = max((share.get(name, 0.0) for name in home.objects), default=0.0)
    if GLIMPSE_HOLDS * glimpsed[more.object] * share.get(more.object, 0.0) <= listed:
        return first
    return replace(more, reason=f"{more.reason}, though it was only glimpsed")


def serve(
    home: Home,
    query: str,
    selection: Selection,
    reasoner: str,
    *,
    index: str | None = None,
    place: Place | None = None,
    from_xy: Sequence[float] | None = None,
    timing_ms: dict[str, float] | None = None,
) -> Answer:
    """From what was chosen to its place and a goal; then, from there, to what was asked for in the same breath.

    ``place`` is where the object is, if that is known already; else the index says it. ``reasoner`` names who chose.
    """
    index_name, spatial_index = home.index(index)
    timing_ms = {} if timing_ms is None else timing_ms
    from_xy = from_xy or home.start_xy
    notes: list[str] = []

    if place is None and selection.object is not None:
        with _timed(timing_ms, "locate"):
            place = spatial_index.locate(selection.object)
            if place is None and isinstance(spatial_index, Glimpsing):
                place = spatial_index.glimpse(selection.object)
        if place is None:
            notes.append(
                f"{index_name} has no place for the {selection.object}: it was never seen well enough; try another --index"
            )

    if place is not None and not place.sure:
        notes.append(f"the {place.label} was only glimpsed (score {place.score:.2f}): it may not be there")

    goal: Goal | None = None
    if place is not None and home.grid is None:
        notes.append("no goal: without depth the home has no occupancy grid to plan on")
    elif place is not None and home.grid is not None:
        with _timed(timing_ms, "plan"):
            goal, why_not = plan(home.grid, place, from_xy, home.robot_radius_m)
        if goal is None:
            notes.append(f"no goal: {why_not}")
        elif not goal.line_of_sight:
            notes.append(f"the goal faces the {place.label}, but something known stands in between")

    then, here = [], from_xy if goal is None else (goal.x, goal.y)
    for further in selection.then:
        then.append(serve(home, query, further, reasoner, index=index, from_xy=here))
        if (last := then[-1].goal) is not None:
            here = (last.x, last.y)
    return Answer(
        query, selection, place, goal, reasoner, index_name, home.detector, home.name, timing_ms, tuple(notes),
        getattr(spatial_index, "encoder", None), tuple(then),
    )  # fmt: skip


@contextmanager
def _timed(timing_ms: dict[str, float], step: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    timing_ms[step] = (time.perf_counter() - begin) * 1e3


def _index(name: str, min_views: int, encoder: str | Encoder) -> SpatialIndex:
    options = {"encoder": encoder} if plugins.takes("indexes", name, "encoder") else {}
    return plugins.make("indexes", name, min_views=min_views, **options)


def _without_masks(detections: Detections) -> Detections:
    return Detections(detections.frame, detections.boxes_xyxy, detections.scores, detections.labels)


def _usable(built: dict[str, SpatialIndex], explicit: bool, notes: list[str]) -> dict[str, SpatialIndex]:
    """The indices that hold anything; one that was asked for by name and stayed empty is an error."""
    empty = [name for name, index in built.items() if not index.names()]
    if empty and (explicit or len(empty) == len(built)):
        raise InputError(
            f"index {empty[0]} stayed empty: no detection has what it needs (object_depth needs depth in the boxes)"
        )
    notes.extend(f"index {name} is left out: no detection had depth" for name in empty)
    return {name: index for name, index in built.items() if name not in empty}


def _keyframes(recording: Recording, indexes: dict[str, SpatialIndex], first: int) -> dict[int, bytes]:
    """The evidence photos of every place that this recording shows, as JPEG; its frames count from ``first``."""
    from PIL import Image

    places = [index.locate(name) for index in indexes.values() for name in index.names()]
    places += [i.glimpse(name) for i in indexes.values() if isinstance(i, Glimpsing) for name in i.glimpsed()]
    photos: dict[int, bytes] = {}
    for frame in sorted({place.frame for place in places if place is not None and place.frame >= first}):
        buffer = io.BytesIO()
        Image.fromarray(recording[frame - first].rgb).save(buffer, "JPEG", quality=90)
        photos[frame] = buffer.getvalue()
    return photos
