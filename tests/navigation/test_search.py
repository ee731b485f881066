from __future__ import annotations

import heapq
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.navigation import search
from cartier.navigation.search import cheapest, shortest

Floats = npt.NDArray[np.float64]


def brute_force(cost: Floats, start: tuple[int, int], passes: list[npt.NDArray[np.bool_]]) -> float:
    """The cost of the cheapest path through the areas in order, by the slowest way; inf if there is none."""
    best, queue = {(0, *start): 0.0}, [(0.0, 0, *start)]
    while queue:
        so_far, k, r, c = heapq.heappop(queue)
        if so_far > best.get((k, r, c), math.inf):
            continue
        if passes[k][r, c]:
            if k == len(passes) - 1:
                return so_far
            if so_far < best.get((k + 1, r, c), math.inf):
                best[k + 1, r, c] = so_far
                heapq.heappush(queue, (so_far, k + 1, r, c))
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                there = (r + dr, c + dc)
                if (dr or dc) and 0 <= there[0] < cost.shape[0] and 0 <= there[1] < cost.shape[1]:
                    then = so_far + math.hypot(dr, dc) * (cost[r, c] + cost[there]) / 2
                    if then < best.get((k, *there), math.inf):
                        best[k, *there] = then
                        heapq.heappush(queue, (then, k, *there))
    return math.inf


def price(cost: Floats, cells: npt.NDArray[np.intp]) -> float:
    steps = np.linalg.norm(np.diff(cells, axis=0), axis=1)
    each = cost[tuple(cells.T)]
    return float((steps * (each[1:] + each[:-1]) / 2).sum())


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_paths_are_the_cheapest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(map(int, rng.integers(2, 26, 2)))
    cost = 1 + rng.integers(0, 5, shape) * rng.random(shape)
    cost[rng.random(shape) < 0.35] = np.inf
    start = int(rng.integers(shape[0])), int(rng.integers(shape[1]))
    cost[start] = 1.0
    passes = [rng.random(shape) < 0.06 for _ in range(int(rng.integers(1, 4)))]
    found, best = cheapest(cost, start, passes), brute_force(cost, start, passes)
    assert (found is None) == math.isinf(best)
    if found is not None:
        assert math.isclose(found.cost, best, rel_tol=1e-9, abs_tol=1e-9)
        assert math.isclose(price(cost, found.cells), best, rel_tol=1e-9, abs_tol=1e-9)
        assert tuple(found.cells[0]) == start and passes[-1][tuple(found.cells[-1])]
        left = 0  # the areas come in their order
        for cell in found.cells:
            while left < len(passes) and passes[left][tuple(cell)]:
                left += 1
        assert left == len(passes)


def test_a_long_detour_is_still_found() -> None:
    """The bound on the path grows until the way around a wall fits into it."""
    cost = np.ones((120, 120))
    cost[1:, 60] = np.inf
    goal = np.zeros(cost.shape, bool)
    goal[119, 119] = True
    found = cheapest(cost, (119, 0), [goal])
    assert found is not None and math.isclose(found.cost, brute_force(cost, (119, 0), [goal]))


def test_a_long_detour_is_cheaper_than_a_dear_way_that_is_found_first() -> None:
    cost = np.ones((120, 42))
    cost[1:, 20] = 150.0
    goal = np.zeros(cost.shape, bool)
    goal[60, 41] = True
    found = cheapest(cost, (60, 0), [goal])
    assert found is not None and found.cost < 140 and math.isclose(found.cost, brute_force(cost, (60, 0), [goal]))


def test_dear_cells_are_no_walls() -> None:
    cost = np.array([[1.0, 500.0, 500.0, 1.0]])
    goal = np.array([[False, False, False, True]])
    found = cheapest(cost, (0, 0), [goal])
    assert found is not None and math.isclose(found.cost, 1001.0)
    assert cheapest(cost, (0, 0), [goal], most=900.0) is None


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_small_and_large_grids_agree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    open_cells = rng.random(tuple(rng.integers(2, 40, 2))) < rng.choice([0.5, 0.8, 0.95, 1.0])
    start = tuple(rng.integers(open_cells.shape).tolist())
    open_cells[start] = True
    with pytest.MonkeyPatch.context() as patch:
        small = shortest(open_cells, start, 0.05)
        patch.setattr(search, "MANY", 0)
        large = shortest(open_cells, start, 0.05)
    np.testing.assert_array_equal(small[0], large[0])
    np.testing.assert_array_equal(small[1], large[1])
