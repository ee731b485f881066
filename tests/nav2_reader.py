"""What Nav2 does with an exported folder, written from the behaviour of its sources; it shares no code with the writer.

map_io.cpp (masks), geojson_graph_file_loader.cpp, distance_scorer.cpp, penalty_scorer.cpp, route_planner.cpp and
vector_object_server.cpp, branches humble to main of November 2026. Names of parameters and their defaults are Nav2's.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

Graph = tuple[dict[int, tuple[float, float]], list[dict[str, Any]]]
Scorer = Callable[[dict[str, Any], Mapping[int, tuple[float, float]]], float]


class Refused(Exception):
    """Nav2 would not start with this."""


def read_mask(file: Path) -> tuple[np.ndarray, dict[str, Any]]:
    """The values (rows, cols), least y first, that map_server publishes for a YAML file: 0 to 100, -1 unknown."""
    about = yaml.safe_load(file.read_text())
    magic, size, depth, data = (file.parent / about["image"]).read_bytes().split(b"\n", 3)
    if (magic, depth) != (b"P5", b"255"):
        raise Refused(f"{file}: no PGM")
    cols, rows = map(int, size.split())
    shade = np.frombuffer(data, np.uint8).reshape(rows, cols)[::-1] / np.float32(255)
    occupied = shade if about["negate"] else 1 - shade
    high, low = about["occupied_thresh"], about["free_thresh"]
    between = np.rint((occupied - low) / (high - low) * 100) if about["mode"] == "scale" else -1
    return np.where(occupied >= high, 100, np.where(occupied <= low, 0, between)).astype(int), about


def read_graph(file: Path | str) -> Graph:
    """Nodes by id, and edges. No file name is no graph; one without nodes or edges stops the bring-up."""
    if not str(file):
        return {}, []
    features = json.loads(Path(file).read_text())["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    edges = [f["properties"] for f in features if f["geometry"]["type"] in ("MultiLineString", "LineString")]
    if not points or not edges:
        raise Refused("the graph does not contain nodes or edges")
    nodes = {}
    for node in points:
        about, (x, y) = node["properties"], node["geometry"]["coordinates"]
        if about.get("frame", "map") != "map":
            raise Refused("a transform that nobody publishes")
        nodes[unsigned(about["id"])] = (float(np.float32(x)), float(np.float32(y)))
    for edge in edges:
        unsigned(edge["id"])
        if not {unsigned(edge["startid"]), unsigned(edge["endid"])} <= nodes.keys():
            raise Refused(f"edge {edge['id']}: a node that does not exist")
    return nodes, edges


def unsigned(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise Refused(f"{value!r} is no id")
    return value


def as_float(edge: dict[str, Any], tag: str, default: float) -> float:
    """A metadata value; one that is written as an integer is another type to std::any_cast<float>, which throws."""
    value = edge.get("metadata", {}).get(tag, default)
    if type(value) is not float:
        raise Refused(f"bad any_cast of {tag}: {value!r}")
    return value


def scorers(route_server: Mapping[str, Any]) -> list[Scorer]:
    """The edge cost functions that parameters ask for; by default the distance."""

    def distance(own: Mapping[str, Any]) -> Scorer:
        tag, weight = own.get("speed_tag", "speed_limit"), own.get("weight", 1.0)

        def score(edge: dict[str, Any], nodes: Mapping[int, tuple[float, float]]) -> float:
            straight = math.dist(nodes[edge["startid"]], nodes[edge["endid"]])
            return float(weight * straight / as_float(edge, tag, 1.0))

        return score

    def penalty(own: Mapping[str, Any]) -> Scorer:
        tag, weight = own.get("penalty_tag", "penalty"), own.get("weight", 1.0)
        return lambda edge, nodes: float(weight * as_float(edge, tag, 0.0))

    kinds = {"nav2_route::DistanceScorer": distance, "nav2_route::PenaltyScorer": penalty}
    names = route_server.get("edge_cost_functions", ["DistanceScorer"])
    own = {"DistanceScorer": {"plugin": "nav2_route::DistanceScorer"}, **route_server}
    return [kinds[own[name]["plugin"]](own[name]) for name in names]


def routes_from(
    graph: Graph, begin: int, cost: Callable[[dict[str, Any]], float]
) -> dict[int, tuple[float, list[int]]]:
    """For each node that is reached, the least cost and the nodes on the way."""
    leaving: dict[int, list[dict[str, Any]]] = {}
    for edge in graph[1]:
        leaving.setdefault(edge["startid"], []).append(edge)
    best, queue = {begin: (0.0, [begin])}, [(0.0, begin)]
    while queue:
        far, node = heapq.heappop(queue)
        if far > best[node][0]:
            continue
        for edge in leaving.get(node, ()):
            other, more = edge["endid"], far + cost(edge)
            if other not in best or more < best[other][0]:
                best[other] = more, [*best[node][1], other]
                heapq.heappush(queue, (more, other))
    return best


def nav2_cost(graph: Graph, route_server: Mapping[str, Any]) -> Callable[[dict[str, Any]], float]:
    """What an edge costs in Nav2: its own cost if it is not overridable, else the sum of the scorers."""
    asked = scorers(route_server)
    return lambda edge: (
        edge["cost"] if not edge.get("overridable", True) else sum(score(edge, graph[0]) for score in asked)
    )


def shapes(vector_object_server: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The shapes with which the vector object server starts; a name without a type is a failure to configure.

    An empty list has no type for rcl's reader of parameters (seen with rclpy 7.1.6 and 9.1.2: PARAMETER_NOT_SET).
    """
    found = []
    if not vector_object_server.get("shapes", ("none",)):
        raise Refused("shapes: a parameter without a type")
    for name in vector_object_server.get("shapes", ()):
        shape = vector_object_server.get(name, {})
        if shape.get("type") not in ("polygon", "circle"):
            raise Refused(f"shape {name!r} has no type")
        points = shape["points"]
        if len(points) < 6 or len(points) % 2 or any(type(v) is not float for v in points):
            raise Refused(f"shape {name!r} has incorrect points")
        found.append(shape)
    return found


