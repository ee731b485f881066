"""Cheapest paths on a grid of costs, past areas in order: exact, over no more cells than can lie on such a path.

Dijkstra on the 8-connected grid. A step costs its length times the mean of its two cells' costs, each 1 or more per
cell side; so the octile distance to the start and on to the goal is a lower bound of any path through a cell, and cells
beyond the best bound are left out (the bound grows until the path found lies below it).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
Cells = npt.NDArray[np.intp]

FIRST_DETOUR, DETOUR_GROWS = 1.15, 1.8  # the bounds tried, in lower bounds of the whole way
SLACK = 20.0  # cells added to each bound
LONGEST = 1.5  # more than the longest step, in cell sides
ROUNDING = 1e-9  # relative
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
MANY = 50_000  # open cells from which importing scipy takes less time than it saves


class CheapestPath(NamedTuple):
    """A path over cells (K, 2) as (row, col), and its cost in cell sides."""

    cells: Cells
    cost: float


def cheapest(
    cost: npt.NDArray[np.float64], start: Sequence[int], passes: Sequence[Mask], most: float = math.inf
) -> CheapestPath | None:
    """The cheapest path from a cell into the last of some areas, through the others in their order.

    Args:
        cost: (rows, cols) the cost of each cell, 1 or more; inf where the path may not go.
        start: The cell (row, col) where it begins.
        passes: Areas (rows, cols); the path touches each, in order, and ends in the last.
        most: The most that a path may cost; no dearer one is searched for.

    Returns:
        The path, or None if there is none.
    """
    boxes = [_box(area & np.isfinite(cost)) for area in passes]
    begin = int(start[0]), int(start[1])
    if any(box is None for box in boxes) or not math.isfinite(cost[begin]):
        return None
    chain = [(begin[0], begin[0], begin[1], begin[1]), *(box for box in boxes if box is not None)]
    least = sum(_between(one, other) for one, other in pairwise(chain))
    dearest = LONGEST * len(passes) * float(cost[np.isfinite(cost)].sum())  # of a path that crosses itself nowhere
    everywhere = min(most, dearest)
    bound = min(FIRST_DETOUR * least + SLACK, everywhere)
    while True:
        found = _within(cost, begin, passes, chain, bound)
        if found is not None or bound >= everywhere:
            return found
        grown = DETOUR_GROWS * bound
        bound = grown if grown < everywhere / 8 else everywhere


def shortest(
    open_cells: Mask, start: tuple[int, int], side: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    """The lengths of the shortest paths from an open cell to all others.

    Args:
        open_cells: (rows, cols) where a path may go.
        start: The cell (row, col) where all begin.
        side: The length of a cell's side.

    Returns:
        The length of the path to each cell, inf where there is none; and the cell before it on the path as
        ``row * cols + col``, -1 at the start and where there is none.
    """
    return (_by_heap if np.count_nonzero(open_cells) < MANY else _by_csgraph)(open_cells, start, side)


def _by_heap(
    open_cells: Mask, start: tuple[int, int], side: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    rows, cols = open_cells.shape
    wide = cols + 2  # a closed cell on each side
    done = bytearray(np.pad(~open_cells, 1, constant_values=True).tobytes())
    steps = [(dr * wide + dc, math.hypot(dr, dc) * side) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]
    begin = (start[0] + 1) * wide + start[1] + 1
    length, previous, waiting = [math.inf] * len(done), [-1] * len(done), [(0.0, -begin)]
    length[begin] = 0.0
    while waiting:
        far, here = heappop(waiting)
        here = -here  # of equally far cells the last comes first, as in scipy
        if done[here]:
            continue
        done[here] = 1
        for step, cost in steps:
            there = here + step
            if not done[there] and far + cost < length[there]:
                length[there], previous[there] = far + cost, here
                heappush(waiting, (far + cost, -there))
    before = np.array(previous, np.int32).reshape(rows + 2, wide)[1:-1, 1:-1]
    before = np.where(before >= 0, (before // wide - 1) * cols + before % wide - 1, -1).astype(np.int32)
    return np.array(length).reshape(rows + 2, wide)[1:-1, 1:-1], before


def _by_csgraph(
    open_cells: Mask, start: tuple[int, int], side: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    cells = np.flatnonzero(open_cells).astype(np.int32)
    number = np.full(open_cells.shape, -1, np.int32)
    number[open_cells] = np.arange(len(cells))
    sources, targets, steps = _edges([number], [], np.full(open_cells.shape, side))
    graph = csr_array((steps, (sources, targets)), shape=(len(cells), len(cells)))
    far, previous = dijkstra(graph, indices=number[start], return_predecessors=True)
    length, before = np.full(open_cells.shape, np.inf), np.full(open_cells.shape, -1, np.int32)
    length[open_cells] = far
    before[open_cells] = np.where(previous >= 0, cells[previous.clip(0)], -1)
    return length, before


def _within(
    cost: npt.NDArray[np.float64],
    start: tuple[int, int],
    passes: Sequence[Mask],
    chain: Sequence[tuple[int, int, int, int]],
    bound: float,
) -> CheapestPath | None:
    """The cheapest path over the cells that a path of at most a cost can use."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    top, left, window = _window(cost.shape, chain, bound)
    cost, areas = cost[window], [area[window] for area in passes]
    boxes = [(a - top, b - top, c - left, d - left) for a, b, c, d in chain]
    numbers, count = list[npt.NDArray[np.int32]](), 0
    for k in range(len(areas)):  # one copy of the cells for each area that is still to come
        usable = np.isfinite(cost) & (_lower_bound(cost.shape, boxes, k) <= bound * (1 + ROUNDING))
        number = np.full(cost.shape, -1, np.int32)
        number[usable] = np.arange(count, count + int(usable.sum()))
        count += int(usable.sum())
        numbers.append(number)
    begin = numbers[0][start[0] - top, start[1] - left]
    ends = numbers[-1][areas[-1]]
    ends = ends[ends >= 0]
    if begin < 0 or not len(ends):
        return None
    rows, cols, weights = _edges(numbers, areas, cost)
    graph = csr_array((weights, (rows, cols)), shape=(count, count))
    far, before = dijkstra(graph, indices=begin, return_predecessors=True, limit=bound * (1 + ROUNDING))
    end = int(ends[np.argmin(far[ends])])
    if not math.isfinite(far[end]):
        return None
    nodes = [end]
    while nodes[-1] != begin:
        nodes.append(int(before[nodes[-1]]))
    cell_of = np.concatenate([np.argwhere(number >= 0) for number in numbers])
    cells = cell_of[nodes[::-1]] + (top, left)
    moved = np.concatenate([[True], (np.diff(cells, axis=0) != 0).any(1)])  # not from one copy to the next
    return CheapestPath(np.asarray(cells[moved], np.intp), float(far[end]))


