"""The straight line of the paper (CARTIER, arXiv 2307.11865): recording → map → words → a place → a goal.

Offline, ``map_home``: detect the objects of every frame, and let the mapper make objects, indices and a floor plan of them.
Online, ``ask``: show the words and the inventory to a reasoner, look its choice up in an index, plan a pose there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

from cartier import plugins
from cartier.contracts import Detector, Encoder, Reasoner, Recording
from cartier.errors import BackendError, InputError
from cartier.home import Home
from cartier.labels import object_ref, room_ref
from cartier.llm.prompts import check_query, recent
from cartier.mapping.config import MappingConfig
from cartier.mapping.detection_cache import cached
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.mapper import Mapper
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.navigation.planning import check_start, plan
from cartier.types import Answer, Frame, Goal, Place, RobotModel, Selection
from cartier.understanding.out_of_vocabulary import out_of_vocabulary_mention


def map_home(
    recording: Recording,
    detector: Detector,
    indexes: Sequence[str] | None = None,
    *,
    encoder: str | Encoder = "embedded",
    onto: Home | None = None,
    config: MappingConfig | None = None,
    every: int | None = None,
    resume: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Home:
    """Map a recording, a few frames in memory at a time. All frames make the floor plan; the detector sees those that show something new.

    ``indexes``, ``encoder``, ``onto`` and ``config`` are those of ``Mapper``; a home that holds the recording already is given back as it is.
    ``every`` is for the detector to see each ``every``-th frame instead, 1 for all. ``resume`` is a file that keeps the detections of finished frames, so that a killed run does not detect twice. ``progress``
    is told (frames done, frames in all). Raises InputError if the recording is empty or broken, if nothing was detected in it,
    or if it does not go with ``onto``.
    """
    if not len(recording):
        raise InputError(f"recording {recording.name} holds no frames")
    mapper = Mapper(detector, indexes, encoder=encoder, onto=onto, config=config)
    if onto is not None and mapper.contains(recording):
        return onto
    keyframes, looked, waiting = Keyframes(every, mapper.config.keyframes), 0, list[Frame]()
    batch = batch_size(detector, recording.camera)
    with cached(detector, resume, recording.fingerprint()) as detect:
        for done, frame in enumerate(prefetch(recording, batch), 1):
            waiting += keyframes.push(frame) if mapper.integrate_depth(frame) else []
            waiting += keyframes.flush() if done == len(recording) else []
            if len(waiting) >= batch or done == len(recording):
                for keyframe, detections in zip(waiting, detect(waiting), strict=True):
                    mapper.integrate_detections(keyframe, detections)
                looked, waiting = looked + len(waiting), []
            if progress:
                progress(done, len(recording))
    mapper.finish(recording, looked)
    return mapper.home()


def ask(
    home: Home,
    query: str,
    reasoner: Reasoner | None = None,
    *,
    index: str | None = None,
    from_xy: Sequence[float] | None = None,
    robot: RobotModel | None = None,
    dialogue: Sequence[tuple[str, str]] = (),
) -> Answer:
    """Answer one request: the object that serves it, its place, and a reachable pose that faces it.

    ``reasoner`` is by default the embedded one. ``index`` is one of the home's, by default its first; ``from_xy`` is where the
    ``robot`` stands, by default where the recording began; ``dialogue`` holds earlier (person, robot) turns. Raises InputError
    for an unusable query or start before anybody is asked, ReasonerError if a language model cannot be reached.
    """
    query = check_query(query)
    from_xy = check_start(home.start_xy if from_xy is None else from_xy)
    reasoner = _embedded() if reasoner is None else reasoner
    inventory = home.inventory(index, from_xy)  # an index that is not there is said before anybody is asked
    timing_ms: dict[str, float] = {}
    with _timed(timing_ms, "select"):
        selection = reasoner.select(query, inventory, dialogue)
    for chosen in (selection, *selection.next):
        if not inventory.contains(chosen):
            raise BackendError(
                f"reasoner {reasoner.name} chose {chosen.object!r}, which is not in the list it was given"
            )
    who = selection.model or reasoner.name  # of a reasoner that hands over to another, the one that answered
    answer = serve(home, query, selection, who, index=index, from_xy=from_xy, robot=robot, timing_ms=timing_ms)
    return replace(answer, notes=(*getattr(reasoner, "notes", ()), *_doubts(home, query, selection), *answer.notes))


def _doubts(home: Home, query: str, selection: Selection) -> Iterator[str]:
    """Why the home's detector may be to blame: it was made for other pictures, or has no name for what was asked for."""
    yield from home.settings.get("doubts", ())
    names = home.settings.get("knows", ())
    if names and selection.status != "found" and (asked := out_of_vocabulary_mention(query, names)) is not None:
        yield f"{home.detector}, which mapped this home, knows only {len(names)} names, and {asked} is not among them"


