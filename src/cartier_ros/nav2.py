"""Nav2 export: a folder with the floor plan, filter masks, zones, a route graph, parameters, and what starts them.

The rules that people gave for all drives go in. What the formats mean is what Nav2's sources do with them (Humble to
Rolling, read in November 2026): map server, costmap filters, vector object server, route server. What no file can say
is named in the parameters' first lines.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.exports.scene import rectangles
from cartier.home import Home
from cartier.home.map_server import pgm, yaml
from cartier.io.atomic import write_file
from cartier.navigation.layers import SLOW, RouteMap, ruled_area
from cartier.types import OccupancyGrid, RobotModel
from cartier.types.route_rules import RouteRule
from cartier_ros._nav2_graph import FORBIDDEN, route_graph

UNWANTED = 50  # of 100, as Nav2's masks have it: what costs more
SLOW_PERCENT = 100 * SLOW  # of full speed
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
    contents = files(site, home.rules, home.start_xy)
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("graph.geojson", "vector_objects.yaml"):  # of an export before this one
        (folder / name).unlink(missing_ok=True)
    for name, data in contents.items():
        write_file(folder / name, data)
    return [folder / name for name in contents]


def files(site: RouteMap, rules: Sequence[RouteRule], start_xy: Sequence[float]) -> dict[str, bytes]:
    """The contents of the folder by file name, for drives from a start (x, y) in metres.

    Nav2 does not start with a graph without edges, nor with a shape without a type: where there is no edge or no zone,
    there is no such file.
    """
    radius_m = RobotModel.radius_m
    areas = areas_of(rules, site)
    speed = np.where(areas.slow, 100 - SLOW_PERCENT, 0).astype(np.uint8)
    graph, left_out = route_graph(site, areas.cost, start_xy, radius_m)
    found = {
        "map.pgm": pgm(site.grid), "map.yaml": yaml(site.grid, "map.pgm"),
        "keepout.pgm": mask_pgm(areas.cost), "keepout.yaml": mask_yaml(site.grid, "keepout.pgm"),
        "speed.pgm": mask_pgm(speed), "speed.yaml": mask_yaml(site.grid, "speed.pgm"),
        "params.yaml": parameters(areas, (*areas.left_out, *left_out), radius_m).encode(),
        "filters.launch.yaml": LAUNCH.encode(),
    }  # fmt: skip
    if graph["features"]:
        found["graph.geojson"] = (json.dumps(graph, indent=1) + "\n").encode()
    if areas.zones:
        found["vector_objects.yaml"] = "".join([VECTOR_OBJECTS, *_shapes(site.grid, areas)]).encode()
    return found


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


def parameters(areas: Areas, left_out: Sequence[str], radius_m: float) -> str:
    """The parameters of the filters' servers, of both costmaps and of the route server, as YAML."""
    return "".join([
        "# Written by cartier for Nav2: filters.launch.yaml starts the filters' servers with it; merge the costmaps'\n"
        f"# and the route server's part into your own parameters. The graph is for a radius of {radius_m:.2f} m.\n",
        *(f"# left out: {' '.join(line.split())}\n" for line in left_out),
        *(f"# rule: {rule.text}\n" for rule, _, _ in areas.zones),
        PARAMETERS,
    ])  # fmt: skip


def _shapes(grid: OccupancyGrid, areas: Areas) -> Iterator[str]:
    """The rules' areas for the vector object server."""
    shapes = [
        (f"rule{k}_{n}", value, box)
        for k, (_, area, value) in enumerate(areas.zones) for n, box in enumerate(rectangles(area))
    ]  # fmt: skip
    yield f"    shapes: [{', '.join(name for name, *_ in shapes)}]\n"
    x, y, side = *grid.origin_xy, grid.resolution_m
    for name, value, (row, col, down, across) in shapes:
        low, high = (x + col * side, y + row * side), (x + (col + across) * side, y + (row + down) * side)
        corners = (low[0], low[1], high[0], low[1], high[0], high[1], low[0], high[1])
        yield (
            f"    {name}: {{type: polygon, frame_id: map, closed: true, value: {value}, "
            f"points: [{', '.join(f'{v:.3f}' for v in corners)}]}}\n"
        )


PARAMETERS = """
keepout_filter_mask_server:
  ros__parameters: {topic_name: keepout_filter_mask, frame_id: map}
keepout_costmap_filter_info_server:
  ros__parameters:
    {type: 0, filter_info_topic: keepout_costmap_filter_info, mask_topic: keepout_filter_mask, base: 0.0,
     multiplier: 1.0}
speed_filter_mask_server:
  ros__parameters: {topic_name: speed_filter_mask, frame_id: map}
speed_costmap_filter_info_server: # percent of full speed is 100 - mask
  ros__parameters:
    {type: 1, filter_info_topic: speed_costmap_filter_info, mask_topic: speed_filter_mask, base: 100.0,
     multiplier: -1.0}
lifecycle_manager_filters:
  ros__parameters:
    autostart: true
    node_names: [keepout_filter_mask_server, keepout_costmap_filter_info_server, speed_filter_mask_server,
                 speed_costmap_filter_info_server]
global_costmap:
  global_costmap:
    ros__parameters:
      filters: [keepout_filter, speed_filter]
      keepout_filter:
        {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: keepout_costmap_filter_info}
      speed_filter:
        {plugin: "nav2_costmap_2d::SpeedFilter", enabled: true, filter_info_topic: speed_costmap_filter_info,
         speed_limit_topic: speed_limit}
local_costmap:
  local_costmap:
    ros__parameters:
      filters: [keepout_filter]
      keepout_filter:
        {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true, filter_info_topic: keepout_costmap_filter_info}
route_server: # AdjustSpeedLimit is left out: at each edge it would lift the limit that the speed filter has set
  ros__parameters:
    edge_cost_functions: [DistanceScorer, PenaltyScorer]
    DistanceScorer: {plugin: "nav2_route::DistanceScorer"}
    PenaltyScorer: {plugin: "nav2_route::PenaltyScorer", penalty_tag: penalty}
    operations: [ReroutingService]
    ReroutingService: {plugin: "nav2_route::ReroutingService"}
"""

LAUNCH = """\
# Written by cartier, for Nav2 of Humble and Jazzy; from Kilted on, bringup_launch.py starts these servers itself.
launch:
- node:
    pkg: nav2_map_server
    exec: map_server
    name: keepout_filter_mask_server
    param: [{from: $(dirname)/params.yaml}, {name: yaml_filename, value: $(dirname)/keepout.yaml}]
- node:
    pkg: nav2_map_server
    exec: costmap_filter_info_server
    name: keepout_costmap_filter_info_server
    param: [{from: $(dirname)/params.yaml}]
- node:
    pkg: nav2_map_server
    exec: map_server
    name: speed_filter_mask_server
    param: [{from: $(dirname)/params.yaml}, {name: yaml_filename, value: $(dirname)/speed.yaml}]
- node:
    pkg: nav2_map_server
    exec: costmap_filter_info_server
    name: speed_costmap_filter_info_server
    param: [{from: $(dirname)/params.yaml}]
- node:
    pkg: nav2_lifecycle_manager
    exec: lifecycle_manager
    name: lifecycle_manager_filters
    param: [{from: $(dirname)/params.yaml}]
"""

VECTOR_OBJECTS = """\
# The keepout areas again, as polygons that services can move: for Nav2 from Lyrical on, in place of the keepout mask.
costmap_filter_info_server:
  ros__parameters:
    {type: 0, filter_info_topic: keepout_costmap_filter_info, mask_topic: vo_map, base: 0.0, multiplier: 1.0}
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
