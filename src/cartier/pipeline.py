"""End-to-end pipeline: ``map_home`` and ``ask``.

Source: CARTIER (arXiv 2307.11865). Offline, ``map_home`` detects the objects of every keyframe, and the mapper makes
objects, indices and a floor plan of the detections. Online, ``ask`` gives the words and the inventory to a reasoner,
looks its choice up in an index, and plans a pose there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from cartier import plugins
from cartier.contracts import Detector, Encoder, IndexDefaults, Reasoner, ReasonerDefaults, Recording, optional
from cartier.errors import BackendError, InputError
from cartier.home import Home
from cartier.home.looking import look_for_answer, seen_twice
from cartier.io.blas import one_blas_thread
from cartier.llm.prompts import check_query
from cartier.navigation.planning import check_start, plan
from cartier.navigation.routes import RoutePlan, plan_route
from cartier.navigation.traction import traction_layer
from cartier.types import Answer, Goal, Place, RobotModel, Selection
from cartier.types.route_rules import RouteRule
from cartier.understanding import alarm
from cartier.understanding.cards import deck_of
from cartier.understanding.out_of_vocabulary import out_of_vocabulary_mention
from cartier.understanding.route_rules import GO_ANYWAY, agrees
from cartier.vision.permission import Look

if TYPE_CHECKING:
    from cartier.mapping.config import MappingConfig

STAYS = Selection("answered", reason="the person would rather not", text="All right, I stay here.")


@one_blas_thread
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
    mend_poses: bool = True,
    align: bool | Home = False,
    progress: Callable[[int, int], None] | None = None,
) -> Home:
    """Map a recording. Frames are read a few at a time; all of them make the floor plan, keyframes get detections.

    Its floor and its images are levelled first. Poses that drift are corrected by what depth shows, and the recording
    is mapped again with them.

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
        mend_poses: Whether a world that leans is levelled, its floor taken for z = 0, images on their side turned, and
            poses that drift corrected; the world stays that of the first frame.
        align: Whether the recording has a world of its own, and is to be moved into that of ``onto``: objects and walls
            must agree where it belongs. Or the home that was mapped from it apart, so that this is not done again.
        progress: Called after each frame with the number of frames done and of all frames.

    Returns:
        The home. Mapping the same recording with the same settings gives the same home.

    Raises:
        InputError: The recording is empty or broken, nothing was detected in it, or it does not go with ``onto``, or
            cannot be aligned with it.

    Example:
        >>> import cartier
        >>> walk = cartier.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=12)
        >>> truth = cartier.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        >>> home = cartier.map_home(walk, truth)
        >>> len(home.names) > 5 and home.grid is not None
        True
    """
    from cartier.mapping.detection_cache import cached, remembering
    from cartier.mapping.mapper import Mapper
    from cartier.mapping.poses.alignment import align as find_alignment
    from cartier.mapping.poses.motions import Reposed
    from cartier.mapping.poses.pose_graph import PoseGraph
    from cartier.mapping.upright import Upright, images_key, upright

    if not len(recording):
        raise InputError(f"recording {recording.name} holds no frames")
    if align and onto is None:
        raise InputError("aligning needs a home to align with: onto")
    mapper = Mapper(detector, indexes, encoder=encoder, onto=onto, config=config)
    if onto is not None and mapper.contains(recording):
        return onto
    if mend_poses and not isinstance(recording, Upright):
        recording = upright(recording, detector, () if onto is None or align else onto.settings["recordings"])
    aligned = None if onto is None or not isinstance(align, Home) else find_alignment(onto, align)
    recording = recording if aligned is None else Reposed(recording, aligned.pose)
    with cached(detector, resume, images_key(recording)) as detect:
        detect, graph = remembering(detect), PoseGraph()
        if align is True:
            mapper.begin(None)
        processed = mapper.run(recording, detect, every, progress, graph.add)
        mended = graph.mend() if mend_poses else None
        if mended is not None:
            recording = Reposed(recording, mended.pose)
            mapper.begin(None if align is True else onto)
            processed = mapper.run(recording, detect, every, progress)
        if align is True and onto is not None:
            aligned = find_alignment(onto, replace(mapper.home(), name=recording.name))
            recording = Reposed(recording, aligned.pose)
            mapper.begin(onto)
            processed = mapper.run(recording, detect, every, progress)
    mapper.finish(recording, processed, mended, aligned)
    return mapper.home()


@one_blas_thread
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
    rules: Sequence[RouteRule] = (),
    now: datetime | None = None,
) -> Answer:
    """Answer one request: the object that serves it, its place, and a reachable pose that faces it.

    Meanwhile numpy multiplies matrices on one thread, in the whole process.

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
        rules: Route rules for this drive, beside those of the home and of the words.
        now: The time, with a time zone: which rules of the home hold. By default that of this machine.

    Returns:
        The answer. Words about harm or an emergency are an "alarm", and no reasoner is asked. Its place and goal are
        None where nothing serves, where the robot asks back or answers in words; a goal may also be missing where no
        pose can be reached, and ``notes`` say why. Where a hard route rule stands in the way, it is a question, and
        "yes" as the next turn of the dialogue drives.

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
    now = datetime.now().astimezone() if now is None else now
    kept = [rule for rule in home.rules if not rule.expired(now)]
    inventory = home.inventory(index, from_xy, (*kept, *rules))  # raises for an unknown index before a model is called
    agreed = agrees(query) if dialogue and dialogue[-1][1].endswith(GO_ANYWAY) else None
    said, query = query, dialogue[-1][0] if agreed else query  # "yes": the request before is served
    timing_ms: dict[str, float] = {}
    with _timed(timing_ms, "select"):
        alarming = alarm.screen(said, emergency_number, dialogue)
        selection = alarming or (
            STAYS if agreed is False else reasoner.select(query, inventory, dialogue[:-1] if agreed else dialogue)
        )
        alarming = alarming or alarm.screen_choice(selection, inventory, dialogue, emergency_number)
        selection = alarming or selection
    for chosen in (selection, *selection.next):
        if not inventory.contains(chosen):
            raise BackendError(
                f"reasoner {reasoner.name} chose {chosen.object!r}, which is not in the list it was given"
            )
    looked = None
    if look is not None and alarming is None:
        with _timed(timing_ms, "look"):
            looked = look_for_answer(
                home, query, selection, inventory, look, from_xy, robot or RobotModel(), deck_of(reasoner)
            )
    selection, trace, looked_notes = looked or (selection, None, ())
    selection = selection if alarming is not None else seen_twice(home, query, selection, inventory)
    if not inventory.contains(selection):
        raise BackendError(f"the look chose {selection.object!r}, which is not in the list")
    holding = _holding([*kept, *rules], selection, now)
    answer = serve(
        home, said, selection, selection.model or reasoner.name, index=index, from_xy=from_xy, robot=robot,
        timing_ms=timing_ms, rules=holding, agreed=agreed is True,
    )  # fmt: skip
    if alarming is not None:
        return answer  # what else there is to know about the home can wait
    notes = (*optional(reasoner, ReasonerDefaults, "notes"), *_doubts(home, query, selection, reasoner), *looked_notes)
    return replace(answer, notes=(*notes, *answer.notes), look=trace)


