"""Maps: objects with their views and boxes, rooms and doors, and the floor plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief, finite, need
from cartier.types.frames import Array
from cartier.types.route_rules import FLOOR_KINDS

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Cell values of an OccupancyGrid: those of ``nav_msgs/OccupancyGrid``."""


@dataclass(frozen=True)
class View:
    """A detection that shows an object of the map.

    Args:
        frame: The number of the frame.
        box_xyxy: The box in the image (px).
        score: The score of the detection.
        label: The label that it gave.
        size_px2: The area of the box, corrected for perspective distortion.
        camera: The camera's position (m).
        yaw: The heading (rad) in which the object was seen.
        surface: The mean of the surface points that it shows (m), or None without depth.
    """

    frame: int
    box_xyxy: tuple[float, ...]
    score: float
    label: str
    size_px2: float
    camera: tuple[float, ...]
    yaw: float
    surface: tuple[float, ...] | None

    def __post_init__(self) -> None:
        what = f"view of {self.label!r} in frame {self.frame}"
        finite(self.box_xyxy, 4, f"{what}: its box")
        for point in (self.camera, self.surface):
            if point is not None and len(point) != 3:
                raise InputError(f"{what}: camera and surface are points, got {brief(point)}")


@dataclass(frozen=True)
class OrientedBox:
    """The box of an object in the directions of the walls.

    Args:
        middle: Its middle in the world (m).
        size: How long it is along its own x, y and z axis (m); z is up.
        yaw: How its x axis is turned about the vertical (rad), from -π/4 to π/4.
        seen: Which of its sides views showed: some of "+x", "-x", "+y", "-y", "+z". A side that is not named may be
            farther out than the box says.
    """

    middle: tuple[float, ...]
    size: tuple[float, ...]
    yaw: float
    seen: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        finite(self.middle, 3, "oriented box: its middle")
        finite(self.size, 3, "oriented box: its size")


@dataclass(frozen=True)
class MapObject:
    """One object of a map, with the evidence for and against it.

    Args:
        id: Its number; it stays the same for as long as the home lives.
        label: Its name: the label with the most evidence.
        labels: All labels that detections gave it, with their weights.
        position: The middle of its box (m).
        box_min, box_max: Its axis-aligned box in the world (m).
        probability: How likely it exists.
        confirmed: Whether that is enough to count as existing; otherwise it is tentative.
        n_detected, n_observable: In how many frames it was detected, of those that would have shown it.
        first_seen_s, last_seen_s: The times of its first and last detection.
        last_looked_s: The time of the last frame that would have shown it.
        views: The best views of it, best first.
        colours: The names of its colours, with their shares.
        room: The id of its room, or None.
        aliases: The ids of objects that were merged into it.
        names: The names that people gave it (``Home.correct``).
        oriented: Its box in the directions of the walls, or None where they have no clear one.
        by_person: Whether a person said that it is there (``Home.correct``), which outweighs all scores.
        side_views: Further views, none of them among ``views``: the largest from each side, and of the latest visit.
    """

    id: int
    label: str
    labels: tuple[tuple[str, float], ...]
    position: tuple[float, ...]
    box_min: tuple[float, ...]
    box_max: tuple[float, ...]
    probability: float
    confirmed: bool
    n_detected: int
    n_observable: int
    first_seen_s: float
    last_seen_s: float
    last_looked_s: float
    views: tuple[View, ...]
    colours: tuple[tuple[str, float], ...] = ()
    room: int | None = None
    aliases: tuple[int, ...] = ()
    names: tuple[str, ...] = ()
    oriented: OrientedBox | None = None
    by_person: bool = False
    side_views: tuple[View, ...] = ()

    def __post_init__(self) -> None:
        for name in ("position", "box_min", "box_max"):
            finite(getattr(self, name), 3, f"object {self.id} ({brief(self.label, 40)}): {name}")

    @classmethod
    def of_box(
        cls, id: int, label: str, box_min: tuple[float, ...], box_max: tuple[float, ...], **known: Any
    ) -> MapObject:
        """An object that is there, of which the box is known.

        Args:
            id, label, box_min, box_max: As the fields.
            **known: Further fields.

        Returns:
            The object: confirmed, seen in no frame, and with that label alone.
        """
        middle = tuple((low + high) / 2 for low, high in zip(box_min, box_max, strict=True))
        given: dict[str, Any] = {
            "labels": ((label, 1.0),), "position": middle, "probability": 1.0, "confirmed": True, "n_detected": 0,
            "n_observable": 0, "first_seen_s": 0.0, "last_seen_s": 0.0, "last_looked_s": 0.0, "views": (),
        } | known  # fmt: skip
        return cls(id=id, label=label, box_min=box_min, box_max=box_max, **given)

    @property
    def all_views(self) -> tuple[View, ...]:
        """All views that are kept of it: the best ones, then those of further sides."""
        return (*self.views, *self.side_views)

    @property
    def located(self) -> bool:
        """Whether its distance is known. Without depth it may not be: its box then covers where the object may be."""
        return any(view.surface is not None for view in self.views) or not self.views

    @cached_property
    def volume_m3(self) -> float:
        """The volume of its axis-aligned box (m³)."""
        return math.prod(high - low for low, high in zip(self.box_min, self.box_max, strict=True))


