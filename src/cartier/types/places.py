"""Places: where something is, the pose that faces it, the way there, and the robot that drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import brief, check_radius, finite, need
from cartier.types.route_rules import FLOOR_KINDS, RouteRule

MAX_TRACTION = 100.0


@dataclass(frozen=True)
class RobotModel:
    """The robot that drives.

    Args:
        radius_m: The radius of its body, above 0 and at most 5.
        camera_height_m: The height of its camera above the floor, above 0 and at most 5.
        traction: What a metre on a kind of floor costs besides its length, as (kind, cost) pairs;
            ``navigation.traction`` has sober defaults by wheels.
    """

    radius_m: float = 0.2
    camera_height_m: float = 1.5
    traction: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        check_radius(self.radius_m)
        height_m = self.camera_height_m
        need(0 < height_m <= 5, f"a camera's height must be more than 0 and at most 5 m, got {height_m}")
        for kind, cost in self.traction:
            need(kind in FLOOR_KINDS, f"a kind of floor is {', '.join(FLOOR_KINDS)}, not {brief(kind, 40)!r}")
            need(0 <= cost <= MAX_TRACTION, f"traction on {kind} costs 0 to {MAX_TRACTION:g}, not {cost}")


@dataclass(frozen=True)
class Place:
    """Where an object or a room is.

    Args:
        label: Its name.
        position: Where its index has it (m): a point of its surface, or from where it was seen if ``view_yaw`` is set.
        score: How well it fits; scores of one index compare.
        frame: The number of the frame that shows it, -1 for none.
        box_xyxy: Its box in that frame (px), or None.
        box_min, box_max: Its axis-aligned box in the world (m), or None.
        view_yaw: The heading (rad) in which it was seen, if ``position`` is a *viewpoint*; otherwise None.
        object_id: The id of the object, or None.
        room_cells: (K, 2) int32, the cells (row, col) of the floor plan of its room, or None: a goal pose lies on them.
    """

    label: str
    position: tuple[float, ...]
    score: float
    frame: int
    box_xyxy: tuple[float, ...] | None = None
    box_min: tuple[float, ...] | None = None
    box_max: tuple[float, ...] | None = None
    view_yaw: float | None = None
    object_id: int | None = None
    room_cells: npt.NDArray[np.int32] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", finite(self.position, 3, f"place of {self.label!r}: position"))
        for name, size in (("box_xyxy", 4), ("box_min", 3), ("box_max", 3)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, finite(value, size, f"place of {self.label!r}: {name}"))

    @property
    def middle(self) -> tuple[float, ...]:
        """Where the object is for people and programs (m): the middle of its box; ``position`` without an object."""
        if self.object_id is None or self.box_min is None or self.box_max is None:
            return self.position
        return tuple(round((low + high) / 2, 4) for low, high in zip(self.box_min, self.box_max, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """The place as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints as ``place``: ``position`` is the ``middle``, ``index_position`` the
            field ``position``, and the other keys are the fields, without ``label`` and ``view_yaw``.
        """
        box, low, high = (None if v is None else list(v) for v in (self.box_xyxy, self.box_min, self.box_max))
        return {
            "position": list(self.middle), "index_position": list(self.position), "box_min": low, "box_max": high,
            "frame": self.frame, "box_xyxy": box, "score": self.score, "object_id": self.object_id,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class RouteAlternative:
    """Another way to the same goal.

    Args:
        words: What sets it apart: "1.2 m longer, all on tiles".
        length_m: How long it is.
        path: (K, 2) float64 points (x, y) in metres.
    """

    words: str
    length_m: float
    path: npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Route:
    """How the way to a goal follows route rules.

    Args:
        rules: The rules that hold for this drive, obeyed or weighed.
        shortest_m: How long the way would be without them.
        directions: The way in words that a person could follow, one line a step.
        speed: (K,) float64, the share of full speed (0 to 1) from each point of the goal's path on.
        shortest: (J, 2) float64, the path without the rules.
        alternatives: Other ways, shortest first.
        breaks: The hard rules that it breaks, because a person was asked and agreed.
    """

    rules: tuple[RouteRule, ...]
    shortest_m: float
    directions: tuple[str, ...]
    speed: npt.NDArray[np.float64]
    shortest: npt.NDArray[np.float64]
    alternatives: tuple[RouteAlternative, ...] = ()
    breaks: tuple[RouteRule, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The route as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints as ``goal.route``: rules in their text form, lengths in metres.
        """
        return {
            "rules": [rule.text for rule in self.rules], "breaks": [rule.text for rule in self.breaks],
            "shortest_m": round(self.shortest_m, 3), "directions": list(self.directions),
            "speed": [round(float(share), 3) for share in self.speed],
            "alternatives": [{"words": a.words, "length_m": round(a.length_m, 3)} for a in self.alternatives],
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Goal:
    """A reachable pose that faces a place, in the map frame.

    Args:
        x, y: Where to stand (m).
        yaw: The heading (rad), counter-clockwise from +x.
        path: (K, 2) float64, the collision-free way there as points (x, y) in metres.
        length_m: The length of the path.
        place: What the pose faces.
        line_of_sight: Whether nothing known stands between the pose and the place.
        route: How the path follows route rules; None where none hold.
    """

    x: float
    y: float
    yaw: float
    path: npt.NDArray[np.float64]
    length_m: float
    place: Place
    line_of_sight: bool
    route: Route | None = None

    def __post_init__(self) -> None:
        what = f"goal for the {self.place.label}"
        finite((self.x, self.y, self.yaw), 3, f"{what}: x, y and yaw")
        points = self.path.ndim == 2 and self.path.shape[1] == 2 and len(self.path) > 0
        finite_points = points and bool(np.isfinite(self.path).all())
        need(finite_points, f"{what}: its path must be (K, 2) finite numbers, got {self.path.shape}")
        need(0 <= self.length_m < math.inf, f"{what}: its path's length must be finite, got {self.length_m}")

    def to_dict(self) -> dict[str, Any]:
        """The goal as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints as ``goal``; its keys are the fields, without ``place``.
        """
        path = [[round(x, 4), round(y, 4)] for x, y in self.path.tolist()]
        return {
            "x": self.x, "y": self.y, "yaw": self.yaw, "path": path, "length_m": self.length_m,
            "line_of_sight": self.line_of_sight, "route": None if self.route is None else self.route.to_dict(),
        }  # fmt: skip


DRIVE_ENDS = ("arrived", "failed", "stopped", "unknown")
"""How a drive can end; "unknown" is one that began and cannot be watched."""


@dataclass(frozen=True)
class DriveProgress:
    """How far a robot is on its way to a goal, or how the drive ended.

    Args:
        status: "driving", or one of ``DRIVE_ENDS``.
        text: One line that says so, with the reason if it did not arrive.
        pose: x, y (m) and yaw (rad) of the robot in the map frame; None if it is not known.
        left_m: How far the goal still is (m); None if it is not known.
    """

    status: str
    text: str
    pose: tuple[float, float, float] | None = None
    left_m: float | None = None

    def __post_init__(self) -> None:
        need(self.status in ("driving", *DRIVE_ENDS), f"a drive is driving or {', '.join(DRIVE_ENDS)}: {self.status!r}")
        need(bool(self.text.strip()) and "\n" not in self.text, f"progress of a drive is one line, got {self.text!r}")
        if self.pose is not None:
            finite(self.pose, 3, "the pose of a robot")

    @property
    def ended(self) -> bool:
        """Whether the drive is over."""
        return self.status != "driving"
