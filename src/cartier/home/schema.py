"""Schema of a saved home: type and range of every field, checked when it is read, for a home may come from a stranger.

Right checksums say that nobody changed a home since it was written, not that its writer meant well.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_FAR_M, MAX_TIME_S, brief, need, printable
from cartier.io.files import typed
from cartier.types import Array, MapObject, OccupancyGrid, Room
from cartier.types.route_rules import FLOOR_KINDS

Row = TypeVar("Row")
MAX_NAME_CHARS, MAX_NOTE_CHARS = 1000, 10_000
MAX_ROOMS, MAX_LISTED, MAX_KNOWN = 2000, 1000, 100_000
MAX_COUNT = 2**53  # beyond it, other programs do not read numbers as whole ones
MAX_BOX_PX = 1e6
FAR_M = 2 * MAX_FAR_M  # what is seen lies beyond the camera
SIDES = frozenset(["+x", "-x", "+y", "-y", "+z"])  # of a box along the walls
MIN_CELL_M, MAX_CELL_M = 0.001, 10.0


@dataclass(frozen=True)
class MappedRecording:
    """A recording that a home was mapped from; ``looked`` counts the frames in which objects were detected.

    ``level`` (3 by 4, row by row) took its world to one with z up and the floor at 0, and its images were turned by so
    many quarter ``turns`` to the left. ``mended`` are corrections of its poses: a frame's number, a turn about z (rad)
    and a shift (x, y, z in m).
    ``moved`` is the turn and the shift by which they were brought into the world of the home.
    """

    recording: str
    sha256: str
    frames: int
    looked: int = 0
    level: tuple[float, float, float, float, float, float, float, float, float, float, float, float] | None = None
    turns: int = 0
    mended: tuple[tuple[float, float, float, float, float], ...] = ()
    moved: tuple[float, float, float, float] | None = None
    read_with: dict[str, Any] = field(default_factory=dict)
    live: bool = False  # it was still being recorded


@dataclass(frozen=True)
class Settings:
    """What is known of a home's settings; others may be there, and nothing reads them."""

    recordings: tuple[MappedRecording, ...] = ()
    detector: str = ""
    detector_sha256: str | None = None
    indexes: tuple[str, ...] = ()
    encoder: str | None = None
    knows: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    config: dict[str, dict[str, float]] = field(default_factory=dict)
    scale_guessed: bool = False
    doors: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class GridPlace:
    """Where the floor plan lies: the side of a cell, and the outer corner of cell (0, 0)."""

    resolution_m: float
    origin_xy: tuple[float, float]


@dataclass(frozen=True)
class Manifest:
    """The fields of a home's manifest but for its checksums; ``rooms`` are (id, name, kind)."""

    name: str
    detector: str
    camera: tuple[int, int, float, float, float, float]
    indexes: tuple[str, ...]
    grid: GridPlace | None
    rooms: tuple[tuple[int, str, str], ...]
    start_xy: tuple[float, float]
    settings: dict[str, Any]
    notes: tuple[str, ...]


def manifest_from(about: Mapping[str, Any]) -> Manifest:
    """The checked manifest of a home. Raises InputError, TypeError or ValueError for one that is none."""
    made = _known(about, Manifest)
    settings = _known(made.settings, Settings)
    _check_texts("its name or detector", (made.name, made.detector), MAX_NAME_CHARS)
    _check_texts("indexes", made.indexes, MAX_NAME_CHARS, MAX_LISTED)
    need(0 < len(set(made.indexes)) == len(made.indexes), "it names no index, or one twice")
    _check_texts("notes", made.notes, MAX_NOTE_CHARS, MAX_LISTED)
    _check_texts("settings: doubts", settings.doubts, MAX_NOTE_CHARS, MAX_LISTED)
    _check_texts("settings: knows", settings.knows, MAX_NAME_CHARS, MAX_KNOWN)
    _check_near("start_xy", made.start_xy)
    need(len(settings.doors) <= MAX_LISTED, f"settings: more than {MAX_LISTED} doors")
    _check_near("settings: doors", [value for door in settings.doors for value in door])
    for row in settings.recordings:
        need(
            0 <= row.frames <= MAX_COUNT and 0 <= row.looked <= MAX_COUNT,
            "settings: the frames of a recording are out of range",
        )
    if made.grid is not None:
        _check_near("the floor plan's origin", made.grid.origin_xy)
        sound = MIN_CELL_M <= made.grid.resolution_m <= MAX_CELL_M
        need(sound, f"a cell of the floor plan cannot be {made.grid.resolution_m:g} m wide")
    _check_texts("rooms", [text for _, *texts in made.rooms for text in texts], MAX_NAME_CHARS, 2 * MAX_ROOMS)
    _check_ids("room", [number for number, _, _ in made.rooms])
    return made


