"""Robots that drive to goal poses: one file each, found by name through cartier.plugins; ``send`` calls them."""

from __future__ import annotations

from collections.abc import Callable

from cartier.contracts import DrivingRobot, Robot
from cartier.types import Answer, DriveProgress, Goal

Watch = Callable[[DriveProgress], None]


def send(robot: Robot, answer: Answer, watch: Watch | None = None) -> str:
    """Send an answer's goal pose to a robot; returns a line that says what happened, or why nothing was sent.

    A goal is sent only if the object was ``found`` or is ``likely_near``, and can be reached. Of several needs in one
    request the first with a goal is served, because a second goal would replace the first. With ``watch``, a robot that
    can be watched is until its drive ends; KeyboardInterrupt meanwhile stops the robot.
    Raises BackendError or InputError if the robot is not there or cannot take the goal.
    """
    first, *further = [answer, *answer.next]
    while first.goal is None and further:
        first, *further = further
    goal = first.goal
    if goal is None or first.selection.status not in ("found", "likely_near"):
        return f"nothing was sent: {_why_not(answer)}"
    waiting = [a.goal.place.label for a in further if a.goal is not None]
    later = f"; after that: {', '.join(waiting)}" if waiting else ""
    driving = watch is not None and isinstance(robot, DrivingRobot)
    return (_driven(robot, goal, watch) if driving else robot.go_to(goal)) + later  # type: ignore[arg-type]


def _driven(robot: DrivingRobot, goal: Goal, watch: Watch) -> str:
    text = "the robot said nothing"
    try:
        for progress in robot.drive(goal):
            text = progress.text
            watch(progress)
    except KeyboardInterrupt:
        return robot.stop()
    return text


def _why_not(answer: Answer) -> str:
    chosen = answer.selection
    if chosen.status == "clarify":
        return f"answer the question first: {chosen.question or 'what do you need?'}"
    if chosen.status == "alarm":
        return chosen.text
    if chosen.status == "not_found":
        return "no object here serves the request"
    if chosen.status == "answered":
        return "the answer is in words"
    why = (note for note in answer.notes if note.startswith("no goal") or " has no place for " in note)
    return next(why, f"the {chosen.object} has no goal")
