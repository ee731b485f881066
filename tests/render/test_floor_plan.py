"""Pictures of the floor plan: what decides their extent, and that their key, title and names hide nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from cartier.home import Home
from cartier.pipeline import map_home
from cartier.render import floor_plan
from cartier.render.extent import shown_extent
from cartier.types import FREE, Answer, OccupancyGrid, Selection
from flat import obj
from synthetic import THINGS, TrueBoxes, walk


@pytest.fixture(scope="module")
def home() -> Home:
    return map_home(walk(), TrueBoxes(THINGS))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are saved."""
    figures: list[Figure] = []
    monkeypatch.setattr(floor_plan, "save_figure", lambda figure, file: figures.append(figure))
    return figures


def with_strays(home: Home) -> Home:
    """The home with a ray of free cells through a window, 10 m long, and an island at its end."""
    grid = home.grid
    assert grid is not None
    cells = np.pad(grid.cells, ((0, 0), (0, 220)), constant_values=-1)
    row = len(cells) // 2
    cells[row : row + 2, grid.cells.shape[1] - 20 : -12] = FREE
    cells[row - 5 : row + 5, -12:-2] = FREE
    heights = np.zeros(cells.shape, np.float16)
    return replace(home, grid=OccupancyGrid(cells, grid.resolution_m, grid.origin_xy, heights))


def test_strays_of_the_grid_do_not_decide_the_extent(home: Home) -> None:
    left, right, low, high = shown_extent(home)
    assert 4.5 < right - left < 5.6 and 3.5 < high - low < 4.6, "the room is 5 m by 4 m"
    assert np.allclose(shown_extent(with_strays(home)), (left, right, low, high), atol=0.15)


def test_an_object_far_away_is_in_the_picture_and_a_tentative_one_is_not(home: Home) -> None:
    far, ghost = obj(90, "lamp", (9, 2, 1), (0.2, 0.2, 0.2)), obj(91, "ghost", (30, 2, 1), (1, 1, 1), probability=0.2)
    right = shown_extent(replace(home, objects=(*home.objects, far, ghost)))[1]
    assert right == pytest.approx(9.1)


def boxes(figure: Figure) -> dict[str, Any]:
    figure.canvas.draw()
    axes, (legend,) = figure.axes[0], figure.legends
    title = figure._suptitle  # type: ignore[attr-defined]
    parts = {"title": title, "legend": legend, "plan": axes, "x": axes.xaxis.label}
    return {name: part.get_window_extent() for name, part in parts.items()}


@pytest.mark.parametrize("words", ["mug", "I would like to have something to drink, and then " * 3])
def test_title_legend_and_plan_do_not_overlap(home: Home, drawn: list[Figure], words: str) -> None:
    answer = Answer(
        words, Selection("not_found", reason="nothing " * 30), None, None, "a reasoner", "object_depth", "a detector",
        home.name,
    )  # fmt: skip
    floor_plan.draw_answer(home, answer, Path("a.png"))
    floor_plan.draw_home(home, Path("a.png"))
    for figure in drawn:
        found = boxes(figure)
        assert found["title"].y0 >= found["plan"].y1 and found["legend"].y1 <= found["x"].y0 + 1, found
        assert found["title"].x1 <= figure.bbox.x1 and home.name in figure._suptitle.get_text()  # type: ignore[attr-defined]
        texts = {text.get_text() for text in figure.legends[0].get_texts()}
        assert {"wall", "furniture", "free floor", "not seen", "start"} <= texts
        assert any(text.get_text().endswith(" m") for text in figure.axes[0].texts), "a scale bar"
