"""End-to-end pipeline: ``map_home`` and ``ask``, and ``Conversation``, which asks with memory.

Source: CARTIER (arXiv 2307.11865). Offline, ``map_home`` detects the objects of every keyframe, and the mapper makes
objects, indices and a floor plan of the detections. Online, ``ask`` gives the words and the inventory to a reasoner,
looks its choice up in an index, and plans a pose there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

from cartier import plugins
from cartier.contracts import Detector, Encoder, IndexDefaults, Reasoner, ReasonerDefaults, Recording, optional
from cartier.errors import BackendError, InputError
from cartier.home import Home
from cartier.home.looking import look_for_answer
from cartier.home.spoken import correct_by_words
from cartier.labels import object_ref, room_ref
from cartier.llm.prompts import check_query, recent
from cartier.mapping.config import MappingConfig
from cartier.mapping.detection_cache import cached
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.mapper import Mapper
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.navigation.planning import check_start, plan
from cartier.types import Answer, Frame, Goal, Place, RobotModel, Selection
from cartier.understanding import alarm
from cartier.understanding.out_of_vocabulary import out_of_vocabulary_mention
from cartier.vision.permission import Look

CORRECTION = "correction"
"""What answers words that correct the home, instead of a reasoner."""


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
    """Map a recording. Frames are read a few at a time; all of them make the floor plan, keyframes get detections.

    Args:
        recording: What ``open_recording`` or a world gives.
        detector: Detects the objects.
        indexes: The names of the spatial indices to build; by default those that need no encoder and that the frames
            allow.
        encoder: NAME, NAME:MODEL or an Encoder, for indices that need one.
        onto: A home to grow, mapped by the same detector; its indices and settings stay. A home that already holds the
            recording is returned as it is.
        config: The numbers of the mapping; by default those of ``onto``, else ``MappingConfig()``.
        every: Run the detector on each ``every``-th frame (1 for all) instead of on keyframes, which show something
            new.
        resume: A file that keeps the detections of finished frames, so that a run that was killed can be continued.
        progress: Called after each frame with the number of frames done and of all frames.

    Returns:
        The home. Mapping the same recording with the same settings gives the same home.

    Raises:
        InputError: The recording is empty or broken, nothing was detected in it, or it does not go with ``onto``.

    Example:
        >>> import cartier
        >>> walk = cartier.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=12)
        >>> truth = cartier.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        >>> home = cartier.map_home(walk, truth)
        >>> len(home.names) > 5 and home.grid is not None
        True
    """
    if not len(recording):
        raise InputError(f"recording {recording.name} holds no frames")
    mapper = Mapper(detector, indexes, encoder=encoder, onto=onto, config=config)
    if onto is not None and mapper.contains(recording):
        return onto
    keyframes, processed, waiting = Keyframes(every, mapper.config.keyframes), 0, list[Frame]()
    batch = batch_size(detector, recording.camera)
    with cached(detector, resume, recording.fingerprint()) as detect:
        for done, frame in enumerate(prefetch(recording, batch), 1):
            waiting += keyframes.push(frame) if mapper.integrate_depth(frame) else []
            waiting += keyframes.flush() if done == len(recording) else []
            if len(waiting) >= batch or done == len(recording):
                for keyframe, detections in zip(waiting, detect(waiting), strict=True):
                    mapper.integrate_detections(keyframe, detections)
                processed, waiting = processed + len(waiting), []
            if progress:
                progress(done, len(recording))
    mapper.finish(recording, processed)
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
    emergency_number: str | None = None,
    look: Look | None = None,
) -> Answer:
    """Answer one request: the object that serves it, its place, and a reachable pose that faces it.

    Args:
        home: The home.
        query: What the person says, in plain English.
        reasoner: Chooses the object; by default the embedded reasoner.
        index: The name of one of the home's indices; by default the first.
        from_xy: Where the robot stands (x, y) in metres, map frame; by default where the recording began.
        robot: The size of the robot; by default that of ``RobotModel()``.
        dialogue: Earlier (person, robot) turns, oldest first; ``Conversation`` keeps them.
        emergency_number: What to call in an emergency; by default CARTIER_EMERGENCY_NUMBER, else the number of the
            locale's country.
        look: Who may look at the home's photographs, and when; by default nobody.

    Returns:
        The answer. Words about harm or an emergency are an "alarm", and no reasoner is asked. Its place and goal are
        None where nothing serves, where the robot asks back or answers in words; a goal may also be missing where no
        pose can be reached, and ``notes`` say why.

    Raises:
        InputError: The words are empty or too long, the start is not a point, or the home has no such index.
        ReasonerError: A language model cannot be reached.
        BackendError: The reasoner chose what is not in the inventory.

    Example:
        >>> import cartier
        >>> walk = cartier.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=12)
        >>> truth = cartier.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        >>> home = cartier.map_home(walk, truth)
        >>> answer = cartier.ask(home, "I am tired, I want to go to sleep")
        >>> answer.selection.object
        'bed'
        >>> answer.goal is not None and answer.goal.path.shape[1] == 2
        True
    """
    query = check_query(query)
    from_xy = check_start(home.start_xy if from_xy is None else from_xy)
    reasoner = _embedded() if reasoner is None else reasoner
    inventory = home.inventory(index, from_xy)  # raises for an unknown index before a model is called
    timing_ms: dict[str, float] = {}
    with _timed(timing_ms, "select"):
        alarming = alarm.screen(query, emergency_number)
        selection = alarming or reasoner.select(query, inventory, dialogue)
    for chosen in (selection, *selection.next):
        if not inventory.contains(chosen):
            raise BackendError(
                f"reasoner {reasoner.name} chose {chosen.object!r}, which is not in the list it was given"
            )
    looked = None
    if look is not None and alarming is None:
        with _timed(timing_ms, "look"):
            looked = look_for_answer(home, query, selection, inventory, look, from_xy, robot or RobotModel())
    selection, trace, looked_notes = looked or (selection, None, ())
    if not inventory.contains(selection):
        raise BackendError(f"the look chose {selection.object!r}, which is not in the list")
    who = selection.model or reasoner.name  # a reasoner may hand over to another one
    answer = serve(home, query, selection, who, index=index, from_xy=from_xy, robot=robot, timing_ms=timing_ms)
    if alarming is not None:
        return answer  # what else there is to know about the home can wait
    notes = (*optional(reasoner, ReasonerDefaults, "notes"), *_doubts(home, query, selection), *looked_notes)
    return replace(answer, notes=(*notes, *answer.notes), look=trace)


def _doubts(home: Home, query: str, selection: Selection) -> Iterator[str]:
    """Why the detector may be to blame: it was made for other pictures, or has no label for what was asked for."""
    yield from home.settings.get("doubts", ())
    names = home.settings.get("knows", ())
    if (
        names
        and selection.status != "found"
        and (asked := out_of_vocabulary_mention(query, (*names, *home.names))) is not None
    ):
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
    """Find the place of a selection and plan a goal there; then, from that goal on, the same for its further needs.

    Args:
        home: The home.
        query: What the person said.
        selection: What was chosen.
        reasoner: The name of what chose it.
        index: The name of one of the home's indices; by default the first.
        place: Where the object is, if that is known; otherwise the index finds it.
        from_xy: Where the robot stands (x, y) in metres; by default where the recording began.
        robot: The size of the robot.
        timing_ms: The durations of earlier steps, which those of "locate" and "plan" are added to.

    Returns:
        The answer.

    Raises:
        InputError: The home has no such index.
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
    if selection.status in ("answered", "alarm"):
        pass  # an answer in words has no goal
    elif place is not None and home.grid is None:
        notes.append("no goal: without depth the home has no occupancy grid to plan on")
    elif place is not None and home.grid is not None:
        with _timed(timing_ms, "plan"):
            goal, why_not = plan(home.grid, place, from_xy, robot)
        if goal is None:
            notes.append(f"no goal: {why_not}")
        elif not goal.line_of_sight:
            notes.append(f"the goal faces the {place.label}, but something known stands in between")
    further, here = [], from_xy if goal is None else (goal.x, goal.y)
    for chosen in selection.next:
        further.append(serve(home, query, chosen, reasoner, index=index, from_xy=here, robot=robot))
        if (last := further[-1].goal) is not None:
            here = (last.x, last.y)
    return Answer(
        query, selection, place, goal, reasoner, index_name, home.detector, home.name, timing_ms, tuple(notes),
        optional(spatial_index, IndexDefaults, "encoder") or None, tuple(further),
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
    """A conversation about a home: requests in order, with the memory of both sides and of where the robot was sent.

    ``turns`` holds the latest (person, robot) turns, oldest first, as many as a reasoner is shown. ``from_xy`` is
    where the robot stands: the last goal, unless the caller sets it.

    Args:
        home: The home.
        reasoner: Chooses the objects.
        index: The name of one of the home's indices; by default the first.
        from_xy: Where the robot stands (x, y) in metres, map frame; by default where the recording began.
        robot: The size of the robot; by default that of ``RobotModel()``.
        emergency_number: What to call in an emergency, as for ``ask``.
        look: Who may look at the home's photographs, and when, as for ``ask``.

    Raises:
        InputError: ``from_xy`` is not a point, or the emergency number is none.
    """

    def __init__(
        self,
        home: Home,
        reasoner: Reasoner,
        *,
        index: str | None = None,
        from_xy: Sequence[float] | None = None,
        robot: RobotModel | None = None,
        emergency_number: str | None = None,
        look: Look | None = None,
    ) -> None:
        self.home, self.reasoner, self.index, self.robot, self.look = home, reasoner, index, robot, look
        alarm.emergency_number(emergency_number)  # a mistake is told now, not in an emergency
        self.emergency_number = emergency_number
        self.from_xy: Sequence[float] = check_start(home.start_xy if from_xy is None else from_xy)
        self.turns: list[tuple[str, str]] = []

    def say(self, words: str) -> Answer:
        """Answer what the person says next; words that raise are not remembered.

        Words that correct a saved home do so, and ``home`` is then the corrected one: "yes, it is there", "that is a
        pencil box", "this is Ben's room", "undo that".

        Args:
            words: What the person says.

        Returns:
            The answer.

        Raises:
            InputError, ReasonerError, BackendError: As ``ask`` does.
        """
        words = check_query(words)
        corrected = correct_by_words(self.home, words, self.turns, index=self.index, from_xy=self.from_xy)
        self.home, told = corrected or (self.home, None)
        if told is not None:
            answer = serve(
                self.home, words, told, CORRECTION, index=self.index, from_xy=self.from_xy, robot=self.robot
            )  # fmt: skip
        else:
            waiting = self.turns.pop()[0] if corrected is not None else words  # "which room is Ben's?" is answered
            answer = ask(
                self.home, waiting, self.reasoner,
                index=self.index, from_xy=self.from_xy, robot=self.robot, dialogue=self.turns,
                emergency_number=self.emergency_number, look=self.look,
            )  # fmt: skip
        self.turns = recent([*self.turns, (words, robot_turn(answer))])
        goals = [part.goal for part in (answer, *answer.next) if part.goal is not None]
        if goals:
            self.from_xy = (goals[-1].x, goals[-1].y)
        return answer


def robot_turn(answer: Answer) -> str:
    """What the robot said with an answer, as the dialogue keeps it: ``cup #12, then kitchen (room 3)``.

    Args:
        answer: What ``ask`` gave.

    Returns:
        For each need the object with its number, the room, the answer in words, the question, or that nothing serves.
    """
    return ", then ".join([_said(answer), *map(robot_turn, answer.next)])


def _said(answer: Answer) -> str:
    chosen, place = answer.selection, answer.place
    if answer.look is not None and not answer.look.question.choices and chosen.status == "answered":
        named = "" if chosen.object is None else f" on {object_ref(chosen.object, chosen.object_id or 0)}"
        return f"I told what I see{named}."  # words from a photograph are no part of the conversation
    if chosen.status in ("answered", "alarm"):
        return chosen.text if chosen.object_id is None else f"{chosen.text} (#{chosen.object_id})"
    if chosen.object is None:
        return chosen.question or "nothing here serves that"
    if chosen.room is not None:
        return room_ref(chosen.object, chosen.room)
    number = place.object_id if chosen.object_id is None and place is not None else chosen.object_id
    return chosen.object if number is None else object_ref(chosen.object, number)
