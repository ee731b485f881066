"""Floor plans of homes and answers: rooms, objects, goal pose and path, with the photos that are the evidence."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.home import Home
from cartier.io.atomic import write_file
from cartier.labels import number_of
from cartier.render.extent import shown_extent
from cartier.render.plan_key import (
    CHOSEN,
    FREE_FLOOR,
    FURNITURE,
    NOT_SEEN,
    OBJECT,
    PATH,
    WALL,
    WALL_M,
    add_scale_bar,
    add_title_and_key,
)
from cartier.render.plan_labels import write_names
from cartier.render.route_areas import draw_rules
from cartier.types import FREE, OCCUPIED, Answer, Goal, MapObject, OccupancyGrid, Place, RobotModel, Room

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#333333"
ROOM_TINTS = [
    "#8ecae6",
    "#ffd6a5",
    "#caffbf",
    "#e0bbe4",
    "#fdffb6",
    "#ffc6c7",
    "#bde0fe",
    "#d8e2dc",
    "#f1c0e8",
    "#cfbaf0",
]
MARGIN_M = 0.2
PANEL_IN, PHOTO_IN = 4.5, 6.2  # inches: the height of an answer's plan, and the width of its photo
BELOW = 0.07  # of the plan's height, left free below it for the scale bar


def draw_answer(home: Home, answer: Answer, file: Path, robot: RobotModel | None = None) -> None:
    """Write an image in the format of the suffix: the plan with goal pose and path, and the evidence photo."""
    place, goal = answer.place, answer.goal
    x1, x2, y1, y2 = _extent(home, _stops(place, goal))
    wide = float(np.clip(PANEL_IN * (x2 - x1) / (y2 - y1), 3.5, 10))
    figure, (left, right) = _figure(2, (wide + PHOTO_IN, PANEL_IN + 1.5), [wide, PHOTO_IN])
    draw_plan(left, home, also=_stops(place, goal))
    limits = left.get_xlim(), left.get_ylim()
    rules = draw_rules(left, home, answer)
    left.set(xlim=limits[0], ylim=limits[1])
    _draw_path(left, place, goal, robot or RobotModel())
    if place is not None:
        _draw_evidence(right, home, place)
    else:
        right.axis("off")
        right.text(0.5, 0.5, textwrap.fill(_outcome(answer), 60), ha="center", va="center", fontsize=13)
    made = f"{_outcome(answer)} · reasoner: {answer.reasoner} · index: {answer.index}"
    add_title_and_key(
        figure,
        f"{home.name}: “{_short(answer.query, 150)}”",
        _caption(figure, home, made),
        grid=home.grid is not None,
        answer=True,
        more=rules,
    )
    save_figure(figure, file)


def plan_jpeg(home: Home, place: Place, goal: Goal | None, robot: RobotModel) -> bytes:
    """The floor plan with a place, its goal pose and path, as a JPEG of at most 700 pixels."""
    left, right, low, high = _extent(home, _stops(place, goal))
    scale = 6.3 / max(right - left, high - low)
    figure, (axes,) = _figure(1, ((right - left) * scale, (high - low) * scale))
    draw_plan(axes, home, also=_stops(place, goal))
    axes.set_title(_short(home.name, 60), loc="left", fontsize=10, weight="bold")
    _draw_path(axes, place, goal, robot)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="jpeg")
    return buffer.getvalue()


def draw_home(home: Home, file: Path) -> None:
    """Write a picture of the floor plan with its rooms and the box and name of every confirmed object."""
    objs = [obj for obj in home.objects if obj.confirmed]
    left, right, low, high = _extent(home)
    crowded = max(1.0, len(objs) / ((right - left) * (high - low)) / 2)
    size = 1.2 * math.sqrt(crowded)  # inches per metre
    wide = float(np.clip((right - left) * size, 7, 26))
    figure, (axes,) = _figure(1, (wide, wide * (high - low) / (right - left) + 1.3))
    draw_plan(axes, home)
    _draw_boxes(axes, objs)
    tentative = len(home.objects) - len(objs)
    objects, kinds = number_of(len(objs), "object"), number_of(len(home.names), "kind")
    made = f"{objects} of {kinds}, {tentative} more tentative, not drawn"
    add_title_and_key(figure, home.name, _caption(figure, home, made), grid=home.grid is not None, boxes=True)
    figure.canvas.draw()  # positions must be final before labels are placed
    write_names(figure, axes, [(obj.label, obj.position) for obj in objs])
    save_figure(figure, file)


def draw_object(home: Home, file: Path, object_id: int) -> None:
    """Write the best views of an object with their boxes, and its place. Raises InputError for an unknown object."""
    obj = next((o for o in home.objects if object_id == o.id or object_id in o.aliases), None)
    if obj is None:
        raise InputError(f"{home.name} has no object {object_id}")
    figure, (plan, *views) = _figure(1 + len(obj.views), (5.0 * (1 + len(obj.views)), 4.4))
    draw_plan(plan, home, also=[obj.box_min[:2], obj.box_max[:2]])
    _draw_boxes(plan, [obj])
    plan.plot(*obj.position[:2], "*", color=CHOSEN, ms=16, mec="white", zorder=6)
    for axes, view in zip(views, obj.views, strict=True):
        place = Place(view.label, obj.position, view.score, view.frame, view.box_xyxy)
        _draw_evidence(axes, home, place)
    state = "confirmed" if obj.confirmed else "tentative"
    made = f"detected in {obj.n_detected} of {obj.n_observable} frames in which it was observable"
    add_title_and_key(
        figure,
        f"{home.name}: {obj.label} {obj.id}, {state}, {obj.probability:.0%}",
        _caption(figure, home, made),
        grid=home.grid is not None,
        boxes=True,
    )
    save_figure(figure, file)


def draw_find(home: Home, words: str, file: Path, index: str | None = None) -> Place:
    """Write a picture of the similarity of words to each cell of the home; returns the best place.

    Raises InputError if the index cannot be searched with words.
    """
    from matplotlib.collections import PolyCollection

    name, searched = home.searchable(index)
    place = searched.locate(words)
    centres, cosines, side = searched.similarity(words)
    assert place is not None  # an index that holds nothing is not saved
    left, right, bottom, top = _extent(home)
    figure, (axes,) = _figure(1, (9.5, float(np.clip(7 * (top - bottom) / (right - left), 3, 9)) + 1.2))
    draw_plan(axes, home, tinted=False)
    low, high = np.quantile(cosines, 0.5), max(float(cosines.max()), 1e-6)
    shown = np.argsort(cosines)[len(cosines) // 2 :]  # the better half, the best cells last and on top
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * side / 2
    alpha = np.clip((cosines[shown] - low) / max(high - low, 1e-6), 0, 1)
    squares: list[Any] = [*(centres[shown][:, None] + corners)]
    cells = PolyCollection(squares, array=cosines[shown], cmap="YlOrRd", lw=0, alpha=alpha, zorder=1)
    cells.set_clim(low, high)
    axes.add_collection(cells)
    axes.plot(place.position[0], place.position[1], "*", color=CHOSEN, ms=20, mec="white", zorder=6)
    figure.colorbar(cells, ax=axes, label="cosine with the words", shrink=0.8)
    made = f"index: {name} · image features: {searched.encoder}"
    add_title_and_key(
        figure, f"{home.name}: “{_short(words, 100)}”", _caption(figure, home, made), grid=home.grid is not None
    )
    figure.canvas.draw()
    objs = [obj for obj in home.objects if obj.confirmed]
    write_names(figure, axes, [(obj.label, obj.position) for obj in objs], every=False)
    save_figure(figure, file)
    return place


def draw_plan(axes: Axes, home: Home, tinted: bool = True, also: Sequence[Sequence[float]] = ()) -> None:
    """Draw the floor plan of a home (if it has one) with its rooms, start and a scale bar, in metres.

    The picture shows the points ``also``, too.
    """
    left, right, low, high = _extent(home, also)
    if home.grid is not None:
        _draw_grid(axes, home.grid, home.rooms if tinted else ())
        for room in home.rooms if tinted else ():
            x, y = home.grid.centre(label_cell(home.grid, room)).tolist()
            style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 2}
            axes.text(x, y, room.name, color=INK, alpha=0.45, **style)
    else:
        axes.text(0.02, 0.98, "no floor plan: the recording has no depth", transform=axes.transAxes, va="top")
    unit = "m, scale guessed" if home.scale_guessed else "m"
    axes.set_facecolor("#{:02x}{:02x}{:02x}".format(*NOT_SEEN))
    axes.plot(*home.start_xy[:2], "o", color=PATH, mfc="white", mew=2, ms=7, zorder=4)
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    add_scale_bar(axes)


def label_cell(grid: OccupancyGrid, room: Room) -> tuple[int, int]:
    """The cell (row, col) of a room that is farthest from all that is not free: its label hides least there."""
    from scipy.ndimage import distance_transform_edt

    free = np.zeros((grid.cells.shape[0] + 2, grid.cells.shape[1] + 2), bool)
    rows, columns = room.cells.T
    free[rows + 1, columns + 1] = grid.cells[rows, columns] == FREE
    room_m = distance_transform_edt(free)[1:-1, 1:-1]
    at = int(room_m[rows, columns].argmax())
    return int(rows[at]), int(columns[at])


def write_photo(rgb: npt.NDArray[np.uint8], file: Path) -> None:
    """Write an image (H, W, 3) in the format of the suffix."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, file.suffix.lstrip(".").upper().replace("JPG", "JPEG") or "PNG")
    write_file(file, buffer.getvalue())


