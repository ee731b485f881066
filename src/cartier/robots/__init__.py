"""Robots that drive to goal poses: one file each, found by name through cartier.plugins; ``send`` calls them."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

from cartier.contracts import DrivingRobot, Robot
from cartier.robots.common.signals import stopped_by_signals
from cartier.types import Answer, DriveProgress

Watch = Callable[[DriveProgress], None]


@dataclass(frozen=True)
class Sent:
    """What became of an answer's goal.

    Args:
        text: One line that says what happened, or why nothing was sent.
        end: How the drive ended, if it was watched.
        signal: The signal that stopped it, such as SIGINT of Ctrl-C.
        goal: Whether there was a goal to send.
    """

    text: str
    end: DriveProgress | None = None
    signal: int | None = None
    goal: bool = True

    @property
    def exit_code(self) -> int:
        """0 if all went well, 1 if the drive failed, 3 if the robot may still drive, 4 without a goal, 128 + the signal
        that stopped."""
        if not self.goal:
            return 4
        status = "arrived" if self.end is None else self.end.status
        stopped = 1 if self.signal is None else 128 + self.signal
        return {"arrived": 0, "failed": 1, "unknown": 3, "stopped": stopped}[status]


def send(robot: Robot, answer: Answer, watch: Watch | None = None) -> Sent:
    """Send an answer's goal pose to a robot.

    A goal is sent only if the object was ``found`` or is ``likely_near``, and can be reached. Of several needs in one
    request the first with a goal is served, because a second goal would replace the first. With ``watch``, a robot that
    can be watched is until its drive ends; Ctrl-C, SIGTERM and a closed terminal meanwhile stop the robot.
    Raises BackendError or InputError if the robot is not there or cannot take the goal.
    """
    first, *further = [answer, *answer.next]
    while first.goal is None and further:
        first, *further = further
    goal = first.goal
    if goal is None or first.selection.status not in ("found", "likely_near"):
        return Sent(f"nothing was sent: {_why_not(answer)}", goal=False)
    waiting = [a.goal.place.label for a in further if a.goal is not None]
    later = f"; after that: {', '.join(waiting)}" if waiting else ""
    if watch is None or not isinstance(robot, DrivingRobot):
        return Sent(robot.go_to(goal) + later)
    end, drive = DriveProgress("unknown", "the robot said nothing"), robot.drive(goal)
    with stopped_by_signals(robot) as came:
        try:
            for end in drive:
                watch(end)
        finally:
            if isinstance(drive, Generator):
                drive.close()  # an exception of who watches stops the robot, too
    return Sent(end.text + later, end, came[0] if came else None)


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
