"""The folder for Nav2, read back by a reader that does what Nav2's code does (nav2_reader.py)."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import nav2_reader
from cartier.errors import InputError
from cartier.exports import export
from cartier.home import Home
from cartier.mapping.rooms import find_rooms
from cartier.navigation.layers import SOFT_AVOID, RouteMap
from cartier.navigation.planning import traversable
from cartier.navigation.search import cheapest
from cartier.pipeline import map_home
from cartier.spatial.doors import find_doors
from cartier.types import OCCUPIED, RobotModel
from cartier.types.route_rules import RouteRule
from cartier_ros import nav2
from nav2_reader import read_mask
from plans import LEFT, RIGHT, Plan, flat
from synthetic import THINGS, TrueBoxes, walk

RADIUS_M = RobotModel.radius_m


@pytest.fixture(scope="module")
def site() -> RouteMap:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    return RouteMap(grid, rooms, (), find_doors(rooms, grid))


def rule(text: str) -> RouteRule:
    return RouteRule.parse(text)


def room_at(site: RouteMap, box: tuple[float, float, float, float]) -> str:
    row, col = site.grid.cell(np.array([[(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]]))[0]
    return next(room.name for room in site.rooms if [row, col] in room.cells.tolist())


def test_scaled_masks_are_read_exactly(site: RouteMap, tmp_path: Path) -> None:
    values = (np.arange(site.grid.cells.size) % 101).reshape(site.grid.cells.shape).astype(np.uint8)
    (tmp_path / "m.pgm").write_bytes(nav2.mask_pgm(values))
    (tmp_path / "m.yaml").write_bytes(nav2.mask_yaml(site.grid, "m.pgm"))
    read, about = read_mask(tmp_path / "m.yaml")
    assert np.abs(read - values).max() == 0 and about["mode"] == "scale"
    assert about["resolution"] == site.grid.resolution_m and about["origin"][:2] == list(site.grid.origin_xy)


def test_rules_become_costs_of_their_cells(site: RouteMap) -> None:
    left, right = room_at(site, LEFT), room_at(site, RIGHT)
    rules = [rule(f"avoid room:{left} hard standing"), rule(f"avoid room:{right} soft standing"),
             rule(f"slow-near room:{right} hard standing")]  # fmt: skip
    areas = nav2.areas_of(rules, site)
    row, col = site.grid.cell(np.array([[1.0, 1.0]]))[0]
    other = tuple(site.grid.cell(np.array([[6.0, 1.0]]))[0])
    assert areas.cost[row, col] == nav2.FORBIDDEN and areas.cost[other] == nav2.UNWANTED
    assert areas.slow[other] and not areas.slow[row, col] and not areas.left_out


@pytest.mark.parametrize(
    "text", ["avoid room:{} hard daily:22:00-06:00", "via room:{} hard standing", "prefer room:{} soft standing"]
)
def test_what_no_mask_can_say_is_named(site: RouteMap, text: str) -> None:
    wish = rule(text.format(room_at(site, LEFT)))
    areas = nav2.areas_of([wish], site)
    assert not areas.cost.any() and areas.left_out[0].startswith(wish.text)


def test_a_rule_that_has_expired_marks_nothing(site: RouteMap) -> None:
    wish = replace(rule(f"avoid room:{room_at(site, LEFT)} hard until:10:00"), made="2020-01-01T08:00:00+00:00")
    assert not nav2.areas_of([wish], site).cost.any()


def exported(folder: Path, site: RouteMap, *rules: str) -> tuple[nav2_reader.Graph, dict[str, Any], list[Any]]:
    """What Nav2 has of a floor plan with rules, after its bring-up."""
    for name, data in nav2.files(site, [rule(text) for text in rules], (1.0, 1.0)).items():
        (folder / name).write_bytes(data)
    graph, shapes, params = nav2_reader.start(folder)
    return graph, params, shapes


def test_nav2_starts_with_and_without_zones(site: RouteMap, tmp_path: Path) -> None:
    _, _, none = exported(tmp_path, site)
    assert not none
    _, _, some = exported(tmp_path, site, f"avoid room:{room_at(site, LEFT)} soft standing")
    assert some


def test_one_room_has_no_graph(tmp_path: Path) -> None:
    grid = Plan().rooms(LEFT).grid()
    (nodes, _), _, _ = exported(tmp_path, RouteMap(grid, find_rooms(grid, ())))
    assert not nodes and not (tmp_path / "graph.geojson").exists()
    assert "left out: the route graph" in (tmp_path / "params.yaml").read_text()


@pytest.mark.parametrize("rules", [(), ("avoid room:{} soft standing", "slow-near room:{} hard standing")])
def test_nav2s_scorers_agree_with_exported_costs(site: RouteMap, tmp_path: Path, rules: tuple[str, ...]) -> None:
    graph, params, _ = exported(tmp_path, site, *(text.format(room_at(site, RIGHT)) for text in rules))
    theirs = nav2_reader.nav2_cost(graph, params["route_server"])
    for begin in graph[0]:
        ours = nav2_reader.routes_from(graph, begin, lambda edge: float(edge["cost"]))
        found = nav2_reader.routes_from(graph, begin, theirs)
        assert ours.keys() == found.keys() == graph[0].keys(), "all are connected"
        assert all(found[end][0] == pytest.approx(ours[end][0], abs=1e-3) for end in ours)


def test_the_graph_route_costs_what_the_grid_path_does(site: RouteMap, tmp_path: Path) -> None:
    text = f"avoid room:{room_at(site, RIGHT)} soft standing"
    graph, params, _ = exported(tmp_path, site, text)
    area = nav2.areas_of([rule(text)], site).cost
    cost = np.where(traversable(site.grid, RADIUS_M), 1 + SOFT_AVOID * (area > 0), np.inf)
    for begin, end in combinations(range(len(site.rooms)), 2):
        cells = [tuple(site.grid.cell(np.array([graph[0][k]]))[0]) for k in (begin, end)]
        goal = np.zeros(cost.shape, bool)
        goal[cells[1]] = True
        found = cheapest(cost, cells[0], [goal])
        routes = nav2_reader.routes_from(graph, begin, nav2_reader.nav2_cost(graph, params["route_server"]))
        assert found is not None
        assert routes[end][0] == pytest.approx(found.cost * site.grid.resolution_m, rel=0.08)
    narrow = min(edge["metadata"]["width"] for edge in graph[1])
    assert narrow == pytest.approx(0.9, abs=0.11), "the door of 0.9 m"


def test_edges_are_straight_lines_over_open_floor(tmp_path: Path) -> None:
    plan = flat().draw((1.5, 0.5, 2.5, 2.5), OCCUPIED, 0.8)  # a table between one room's middle and its door
    grid = plan.grid()
    (nodes, edges), _, _ = exported(tmp_path, RouteMap(grid, find_rooms(grid, ())))
    fits = traversable(grid, RADIUS_M)
    for edge in edges:
        line = np.linspace(nodes[edge["startid"]], nodes[edge["endid"]], 200)
        assert fits[tuple(grid.cell(line).T)].all()
    assert {(edge["endid"], edge["startid"]) for edge in edges} == {(e["startid"], e["endid"]) for e in edges}
    assert min(edge["metadata"]["width"] for edge in edges) == 0.5, "beside the table"


def test_a_forbidden_room_has_no_node(site: RouteMap, tmp_path: Path) -> None:
    right = room_at(site, RIGHT)
    graph, _, _ = exported(tmp_path, site, f"avoid room:{right} hard standing")
    told = (tmp_path / "params.yaml").read_text()
    assert all(x < RIGHT[0] for x, _ in graph[0].values()) and f"left out: room {right}" in told


def test_no_edge_has_a_tag_that_divides_lengths(site: RouteMap, tmp_path: Path) -> None:
    (_, edges), _, _ = exported(tmp_path, site, f"slow-near room:{room_at(site, RIGHT)} hard standing")
    assert all("speed_limit" not in edge["metadata"] for edge in edges), "Nav2's own parameters name this tag"


def test_the_folder_holds_the_homes_rules(tmp_path: Path) -> None:
    map_home(walk(), TrueBoxes(THINGS)).save(tmp_path / "home")
    home = Home.load(tmp_path / "home")
    home, _ = home.correct("rule", f"avoid room:{home.rooms[0].name} soft standing")
    files = export(home, tmp_path / "nav2")
    assert {file.name for file in files} == {path.name for path in (tmp_path / "nav2").iterdir()}
    assert home.grid is not None
    mask, about = read_mask(tmp_path / "nav2/keepout.yaml")
    area = np.zeros(mask.shape, bool)
    area[tuple(home.rooms[0].cells.T)] = True
    assert (mask[area] == nav2.UNWANTED).all() and not mask[~area].any()
    assert read_mask(tmp_path / "nav2/speed.yaml")[0].max() == 0
    plan, plan_about = read_mask(tmp_path / "nav2/map.yaml")
    assert plan.shape == mask.shape and plan_about["origin"] == about["origin"]
    covered = np.zeros(mask.shape, bool)
    for shape in nav2_reader.start(tmp_path / "nav2")[1]:
        assert shape["value"] == nav2.UNWANTED
        x, y = np.array(shape["points"]).reshape(4, 2).T
        (row, col), (last, end) = home.grid.cell(np.array([[x.min(), y.min()], [x.max(), y.max()]]) + 1e-4)
        covered[row:last, col:end] = True
    assert (covered == area).all()
    home, _ = home.correct("undo")
    export(home, tmp_path / "nav2")
    assert not nav2_reader.start(tmp_path / "nav2")[1], "those of the earlier export are gone"


def test_a_home_without_a_floor_plan_is_refused_in_one_line(tmp_path: Path) -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    with pytest.raises(InputError, match="without depth"):
        nav2.write(replace(home, grid=None), tmp_path / "nav2")
    assert not (tmp_path / "nav2").exists()
