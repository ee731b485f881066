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
from cartier.types import FREE, OCCUPIED, Answer, Goal, MapObject, OccupancyGrid, Place, RobotModel, Room

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLAN_COLOURS = {FREE: (250, 250, 247), OCCUPIED: (74, 78, 89)}
UNKNOWN_COLOUR = (218, 220, 224)
OBJECT, CHOSEN, PATH, INK = "#3b6ea8", "#d1495b", "#1b998b", "#333333"
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
MARGIN_M = 0.4


def draw_answer(home: Home, answer: Answer, file: Path, robot: RobotModel | None = None) -> None:
    """Write an image in the format of the suffix: the plan with goal pose and path, and the evidence photo."""
    figure, (left, right) = _figure(2, (14.0, 5.4))
    place, goal = answer.place, answer.goal
    draw_plan(left, home)
    _draw_path(left, place, goal, robot or RobotModel())
    if place is not None:
        _draw_evidence(right, home, place)
    else:
        right.axis("off")
        right.text(0.5, 0.5, textwrap.fill(_outcome(answer), 60), ha="center", va="center", fontsize=13)
    title = textwrap.fill(f"“{_short(answer.query, 150)}”", 90)
    figure.suptitle(title, fontsize=13, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"{_outcome(answer)} · reasoner: {answer.reasoner} · index: {answer.index}")
    save_figure(figure, file)


def plan_jpeg(home: Home, place: Place, goal: Goal | None, robot: RobotModel) -> bytes:
    """The floor plan with a place, its goal pose and path, as a JPEG of at most 700 pixels."""
    left, right, low, high = _extent(home)
    scale = 6.3 / max(right - left, high - low)
    figure, (axes,) = _figure(1, ((right - left) * scale, (high - low) * scale))
    draw_plan(axes, home)
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
    figure, (axes,) = _figure(1, (wide, wide * (high - low) / (right - left) + 1.2))
    draw_plan(axes, home)
    _draw_boxes(axes, objs)
    figure.suptitle(home.name, fontsize=14, x=0.02, ha="left", weight="bold")
    tentative = len(home.objects) - len(objs)
    _caption(figure, home, f"{len(objs)} objects of {len(home.names)} kinds, {tentative} more tentative")
    figure.canvas.draw()  # positions must be final before labels are placed
    _label(figure, axes, [(obj.label, obj.position) for obj in objs])
    save_figure(figure, file)


def draw_object(home: Home, file: Path, object_id: int) -> None:
    """Write the best views of an object with their boxes, and its place. Raises InputError for an unknown object."""
    obj = next((o for o in home.objects if object_id == o.id or object_id in o.aliases), None)
    if obj is None:
        raise InputError(f"{home.name} has no object {object_id}")
    figure, (plan, *views) = _figure(1 + len(obj.views), (5.0 * (1 + len(obj.views)), 4.4))
    draw_plan(plan, home)
    _draw_boxes(plan, [obj])
    plan.plot(*obj.position[:2], "*", color=CHOSEN, ms=16, mec="white", zorder=6)
    for axes, view in zip(views, obj.views, strict=True):
        place = Place(view.label, obj.position, view.score, view.frame, view.box_xyxy)
        _draw_evidence(axes, home, place)
    state = "confirmed" if obj.confirmed else "tentative"
    title = f"{obj.label} {obj.id}: {state}, {obj.probability:.0%}"
    figure.suptitle(title, fontsize=13, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"detected in {obj.n_detected} of {obj.n_observable} frames in which it was observable")
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
    figure.suptitle(textwrap.fill(f"“{_short(words, 100)}”", 60), fontsize=13, x=0.02, ha="left", weight="bold")
    _caption(figure, home, f"index: {name} · image features: {searched.encoder}")
    figure.canvas.draw()
    objs = [obj for obj in home.objects if obj.confirmed]
    _label(figure, axes, [(obj.label, obj.position) for obj in objs], every=False)
    save_figure(figure, file)
    return place


def draw_plan(axes: Axes, home: Home, tinted: bool = True) -> None:
    """Draw the floor plan of a home with its rooms, in metres; a line of text if there is none."""
    left, right, low, high = _extent(home)
    if home.grid is not None:
        _draw_grid(axes, home.grid, home.rooms if tinted else ())
        for room in home.rooms if tinted else ():
            x, y = home.grid.centre(label_cell(home.grid, room)).tolist()
            style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 2}
            axes.text(x, y, room.name, color=INK, alpha=0.45, **style)
    else:
        axes.text(0.02, 0.98, "no floor plan: the recording has no depth", transform=axes.transAxes, va="top")
    unit = "m, scale guessed" if home.scale_guessed else "m"
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")


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


def _figure(panels: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, panels, squeeze=False)
    return figure, list(axes[0])