def start(folder: Path) -> tuple[Graph, list[dict[str, Any]], dict[str, Any]]:
    """What Nav2 has after its bring-up on a folder: the graph, the shapes, and the parameters by node.

    Every node that the launch file starts must find its parameters and files, and the lifecycle manager its nodes.
    """
    params = {
        name: of.get("ros__parameters", of) for name, of in yaml.safe_load((folder / "params.yaml").read_text()).items()
    }
    names = set()
    for node in (entity["node"] for entity in yaml.safe_load((folder / "filters.launch.yaml").read_text())["launch"]):
        own = dict(params[node["name"]])
        for param in node["param"]:
            if "name" in param:
                own[param["name"]] = param["value"].replace("$(dirname)", str(folder))
            elif not (folder / param["from"].replace("$(dirname)/", "")).is_file():
                raise Refused(f"{node['name']}: no file {param['from']}")
        if node["exec"] == "map_server":
            read_mask(Path(own["yaml_filename"]))
        names.add(node["name"])
    if missing := set(params["lifecycle_manager_filters"]["node_names"]) - names:
        raise Refused(f"the lifecycle manager waits for {missing}")
    for name in params["lifecycle_manager_filters"]["node_names"]:
        if "info" in name and params[name]["mask_topic"] not in {p.get("topic_name") for p in params.values()}:
            raise Refused(f"{name}: nobody publishes its mask")
    vectors = folder / "vector_objects.yaml"
    found = yaml.safe_load(vectors.read_text())["vector_object_server"]["ros__parameters"] if vectors.exists() else {}
    graph = folder / "graph.geojson"
    return read_graph(graph if graph.exists() else ""), shapes(found), params
