"""Route graph for Nav2: rooms, doors and the corners between them as GeoJSON, as nav2_route reads and scores it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.navigation.layers import SOFT_AVOID, RouteMap
from cartier.navigation.planning import reach, room_middle
from cartier.navigation.search import cheapest
from cartier.types import FREE, OccupancyGrid

FORBIDDEN = 100  # of 100, as Nav2's masks have it: what no path crosses
DOOR_MOVED_M = 0.5  # how far from its middle a door's node may lie, where the robot fits
SAMPLES = 4  # per cell, of a straight edge
Mask = npt.NDArray[np.bool_]
Cost = npt.NDArray[np.uint8]
Cell = tuple[int, int]


def route_graph(
    site: RouteMap, unwanted: Cost, start_xy: Sequence[float], radius_m: float
) -> tuple[dict[str, Any], list[str]]:
    """Rooms, doors and the corners between them as a graph in the GeoJSON form of nav2_route.

    Nav2 drives an edge as the straight line between its nodes, so that each line here is drivable; DistanceScorer and
    PenaltyScorer make of it the exported ``cost``.

    Args:
        site: The floor plan with rooms and doors.
        unwanted: (rows, cols) from 0 to 100, what rules say of its cells.
        start_xy: Where the robot stands (m); only what it can reach, and no rule forbids, is in the graph.
        radius_m: The robot's radius.

    Returns:
        A FeatureCollection, and a line for each room and door that is not in it. All nodes are connected, and edges go
        both ways; their metadata are the room's kind as ``class``, ``length`` and narrowest ``width`` in metres, and as
        ``penalty`` what crossing unwanted floor is worth in metres. It has no features where fewer than two rooms or
        doors can be reached: Nav2 refuses a graph without edges.
    """
    floor = _floor(site.grid, unwanted, start_xy, radius_m)
    nodes, left_out = _nodes(site, floor)
    lines = _lines(site, nodes, np.where(floor, 1 + SOFT_AVOID * (unwanted > 0), np.inf))
    if not lines:
        return {"type": "FeatureCollection", "features": []}, [*left_out, "the route graph: it would have no edge"]
    cells = dict.fromkeys([*nodes, *(cell for line in lines for cell in line)])
    number = {cell: k for k, cell in enumerate(cells)}
    features = [_node(site.grid, k, cell, nodes.get(cell)) for cell, k in number.items()]
    clearance_m = _clearance_m(site.grid)
    for line, kind in lines.items():
        metadata = _metadata(site.grid, unwanted, clearance_m, line, kind)
        for one, other in (line, line[::-1]):
            features.append(_edge(site.grid, len(features), (number[one], one), (number[other], other), metadata))
    return {"type": "FeatureCollection", "name": "cartier", "features": features}, left_out


class _Node(NamedTuple):
    name: str
    kind: str
    rooms: tuple[int, ...]


def _floor(grid: OccupancyGrid, unwanted: Cost, start_xy: Sequence[float], radius_m: float) -> Mask:
    """The cells (rows, cols) that a robot can reach from the start, over nothing that is forbidden.

    If the start is forbidden, they are the largest part of what can be reached at all.
    """
    from scipy.ndimage import label

    area = reach(grid, start_xy, radius_m)
    if area is None:
        raise InputError("no floor around the start fits the robot: there is no route graph")
    parts, _ = label(np.isfinite(area.length_m) & (unwanted < FORBIDDEN), np.ones((3, 3)))
    largest = int(np.bincount(parts.ravel(), minlength=2)[1:].argmax()) + 1
    return np.asarray(parts == (parts[area.start] or largest))


def _nodes(site: RouteMap, floor: Mask) -> tuple[dict[Cell, _Node], list[str]]:
    """The cells of rooms and doors that a robot can reach, and a line for each other one."""
    grid, names = site.grid, {room.id: room.name for room in site.rooms}
    found, left_out = dict[Cell, _Node](), list[str]()
    for room in site.rooms:
        inside = room.cells[floor[tuple(room.cells.T)]]
        if len(inside):
            found[_nearest(grid, inside, room_middle(room, grid))] = _Node(room.name, room.kind, (room.id,))
        else:
            left_out.append(f"room {room.name}: the robot does not get there, or must not")
    cells = np.argwhere(floor)
    for door in site.doors:
        name = f"door of {' and '.join(names[r] for r in door.rooms)}"
        cell = _nearest(grid, cells, door.xy) if len(cells) else None
        if cell is None or np.hypot(*(grid.centre(np.array(cell)) - door.xy)) > DOOR_MOVED_M:
            left_out.append(f"{name}: the robot does not get there, or must not")
        else:
            found.setdefault(cell, _Node(name, "door", door.rooms))
    return found, left_out


def _nearest(grid: OccupancyGrid, cells: npt.NDArray[np.intp], xy: Sequence[float]) -> Cell:
    row, col = cells[int(np.hypot(*(grid.centre(cells) - xy).T).argmin())].tolist()
    return row, col


def _lines(site: RouteMap, nodes: Mapping[Cell, _Node], cost: npt.NDArray[np.float64]) -> dict[tuple[Cell, Cell], str]:
    """The straight lines of the cheapest paths between nodes, with the kind of the room that each is in.

    Nodes of one room are joined, and then, nearest first, what is not connected yet.
    """
    kinds = {room.id: room.kind for room in site.rooms}
    group = {cell: k for k, cell in enumerate(nodes)}
    found = dict[tuple[Cell, Cell], str]()

    def order(pair: tuple[Cell, Cell]) -> tuple[bool, float]:
        one, other = pair
        return set(nodes[one].rooms).isdisjoint(nodes[other].rooms), float(np.hypot(*np.subtract(one, other)))

    for one, other in sorted(combinations(nodes, 2), key=order):
        shared = sorted(set(nodes[one].rooms) & set(nodes[other].rooms))
        if not shared and group[one] == group[other]:
            continue
        goal = np.zeros(cost.shape, bool)
        goal[other] = True
        path = cheapest(cost, one, [goal])
        assert path is not None, "the floor is connected"
        for line in pairwise(_corners(path.cells, cost)):
            if line[::-1] not in found:
                found.setdefault(line, kinds[shared[0]] if shared else "passage")
        merged = group[other]
        group = {cell: group[one] if number == merged else number for cell, number in group.items()}
    return found


def _corners(path: npt.NDArray[np.intp], cost: npt.NDArray[np.float64]) -> list[Cell]:
    """The cells where a path bends, once each straight line over open cells that costs no more replaces its part."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    each = cost[tuple(path.T)]
    spent = np.concatenate([[0], np.cumsum(steps * (each[1:] + each[:-1]) / 2)])
    kept = [0]
    for k in range(2, len(path)):
        straight = cost[_crossed(path[kept[-1]], path[k])].mean() * np.hypot(*(path[k] - path[kept[-1]]))
        if not straight <= spent[k] - spent[kept[-1]] + 1e-6:
            kept.append(k - 1)
    return [(int(row), int(col)) for row, col in path[[*kept, len(path) - 1]]]


