"""The picture of an answer or a home: floor plan, objects, place, goal and path; and beside it the evidence photo."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from cartier.atomic import write_file
from cartier.errors import InputError
from cartier.home import Home
from cartier.types import FREE, OCCUPIED, Answer, OccupancyGrid, Place

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAN_COLOURS = {FREE: (250, 250, 247), OCCUPIED: (74, 78, 89)}
UNKNOWN_COLOUR = (218, 220, 224)
OBJECT, CHOSEN, PATH = "#3b6ea8", "#d1495b", "#1b998b"


def draw_answer(home: Home, answer: Answer, file: Path) -> None:
    """Write a PNG (or whatever the suffix names): the plan with place, goal pose and path; the evidence photo with its box."""
    figure, (left, right) = _figure(2)
    place, goal = answer.place, answer.goal
    _draw_plan(left, home, answer.index, quiet=True, keep_clear=place)
    if goal is not None:
        left.plot(*goal.path.T, color=PATH, lw=2.5, zorder=4, label=f"path, {goal.length_m:.1f} m")
        left.plot(*goal.path[0], "o", color=PATH, ms=7, zorder=4)
        _draw_robot(left, goal.x, goal.y, goal.yaw, home.robot_radius_m)
    if place is not None:
        left.plot(place.position[0], place.position[1], "*", color=CHOSEN, ms=20, mec="white", zorder=6)
        kind = "seen from here" if place.view_yaw is not None else place.label
        left.annotate(
            kind, (place.position[0], place.position[1]), (9, 9), textcoords="offset points", color=CHOSEN, weight="bold", zorder=7,
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.5},
        )  # fmt: skip
        _draw_evidence(right, home, answer)
    else:
        right.axis("off")
        right.text(0.5, 0.5, _outcome(answer), ha="center", va="center", wrap=True, fontsize=13)
    title = textwrap.fill(f"“{_short(answer.query, 150)}”", 90)
    figure.suptitle(title, fontsize=13, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"{_outcome(answer)} · reasoner: {answer.reasoner} · index: {answer.index}")
    _save(figure, file)


def draw_home(home: Home, file: Path, index: str | None = None) -> None:
    """Write a picture of the floor plan with every object of an index."""
    figure, (left,) = _figure(1)
    name, _ = home.index(index)
    _draw_plan(left, home, name, quiet=False)
    _fit(figure, left)
    figure.suptitle(home.name, fontsize=14, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"{len(home.objects)} kinds of object · index: {name}")
    _save(figure, file)


def draw_find(home: Home, words: str, file: Path, index: str | None = None) -> Place:
    """Write a picture of how similar any words are to each spot of the home, and give back the best spot.

    Raises InputError if the index cannot be searched with words.
    """
    from matplotlib.collections import PolyCollection

    name, searched = home.searchable(index)
    place = searched.locate(words)
    centres, cosines, side = searched.similarity(words)
    assert place is not None  # an index that holds nothing is not saved
    figure, (axes,) = _figure(1)
    _draw_plan(axes, home, name, quiet=True, keep_clear=place)
    low, high = np.quantile(cosines, 0.5), max(float(cosines.max()), 1e-6)
    shown = np.argsort(cosines)[len(cosines) // 2 :]  # the best cells last, on top; the lower half says nothing
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * side / 2
    alpha = np.clip((cosines[shown] - low) / max(high - low, 1e-6), 0, 1)
    squares: list[Any] = [*(centres[shown][:, None] + corners)]
    cells = PolyCollection(squares, array=cosines[shown], cmap="YlOrRd", lw=0, alpha=alpha, zorder=1)
    cells.set_clim(low, high)
    axes.add_collection(cells)
    axes.plot(place.position[0], place.position[1], "*", color=CHOSEN, ms=20, mec="white", zorder=6)
    figure.colorbar(cells, ax=axes, label="cosine with the words", shrink=0.8)
    _fit(figure, axes)
    figure.suptitle(textwrap.fill(f"“{_short(words, 100)}”", 60), fontsize=13, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"index: {name} · image features: {searched.encoder}")
    _save(figure, file)
    return place


def write_photo(rgb: npt.NDArray[np.uint8], file: Path) -> None:
    """Write an image (H, W, 3) as the suffix says."""
    from PIL import Image

    Image.fromarray(rgb).save(file)


def _figure(panels: int) -> tuple[Any, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0 * panels, 5.4 if panels > 1 else 6.4), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)
    return figure, list(axes[0])


def _fit(figure: Any, axes: Axes) -> None:
    """As high as the plan is, so that a wide home leaves no white bands."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    figure.set_size_inches(8.5, float(np.clip(7 * (high - low) / (right - left), 3, 9)) + 1.2)


def _draw_plan(axes: Axes, home: Home, index_name: str, quiet: bool, keep_clear: Place | None = None) -> None:
    points = np.array([place.position[:2] for place in _places(home, index_name)] + [home.start_xy])
    if home.grid is not None:
        _draw_grid(axes, home.grid, points)
    else:
        axes.text(0.02, 0.98, "no floor plan: the recording has no depth", transform=axes.transAxes, va="top")
    _draw_names(axes, home, index_name, quiet, keep_clear)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _places(home: Home, index_name: str) -> list[Place]:
    index = home.index(index_name)[1]
    return [place for name in index.names() if (place := index.locate(name)) is not None]