def _edges(
    numbers: Sequence[npt.NDArray[np.int32]], areas: Sequence[Mask], cost: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Steps between neighbours both ways, and for nothing from each copy of the cells to the next inside its area."""
    rows, cols = cost.shape
    sources, targets, weights = list[npt.NDArray[np.int32]](), list[npt.NDArray[np.int32]](), []
    for number in numbers:
        for dr, dc in STEPS:
            here = slice(0, rows - dr), slice(max(0, -dc), cols - max(0, dc))
            there = slice(dr, rows), slice(max(0, dc), cols + min(0, dc))
            both = (number[here] >= 0) & (number[there] >= 0)
            step = math.hypot(dr, dc) / 2 * (cost[here][both] + cost[there][both])
            sources += [number[here][both], number[there][both]]
            targets += [number[there][both], number[here][both]]
            weights += [step, step]
    for before, after, area in zip(numbers, numbers[1:], areas, strict=False):
        both = area & (before >= 0) & (after >= 0)
        sources.append(before[both])
        targets.append(after[both])
        weights.append(np.zeros(int(both.sum())))
    return np.concatenate(sources), np.concatenate(targets), np.concatenate(weights)


def _lower_bound(shape: tuple[int, ...], boxes: Sequence[tuple[int, int, int, int]], k: int) -> npt.NDArray[np.float64]:
    """The least cost (rows, cols) of a way through each cell between the k-th area and the next."""
    before = sum(_between(one, other) for one, other in pairwise(boxes[: k + 1]))
    after = sum(_between(one, other) for one, other in pairwise(boxes[k + 1 :]))
    return np.asarray(_octile_to(shape, boxes[k]) + _octile_to(shape, boxes[k + 1]) + before + after)


def _octile_to(shape: tuple[int, ...], box: tuple[int, int, int, int]) -> npt.NDArray[np.float64]:
    rows, cols = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
    down = np.maximum(np.maximum(box[0] - rows, rows - box[1]), 0)
    side = np.maximum(np.maximum(box[2] - cols, cols - box[3]), 0)
    return np.asarray(np.maximum(down, side) + (math.sqrt(2) - 1) * np.minimum(down, side))


def _between(one: tuple[int, int, int, int], other: tuple[int, int, int, int]) -> float:
    down = max(one[0] - other[1], other[0] - one[1], 0)
    side = max(one[2] - other[3], other[2] - one[3], 0)
    return max(down, side) + (math.sqrt(2) - 1) * min(down, side)


def _window(
    shape: tuple[int, ...], chain: Sequence[tuple[int, int, int, int]], bound: float
) -> tuple[int, int, tuple[slice, slice]]:
    """The rows and columns that a path of at most a cost can reach, and where they begin."""
    least = sum(_between(one, other) for one, other in pairwise(chain))
    aside = math.ceil((bound - least) / (2 * (math.sqrt(2) - 1))) + 1
    top, left = max(min(box[0] for box in chain) - aside, 0), max(min(box[2] for box in chain) - aside, 0)
    bottom, right = max(box[1] for box in chain) + aside + 1, max(box[3] for box in chain) + aside + 1
    return top, left, (slice(top, min(bottom, shape[0])), slice(left, min(right, shape[1])))


def _box(area: Mask) -> tuple[int, int, int, int] | None:
    """The first and last row and column of an area; None if it is empty."""
    rows, cols = np.flatnonzero(area.any(1)), np.flatnonzero(area.any(0))
    return (int(rows[0]), int(rows[-1]), int(cols[0]), int(cols[-1])) if len(rows) else None
