"""Nav2 export: a folder with the floor plan, filter masks, zones and a route graph, and one file of parameters.

The rules that people gave for all drives go in. Sources of the formats: Nav2's configuration guide (map server, costmap
filters, vector object server, route server). What a mask cannot say is named in the parameters' first lines.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.exports.scene import rectangles
from cartier.home import Home
from cartier.home.map_server import pgm, yaml
from cartier.io.atomic import write_file
from cartier.navigation.layers import RouteMap, ruled_area
from cartier.navigation.planning import reach, room_middle, traversable
from cartier.navigation.search import cheapest
from cartier.route_rules import RouteRule
from cartier.types import FREE, OccupancyGrid, RobotModel

FOLDER = "nav2"
FORBIDDEN, UNWANTED = 100, 50  # of 100, as Nav2's masks have it: what no path crosses, and what costs more
SLOW_PERCENT = 40.0  # of full speed, as ``navigation.layers.SLOW``
Mask = npt.NDArray[np.bool_]


class Areas(NamedTuple):
    """What rules say of each cell: costs (rows, cols) from 0 to 100, where to be slow, and what no mask can say.

    ``zones`` are the rules' own areas with their costs.
    """

    cost: npt.NDArray[np.uint8]
    slow: Mask
    zones: tuple[tuple[RouteRule, Mask, int], ...]
    left_out: tuple[str, ...]


def write(home: Home, folder: Path) -> list[Path]:
    """Write the folder.

    Args:
        home: The home; it needs depth, and so a floor plan.
        folder: Where to write; it is made.

    Returns:
        The files.

    Raises:
        InputError: The home has no floor plan, or a file cannot be written.
    """
    site = home.route_map
    if site is None:
        raise InputError(f"{home.name} was mapped without depth: it has no floor plan that Nav2 could read")
    radius_m = RobotModel.radius_m
    areas = areas_of(home.rules, site)
    speed = np.where(areas.slow, 100 - SLOW_PERCENT, 0).astype(np.uint8)
    graph = route_graph(site, areas, home.start_xy, radius_m)
    files = {
        "map.pgm": pgm(site.grid), "map.yaml": yaml(site.grid, "map.pgm"),
        "keepout.pgm": mask_pgm(areas.cost), "keepout.yaml": mask_yaml(site.grid, "keepout.pgm"),
        "speed.pgm": mask_pgm(speed), "speed.yaml": mask_yaml(site.grid, "speed.pgm"),
        "graph.geojson": (json.dumps(graph, indent=1) + "\n").encode(),
        "params.yaml": parameters(site.grid, areas, radius_m).encode(),
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        write_file(folder / name, data)
    return [folder / name for name in files]


def areas_of(rules: Sequence[RouteRule], site: RouteMap) -> Areas:
    """The areas of the rules that always hold; those of certain hours, and wishes to pass something, are left out."""
    shape = site.grid.cells.shape
    cost, slow, zones, left_out = np.zeros(shape, np.uint8), np.zeros(shape, bool), [], []
    for rule in rules:
        if rule.scope != "standing" and not (rule.scope.startswith("until") and not rule.expired(_now())):
            left_out.append(f"{rule.text}: holds at certain hours only")
            continue
        try:
            if rule.kind in ("avoid", "keep-away"):
                area, value = ruled_area(rule, site), FORBIDDEN if rule.strength == "hard" else UNWANTED
                cost = np.maximum(cost, np.where(area, value, 0).astype(np.uint8))
                zones.append((rule, area, value))
            elif rule.kind == "slow-near":
                slow |= ruled_area(rule, site)
            else:
                left_out.append(f"{rule.text}: depends on where a drive begins and ends")
        except InputError as error:
            left_out.append(f"{rule.text}: {error}")
    return Areas(cost, slow, tuple(zones), tuple(left_out))


def _now() -> datetime:
    return datetime.now().astimezone()


def mask_pgm(values: npt.NDArray[np.uint8]) -> bytes:
    """A mask of values from 0 to 100 as a PGM that ``mode: scale`` reads exactly; its first row has the largest y."""
    pixels = (255 - np.ceil(values * 2.55)).astype(np.uint8)
    rows, cols = values.shape
    return b"".join([b"P5\n%d %d\n255\n" % (cols, rows), pixels[::-1].tobytes()])


def mask_yaml(grid: OccupancyGrid, image: str) -> bytes:
    """The YAML file of a mask."""
    plain = yaml(grid, image).decode()
    scaled = plain.replace("mode: trinary", "mode: scale").replace("thresh: 0.65", "thresh: 1.0")
    return bytes(scaled.replace("thresh: 0.196", "thresh: 0.0"), "utf-8")


def route_graph(site: RouteMap, areas: Areas, start_xy: Sequence[float], radius_m: float) -> dict[str, Any]:
    """Rooms and doors as the nodes of a graph in the GeoJSON form of nav2_route, with what each edge is like.

    Args:
        site: The floor plan with rooms and doors.
        areas: What rules say of its cells.
        start_xy: Where the robot stands (m); only what it can reach is in the graph.
        radius_m: The robot's radius.

    Returns:
        A FeatureCollection. Edges go both ways and have as ``cost`` the length of the shortest path in metres; their
        metadata are the room's kind as ``class``, the narrowest width, the speed limit in percent and, for what people
        would rather not have crossed, a penalty in metres. What a rule forbids has no edge.
    """
    grid, nodes = site.grid, _nodes(site)
    area = reach(grid, start_xy, radius_m)
    open_cells = traversable(grid, radius_m) & (areas.cost < FORBIDDEN)
    if area is None:
        raise InputError("no floor around the start fits the robot: there is no route graph")
    open_cells &= np.isfinite(area.length_m)
    features = [_node(k, node, _class(site, node)) for k, node in enumerate(nodes)]
    clearance_m, number = _clearance_m(grid), len(nodes)
    for (i, one), (k, other) in combinations(enumerate(nodes), 2):
        shared = sorted(set(one.rooms) & set(other.rooms))
        metadata = _metadata(site, areas, shared[0], (one.xy, other.xy), open_cells, clearance_m) if shared else None
        if metadata is not None:
            features.append(_edge(number, (i, one.xy), (k, other.xy), metadata))
            features.append(_edge(number + 1, (k, other.xy), (i, one.xy), metadata))
            number += 2
    return {"type": "FeatureCollection", "name": "cartier", "features": features}


class _Node(NamedTuple):
    name: str
    xy: tuple[float, float]
    rooms: tuple[int, ...]


def _nodes(site: RouteMap) -> list[_Node]:
    names = {room.id: room.name for room in site.rooms}
    middles = [_Node(room.name, room_middle(room, site.grid), (room.id,)) for room in site.rooms]
    doors = [_Node(f"door of {' and '.join(names[r] for r in door.rooms)}", door.xy, door.rooms) for door in site.doors]
    return middles + doors


def _class(site: RouteMap, node: _Node) -> str:
    return "door" if len(node.rooms) > 1 else next(room.kind for room in site.rooms if room.id == node.rooms[0])


def _metadata(
    site: RouteMap,
    areas: Areas,
    room: int,
    ends: tuple[tuple[float, float], tuple[float, float]],
    open_cells: Mask,
    clearance_m: npt.NDArray[np.float64],
) -> dict[str, Any] | None:
    """What the shortest path between two points is like; None if the robot cannot drive it."""
    grid = site.grid
    begin, end = (_nearest(grid, open_cells, xy) for xy in ends)
    if begin is None or end is None:
        return None
    goal = np.zeros(open_cells.shape, bool)
    goal[end] = True
    found = cheapest(np.where(open_cells, 1 + areas.cost / 100, np.inf), begin, [goal])
    if found is None:
        return None
    cells = tuple(found.cells.T)
    steps_m = np.hypot(*np.diff(grid.centre(found.cells), axis=0).T)
    length_m, unwanted = float(steps_m.sum()), areas.cost[cells][1:] > 0
    return {
        "class": next(each.kind for each in site.rooms if each.id == room), "length": max(round(length_m, 3), 0.01),
        "width": round(2 * float(clearance_m[cells].min()), 3),
        "speed_limit": SLOW_PERCENT if areas.slow[cells].any() else 100.0,
        "penalty": round(float(steps_m[unwanted].sum()), 3),
    }  # fmt: skip


def _nearest(grid: OccupancyGrid, open_cells: Mask, xy: tuple[float, float]) -> tuple[int, int] | None:
    """The open cell within half a metre that is nearest to a point."""
    cells = np.argwhere(open_cells)
    if not len(cells):
        return None
    far = np.hypot(*(grid.centre(cells) - xy).T)
    best = int(far.argmin())
    return (int(cells[best][0]), int(cells[best][1])) if far[best] <= 0.5 else None


def _clearance_m(grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """How far (rows, cols) each cell's centre is from the nearest one that is not free."""
    from scipy.ndimage import distance_transform_edt

    free = np.pad(grid.cells == FREE, 1)
    return np.asarray(distance_transform_edt(free)[1:-1, 1:-1] * grid.resolution_m)