@dataclass(frozen=True)
class Room:
    """A room of the floor plan.

    Args:
        id: Its number.
        name: Its name; each room has another.
        kind: What the objects in it make it: "kitchen", "bathroom", …, or "room".
        cells: (K, 2) int32, its cells of the floor plan as (row, col).
    """

    id: int
    name: str
    kind: str
    cells: npt.NDArray[np.int32] = field(repr=False, compare=False)


@dataclass(frozen=True)
class Door:
    """A passage between two rooms of the floor plan.

    Args:
        xy: Its middle on the floor (m).
        rooms: The ids of the rooms that it joins.
        width_m: Its width.
        narrowest_m: The diameter of the largest round robot that gets through, furniture beside it included; 0 if
            nobody measured it.
    """

    xy: tuple[float, float]
    rooms: tuple[int, int]
    width_m: float
    narrowest_m: float = 0.0


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A floor plan.

    Args:
        cells: (rows, cols) int8 of FREE, OCCUPIED and UNKNOWN; row 0 has the smallest y.
        resolution_m: The side of a cell.
        origin_xy: The outer corner of cell (0, 0) in the map frame (m).
        height_m: (rows, cols) float16, the height of the highest surface seen in each cell (0 = none): with it, lines
            of sight can pass over a table.
        floor_kinds: (rows, cols) uint8, the kind of floor in each cell as an index into ``FLOOR_KINDS`` (0 = unknown),
            or None if nobody looked.
    """

    cells: npt.NDArray[np.int8]
    resolution_m: float
    origin_xy: tuple[float, float]
    height_m: npt.NDArray[np.float16]
    floor_kinds: npt.NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        shape, heights = self.cells.shape, self.height_m.shape
        need(len(shape) == 2 and self.cells.size > 0, f"an occupancy grid needs (rows, cols) cells, got {shape}")
        need(heights == shape, f"grid heights must be {shape}, got {heights}")
        if self.floor_kinds is not None:
            known = self.floor_kinds.shape == shape and int(self.floor_kinds.max()) < len(FLOOR_KINDS)
            need(known, f"grid floor kinds must be {shape} of 0 to {len(FLOOR_KINDS) - 1}")
        need(self.resolution_m > 0, f"grid resolution must be positive, got {self.resolution_m}")

    def cell(self, xy: Sequence[float] | Array) -> npt.NDArray[np.int64]:
        """The cells of points.

        Args:
            xy: (..., 2) points in the map frame (m).

        Returns:
            (..., 2) int64 as (row, col); they may lie outside of the grid.
        """
        cells = np.floor((np.asarray(xy, dtype=np.float64) - self.origin_xy) / self.resolution_m)
        return cells.astype(np.int64)[..., ::-1]

    def centre(self, cell: Sequence[int] | Array) -> npt.NDArray[np.float64]:
        """The centres of cells.

        Args:
            cell: (..., 2) as (row, col).

        Returns:
            (..., 2) points in the map frame (m).
        """
        return np.asarray((np.asarray(cell)[..., ::-1] + 0.5) * self.resolution_m + self.origin_xy, dtype=np.float64)

    def value(self, xy: Sequence[float]) -> int:
        """The cell value at a point.

        Args:
            xy: The point in the map frame (m).

        Returns:
            FREE, OCCUPIED or UNKNOWN; outside of the grid UNKNOWN.
        """
        row, col = self.cell(xy)
        inside = 0 <= row < self.cells.shape[0] and 0 <= col < self.cells.shape[1]
        return int(self.cells[row, col]) if inside else UNKNOWN