def _holding(rules: Sequence[RouteRule], selection: Selection, now: datetime) -> list[RouteRule]:
    """The rules that hold now, with what the words say of all drives, and without what they take back."""
    parts = (selection, *selection.next)
    ended = [rule for part in parts for rule in part.lifts]
    said = [rule for part in parts if part.status == "answered" for rule in part.rules]
    return [rule for rule in dict.fromkeys((*rules, *said)) if rule.holds(now) and rule not in ended]


def _doubts(home: Home, query: str, selection: Selection, reasoner: Reasoner) -> Iterator[str]:
    """Why the detector may be to blame: it was made for other pictures, or has no label for what was asked for."""
    yield from home.settings.get("doubts", ())
    names = home.settings.get("knows", ())
    if (
        names
        and selection.status != "found"
        and (asked := out_of_vocabulary_mention(query, (*names, *home.names), deck_of(reasoner))) is not None
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
    rules: Sequence[RouteRule] = (),
    agreed: bool = False,
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
        rules: The route rules that hold, beside those of the selection.
        agreed: Whether a person agreed to break the hard rules that stand in the way.

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
    elif place is not None:
        with _timed(timing_ms, "plan"):
            planned = plan_for(home, place, from_xy, robot, tuple(dict.fromkeys((*rules, *selection.rules))))
        goal = planned.breach if agreed and planned.breach is not None else planned.goal
        notes += [f"understood: {rule.in_words()}" for rule in selection.rules]
        notes += [f"a rule of this home: {rule.in_words()}{_quoted(rule)}" for rule in rules if rule.id]
        notes += planned.notes
        if goal is None and planned.breach is not None:
            question = f"{planned.why_not[:1].upper()}{planned.why_not[1:]}. {GO_ANYWAY}"
            selection = Selection(
                "clarify", reason=planned.why_not, question=question, text=question, model=selection.model,
                prompt=selection.prompt, reply=selection.reply, rules=selection.rules, lifts=selection.lifts,
            )  # fmt: skip
        elif goal is None:
            notes.append(f"no goal: {planned.why_not}")
        elif not goal.line_of_sight:
            notes.append(f"the goal faces the {place.label}, but something known stands in between")
    further, here = [], from_xy if goal is None else (goal.x, goal.y)
    for chosen in selection.next:
        further.append(
            serve(home, query, chosen, reasoner, index=index, from_xy=here, robot=robot, rules=rules, agreed=agreed)
        )
        if (last := further[-1].goal) is not None:
            here = (last.x, last.y)
    return Answer(
        query, selection, place, goal, reasoner, index_name, home.detector, home.name, timing_ms, tuple(notes),
        optional(spatial_index, IndexDefaults, "encoder") or None, tuple(further),
    )  # fmt: skip


def plan_for(
    home: Home, place: Place, from_xy: Sequence[float], robot: RobotModel, rules: Sequence[RouteRule]
) -> RoutePlan:
    """Plan a drive in a home with a floor plan, under route rules.

    Args:
        home: The home.
        place: Where to.
        from_xy: Where the robot stands (x, y) in metres.
        robot: The size of the robot.
        rules: The rules that hold for this drive.

    Returns:
        The goal, or why there is none and which rules stand in the way.

    Raises:
        InputError: The start is not a point.
    """
    assert home.grid is not None and home.route_map is not None
    if not rules and not robot.traction:
        return RoutePlan(*plan(home.grid, place, from_xy, robot))
    layers = [traction_layer(robot)] if robot.traction else []
    return plan_route(home.route_map, place, from_xy, robot, rules, layers)


def _quoted(rule: RouteRule) -> str:
    return f" (“{rule.said}”)" if rule.said else ""


@cache
def _embedded() -> Reasoner:
    return plugins.make("reasoners", "embedded")


@contextmanager
def _timed(timing_ms: dict[str, float], step: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    timing_ms[step] = (time.perf_counter() - begin) * 1e3