def _node(number: int, node: _Node, kind: str) -> dict[str, Any]:
    about = {"id": number, "frame": "map", "metadata": {"class": kind, "name": node.name}}
    point = {"type": "Point", "coordinates": [round(float(v), 4) for v in node.xy]}
    return {"type": "Feature", "properties": about, "geometry": point}


def _edge(
    number: int, one: tuple[int, Sequence[float]], other: tuple[int, Sequence[float]], metadata: Mapping[str, Any]
) -> dict[str, Any]:
    line = [[round(float(v), 4) for v in xy] for _, xy in (one, other)]
    about = {"id": number, "startid": one[0], "endid": other[0], "cost": metadata["length"], "overridable": True,
             "metadata": dict(metadata)}  # fmt: skip
    return {"type": "Feature", "properties": about, "geometry": {"type": "MultiLineString", "coordinates": [line]}}


def parameters(grid: OccupancyGrid, areas: Areas, radius_m: float) -> str:
    """The parameters of the servers and of both costmaps, as YAML."""
    return "".join([
        "# Written by cartier for Nav2. Start map servers, filter info servers, vector object server and route server\n"
        "# with it from this folder (paths are relative), and merge the costmaps' part into your own parameters.\n",
        *(f"# left out: {line}\n" for line in areas.left_out),
        *(f"# rule: {rule.text}\n" for rule, _, _ in areas.zones),
        SERVERS.format(radius=f"{radius_m:.3f}"), *_shapes(grid, areas),
    ])  # fmt: skip