def _figure(panels: int, size: tuple[float, float], widths: Sequence[float] | None = None) -> tuple[Figure, list[Axes]]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, panels, squeeze=False, width_ratios=widths)
    return figure, list(axes[0])


def _extent(home: Home, also: Sequence[Sequence[float]] = ()) -> tuple[float, float, float, float]:
    """What a picture of a home shows, with a margin and room for the scale bar: x from, x to, y from, y to."""
    left, right, low, high = shown_extent(home)
    xs, ys = [left, right, *(p[0] for p in also)], [low, high, *(p[1] for p in also)]
    margin = MARGIN_M + BELOW * (max(ys) - min(ys))
    return min(xs) - MARGIN_M, max(xs) + MARGIN_M, min(ys) - margin, max(ys) + MARGIN_M


def _stops(place: Place | None, goal: Goal | None) -> list[Sequence[float]]:
    """The points (x, y) that a picture of an answer must show."""
    path = [] if goal is None else [*goal.path, (goal.x, goal.y)]
    return [*([] if place is None else [place.position[:2]]), *path]


def _draw_grid(axes: Axes, grid: OccupancyGrid, rooms: Sequence[Room]) -> None:
    from matplotlib.colors import to_rgb

    rgb = np.empty((*grid.cells.shape, 3), np.uint8)
    rgb[:] = NOT_SEEN
    rgb[grid.cells == FREE] = FREE_FLOOR
    wall = grid.height_m > WALL_M
    rgb[grid.cells == OCCUPIED], rgb[(grid.cells == OCCUPIED) & wall] = FURNITURE, WALL
    for number, room in enumerate(rooms):
        rows, cols = room.cells.T
        tint = np.array(to_rgb(ROOM_TINTS[number % len(ROOM_TINTS)])) * 255
        rgb[rows, cols] = (0.7 * rgb[rows, cols] + 0.3 * tint).astype(np.uint8)
    (height, width), (x, y), side = grid.cells.shape, grid.origin_xy, grid.resolution_m
    axes.imshow(
        rgb, origin="lower", extent=(x, x + width * side, y, y + height * side), zorder=0, interpolation="nearest"
    )


