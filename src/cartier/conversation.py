"""A conversation with a home: each request is understood in the context of what was said before."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.contracts import Reasoner
from cartier.home import Home
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
    """What the robot has said with an answer: the object's name, its question, or that nothing serves; then the next need's."""
    chosen = answer.selection
    said = chosen.object or chosen.question or "nothing here serves that"
    return ", then ".join([said, *map(robot_turn, answer.then)])
