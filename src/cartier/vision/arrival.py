"""Arrival: at a goal the object is looked for again, and the next candidate is taken if it is not there.

ConceptGraphs' robot does the same: what the map holds may be gone, and a photograph from the goal shows it large.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartier.errors import ReasonerError
from cartier.geometry import project
from cartier.types import Frame, Goal, MapObject, View, VisualTrace
from cartier.vision import prompt
from cartier.vision.crops import MAX_TOKENS, picture
from cartier.vision.decision import MIN_MARGIN
from cartier.vision.look import barred, question_about, unanswered
from cartier.vision.permission import Look
from cartier.vision.views import MIN_APPARENT_PX, apparent_px

MAX_TRIES = 3
"""Candidates that are driven to for one request."""


@dataclass(frozen=True)
class Arrival:
    """What a drive to a candidate came to.

    Args:
        obj: The candidate.
        goal: Where the robot went.
        drove: What the robot said of the drive.
        said: Whether the camera shows it there.
        why: Why nothing could be told; empty otherwise.
        trace: What was asked, or None if nothing was.
    """

    obj: MapObject
    goal: Goal
    drove: str
    said: Literal["yes", "no", "cannot tell"]
    why: str = ""
    trace: VisualTrace | None = None


def seek(
    allowed: Look,
    candidates: Iterable[tuple[MapObject, Goal]],
    go: Callable[[Goal], str],
    see: Callable[[Goal], Frame],
) -> list[Arrival]:
    """Drive to candidates in turn, at most ``MAX_TRIES``, until one is not denied by what the camera shows there.

    Args:
        allowed: Who may look.
        candidates: Objects with the goals to look at them from, best first; the next one is planned only when it is
            needed.
        go: Drives to a goal; returns what happened.
        see: What the camera shows at a goal.

    Returns:
        The arrivals in their order; the last one is where the robot stays.
    """
    arrivals = []
    for obj, goal in itertools.islice(candidates, MAX_TRIES):
        drove = go(goal)
        arrivals.append(look_there(allowed, obj, goal, drove, see(goal)))
        if arrivals[-1].said != "no":
            break
    return arrivals


def look_there(allowed: Look, obj: MapObject, goal: Goal, drove: str, frame: Frame) -> Arrival:
    """Ask whether a frame that was taken at a goal shows an object where the map has it."""
    box = expected_box(obj, frame)
    if box is None:
        return Arrival(obj, goal, drove, "cannot tell", f"the {obj.label} is not in the camera's view")
    camera, yaw = tuple(map(float, frame.world_from_camera[:3, 3])), goal.yaw
    view = View(frame.index, box, 1.0, obj.label, (box[2] - box[0]) * (box[3] - box[1]), camera, yaw, None)
    if apparent_px(view, (frame.camera.width, frame.camera.height)) < MIN_APPARENT_PX:
        return Arrival(obj, goal, drove, "cannot tell", f"the {obj.label} would be below {MIN_APPARENT_PX:g} px")
    pictures = (picture(obj, view, frame.rgb, MAX_TOKENS),)
    question = question_about(obj.label, "exists", "yes", reason="doubt", objects=(obj.id,))
    if allowed.blur:
        return Arrival(obj, goal, drove, "cannot tell", "nothing is known to blur in what the camera shows")
    if (why := barred(allowed, question, pictures)) is not None:
        return Arrival(obj, goal, drove, "cannot tell", why)
    try:
        reply = allowed.model.look(question, pictures)
    except ReasonerError as error:
        reply = unanswered(allowed.model, pictures, error)
        trace = VisualTrace(question, pictures, reply, "cannot_tell", why=str(error))
        return Arrival(obj, goal, drove, "cannot tell", str(error), trace)
    answer = reply.answers[0]
    if answer.answer not in ("yes", "no") or 2 * answer.certainty - 1 < MIN_MARGIN:
        why = "the vision model cannot tell" if reply.valid else prompt.INVALID
        trace = VisualTrace(question, pictures, reply, "cannot_tell", why=why)
        return Arrival(obj, goal, drove, "cannot tell", why, trace)
    trace = VisualTrace(question, pictures, reply, "told", answer.answer, obj.id, answer.certainty, "seen at the goal")
    return Arrival(obj, goal, drove, "yes" if answer.answer == "yes" else "no", "", trace)


def expected_box(obj: MapObject, frame: Frame) -> tuple[float, float, float, float] | None:
    """Where an object's box should appear in a frame (px), inside of the image; None if it is not in view."""
    corners = np.array(list(itertools.product(*zip(obj.box_min, obj.box_max, strict=True))))
    pixels, depth_m = project(corners, frame.camera, frame.world_from_camera)
    if (depth_m <= 0).any():
        return None
    (x1, y1), (x2, y2) = pixels.min(0), pixels.max(0)
    x1, x2 = np.clip((x1, x2), 0, frame.camera.width)
    y1, y2 = np.clip((y1, y2), 0, frame.camera.height)
    return (float(x1), float(y1), float(x2), float(y2)) if x1 < x2 and y1 < y2 else None