def rooms_from(rows: Sequence[tuple[int, str, str]], place_of_cell: Array, grid: OccupancyGrid) -> tuple[Room, ...]:
    """Rooms (id, name, kind) with their cells, from the place of each cell's room in the list (-1 for none)."""
    need(place_of_cell.shape == grid.cells.shape and place_of_cell.dtype.kind == "i", "the cells of rooms fit no plan")
    need(
        grid.height_m.dtype.kind == "f" and bool(np.isfinite(grid.height_m).all()),
        "a height of the floor plan is no number",
    )
    rooms = tuple(
        Room(number, name, kind, np.argwhere(place_of_cell == place).astype(np.int32))
        for place, (number, name, kind) in enumerate(rows)
    )
    need(all(len(room.cells) for room in rooms), "a room has no cells")
    return rooms


def floor_kinds_from(kinds: Array, grid: OccupancyGrid) -> npt.NDArray[np.uint8]:
    """The checked kinds of floor in the cells of a floor plan. Raises InputError for what is none."""
    need(kinds.shape == grid.cells.shape and kinds.dtype == np.uint8, "the kinds of floor fit no plan")
    need(
        int(kinds.max()) < len(FLOOR_KINDS),
        f"a kind of floor is {int(kinds.max())}, where 0 to {len(FLOOR_KINDS) - 1} may be",
    )
    return kinds


def objects_from(rows: Any, rooms: Sequence[Room]) -> tuple[MapObject, ...]:
    """The checked objects of a home. Raises InputError, TypeError or ValueError for what is none."""
    objects: tuple[MapObject, ...] = typed(rows, tuple[MapObject, ...])
    _check_ids("object", [obj.id for obj in objects])
    known = {None, *(room.id for room in rooms)}
    for obj in objects:
        what = f"object {obj.id}"
        need(obj.room in known, f"{what} is in a room that is not there")
        need(0 <= obj.probability <= 1, f"{what}: its probability is {obj.probability:g}")
        for name in ("position", "box_min", "box_max"):
            _check_near(f"{what}: {name}", getattr(obj, name))
        need(
            all(low <= high for low, high in zip(obj.box_min, obj.box_max, strict=True)),
            f"{what}: its box is inside out",
        )
        counts = (obj.n_detected, obj.n_observable, *obj.aliases)
        need(all(0 <= count <= MAX_COUNT for count in counts), f"{what}: a count or an alias is out of range")
        times = (obj.first_seen_s, obj.last_seen_s, obj.last_looked_s)
        need(all(abs(time) <= MAX_TIME_S for time in times), f"{what}: a time is out of range")
        texts = (obj.label, *obj.names, *(text for text, _ in (*obj.labels, *obj.colours)))
        _check_texts(what, texts, MAX_NAME_CHARS, MAX_LISTED)
        if (box := obj.oriented) is not None:
            _check_near(f"{what}: its box along the walls", (*box.middle, *box.size, box.yaw))
            need(min(box.size) >= 0 and set(box.seen) <= SIDES, f"{what}: its box along the walls is none")
        _check_views(obj)
    return objects


def _check_views(obj: MapObject) -> None:
    need(len(obj.all_views) <= MAX_LISTED, f"object {obj.id} has {len(obj.all_views)} views")
    for view in obj.all_views:
        what = f"object {obj.id}: its view in frame {brief(view.frame, 20)}"
        need(0 <= view.frame <= MAX_COUNT and len(view.label) <= MAX_NAME_CHARS, f"{what} is none")
        x1, y1, x2, y2 = view.box_xyxy
        need(
            min(x1, y1) >= -MAX_BOX_PX and max(x2, y2) <= MAX_BOX_PX and x1 <= x2 and y1 <= y2,
            f"{what}: its box is none",
        )
        need(
            0 <= view.size_px2 <= MAX_BOX_PX**2 and abs(view.score) <= MAX_COUNT,
            f"{what}: its size or score is out of range",
        )
        for point in (view.camera, view.surface):
            _check_near(what, () if point is None else point)


def _check_ids(what: str, ids: Sequence[int]) -> None:
    need(all(0 <= number <= MAX_COUNT for number in ids), f"the id of a {what} is out of range")
    need(len(set(ids)) == len(ids), f"two {what}s have one id")


def _check_near(what: str, values: Iterable[float]) -> None:
    need(all(abs(value) <= FAR_M for value in values), f"{what} lies beyond {FAR_M:g} m")


def _check_texts(what: str, texts: Sequence[str], most_chars: int, most: int = MAX_LISTED) -> None:
    need(len(texts) <= most, f"{what}: more than {most}")
    longest = max(map(len, texts), default=0)
    need(longest <= most_chars, f"{what}: a text of {longest} characters, where up to {most_chars} may be")


def _known(values: Any, kind: type[Row]) -> Row:
    """A row of ``kind``; what else is in ``values`` is for a newer cartier."""
    if not isinstance(values, Mapping):
        raise TypeError(f"{brief(values)} is no {kind.__name__}")
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    found: Row = typed({name: values[name] for name in names if name in values}, kind)
    return found


def printed(value: Any) -> Any:
    """A JSON value whose texts a terminal prints as they are: control characters become blanks."""
    if isinstance(value, dict):
        return {printable(key): printed(part) for key, part in value.items()}
    if isinstance(value, list):
        return [printed(part) for part in value]
    return printable(value) if isinstance(value, str) else value
