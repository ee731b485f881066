from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.navigation.landmarks import directions
from cartier.navigation.layers import KEEP_AWAY_M, SOFT_AVOID, RouteMap, area_of, ruled_area, total, wish_layer
from cartier.navigation.planning import line_of_sight, plan
from cartier.navigation.routes import RoutePlan, plan_route
from cartier.types import Goal, Place, RobotModel
from cartier.types.route_rules import RouteRule, RouteTarget
from route_maps import ROOMS, at, flat, thing

ROBOT = RobotModel(0.2)
STUDY, CUP = (0.5, 1.5), at(7.5, 1.5)


def drive(site: RouteMap, *rules: str, to: Place = CUP, start: tuple[float, float] = STUDY) -> RoutePlan:
    return plan_route(site, to, start, ROBOT, [RouteRule.parse(rule) for rule in rules])


def got(plan: RoutePlan) -> Goal:
    assert plan.goal is not None, plan.why_not
    return plan.goal


def crossed(goal: Goal, area: np.ndarray, site: RouteMap) -> int:
    return int(area[tuple(site.grid.cell(goal.path).T)].sum())


def through(goal: Goal, room: str) -> bool:
    x1, y1, x2, y2 = ROOMS[room]
    return bool(((goal.path >= (x1, y1)) & (goal.path <= (x2, y2))).all(1).any())


def test_without_rules_as_the_plain_planner() -> None:
    site = flat()
    ruled, plain = got(drive(site)), plan(site.grid, CUP, STUDY, ROBOT)[0]
    assert plain is not None and ruled.length_m == pytest.approx(plain.length_m)
    assert (ruled.x, ruled.y, ruled.line_of_sight) == (plain.x, plain.y, plain.line_of_sight)


def test_a_hard_rule_makes_a_detour() -> None:
    site = flat()
    goal = got(drive(site, "avoid door:study|kitchen hard drive"))
    assert through(goal, "hall") and not through(got(drive(site)), "hall")
    assert goal.route is not None and goal.length_m > goal.route.shortest_m + 1
    assert "longer than the shortest" in " ".join(drive(site, "avoid door:study|kitchen hard drive").notes)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 7), st.floats(0, 4), st.floats(0.2, 3), st.floats(0.2, 2), st.booleans())
def test_what_a_hard_rule_forbids_is_never_crossed_unasked(
    x: float, y: float, wide: float, high: float, ruled: bool
) -> None:
    """A goal's path has no cell of it, but where it begins in it; else there is no goal, and the rule is named."""
    site = flat(doors=(("study", "kitchen"),)) if ruled else flat()
    zone = f"avoid zone:{x},{y};{x + wide},{y};{x + wide},{y + high};{x},{y + high} hard drive"
    planned = drive(site, zone)
    area = area_of(RouteRule.parse(zone).target, site)  # type: ignore[arg-type]
    if planned.goal is None:
        assert [rule.text for rule in planned.blocking] == [RouteRule.parse(zone).text]
        assert planned.breach is not None and crossed(planned.breach, area, site) > 0
        return
    inside = area[tuple(site.grid.cell(planned.goal.path).T)]
    assert not inside[int(np.argmin(inside)) :].any() and not inside[-1]


@pytest.mark.parametrize("side_m", [0.4, 0.8, 1.6, 2.6])
def test_a_wish_is_weighed_against_the_detour(side_m: float) -> None:
    """What a path costs is its length and, over what should be avoided, as much again times the weight."""
    site = flat()
    rule = f"avoid zone:2,{1.5 - side_m / 2};3,{1.5 - side_m / 2};3,{1.5 + side_m / 2};2,{1.5 + side_m / 2} soft drive"
    area = area_of(RouteRule.parse(rule).target, site)  # type: ignore[arg-type]

    def price(goal: Goal) -> float:
        steps = np.linalg.norm(np.diff(goal.path, axis=0), axis=1)
        inside = area[tuple(site.grid.cell(goal.path).T)].astype(float)
        return float((steps * (1 + SOFT_AVOID * (inside[1:] + inside[:-1]) / 2)).sum())

    wished = got(drive(site, rule))
    around = drive(site, rule.replace("soft", "hard"))
    others = [got(drive(site))] + ([around.goal] if around.goal is not None else [])
    assert price(wished) <= min(map(price, others)) + 1e-6
    assert side_m > 1 or crossed(wished, area, site) == 0  # a small one is driven around


