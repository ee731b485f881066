"""Core data types: frozen dataclasses over numpy arrays, validated when they are made.

Conventions of the whole project:

- Metres, seconds, radians, pixels; the unit or the layout stands in the name (``_m``, ``_s``, ``_px``, ``_xyxy``).
- World: right-handed, z up (REP-103), the ``map`` frame of REP-105; z = 0 is the floor.
- Camera: optical frame, x right, y down, z forward. Pixel (0, 0) is the *centre* of the top-left pixel.
- ``b_from_a`` is the 4x4 transform that takes points of a to b.
- Boxes in images are ``xyxy`` in pixels; boxes in the world are axis-aligned, from ``box_min`` to ``box_max``.
- Depth is z-depth (not range), float32, NaN where the sensor has no reading.

Only the recording readers and the AI2-THOR adapter convert other conventions to these. A value that breaks them is an
InputError.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from cartier.errors import (
    MAX_TIME_S,
    BackendError,
    InputError,
    brief,
    check_camera,
    check_pose,
    check_radius,
    finite,
    need,
    only_readings,
)
from cartier.route_rules import FLOOR_KINDS, RouteRule

Array = npt.NDArray[Any]
Floats = npt.NDArray[np.floating[Any]]
Status = Literal["found", "likely_near", "not_found", "clarify", "answered", "alarm"]
AlarmKind = Literal["self_harm", "violence", "child", "medical", "fire"]
STATUSES: tuple[str, ...] = get_args(Status)

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Cell values of an OccupancyGrid: those of ``nav_msgs/OccupancyGrid``."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion.

    Args:
        width, height: The size of its images in pixels.
        fx, fy: The focal lengths in pixels.
        cx, cy: The principal point in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        check_camera(self.width, self.height, (self.fx, self.fy, self.cx, self.cy))

    def scaled(self, width: int, height: int) -> Camera:
        """The same camera with images of another size.

        Args:
            width, height: The new size in pixels.

        Returns:
            The camera; pixel centres stay at whole numbers.
        """
        sx, sy = width / self.width, height / self.height
        return Camera(width, height, self.fx * sx, self.fy * sy, (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5)


@dataclass(frozen=True, eq=False)
class Frame:
    """One RGB-D image with its pose. All its images have the size of ``camera``; ``cropped`` gives a part.

    Args:
        index: Its number in the recording, from 0.
        time_s: When it was taken.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32, or None without depth.
        world_from_camera: (4, 4) pose.
        camera: The camera, of the size of the image.
        instances: (H, W) int32, a simulator's true object ids (0 = none). Only what is *called* ground truth may read
            them.
    """

    index: int
    time_s: float
    rgb: npt.NDArray[np.uint8]
    depth_m: npt.NDArray[np.float32] | None
    world_from_camera: npt.NDArray[np.float64]
    camera: Camera
    instances: npt.NDArray[np.int32] | None = None

    def __post_init__(self) -> None:
        shape, where = (self.camera.height, self.camera.width), f"frame {self.index}"
        need(math.isfinite(self.time_s), f"{where}: time_s must be finite, got {self.time_s}")
        in_ns = f"{where}: {self.time_s:g} is no time in seconds: are its stamps in nanoseconds? divide them by 1e9"
        need(abs(self.time_s) <= MAX_TIME_S, in_ns)
        right = self.rgb.shape == (*shape, 3) and self.rgb.dtype == np.uint8
        need(right, f"{where}: rgb must be {(*shape, 3)} uint8, got {self.rgb.shape} {self.rgb.dtype}")
        for name, image in (("depth_m", self.depth_m), ("instances", self.instances)):
            if image is not None:
                need(image.shape == shape, f"{where}: {name} must be {shape}, got {image.shape}")
        if self.depth_m is not None:
            object.__setattr__(self, "depth_m", only_readings(self.depth_m, where))
        object.__setattr__(self, "world_from_camera", check_pose(self.world_from_camera, where))

    def cropped(self, box_xyxy: Sequence[int]) -> Frame:
        """A part of the image, with its depth and the camera that sees that part alone.

        The pose stays, and the camera's principal point moves, so pixels show the same points of the world as before.
        A detector that looks at parts adds (x1, y1) to their boxes: its detections are those of the whole image.

        Args:
            box_xyxy: The part in whole pixels; x2 and y2 are the first that are left out.

        Returns:
            The part, with the index and time of the frame.

        Raises:
            InputError: The part is empty or reaches out of the image.
        """
        x1, y1, x2, y2 = box_xyxy
        width, height, where = self.camera.width, self.camera.height, f"frame {self.index}"
        inside = 0 <= x1 < x2 <= width and 0 <= y1 < y2 <= height
        need(inside, f"{where}: a part must lie in the {width}x{height} px of its image, got {tuple(box_xyxy)}")
        camera = replace(self.camera, width=x2 - x1, height=y2 - y1, cx=self.camera.cx - x1, cy=self.camera.cy - y1)
        depth = None if self.depth_m is None else self.depth_m[y1:y2, x1:x2]
        instances = None if self.instances is None else self.instances[y1:y2, x1:x2]
        rgb = self.rgb[y1:y2, x1:x2]
        return Frame(self.index, self.time_s, rgb, depth, self.world_from_camera, camera, instances)


@dataclass(frozen=True, eq=False)
class Detections:
    """The N detections of one frame, low scores included.

    Args:
        frame: The number of the frame.
        boxes_xyxy: (N, 4) float32, pixels.
        scores: (N,) float32, 0 to 1.
        labels: N display names.
        masks: (N, H, W) bool, or None.
    """

    frame: int
    boxes_xyxy: npt.NDArray[np.float32]
    scores: npt.NDArray[np.float32]
    labels: tuple[str, ...]
    masks: npt.NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # 1e308 becomes infinite, which is refused below
            boxes = np.asarray(self.boxes_xyxy, dtype=np.float32).reshape(-1, 4)
            scores = np.asarray(self.scores, dtype=np.float32).reshape(-1)
        object.__setattr__(self, "boxes_xyxy", boxes)
        object.__setattr__(self, "scores", scores)
        object.__setattr__(self, "labels", tuple(self.labels))
        n, where = len(self.labels), f"detections of frame {self.frame}"
        need(len(boxes) == len(scores) == n, f"{where}: {len(boxes)} boxes, {len(scores)} scores, {n} labels")
        finite = bool(np.isfinite(boxes).all() and np.isfinite(scores).all())
        need(finite, f"{where}: a box or score is NaN or infinite")
        need(bool((boxes[:, 2:] >= boxes[:, :2]).all()), f"{where}: a box has x2 < x1 or y2 < y1")
        need(self.masks is None or len(self.masks) == n, f"{where}: as many masks as boxes are needed")

    def __len__(self) -> int:
        return len(self.labels)

    def keep(self, which: Array) -> Detections:
        """Some of the detections.

        Args:
            which: Their indices, or a boolean mask (N,).

        Returns:
            The detections chosen.
        """
        chosen = np.arange(len(self))[which]
        labels = tuple(self.labels[i] for i in chosen)
        masks = None if self.masks is None else self.masks[chosen]
        return Detections(self.frame, self.boxes_xyxy[chosen], self.scores[chosen], labels, masks)


@dataclass(frozen=True)
class DetectorScoreModel:
    """What a detector's scores say about existence; the defaults are cautious values for unmeasured detectors.

    Args:
        threshold: The score from which a single detection counts.
        spawn_threshold: The score from which a detection starts a new object.
        zero_weight_score, full_weight_score: The scores at which a detection weighs 0 and 1.
        beta_true, beta_false: Beta(a, b) distributions of the share of viewpoint bins with a detection, for real
            objects and for false positives.
        prior_log_odds: The log-odds of an object before any frame.
        best_view_log_odds: What its best viewpoint bin adds.
        log_odds_per_log_width: What the log-odds lose for each factor e by which its best view is wider than 0.1 rad:
            real objects that appear large are detected reliably.
        measured: The data that it was measured on; empty for the defaults.
    """

    threshold: float = 0.5
    spawn_threshold: float = 0.32
    zero_weight_score: float = 0.32
    full_weight_score: float = 0.5
    beta_true: tuple[float, float] = (1.5, 1.25)
    beta_false: tuple[float, float] = (0.19, 15.0)
    prior_log_odds: float = -2.0
    best_view_log_odds: float = 1.4
    log_odds_per_log_width: float = 0.0
    measured: str = ""

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DetectorScoreModel:
        """A score model from JSON values.

        Args:
            values: Fields by name; those left out have their defaults.

        Returns:
            The score model.

        Raises:
            TypeError, ValueError: A field is unknown, or a value is out of range.
        """
        given: dict[str, Any] = {
            name: tuple(map(float, value)) if isinstance(value, list) else value for name, value in values.items()
        }
        model = cls(**given)
        scores = (model.threshold, model.spawn_threshold, model.zero_weight_score, model.full_weight_score)
        betas = (*model.beta_true, *model.beta_false)
        log_odds = (model.prior_log_odds, model.best_view_log_odds, model.log_odds_per_log_width)
        if not all(map(math.isfinite, (*scores, *betas, *log_odds))) or min(scores) < 0 or max(scores) > 1:
            raise ValueError("scores lie between 0 and 1, and all numbers are finite")
        if not model.zero_weight_score < model.full_weight_score:
            raise ValueError("zero_weight_score must be below full_weight_score")
        if len(model.beta_true) != 2 or len(model.beta_false) != 2 or min(betas) <= 0:
            raise ValueError("beta_true and beta_false are two positive numbers each")
        return model

    def with_threshold(self, threshold: float | None) -> DetectorScoreModel:
        """The same with another threshold; its other scores are scaled with it, and it no longer counts as measured.

        Args:
            threshold: The new threshold; None changes nothing.

        Returns:
            The score model.

        Raises:
            BackendError: The threshold is not from 0 to 1.
        """
        if threshold is None or threshold == self.threshold:
            return self
        if not 0 <= threshold <= 1:
            raise BackendError(f"option threshold must be from 0 to 1, got {threshold}")
        factor = threshold / max(self.threshold, 1e-6)
        given = (self.zero_weight_score, self.spawn_threshold, self.full_weight_score)
        zero, spawn, full = (min(factor * score, 1.0) for score in given)
        return replace(
            self, threshold=threshold, zero_weight_score=min(zero, 0.99), spawn_threshold=spawn,
            full_weight_score=max(full, zero + 0.01), measured="",
        )  # fmt: skip


@dataclass(frozen=True)
class TrueObject:
    """A simulator's object: ground truth, never an estimate.

    Args:
        id: Its number in ``Frame.instances``, from 1.
        label: Its display name.
        box_min, box_max: Its axis-aligned box in the world (m).
    """

    id: int
    label: str
    box_min: tuple[float, ...]
    box_max: tuple[float, ...]


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


@dataclass(frozen=True)
class Inventory:
    """What a reasoner chooses from.

    Args:
        objects: The objects of a home, confirmed and tentative.
        rooms: Its rooms.
        photo: Gives the JPEG of the best view of an object by its id, or None.
        from_xy: Where the robot stands (x, y) in metres, or None if unknown.
        doors: The passages between its rooms.
        rules: The route rules that people gave and that hold.
        shut_doors: Passages that an earlier recording showed open, and the floor plan now shows shut.
        way_m: Gives the length (m) of the way that the robot drives to an object by its id; None where it knows no way.
    """

    objects: tuple[MapObject, ...]
    rooms: tuple[Room, ...] = ()
    photo: Callable[[int], bytes | None] = lambda _: None
    from_xy: tuple[float, ...] | None = None
    doors: tuple[Door, ...] = ()
    rules: tuple[RouteRule, ...] = ()
    shut_doors: tuple[Door, ...] = ()
    way_m: Callable[[int], float | None] = lambda _: None

    @property
    def names(self) -> list[str]:
        """The labels of all confirmed objects and the names that people gave them, each once, sorted."""
        return sorted({name for obj in self.objects if obj.confirmed for name in (obj.label, *obj.names)})

    def contains(self, chosen: Selection) -> bool:
        """Whether everything that a selection names is in the inventory.

        Args:
            chosen: What a reasoner chose.

        Returns:
            False if it names an unknown object, room or id.
        """
        objects = {obj.id: obj for obj in self.objects}
        if not objects.keys() >= set(chosen.fact.objects if chosen.fact else ()):
            return False
        if chosen.door is not None:
            return 0 <= chosen.door < len(self.doors)
        if chosen.room is not None:
            return any((room.id, room.name) == (chosen.room, chosen.object) for room in self.rooms)
        if chosen.object_id is not None:
            obj = objects.get(chosen.object_id)
            return obj is not None and chosen.object in (obj.label, *obj.names)
        return chosen.object is None or chosen.object in self.names

    @classmethod
    def of(cls, names: Iterable[str]) -> Inventory:
        """An inventory of bare names.

        Args:
            names: The names; duplicates count once.

        Returns:
            One confirmed object for each name, of which nothing else is known.
        """
        here, never = (0.0, 0.0, 0.0), (1.0, True, 1, 1, 0.0, 0.0, 0.0, ())
        every = enumerate(dict.fromkeys(names))
        return cls(tuple(MapObject(number, name, ((name, 1.0),), here, here, here, *never) for number, name in every))


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


@dataclass(frozen=True)
class Fact:
    """The answer to a question, for programs.

    Args:
        kind: What was asked: how many, whether there is one, where, which, which of two has more of something, or a
            property.
        value: For "count" a number, for "exists" a bool, for "where" the name of a room or None, for "list" names, for
            "compare" the name of the object that has more, for "tell" a word or a length in metres.
        objects: The ids of the objects that the answer is about.
    """

    kind: Literal["count", "exists", "where", "list", "compare", "tell"]
    value: Any
    objects: tuple[int, ...] = ()


@dataclass(frozen=True)
class Selection:
    """What a reasoner chose.

    Args:
        status: "found" (an object or room serves the words), "likely_near" (the object stands for one that is not in
            the map but usually near it), "not_found" (nothing serves), "clarify" (``question`` has to be answered
            first), "answered" (``text`` is the answer, and there is no goal) or "alarm" (harm or an emergency: ``text``
            says what a person should do now, and there is no goal).
        object: The name of the chosen object or room, from the inventory. Given for "found" and "likely_near"; for
            "answered" it may name what the answer is about.
        reason: Why, in one sentence.
        question: What to ask the person, for "clarify".
        candidates: Names that were considered, with their scores, best first.
        prompt, reply, model: What a language model was sent, what it returned, and which one it was; empty without one.
        next: The choices for further needs in the same words, in the order in which to serve them.
        object_id: Which object of that name, or None to leave it to the index.
        room: The id of the chosen room, or None for an object.
        door: The chosen passage between rooms, by its place among the inventory's doors, or None.
        text: The answer in words, for "answered" and "alarm".
        fact: The same answer for programs, or None.
        alarm: The kind of emergency, for "alarm": "self_harm", "violence" (to others), "child" (in danger), "medical"
            or "fire" (also gas and floods); else None.
        tentative: The id of an object that is not confirmed and that the question or the answer speaks of, or None: a
            person may be shown its photo.
        rules: What the words want of the way, in the order in which they say it. With "answered" they are rules for
            drives to come.
        lifts: Rules that the words take back.
    """

    status: Status
    object: str | None = None
    reason: str = ""
    question: str | None = None
    candidates: tuple[tuple[str, float], ...] = ()
    prompt: str = ""
    reply: str = ""
    model: str = ""
    next: tuple[Selection, ...] = ()
    object_id: int | None = None
    room: int | None = None
    text: str = ""
    fact: Fact | None = None
    alarm: AlarmKind | None = None
    tentative: int | None = None
    rules: tuple[RouteRule, ...] = ()
    lifts: tuple[RouteRule, ...] = ()
    door: int | None = None

    def __post_init__(self) -> None:
        need(self.status in STATUSES, f"selection status {self.status!r} is not one of {', '.join(STATUSES)}")
        names_one = self.status in ("found", "likely_near")
        need(
            self.status == "answered" or (self.object is not None) == names_one,
            f"a selection that is {self.status!r} must {'' if names_one else 'not '}name an object",
        )
        need((self.status == "alarm") == (self.alarm is not None), "a selection has a kind of alarm if it is 'alarm'")
        need(self.object is not None or self.object_id is None, "a selection with an object's id must name the object")


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


CANNOT_TELL = "cannot tell"
"""What a vision model answers where a photograph does not show it; no other answer may be called so."""


@dataclass(frozen=True)
class VisualQuestion:
    """A question about photographs (visual question answering).

    Args:
        words: What to find out about the object in the drawn box, as a sentence: "Is this mug clean or dirty?".
        attribute: What is asked for: "colour", "clean", "on", "open", "full", "text", "look" (all else that an object
            looks like), "which" (whether this is the object that was meant) or "exists" (whether it is what the map
            calls it).
        choices: The closed set of answers; empty for an open answer, which is short text and never obeyed.
        wanted: The choice that the person hopes for or presumes: "clean" in "is the mug clean?"; empty for none.
        reason: Why photographs are asked about: "look", "which", "state" or "doubt".
        objects: The ids of the candidate objects, best first.
    """

    words: str
    attribute: str
    choices: tuple[str, ...]
    wanted: str = ""
    reason: Literal["look", "which", "state", "doubt"] = "look"
    objects: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        need(CANNOT_TELL not in self.choices, f"{CANNOT_TELL!r} is always possible and no choice")
        need(not self.wanted or self.wanted in self.choices, f"{self.wanted!r} is not one of {self.choices}")


@dataclass(frozen=True)
class CandidateView:
    """A picture of a candidate that goes with a question: a crop, and its context with the box drawn.

    Args:
        object_id: The id of the object.
        label: Its label.
        frame: The number of the frame whose photograph this is.
        box_xyxy: Its box in the photograph (px).
        apparent_px: The shorter side of that box, inside the photograph.
        crop_jpeg: The box with a small margin, enlarged, as JPEG.
        context_jpeg: The photograph around it with the box drawn, as JPEG.
        tokens: How many image tokens both take, by the counting rule of ``cartier.vision.crops``.
        blurred: How many people and screens were blurred.
    """

    object_id: int
    label: str
    frame: int
    box_xyxy: tuple[float, ...]
    apparent_px: float
    crop_jpeg: bytes = field(repr=False)
    context_jpeg: bytes = field(repr=False)
    tokens: int
    blurred: int = 0

    def to_dict(self) -> dict[str, Any]:
        """The picture as plain JSON values, with digests instead of the images.

        Returns:
            What ``cartier ask --json`` prints of a photograph that was looked at.
        """
        sent = {"crop_sha256": self.crop_jpeg, "context_sha256": self.context_jpeg}
        return {
            "object_id": self.object_id, "label": self.label, "frame": self.frame, "box_xyxy": list(self.box_xyxy),
            "apparent_px": round(self.apparent_px, 1), "image_tokens": self.tokens, "blurred": self.blurred,
            **{name: hashlib.sha256(jpeg).hexdigest() for name, jpeg in sent.items()},
        }  # fmt: skip


@dataclass(frozen=True)
class VisualAnswer:
    """What a vision model says about one picture.

    Args:
        object_id, frame: Which candidate, and in which frame.
        answer: One of the question's choices, or short text for an open question; None for "cannot tell".
        certainty: How certain it is, 0 to 1; 0 where it cannot tell.
    """

    object_id: int
    frame: int
    answer: str | None
    certainty: float

    def __post_init__(self) -> None:
        need(0 <= self.certainty <= 1, f"a certainty lies between 0 and 1, got {self.certainty}")


@dataclass(frozen=True)
class VisualReply:
    """The answer of a vision model to a question.

    Args:
        answers: One for each picture, in their order.
        model: Which model it was.
        endpoint: Where the pictures went: a URL without credentials, and a proxy on the way; empty if they did not
            leave this process.
        prompt, reply: What it was sent (without the images) and what it returned.
        tokens: How many tokens it took, as the server counts them; 0 if unknown.
        valid: False if the reply was not of the form that it was asked for, so that it answers nothing.
        times_sent: How often the pictures were sent; 0 if the server did not even take a made one.
    """

    answers: tuple[VisualAnswer, ...]
    model: str
    endpoint: str = ""
    prompt: str = ""
    reply: str = ""
    tokens: int = 0
    valid: bool = True
    times_sent: int = 1


@dataclass(frozen=True)
class VisualTrace:
    """How photographs were looked at for an answer, or why not.

    Args:
        question: What was to be found out.
        pictures: The pictures that went with it.
        reply: What the vision model answered; None if none was asked.
        verdict: What follows: "told", "cannot_tell", "refused" (too little certainty or too few views), "several" (two
            candidates fit) or "not_asked" (nothing was sent; ``why`` says why).
        answer: The answer of the latest verified observation, or None.
        object_id: The candidate that it is about, or None.
        certainty: How certain that is.
        why: The verdict's reason, in one sentence.
        view_from: A reachable pose from which the object would appear large enough, or None.
    """

    question: VisualQuestion
    pictures: tuple[CandidateView, ...]
    reply: VisualReply | None
    verdict: Literal["told", "cannot_tell", "refused", "several", "not_asked"]
    answer: str | None = None
    object_id: int | None = None
    certainty: float = 0.0
    why: str = ""
    view_from: Goal | None = None

    def to_dict(self) -> dict[str, Any]:
        """The trace as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints as ``look``.
        """
        asked, reply = asdict(self.question), self.reply
        times_sent = 0 if reply is None else reply.times_sent
        return {
            "question": {**asked, "choices": list(asked["choices"]), "objects": list(asked["objects"])},
            "photos": [picture.to_dict() for picture in self.pictures], "sent": times_sent > 0,
            "times_sent": times_sent,
            "to": None if reply is None else {"model": reply.model, "endpoint": reply.endpoint or None},
            "answers": [] if reply is None else [asdict(answer) for answer in reply.answers],
            "reply": "" if reply is None else reply.reply, "verdict": self.verdict, "answer": self.answer,
            "object_id": self.object_id, "certainty": round(self.certainty, 3), "why": self.why,
            "view_from": None if self.view_from is None else self.view_from.to_dict(),
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


@dataclass(frozen=True)
class AsOf:
    """Of which moment of a live map an answer is.

    Args:
        age_s: How old the newest frame in it is (s).
        floor_seen: Which share of the floor was looked at, an estimate from 0 to 1.
        frame_epoch: How often the map was moved by corrected poses; a goal of an older epoch is void.
        correcting: Whether the map is being corrected, so that places may change.
        not_seen_yet: Whether what was asked for may be where nobody has looked yet.
    """

    age_s: float
    floor_seen: float
    frame_epoch: int = 0
    correcting: bool = False
    not_seen_yet: bool = False


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one request, with its whole trace.

    Args:
        query: What the person said.
        selection: What the reasoner chose.
        place: Where that is, or None.
        goal: How to get there, or None; ``notes`` say why.
        reasoner, index, detector, home: The names of what the answer comes from.
        timing_ms: How long each step took.
        notes: What a person should know about the answer, one line each.
        encoder: Which encoder the index used, or None.
        next: The answers to further needs in the same words, in order; each goal is planned from where the last one
            ends.
        look: How photographs were looked at for it, or None.
        as_of: Of which moment it is, for a home that is being mapped; else None.
    """

    query: str
    selection: Selection
    place: Place | None
    goal: Goal | None
    reasoner: str
    index: str
    detector: str
    home: str
    timing_ms: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    encoder: str | None = None
    next: tuple[Answer, ...] = ()
    look: VisualTrace | None = None
    as_of: AsOf | None = None

    def to_dict(self) -> dict[str, Any]:
        """The answer as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints.
        """
        chosen, number = self.selection, self.selection.object_id
        if number is None and self.place is not None:
            number = self.place.object_id  # the index chose among objects of one name
        return {
            "query": self.query, "status": chosen.status, "object": chosen.object, "object_id": number,
            "room": chosen.room, "reason": chosen.reason, "question": chosen.question, "text": chosen.text,
            "alarm": chosen.alarm, "answer": None if chosen.fact is None else asdict(chosen.fact),
            "tentative": chosen.tentative,
            "rules": [rule.text for rule in chosen.rules], "lifts": [rule.text for rule in chosen.lifts],
            "place": self.place.to_dict() if self.place else None, "goal": self.goal.to_dict() if self.goal else None,
            "candidates": [{"object": name, "score": score} for name, score in chosen.candidates],
            "reasoner": self.reasoner, "index": self.index, "encoder": self.encoder, "detector": self.detector,
            "home": self.home, "timing_ms": {step: round(ms, 2) for step, ms in self.timing_ms.items()},
            "notes": list(self.notes), "next": [answer.to_dict() for answer in self.next],
        } | self._extras()  # fmt: skip

    def _extras(self) -> dict[str, Any]:
        looked = {} if self.look is None else {"look": self.look.to_dict()}
        return looked | ({} if self.as_of is None else {"as_of": asdict(self.as_of)})
