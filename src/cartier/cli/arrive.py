"""Drive with a look on arrival: the object is looked for at the goal, and the next candidate is taken without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from cartier.contracts import Robot
from cartier.home import Home
from cartier.home.looking import name_of
from cartier.pipeline import serve
from cartier.robots import Sent, send
from cartier.types import Answer, Frame, Goal, MapObject, RobotModel, Selection
from cartier.vision.permission import Look


def send_and_look(
    robot: Robot, answer: Answer, home: Home, model: RobotModel, allowed: Look, see: Callable[[Goal], Frame]
) -> Iterator[Sent]:
    """Send an answer's goal; at an object that a photograph from there denies, go on to the next of its label.

    Yields what happened, one thing after the other. Requests of several needs are sent as they are.
    """
    from cartier.vision.arrival import seek

    chosen = answer.selection
    first = next((obj for obj in home.objects if obj.id == chosen.object_id), None)
    if answer.goal is None or chosen.status not in ("found", "likely_near") or first is None or answer.next:
        yield send(robot, answer)
        return
    for arrival in seek(allowed, _candidates(home, first, answer.goal, model), robot.go_to, see):
        yield Sent(arrival.drove)
        if arrival.trace is not None:
            left = arrival.trace.reply is not None and arrival.trace.reply.times_sent > 0
            went = "a photograph from the goal went to" if left else "no photograph was sent to"
            yield Sent(f"{went} {name_of(allowed.model)}: {arrival.trace.question.words}")
        told = {"yes": "is there", "no": "is not there", "cannot tell": f"could not be looked for: {arrival.why}"}
        yield Sent(f"the {arrival.obj.label} ({arrival.obj.id}) {told[arrival.said]}")


def _candidates(home: Home, first: MapObject, goal: Goal, model: RobotModel) -> Iterator[tuple[MapObject, Goal]]:
    """The chosen object, then the others of its label that can be reached from there: sure ones first, then near."""
    yield first, goal
    here = (goal.x, goal.y)
    left = [obj for obj in home.objects if obj.label == first.label and obj.id != first.id]
    while left:
        reached = [(obj, _goal(home, obj, here, model)) for obj in left]
        open_ = [(obj, to) for obj, to in reached if to is not None]
        if not open_:
            return
        obj, to = min(open_, key=lambda pair: (not pair[0].confirmed, pair[1].length_m))
        left.remove(obj)
        here = (to.x, to.y)
        yield obj, to


def _goal(home: Home, obj: MapObject, from_xy: tuple[float, float], model: RobotModel) -> Goal | None:
    chosen = Selection("found", obj.label, reason="the next of its label", object_id=obj.id)
    return serve(home, "", chosen, "arrival", from_xy=from_xy, robot=model, rules=home.rules).goal
