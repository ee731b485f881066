"""How a goal leaves: one file each, found by name through cartier.plugins; ``send`` is the one way to use them."""

from __future__ import annotations

from cartier.contracts import Robot
from cartier.types import Answer


def send(robot: Robot, answer: Answer) -> str:
    """Send an answer's goal to a robot, and say in one line what happened, or why there was nothing to send.

    A goal leaves only if something was ``found`` or is ``near``, and only if it can be reached. Of several needs said in one
    breath the first that has a goal is served: a robot that gets a second goal drops the one it is driving to.
    Raises BackendError or InputError if the robot is not there or cannot take the goal.
    """
    first, *further = [answer, *answer.next]
    while first.goal is None and further:
        first, *further = further
    goal = first.goal
    if goal is None or first.selection.status not in ("found", "likely_near"):
        return f"nothing was sent: {_why_not(answer)}"
    waiting = [a.goal.place.label for a in further if a.goal is not None]
    later = f"; still to come, once it is there: {', '.join(waiting)}" if waiting else ""
    return robot.go_to(goal) + later


def _why_not(answer: Answer) -> str:
    chosen = answer.selection
    if chosen.status == "clarify":
        return f"answer the question first: {chosen.question or 'what do you need?'}"
    if chosen.status == "not_found":
        return "nothing here serves the request"
    return next((note for note in answer.notes), f"the {chosen.object} has no goal")