def _draw_boxes(axes: Axes, objs: Sequence[MapObject]) -> None:
    from matplotlib.patches import Rectangle

    def area(obj: MapObject) -> float:
        return (obj.box_max[0] - obj.box_min[0]) * (obj.box_max[1] - obj.box_min[1])

    for obj in sorted(objs, key=area, reverse=True):  # small objects are drawn on top
        (x1, y1), (x2, y2) = obj.box_min[:2], obj.box_max[:2]
        if obj.located:
            box = Rectangle((x1, y1), x2 - x1, y2 - y1, fc=OBJECT, ec=OBJECT, alpha=0.25, lw=0, zorder=2.5)
            axes.add_patch(box)
        style = "-" if obj.located else ":"  # dotted: its distance is unknown
        axes.add_patch(Rectangle((x1, y1), x2 - x1, y2 - y1, fill=False, ec=OBJECT, lw=0.8, ls=style, zorder=3))


def _draw_path(axes: Axes, place: Place | None, goal: Goal | None, robot: RobotModel) -> None:
    if goal is not None:
        axes.plot(*goal.path.T, color=PATH, lw=2.5, zorder=4)
        axes.plot(*goal.path[0], "o", color=PATH, mfc="white", mew=2, ms=7, zorder=4.5)
        _draw_robot(axes, goal.x, goal.y, goal.yaw, robot.radius_m)
    if place is not None:
        axes.plot(place.position[0], place.position[1], "*", color=CHOSEN, ms=20, mec="white", zorder=6)
        kind = "seen from here" if place.view_yaw is not None else place.label
        axes.annotate(
            kind, (place.position[0], place.position[1]), (9, 9), textcoords="offset points", color=CHOSEN,
            weight="bold", zorder=7, clip_on=True,
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.5},
        )  # fmt: skip