def test_blocking_rules_are_as_few_as_can_be() -> None:
    site = flat(doors=(("study", "hall"), ("kitchen", "hall")))
    planned = drive(site, "avoid zone:0,0;0.2,0;0.2,0.2 hard drive", "avoid room:hall hard standing")
    assert planned.goal is None and [rule.text for rule in planned.blocking] == ["avoid room:hall hard standing"]
    assert "through the hall" in planned.why_not and planned.breach is not None
    assert planned.breach.route is not None and planned.breach.route.breaks == planned.blocking


def test_the_breach_crosses_as_little_as_can_be() -> None:
    site = flat(doors=(("study", "kitchen"),))
    strip = "avoid zone:2,-1;3,-1;3,2.4;2.2,2.4;2.2,3;2,3 hard drive"  # 1 m wide, 0.2 m near the top
    planned = drive(site, strip)
    assert planned.goal is None and planned.breach is not None
    area = area_of(RouteRule.parse(strip).target, site)  # type: ignore[arg-type]
    assert crossed(planned.breach, area, site) * site.grid.resolution_m < 0.5


def test_a_goal_behind_a_forbidden_room_is_asked_about() -> None:
    """The cup could be reached for from the door, but not as well."""
    planned = drive(flat(), "avoid room:kitchen hard standing")
    assert planned.goal is None and planned.breach is not None and planned.blocking[0].target is not None


def test_places_are_passed_in_their_order() -> None:
    site = flat(thing(1, "sofa", (3.0, 0.2, 3.8, 0.6)), thing(2, "lamp", (0.2, 4.0, 0.4, 4.2)))
    goal = got(drive(site, "via object:2 hard drive", "via object:1 hard drive"))
    cells = site.grid.cell(goal.path)
    lamp, sofa = (ruled_area(RouteRule.parse(f"via object:{k} hard drive"), site)[tuple(cells.T)] for k in (2, 1))
    assert lamp.any() and sofa.any() and int(np.argmax(lamp)) < len(cells) - 1 - int(np.argmax(sofa[::-1]))


def test_objects_are_passed_in_their_room() -> None:
    """Not on the other side of a wall."""
    site = flat(thing(1, "sofa", (3.0, 2.8, 3.8, 3.0)))
    goal = got(drive(site, "via object:1 hard drive", start=(1.5, 4.0), to=at(7.0, 4.0)))
    assert through(goal, "study")


def test_a_long_detour_for_a_wish_is_left_out() -> None:
    site = flat(thing(1, "sofa", (0.1, 0.1, 0.4, 0.3)), doors=(("study", "hall"), ("kitchen", "hall")))
    short = drive(site, "via object:1 soft drive", start=(4.5, 1.5))
    assert not through(got(short), "study") and "long detour" in " ".join(short.notes)
    assert through(got(drive(site, "via object:1 hard drive", start=(4.5, 1.5))), "study")


def test_only_through_a_room() -> None:
    goal = got(drive(flat(), "only-through room:hall hard drive"))
    assert through(goal, "hall")
    inside = got(drive(flat(), "only-through room:hall hard drive", to=at(3.0, 1.0)))
    assert not through(inside, "hall"), "a drive inside of one room asks for nothing"


def test_distance_is_kept() -> None:
    vase = thing(1, "vase", (3.0, 1.4, 3.2, 1.6))
    goal = got(drive(flat(vase), "keep-away object:1 hard drive"))
    away = np.linalg.norm(np.maximum(np.maximum((3.0, 1.4) - goal.path, goal.path - (3.2, 1.6)), 0), axis=1)
    assert away.min() >= KEEP_AWAY_M


def test_slow_near_limits_speed_and_no_length() -> None:
    site = flat(thing(1, "table", (3.0, 0.2, 3.4, 0.6)))
    goal, free = got(drive(site, "slow-near object:1 hard drive")), got(drive(site))
    assert goal.length_m == pytest.approx(free.length_m) and goal.route is not None
    away = np.linalg.norm(np.maximum(np.maximum((3.0, 0.2) - goal.path, goal.path - (3.4, 0.6)), 0), axis=1)
    assert ((goal.route.speed < 1) == (away <= 1.0)).all() and (goal.route.speed < 1).any()