def _extent(home: Home) -> tuple[float, float, float, float]:
    """The extent of a home with a margin: x from, x to, y from, y to."""
    points = [np.array([home.start_xy])]
    points += [np.array([obj.box_min[:2], obj.box_max[:2]]) for obj in home.objects if obj.confirmed]
    if home.grid is not None and (home.grid.cells >= 0).any():
        points.append(home.grid.centre(np.argwhere(home.grid.cells >= 0)))
    every = np.concatenate(points)
    (left, low), (right, high) = every.min(0) - MARGIN_M, every.max(0) + MARGIN_M
    return float(left), float(right), float(low), float(high)


def _draw_grid(axes: Axes, grid: OccupancyGrid, rooms: Sequence[Room]) -> None:
    from matplotlib.colors import to_rgb

    rgb = np.empty((*grid.cells.shape, 3), np.uint8)
    rgb[:] = UNKNOWN_COLOUR
    for value, colour in PLAN_COLOURS.items():
        rgb[grid.cells == value] = colour
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

    for obj in sorted(objs, key=lambda obj: obj.box_max[2]):  # higher objects are drawn on top
        (x1, y1), (x2, y2) = obj.box_min[:2], obj.box_max[:2]
        if obj.located:
            box = Rectangle((x1, y1), x2 - x1, y2 - y1, fc=OBJECT, ec=OBJECT, alpha=0.25, lw=0, zorder=2.5)
            axes.add_patch(box)
        style = "-" if obj.located else ":"  # dotted: its distance is unknown
        axes.add_patch(Rectangle((x1, y1), x2 - x1, y2 - y1, fill=False, ec=OBJECT, lw=0.8, ls=style, zorder=3))


def _label(figure: Figure, axes: Axes, names: Sequence[tuple[str, Sequence[float]]], every: bool = True) -> None:
    """Write each name beside its place so that none overlap; a line leads from the place to a name far from it.

    A name that finds no room is written smaller; without ``every`` it is left out.
    """
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2, foreground="white")]  # legible on dark cells, too
    frame = axes.get_window_extent()
    taken: list[tuple[float, float, float, float]] = []
    renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    steps = [(r, math.radians(turn)) for r in (7, 14, 24, 38, 56, 80, 110, 150) for turn in range(15, 375, 30)]
    for name, position in sorted(names, key=lambda named: -len(named[0])):
        at = axes.transData.transform(tuple(position[:2]))
        for size in (7.5, 6.0, 5.0) if every else (7.5,):
            text = axes.text(0, 0, name, fontsize=size, color="#1f3f66", zorder=8, path_effects=halo)
            box = text.get_window_extent(renderer)
            wide, tall = box.width + 2, box.height + 1
            spots = (
                (at[0] + r * math.cos(a) - (wide if math.cos(a) < 0 else 0), at[1] + r * math.sin(a) - tall / 2)
                for r, a in steps
            )
            free = next(((x, y) for x, y in spots if _fits(x, y, wide, tall, frame, taken)), None)
            if free is not None:
                break
            text.remove()
        if free is None:
            continue
        taken.append((free[0], free[1], free[0] + wide, free[1] + tall))
        text.set_position(tuple(axes.transData.inverted().transform((free[0] + 1, free[1] + 2))))
        near = np.clip(at, free, (free[0] + wide, free[1] + tall))
        if math.dist(at, near) > 9:
            ends = axes.transData.inverted().transform([at, near])
            axes.plot(*ends.T, color="#1f3f66", lw=0.4, alpha=0.7, zorder=7)
        axes.plot(*position[:2], ".", color="#1f3f66", ms=2.5, zorder=7)


def _fits(x: float, y: float, wide: float, tall: float, frame: Any, taken: Sequence[tuple[float, ...]]) -> bool:
    inside = frame.x0 < x and x + wide < frame.x1 and frame.y0 < y and y + tall < frame.y1
    return inside and all(x + wide < a or c < x or y + tall < b or d < y for a, b, c, d in taken)


def _draw_path(axes: Axes, place: Place | None, goal: Goal | None, robot: RobotModel) -> None:
    if goal is not None:
        axes.plot(*goal.path.T, color=PATH, lw=2.5, zorder=4)
        axes.plot(*goal.path[0], "o", color=PATH, ms=7, zorder=4)
        _draw_robot(axes, goal.x, goal.y, goal.yaw, robot.radius_m)
    if place is not None:
        axes.plot(place.position[0], place.position[1], "*", color=CHOSEN, ms=20, mec="white", zorder=6)
        kind = "seen from here" if place.view_yaw is not None else place.label
        axes.annotate(
            kind, (place.position[0], place.position[1]), (9, 9), textcoords="offset points", color=CHOSEN,
            weight="bold", zorder=7, annotation_clip=False,
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


def _caption(figure: Any, home: Home, text: str) -> None:
    line = textwrap.fill(f"{text} · detector: {home.detector}", int(figure.get_figwidth() * 14))
    figure.supxlabel(line, fontsize=8, color="#555555", x=0.02, ha="left")


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
