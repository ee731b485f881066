"""Route planning under rules: a goal whose path obeys them, or the rule that stands in the way and what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cartier.navigation.layers import CostLayer, RouteMap
from cartier.route_rules import RouteRule
from cartier.types import Goal, Place, RobotModel


@dataclass(frozen=True, eq=False)
class RoutePlan:
    """The outcome of planning under rules.

    ``goal`` is the pose and the way there, or None; ``why_not`` says why there is none. Where hard rules alone stand in
    the way, ``blocking`` is a smallest set of them that would have to be broken, and ``breach`` the goal if they are:
    whoever drives it must have asked. ``notes`` are lines for the person.
    """

    goal: Goal | None
    why_not: str = ""
    blocking: tuple[RouteRule, ...] = ()
    breach: Goal | None = None
    notes: tuple[str, ...] = ()


def plan_route(
    site: RouteMap,
    place: Place,
    start_xy: Sequence[float],
    robot: RobotModel,
    rules: Sequence[RouteRule] = (),
    layers: Sequence[CostLayer] = (),
) -> RoutePlan:
    """A goal for a place whose path obeys the hard rules and weighs the soft ones and the further cost layers.

    Raises InputError for an invalid start or radius, and for a rule about what the home lacks.
    """
    raise NotImplementedError
