"""A conversation with a home: each request is understood in the context of what was said before."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.contracts import Reasoner
from cartier.home import Home
from cartier.language.names import object_ref, room_ref
from cartier.language.prompts import check_query, recent
from cartier.pipeline import ask
from cartier.planning import check_start
from cartier.types import Answer, RobotModel


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
        goals = [part.goal for part in (answer, *answer.then) if part.goal is not None]
        if goals:
            self.from_xy = (goals[-1].x, goals[-1].y)
        return answer


def robot_turn(answer: Answer) -> str:
    """What the robot has said with an answer, and then with that to the next need: ``cup #12, then kitchen (room 3)``.

    It is the object that was served with its number, or the room; a sentence that was told; the question; or that nothing serves.
    """
    return ", then ".join([_said(answer), *map(robot_turn, answer.then)])


def _said(answer: Answer) -> str:
    chosen, place = answer.selection, answer.place
    if chosen.status == "told":
        return chosen.say if chosen.object_id is None else f"{chosen.say} (#{chosen.object_id})"
    if chosen.object is None:
        return chosen.question or "nothing here serves that"
    if chosen.room is not None:
        return room_ref(chosen.object, chosen.room)
    number = place.object_id if chosen.object_id is None and place is not None else chosen.object_id
    return chosen.object if number is None else object_ref(chosen.object, number)
