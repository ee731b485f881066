"""The folder for Nav2, read back by readers written from Nav2's documentation, which share no code with the writer."""

from __future__ import annotations

import heapq
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cartier.errors import InputError
from cartier.exports import export, nav2
from cartier.home import Home
from cartier.mapping.rooms import find_rooms
from cartier.navigation.layers import RouteMap
from cartier.navigation.planning import reach
from cartier.pipeline import map_home
from cartier.route_rules import RouteRule
from cartier.spatial.doors import find_doors
from plans import LEFT, RIGHT, flat
from synthetic import THINGS, TrueBoxes, walk

RADIUS_M = 0.2


@pytest.fixture(scope="module")
def site() -> RouteMap:
    grid = flat().grid()
    rooms = find_rooms(grid, ())
    return RouteMap(grid, rooms, (), find_doors(rooms, grid))


def read_mask(file: Path) -> tuple[np.ndarray, dict[str, Any]]:
    """The values (rows, cols) from 0 to 100 that Nav2's map server publishes for a YAML file, least y first."""
    about = yaml.safe_load(file.read_text())
    magic, size, depth, data = (file.parent / about["image"]).read_bytes().split(b"\n", 3)
    assert (magic, depth) == (b"P5", b"255")
    cols, rows = map(int, size.split())
    shade = np.frombuffer(data, np.uint8).reshape(rows, cols)[::-1] / 255
    occupied = shade if about["negate"] else 1 - shade
    high, low = about["occupied_thresh"], about["free_thresh"]
    scaled = np.rint((occupied - low) / (high - low) * 100)
    return np.where(occupied > high, 100, np.where(occupied < low, 0, scaled)).astype(int), about


def read_graph(graph: dict[str, Any]) -> tuple[dict[int, tuple[float, float]], dict[tuple[int, int], dict[str, Any]]]:
    """Nodes and directed edges, with every check of the documented form."""
    assert graph["type"] == "FeatureCollection"
    nodes, edges, ids = {}, {}, set()
    for feature in graph["features"]:
        about, shape = feature["properties"], feature["geometry"]
        assert feature["type"] == "Feature" and type(about["id"]) is int and about["id"] not in ids
        ids.add(about["id"])
        if shape["type"] == "Point":
            assert all(type(v) is float for v in shape["coordinates"])
            nodes[about["id"]] = tuple(shape["coordinates"])
            continue
        assert shape["type"] == "MultiLineString" and type(about["cost"]) is float and about["cost"] > 0
        metadata = about["metadata"]
        assert all(type(metadata[key]) is float for key in ("length", "width", "speed_limit", "penalty"))
        assert type(metadata["class"]) is str
        edges[about["startid"], about["endid"]] = about
    assert nodes and edges and {end for pair in edges for end in pair} <= nodes.keys()
    return nodes, edges


def shortest_m(edges: dict[tuple[int, int], dict[str, Any]], begin: int, end: int) -> float:
    best, queue = {begin: 0.0}, [(0.0, begin)]
    while queue:
        far, node = heapq.heappop(queue)
        for (one, other), about in edges.items():
            if one == node and far + about["cost"] < best.get(other, math.inf):
                best[other] = far + about["cost"]
                heapq.heappush(queue, (best[other], other))
    return best.get(end, math.inf)


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


def test_the_graph_route_is_as_long_as_the_grid_path(site: RouteMap) -> None:
    areas = nav2.areas_of([], site)
    nodes, edges = read_graph(nav2.route_graph(site, areas, (1.0, 1.0), RADIUS_M))
    rooms = [k for k in nodes if k < len(site.rooms)]
    area = reach(site.grid, nodes[rooms[0]], RADIUS_M)
    assert area is not None
    straight = float(area.length_m[tuple(site.grid.cell(np.array([nodes[rooms[1]]]))[0])])
    assert shortest_m(edges, *rooms[:2]) == pytest.approx(straight, rel=0.05)
    assert {(b, a) for a, b in edges} == edges.keys(), "both ways"
    narrow = min(about["metadata"]["width"] for about in edges.values())
    assert narrow == pytest.approx(0.9, abs=0.11), "the door of 0.9 m"


def test_a_forbidden_room_has_no_edges_and_an_unwanted_one_a_penalty(site: RouteMap) -> None:
    right = room_at(site, RIGHT)
    hard = nav2.areas_of([rule(f"avoid room:{right} hard standing")], site)
    number = next(k for k, room in enumerate(site.rooms) if room.name == right)
    graph = nav2.route_graph(site, hard, (1.0, 1.0), RADIUS_M)
    ends = {end for f in graph["features"] if "startid" in (p := f["properties"]) for end in (p["startid"], p["endid"])}
    assert number not in ends
    soft = nav2.areas_of(
        [rule(f"avoid room:{right} soft standing"), rule(f"slow-near room:{right} hard standing")], site
    )
    _, edges = read_graph(nav2.route_graph(site, soft, (1.0, 1.0), RADIUS_M))
    into = [about["metadata"] for (one, other), about in edges.items() if number in (one, other)]
    assert into and all(m["penalty"] > 0 and m["speed_limit"] == nav2.SLOW_PERCENT for m in into)
    away = [about["metadata"] for (one, other), about in edges.items() if number not in (one, other)]
    assert away and all(m["speed_limit"] == 100.0 or m["penalty"] > 0 for m in away)


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
    read_graph_ids = {
        f["properties"]["id"] for f in json.loads((tmp_path / "nav2/graph.geojson").read_text())["features"]
    }
    assert len(read_graph_ids) >= len(home.rooms)
    about_nodes = yaml.safe_load((tmp_path / "nav2/params.yaml").read_text())
    shapes = about_nodes["vector_object_server"]["ros__parameters"]
    covered = np.zeros(mask.shape, bool)
    for name in shapes["shapes"]:
        assert shapes[name]["type"] == "polygon" and shapes[name]["value"] == nav2.UNWANTED
        x, y = np.array(shapes[name]["points"]).reshape(4, 2).T
        (row, col), (last, end) = home.grid.cell(np.array([[x.min(), y.min()], [x.max(), y.max()]]) + 1e-4)
        covered[row:last, col:end] = True
    assert (covered == area).all()
    for server in ("keepout_filter_mask_server", "speed_filter_mask_server", "map_server"):
        assert (tmp_path / "nav2" / about_nodes[server]["ros__parameters"]["yaml_filename"]).is_file()
    assert (tmp_path / "nav2" / about_nodes["route_server"]["ros__parameters"]["graph_filepath"]).is_file()


def test_a_home_without_a_floor_plan_is_refused_in_one_line(tmp_path: Path) -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    with pytest.raises(InputError, match="without depth"):
        nav2.write(replace(home, grid=None), tmp_path / "nav2")
    assert not (tmp_path / "nav2").exists()