def test_the_short_way_weighs_no_wish() -> None:
    site, wish = flat(), "avoid door:study|kitchen soft standing"
    assert through(got(drive(site, wish)), "hall")
    short = drive(site, wish, "shortest hard drive")
    assert not through(got(short), "hall") and "not weighed" in " ".join(short.notes)
    assert through(got(drive(site, wish.replace("soft", "hard"), "shortest hard drive")), "hall")


def test_floors_are_preferred_and_avoided() -> None:
    site = flat(floors={"tiles": (0, 0, 8, 4.5), "carpet": (1.5, 0.9, 2.5, 3.0)})
    carpet = area_of(RouteTarget("floor", ("carpet",)), site)
    assert crossed(got(drive(site)), carpet, site) > 0
    assert crossed(got(drive(site, "avoid floor:carpet hard drive")), carpet, site) == 0
    assert crossed(got(drive(site, "avoid floor:rug hard drive")), carpet, site) == 0, "a rug may be called a carpet"
    assert crossed(got(drive(site, "prefer floor:tiles hard drive")), carpet, site) == 0


def test_unknown_floor_is_kept_off_or_told() -> None:
    order = "avoid floor:rug hard drive"
    around = flat(floors={"tiles": (0, 0, 8, 4.5), "unknown": (1.5, 0.9, 2.5, 3.0), "rug": (6.5, 0.0, 7.0, 0.3)})
    told = drive(around, order)
    assert crossed(got(told), around.grid.floor_kinds == 0, around) == 0 and not told.doubts
    across = flat(floors={"tiles": (0, 0, 8, 4.5), "unknown": (1.5, -0.5, 2.5, 4.6), "rug": (6.5, 0.0, 7.0, 0.3)})
    ((rule, over_m),) = drive(across, order).doubts
    assert rule.text == order and over_m == pytest.approx(1.0, abs=0.1)
    assert "it may be the rug" in " ".join(drive(across, order).notes)
    assert not drive(across).doubts and not drive(across, order.replace("hard", "soft")).doubts


def test_the_rim_keeps_off_where_there_is_room() -> None:
    site = flat()
    goal = got(drive(site, "avoid zone:2,1;3,1;3,2;2,2 hard drive"))
    near = ((goal.path > (1.85, 0.85)) & (goal.path < (3.15, 2.15))).all(1)
    assert not near.any()


def test_a_robot_leaves_what_it_stands_on() -> None:
    site = flat()
    goal = got(drive(site, "avoid zone:0,1;1,1;1,2;0,2 hard drive"))
    inside = (goal.path[:, 0] < 1.0) & (goal.path[:, 1] > 1.0) & (goal.path[:, 1] < 2.0)
    assert inside[0] and not inside[int(np.argmin(inside)) :].any()


def test_a_robot_leaves_by_the_shortest_way() -> None:
    """Though the whole way would be shorter straight on, and longer inside of what it must leave."""
    site = flat()
    rule = "avoid zone:0,0.5;2.3,0.5;2.3,2.5;0,2.5 hard drive"
    area = area_of(RouteRule.parse(rule).target, site)  # type: ignore[arg-type]
    assert crossed(got(drive(site, rule, start=(1.0, 1.5))), area, site) * site.grid.resolution_m < 1.15


def test_a_goal_that_is_said_to_see_the_place_sees_it() -> None:
    site, seen = flat(), set()
    for x in np.arange(0.3, 9.0, 0.4):
        for y in (0.3, 1.5, 2.7):
            place = at(float(x), y)
            goal = drive(site, to=place).goal
            if goal is not None:
                sees = line_of_sight(site.grid, np.array([goal.x, goal.y]), place, ROBOT.camera_height_m)
                assert goal.line_of_sight == sees
                seen.add(sees)
    assert True in seen


def test_layers_of_a_cell_are_summed() -> None:
    site = flat()
    assert (total([lambda _: np.array(2.0), lambda _: np.array(3.0)], site) == 6).all()


def test_no_goal_lies_where_the_robot_must_not_stay() -> None:
    """It stands in the forbidden area, and so does the place: the goal is beside it."""
    site = flat()
    planned = drive(site, "avoid zone:0,0;2,0;2,3;0,3 hard drive", to=at(1.2, 1.5))
    area = area_of(RouteRule.parse("avoid zone:0,0;2,0;2,3;0,3").target, site)  # type: ignore[arg-type]
    free = got(drive(site, to=at(1.2, 1.5)))
    assert area[tuple(site.grid.cell(np.array([[free.x, free.y]]))[0])], "without the rule it would stop there"
    assert not area[tuple(site.grid.cell(np.array([[got(planned).x, got(planned).y]]))[0])]