def _crossed(one: Cell, other: Cell) -> tuple[npt.NDArray[np.intp], ...]:
    """The rows and columns at evenly spaced points of the line between the centres of two cells."""
    count = int(SAMPLES * np.abs(np.subtract(one, other)).max()) + 1
    return tuple(np.rint(np.linspace(one, other, count)).astype(np.intp).T)


def _metadata(
    grid: OccupancyGrid, unwanted: Cost, clearance_m: npt.NDArray[np.float64], line: tuple[Cell, Cell], kind: str
) -> dict[str, Any]:
    cells = _crossed(*line)
    length_m = float(np.hypot(*np.subtract(*line))) * grid.resolution_m
    share = float((unwanted[cells] > 0).mean())
    return {
        "class": kind, "length": round(length_m, 4), "width": round(2 * float(clearance_m[cells].min()), 3),
        "penalty": round(SOFT_AVOID * share * length_m, 4),
    }  # fmt: skip


def _clearance_m(grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """How far (rows, cols) each cell's centre is from the nearest one that is not free."""
    from scipy.ndimage import distance_transform_edt

    free = np.pad(grid.cells == FREE, 1)
    return np.asarray(distance_transform_edt(free)[1:-1, 1:-1] * grid.resolution_m)


def _node(grid: OccupancyGrid, number: int, cell: Cell, node: _Node | None) -> dict[str, Any]:
    metadata = {"class": "corner"} if node is None else {"class": node.kind, "name": node.name}
    about = {"id": number, "frame": "map", "metadata": metadata}
    return {"type": "Feature", "properties": about, "geometry": {"type": "Point", "coordinates": _xy(grid, cell)}}


def _edge(
    grid: OccupancyGrid, number: int, one: tuple[int, Cell], other: tuple[int, Cell], metadata: Mapping[str, Any]
) -> dict[str, Any]:
    """An edge; ``overridable``, so that scorers that a user adds (closed doors, costmaps) are asked."""
    about = {"id": number, "startid": one[0], "endid": other[0], "overridable": True,
             "cost": round(metadata["length"] + metadata["penalty"], 4), "metadata": dict(metadata)}  # fmt: skip
    line = [_xy(grid, cell) for _, cell in (one, other)]
    return {"type": "Feature", "properties": about, "geometry": {"type": "MultiLineString", "coordinates": [line]}}


def _xy(grid: OccupancyGrid, cell: Cell) -> list[float]:
    return [round(float(v), 4) for v in grid.centre(np.array(cell))]
