"""Conversation: requests in order, with the memory of both sides."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.contracts import Reasoner
from cartier.home import Home
from cartier.home.spoken import correct_by_words, keep_rules
from cartier.labels import object_ref, room_ref
from cartier.llm.prompts import check_query, recent
from cartier.navigation.planning import check_start
from cartier.pipeline import ask, serve
from cartier.types import Answer, RobotModel
from cartier.types.route_rules import RouteRule
from cartier.understanding import alarm
from cartier.vision.permission import Look

CORRECTION = "correction"
"""What answers words that correct the home, instead of a reasoner."""


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
        self.rules: tuple[RouteRule, ...] = ()  # of a home that is not saved, and so keeps none itself

    def say(self, words: str) -> Answer:
        """Answer what the person says next; words that raise are not remembered.

        Words that correct a saved home do so, and ``home`` is then the corrected one: "yes, it is there", "that is a
        pencil box", "this is Ben's room", "undo that". Route rules for more than one drive are kept with
        it, too: "never through the bedroom", until they are taken back.

        Args:
            words: What the person says.

        Returns:
            The answer.

        Raises:
            InputError, ReasonerError, BackendError: As ``ask`` does.
        """
        words = check_query(words)
        corrected = correct_by_words(
            self.home, words, self.turns, index=self.index, from_xy=self.from_xy, reasoner=self.reasoner
        )  # fmt: skip
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
                emergency_number=self.emergency_number, look=self.look, rules=self.rules,
            )  # fmt: skip
            self.home, answer = keep_rules(self.home, answer)
            if self.home.store is None:
                parts = [part.selection for part in (answer, *answer.next)]
                ended = [rule for part in parts for rule in part.lifts]
                said = [rule for part in parts for rule in part.rules if rule.stays]
                self.rules = tuple(rule for rule in dict.fromkeys((*self.rules, *said)) if rule not in ended)
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