def serve(
    home: Home,
    query: str,
    selection: Selection,
    reasoner: str,
    *,
    index: str | None = None,
    place: Place | None = None,
    from_xy: Sequence[float] | None = None,
    robot: RobotModel | None = None,
    timing_ms: dict[str, float] | None = None,
) -> Answer:
    """From what was chosen to its place and a goal; then, from there, to what was asked for in the same breath.

    ``place`` is where the object is, if that is known already; else the index says it. ``reasoner`` names who chose.
    """
    index_name, spatial_index = home.index(index)
    timing_ms, robot = {} if timing_ms is None else timing_ms, robot or RobotModel()
    from_xy = home.start_xy if from_xy is None else from_xy
    notes: list[str] = []
    if place is None and selection.object is not None:
        with _timed(timing_ms, "locate"):
            place = home.locate(selection, index_name)
        if place is None:
            notes.append(f"{index_name} has no place for the {selection.object}: try another --index")
    goal: Goal | None = None
    if selection.status == "answered":
        pass  # an answer in words sends nobody anywhere
    elif place is not None and home.grid is None:
        notes.append("no goal: without depth the home has no occupancy grid to plan on")
    elif place is not None and home.grid is not None:
        with _timed(timing_ms, "plan"):
            goal, why_not = plan(home.grid, place, from_xy, robot)
        if goal is None:
            notes.append(f"no goal: {why_not}")
        elif not goal.line_of_sight:
            notes.append(f"the goal faces the {place.label}, but something known stands in between")
    then, here = [], from_xy if goal is None else (goal.x, goal.y)
    for further in selection.next:
        then.append(serve(home, query, further, reasoner, index=index, from_xy=here, robot=robot))
        if (last := then[-1].goal) is not None:
            here = (last.x, last.y)
    return Answer(
        query, selection, place, goal, reasoner, index_name, home.detector, home.name, timing_ms, tuple(notes),
        getattr(spatial_index, "encoder", None), tuple(then),
    )  # fmt: skip


@cache
def _embedded() -> Reasoner:
    return plugins.make("reasoners", "embedded")


@contextmanager
def _timed(timing_ms: dict[str, float], step: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    timing_ms[step] = (time.perf_counter() - begin) * 1e3


class Conversation:
    """Remembers what was said, on both sides, and where the robot has been sent.

    ``turns`` are the latest (person, robot) turns, oldest first, no more than a reasoner is shown. ``from_xy`` is where the
    robot stands (m, map frame): the last goal, until somebody who knows better sets it; InputError for what is no point.
    """

    def __init__(
        self,
        home: Home,
        reasoner: Reasoner,
        *,
        index: str | None = None,
        from_xy: Sequence[float] | None = None,
        robot: RobotModel | None = None,
    ) -> None:
        self.home, self.reasoner, self.index, self.robot = home, reasoner, index, robot
        self.from_xy: Sequence[float] = check_start(home.start_xy if from_xy is None else from_xy)
        self.turns: list[tuple[str, str]] = []

    def say(self, words: str) -> Answer:
        """The answer to what the person says next. Raises as ``pipeline.ask``; what raised was not said."""
        words = check_query(words)
        answer = ask(
            self.home,
            words,
            self.reasoner,
            index=self.index,
            from_xy=self.from_xy,
            robot=self.robot,
            dialogue=self.turns,
        )
        self.turns = recent([*self.turns, (words, robot_turn(answer))])
        goals = [part.goal for part in (answer, *answer.next) if part.goal is not None]
        if goals:
            self.from_xy = (goals[-1].x, goals[-1].y)
        return answer


def robot_turn(answer: Answer) -> str:
    """What the robot has said with an answer, and then with that to the next need: ``cup #12, then kitchen (room 3)``.

    It is the object that was served with its number, or the room; a sentence that was told; the question; or that nothing serves.
    """
    return ", then ".join([_said(answer), *map(robot_turn, answer.next)])


def _said(answer: Answer) -> str:
    chosen, place = answer.selection, answer.place
    if chosen.status == "answered":
        return chosen.text if chosen.object_id is None else f"{chosen.text} (#{chosen.object_id})"
    if chosen.object is None:
        return chosen.question or "nothing here serves that"
    if chosen.room is not None:
        return room_ref(chosen.object, chosen.room)
    number = place.object_id if chosen.object_id is None and place is not None else chosen.object_id
    return chosen.object if number is None else object_ref(chosen.object, number)