def _draw_robot(axes: Axes, x: float, y: float, yaw: float, radius_m: float) -> None:
    from matplotlib.patches import Circle

    axes.add_patch(Circle((x, y), radius_m, fc=PATH, ec="white", alpha=0.9, zorder=5))
    tip = 2.2 * radius_m
    axes.annotate(
        "", (x + tip * math.cos(yaw), y + tip * math.sin(yaw)), (x, y), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 2.2, "mutation_scale": 16},
    )  # fmt: skip


def _draw_evidence(axes: Axes, home: Home, place: Place) -> None:
    from matplotlib.patches import Rectangle

    photo = home.evidence(place)
    axes.axis("off")
    if photo is None:
        axes.text(0.5, 0.5, f"the photo of frame {place.frame} is not in the home", ha="center")
        return
    axes.imshow(photo)
    axes.set_title(f"evidence: frame {place.frame}, {place.label}, score {place.score:.2f}", loc="left", fontsize=10)
    if place.box_xyxy is not None:
        x1, y1, x2, y2 = place.box_xyxy
        axes.add_patch(Rectangle((x1, y1), x2 - x1, y2 - y1, fill=False, ec=CHOSEN, lw=3))


def _outcome(answer: Answer) -> str:
    chosen = answer.selection
    if chosen.status == "clarify":
        return f"asks back: {chosen.question}"
    if chosen.object is None:
        return f"{chosen.status}: {chosen.reason}"
    return f"{chosen.status}: {chosen.object}{'' if answer.goal else ', no goal'}"


def _caption(figure: Figure, home: Home, text: str) -> str:
    """What made the picture, in lines that fit its width."""
    return textwrap.fill(f"{text} · detector: {home.detector}", int(figure.get_figwidth() * 14))


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def save_figure(figure: Any, file: Path) -> None:
    """Write a figure in the format of the suffix (PNG without one). Raises InputError if that is not possible."""
    buffer = io.BytesIO()
    try:
        figure.savefig(buffer, format=file.suffix.lstrip(".") or "png")
    except ValueError as error:
        raise InputError(f"cannot draw to {file}: {str(error).splitlines()[0]}") from error
    write_file(file, buffer.getvalue())