def _draw_names(axes: Axes, home: Home, index_name: str, quiet: bool, keep_clear: Place | None) -> None:
    from matplotlib.patheffects import withStroke

    places = _places(home, index_name)
    points = np.array([place.position[:2] for place in places] + [home.start_xy])
    halo = [withStroke(linewidth=2.5, foreground="white", alpha=0.85)]
    size = 8 if quiet else 9
    named = _without_overlap(places, size, points, keep_clear)
    for place in places:
        axes.plot(*place.position[:2], "o", color=OBJECT, ms=4 if quiet else 6, mec="white", mew=0.5, zorder=3)
        if place in named:
            axes.annotate(
                place.label, (place.position[0], place.position[1]), (4, 3), textcoords="offset points",
                fontsize=size, color=OBJECT, zorder=3, path_effects=halo,
            )  # fmt: skip


def _without_overlap(places: Sequence[Place], size_pt: int, points: Any, keep_clear: Place | None) -> list[Place]:
    """The places whose names can be read: first come, first served, and never over the chosen one."""
    metres_per_pt = max(np.ptp(points[:, 0]), np.ptp(points[:, 1]), 1.0) / 430
    wide, high = 0.58 * size_pt * metres_per_pt, 1.25 * size_pt * metres_per_pt
    taken: list[tuple[float, float, float, float]] = []
    named: list[Place] = []
    for place in ([keep_clear] if keep_clear else []) + [p for p in places if p != keep_clear]:
        x, y = place.position[:2]
        mine = (x, y, x + (len(place.label) + 2) * wide * (1.5 if place is keep_clear else 1), y + high)
        if all(mine[2] < t[0] or mine[0] > t[2] or mine[3] < t[1] or mine[1] > t[3] for t in taken):
            taken.append(mine)
            if place is not keep_clear:  # whose name is written larger, by the caller
                named.append(place)
    return named


def _draw_grid(axes: Axes, grid: OccupancyGrid, points: Any) -> None:
    rgb = np.empty((*grid.cells.shape, 3), np.uint8)
    rgb[:] = UNKNOWN_COLOUR
    for value, colour in PLAN_COLOURS.items():
        rgb[grid.cells == value] = colour
    rows, cols = grid.cells.shape
    x, y = grid.origin_xy
    axes.imshow(
        rgb, origin="lower", extent=(x, x + cols * grid.resolution_m, y, y + rows * grid.resolution_m), zorder=0
    )
    known = np.concatenate([grid.centre(np.argwhere(grid.cells >= 0)), points])
    axes.set_xlim(known[:, 0].min() - 0.3, known[:, 0].max() + 0.3)
    axes.set_ylim(known[:, 1].min() - 0.3, known[:, 1].max() + 0.3)


def _draw_robot(axes: Axes, x: float, y: float, yaw: float, radius_m: float) -> None:
    from matplotlib.patches import Circle

    axes.add_patch(Circle((x, y), radius_m, fc=PATH, ec="white", alpha=0.9, zorder=5))
    tip = 2.2 * radius_m
    axes.annotate(
        "", (x + tip * math.cos(yaw), y + tip * math.sin(yaw)), (x, y), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 2.2, "mutation_scale": 16},
    )  # fmt: skip


def _draw_evidence(axes: Axes, home: Home, answer: Answer) -> None:
    from matplotlib.patches import Rectangle

    assert answer.place is not None
    place = answer.place
    photo = home.keyframe(place)
    axes.axis("off")
    if photo is None:
        axes.text(0.5, 0.5, f"the photo of frame {place.frame} is not in the home", ha="center")
        return
    axes.imshow(photo)
    seen = f"evidence: frame {place.frame}, {place.label}, score {place.score:.2f}{'' if place.sure else ', only glimpsed'}"
    axes.set_title(seen, loc="left", fontsize=10)
    if place.box_xyxy is not None:
        x1, y1, x2, y2 = place.box_xyxy
        axes.add_patch(Rectangle((x1, y1), x2 - x1, y2 - y1, fill=False, ec=CHOSEN, lw=3))


def _outcome(answer: Answer) -> str:
    chosen = answer.selection
    if chosen.status == "clarify":
        return f"asks back: {chosen.question}"
    if chosen.object is None:
        return f"{chosen.status}: {chosen.reason}"
    where = "" if answer.goal else ", no goal"
    how = chosen.status if answer.place is None or answer.place.sure else "only glimpsed"
    return f"{how}: {chosen.object}{where}"


def _caption(figure: Any, home: Home, text: str) -> None:
    figure.supxlabel(
        textwrap.fill(f"{text} · detector: {home.detector}", 130), fontsize=8, color="#555555", x=0.02, ha="left"
    )


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _save(figure: Any, file: Path) -> None:
    buffer = io.BytesIO()
    try:
        figure.savefig(buffer, format=file.suffix.lstrip(".") or "png", dpi=110, bbox_inches="tight")
    except ValueError as error:
        raise InputError(f"cannot draw to {file}: {str(error).splitlines()[0]}") from error
    write_file(file, buffer.getvalue())