def _shapes(grid: OccupancyGrid, areas: Areas) -> Iterator[str]:
    """The rules' areas for the vector object server."""
    shapes = [
        (f"rule{k}_{n}", value, box)
        for k, (_, area, value) in enumerate(areas.zones) for n, box in enumerate(rectangles(area))
    ]  # fmt: skip
    yield f"    shapes: [{', '.join(name for name, *_ in shapes)}]\n" if shapes else '    shapes: [""]\n'
    x, y, side = *grid.origin_xy, grid.resolution_m
    for name, value, (row, col, down, across) in shapes:
        low, high = (x + col * side, y + row * side), (x + (col + across) * side, y + (row + down) * side)
        corners = (low[0], low[1], high[0], low[1], high[0], high[1], low[0], high[1])
        yield (
            f"    {name}: {{type: polygon, frame_id: map, closed: true, value: {value}, "
            f"points: [{', '.join(f'{v:.3f}' for v in corners)}]}}\n"
        )


SERVERS = """
map_server:
  ros__parameters: {{yaml_filename: map.yaml, topic_name: map, frame_id: map}}
keepout_filter_mask_server:
  ros__parameters: {{yaml_filename: keepout.yaml, topic_name: keepout_filter_mask, frame_id: map}}
keepout_costmap_filter_info_server:
  ros__parameters:
    {{type: 0, filter_info_topic: keepout_costmap_filter_info, mask_topic: keepout_filter_mask, base: 0.0,
     multiplier: 1.0}}
speed_filter_mask_server:
  ros__parameters: {{yaml_filename: speed.yaml, topic_name: speed_filter_mask, frame_id: map}}
speed_costmap_filter_info_server: # percent of full speed is 100 - mask
  ros__parameters:
    {{type: 1, filter_info_topic: speed_costmap_filter_info, mask_topic: speed_filter_mask, base: 100.0,
     multiplier: -1.0}}
vo_costmap_filter_info_server: # of the vector object server
  ros__parameters:
    {{type: 0, filter_info_topic: vo_costmap_filter_info, mask_topic: vo_map, base: 0.0, multiplier: 1.0}}
lifecycle_manager_costmap_filters:
  ros__parameters:
    autostart: true
    node_names: [map_server, keepout_filter_mask_server, keepout_costmap_filter_info_server, speed_filter_mask_server,
                 speed_costmap_filter_info_server, vector_object_server, vo_costmap_filter_info_server, route_server]
global_costmap:
  global_costmap:
    ros__parameters:
      robot_radius: {radius}
      filters: [keepout_filter, speed_filter, vector_filter]
      keepout_filter:
        {{plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: keepout_costmap_filter_info}}
      speed_filter:
        {{plugin: "nav2_costmap_2d::SpeedFilter", enabled: true, filter_info_topic: speed_costmap_filter_info,
         speed_limit_topic: speed_limit}}
      vector_filter: # the same areas as keepout_filter, as polygons that services can change: enable one of the two
        {{plugin: "nav2_costmap_2d::KeepoutFilter", enabled: false, filter_info_topic: vo_costmap_filter_info}}
local_costmap:
  local_costmap:
    ros__parameters:
      robot_radius: {radius}
      filters: [keepout_filter]
      keepout_filter:
        {{plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: keepout_costmap_filter_info}}
route_server:
  ros__parameters:
    graph_filepath: graph.geojson
    graph_file_loader: GeoJsonGraphFileLoader
    GeoJsonGraphFileLoader: {{plugin: "nav2_route::GeoJsonGraphFileLoader"}}
    edge_cost_functions: [DistanceScorer, PenaltyScorer]
    DistanceScorer: {{plugin: "nav2_route::DistanceScorer", speed_tag: speed_limit}}
    PenaltyScorer: {{plugin: "nav2_route::PenaltyScorer", penalty_tag: penalty}}
    operations: [AdjustSpeedLimit]
    AdjustSpeedLimit: {{plugin: "nav2_route::AdjustSpeedLimit", speed_tag: speed_limit}}
vector_object_server:
  ros__parameters:
    map_topic: vo_map
    global_frame_id: map
    resolution: 0.05
    default_value: -1
    overlay_type: 1 # where areas overlap, the greater cost
    update_frequency: 1.0
    transform_tolerance: 0.1
"""