def test_a_robot_that_left_does_not_come_back_in() -> None:
    """The hole in what is forbidden is out of it; to go on from there would be to come back in, and is asked."""
    site = flat(doors=(("study", "kitchen"),))
    holed = "0,0;4.2,0;4.2,3;0,3;0,2;2,2;2,2.2;2.4,2.2;2.4,0.8;2,0.8;2,2;0,2"
    planned = drive(site, f"avoid zone:{holed} hard drive")
    assert planned.goal is None and planned.breach is not None


def test_a_rule_about_nothing_is_left_out_and_told() -> None:
    planned = drive(flat(), "avoid object:99 hard standing")
    assert planned.goal is not None and "left out" in planned.notes[0]


def test_other_ways_are_offered() -> None:
    site = flat(floors={"tiles": (0, 0, 8, 4.5), "carpet": (2.2, -0.5, 2.6, 3.0)})
    goal = got(drive(site, "avoid floor:carpet soft drive"))
    assert goal.route is not None and not through(goal, "hall")
    assert [
        other.words for other in goal.route.alternatives if "longer" in other.words and "none of it over" in other.words
    ]
    around = got(drive(site, "avoid floor:carpet hard drive"))
    assert around.route is not None and "shorter" in around.route.alternatives[0].words


def test_directions_name_turns_doors_and_landmarks() -> None:
    site = flat(thing(1, "sofa", (2.2, 2.0, 2.8, 2.6)), thing(2, "shelf", (1.2, 4.0, 1.8, 4.4), 1.8))
    goal = got(drive(site, "only-through room:hall hard drive"))
    assert goal.route is not None
    told = "; ".join(goal.route.directions)
    assert "through the door into the hall" in told and "through the door into the kitchen" in told
    assert "right at the shelf" in told and told.endswith(("in front of you", "on your left", "on your right"))


def test_landmarks_stand_in_the_room_of_the_path() -> None:
    site = flat(thing(1, "stove", (4.3, 2.6, 4.7, 2.95)))
    goal = got(drive(site, "slow-near room:hall hard drive", start=(0.5, 4.0), to=at(7.5, 4.0)))
    assert goal.route is not None and "stove" not in "; ".join(goal.route.directions)


def test_further_cost_layers_are_summed() -> None:
    site = flat()

    def layer(of: RouteMap) -> np.ndarray:
        return 9.0 * area_of(RouteTarget("door", ("study", "kitchen")), of)

    planned = plan_route(site, CUP, STUDY, ROBOT, (), [layer])
    assert planned.goal is not None and through(planned.goal, "hall")


@pytest.mark.parametrize(("side", "y"), [("left", 4.1), ("right", 3.15)])
def test_landmarks_tell_their_side(side: str, y: float) -> None:
    sofa = thing(1, "sofa", (3.4, y, 4.0, y + 0.3))
    path = np.column_stack([np.linspace(0.5, 7.5, 141), np.full(141, 3.8)])
    assert f"past the sofa on your {side}" in "; ".join(directions(path, flat(sofa), CUP))
    back = "; ".join(directions(path[::-1], flat(sofa), CUP))
    assert f"past the sofa on your {'right' if side == 'left' else 'left'}" in back


def test_landmarks_have_a_name_of_their_own() -> None:
    path = np.column_stack([np.linspace(0.5, 7.5, 141), np.full(141, 3.8)])
    one, two = thing(1, "sofa", (2.0, 4.1, 2.6, 4.4)), thing(2, "sofa", (5.0, 4.1, 5.6, 4.4))
    assert "sofa" in "; ".join(directions(path, flat(one), CUP))
    assert "sofa" not in "; ".join(directions(path, flat(one, two), CUP))


def test_farther_away_costs_less() -> None:
    site = flat(thing(1, "stove", (6.0, 1.0, 6.4, 1.4)))
    rule = RouteRule.parse("keep-away object:1 soft drive")
    layer = wish_layer(rule, area_of(rule.target, site))
    assert layer is not None
    cells = site.grid.cell([(6.4 + far_m, 1.2) for far_m in (0.05, 0.35, 0.65, 0.95, 1.35)])
    cost = layer(site)[tuple(cells.T)]
    assert (np.diff(cost[:4]) < -0.5).all() and cost[4] == 0
