"""Gravity and floor estimation: which way is up, how high the floor is, and how the images must be turned.

Cameras are held level: upright, on their heads or on a side, as phones are. People who look around turn about up, which
therefore keeps its direction in the images, and they walk on the floor, so that cameras move least along up. Each way
to hold a camera gives a guess of up. Without depth, the poses alone choose one, unless the format documents up. With
depth, the horizontal surfaces (floor, tables, seats) are the largest set of normals near a guess, and the thin layers
that they form give up to a fraction of a degree; of the guesses, the one is right whose surfaces are large and that the
cameras turn about and hardly move along. It also judges a documented up. The lowest layer is the floor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.geometry import backproject, transform
from cartier.types import Array, Camera

Vector = npt.NDArray[np.float64]

FRAMES = 20
SAMPLES_ACROSS = 80
CONE_DEG = 45.0  # a camera that always looks 30 degrees down puts its own up 30 degrees off
AGREE_DEG = 10.0
MIN_SHARE, MIN_SAMPLES = 0.03, 200
BIN_M, LAYER_M = 0.02, 0.03
ASSUMED_CAMERA_HEIGHT_M = 1.5
# Right and down, by the quarter turns to the left that mend it.
UP_IN_IMAGE = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])
LYING = ("stand upright", "lie on their right side", "stand on their heads", "lie on their left side")
USUAL = 3.0  # how many times more must speak for images that do not stand upright
DOCUMENTED = 10.0  # and against the up that a format documents
OFF_DEG = 5.0  # what a documented up may be off
STEADY, STILL, LEAST_WAY_M = 0.05, 0.1, 0.05  # floors of how much cameras sway, and rise and sink in their way
UP_SEEN = 0.5  # least length of the mean up direction in the images that shows how they are turned
GIVEN_FLOOR = "floor given by the user"
BELOW_SHARE = 0.02  # of points under the floor: above, it was perhaps not in view
BELOW_M = 2.5  # what lies farther below every camera is the floor of another storey
# How much less one axis of the images moves than the other: enough by itself, and enough if the cameras walk.
PANS, PANS_LITTLE = 0.25, 0.03
WALKS_M, WALKS_TIMES = 0.25, 2.0  # root mean square along one direction, and times that along the other


@dataclass(frozen=True, eq=False)
class Levelling:
    """``level_from_world`` (4, 4) takes the source's world to one with z up and z = 0 on the floor.

    ``up`` (3,) is a unit vector of the source's world, ``floor_m`` the floor's height along it; ``notes`` say how both
    were found, one line each. ``seen``: horizontal surfaces gave up, rather than the cameras alone; ``floor_seen``: and
    the lowest of them is the floor, without doubt. ``turns`` counts the quarter turns to the left (counter-clockwise)
    that bring the images upright, 0 where most look down or at the ceiling.
    """

    level_from_world: npt.NDArray[np.float64]
    up: Vector
    floor_m: float
    notes: tuple[str, ...]
    seen: bool
    floor_seen: bool
    turns: int


def level(
    world_from_cameras: Array,
    camera: Camera,
    depth_of: Callable[[int], Array | None] | None = None,
    up: Sequence[float] | None = None,
    floor_m: float | None = None,
    documented_up: Sequence[float] | None = None,
) -> Levelling:
    """Estimate up and the floor from camera poses (N, 4, 4) and, where there is depth, about 20 depth images.

    ``depth_of(i)`` gives frame i's z-depth (H, W) in metres, NaN where there is none. ``up`` (x, y, z in the source's
    world) and ``floor_m`` (along up) override the estimates. ``documented_up`` is what the format says; it holds unless
    surfaces contradict it by more than OFF_DEG. Raises InputError if they make no sense.
    """
    poses = np.asarray(world_from_cameras, dtype=np.float64)
    given_floor_m = None if floor_m is None else _height(floor_m)
    surfaces = None
    if depth_of is not None and (up is None or given_floor_m is None):
        surfaces = _surfaces(poses, camera, depth_of)
    found = _find_up(poses, surfaces, documented_up) if up is None else _Up(_direction(up), "up given by the user")
    floor = _find_floor(poses, surfaces, found.up) if given_floor_m is None else _Floor(given_floor_m, GIVEN_FLOOR)
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation_to_z(found.up)
    matrix[2, 3] = -floor.height_m
    return Levelling(
        matrix, found.up, floor.height_m, (found.note, floor.note), found.seen, floor.seen,
        turned(poses, found.up),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Up:
    up: Vector
    note: str
    seen: bool = False


@dataclass(frozen=True)
class _Floor:
    height_m: float
    note: str
    seen: bool = False


@dataclass(frozen=True, eq=False)
class _Surfaces:
    """World points (M, 3) and unit normals (M, 3), towards the camera, sampled from ``frames`` frames."""

    points: Array
    normals: Array
    frames: int

    def level_points(self, up: Vector) -> Array:
        """The points of nearly horizontal, upward surfaces."""
        return self.points[_near(self.normals, up, AGREE_DEG + 5)]


def quarter_turns(up_in_image: Array) -> int:
    """How many quarter turns to the left (counter-clockwise) bring images upright in which up points (right, down)."""
    return int(np.argmax(UP_IN_IMAGE @ np.asarray(up_in_image, dtype=np.float64)))


def turned(poses: Array, up: Array) -> int:
    """The quarter turns to the left that bring the images of poses (N, 4, 4) upright; 0 if most look down or up."""
    up_in_image = np.asarray(up) @ poses[:, :3, :2].mean(axis=0)
    return quarter_turns(up_in_image) if np.linalg.norm(up_in_image) > UP_SEEN else 0


def _find_up(poses: Array, surfaces: _Surfaces | None, documented_up: Sequence[float] | None) -> _Up:
    documented = None if documented_up is None else _direction(documented_up)
    seen = None if surfaces is None else _seen_up(poses, surfaces, documented)
    if documented is not None and documented_up is not None:
        told = f"up is {tuple(float(v) for v in documented_up)} in this format's world"
        off_deg = 0.0 if seen is None else float(np.degrees(np.arccos(np.clip(seen[1] @ documented, -1, 1))))
        if off_deg <= OFF_DEG:
            return _Up(documented, f"{told}; override with --up X,Y,Z", seen is not None)
        told = f"; {told}, which is {off_deg:.0f}° off and does not hold"
    if surfaces is not None and seen is not None:
        turn, up, share = seen
        source = f"{surfaces.frames} frames: {share:.0%} of the surfaces agree"
    else:
        turn = _turn_held(poses)
        lack = "there is no depth" if surfaces is None else "too few horizontal surfaces were seen"
        up, how = _camera_up(poses, turn)
        source = f"the cameras alone ({how}; {lack}), perhaps some degrees off"
    x, y, z = up
    assumed = f"; the pictures {LYING[turn]} then" if turn or seen is None else ""
    against = told if documented is not None else ""
    note = f"up estimated as ({x:.3f}, {y:.3f}, {z:.3f}) from {source}{assumed}{against}; override with --up X,Y,Z"
    return _Up(up, note, seen is not None)


def _seen_up(poses: Array, surfaces: _Surfaces, documented: Vector | None) -> tuple[int, Vector, float] | None:
    """The turn of the images, up and the share of the surfaces that agree with it; None where too few do.

    Each turn has its guess, and the documented up is one more; the one for which most speaks is taken.
    """
    axes = poses[:, :3, :2].mean(axis=0)
    found = []
    for up, turn in ((by[0], turn) for turn in range(4) if (by := _up_by(poses, turn)) is not None):
        seen, share = _surface_up(surfaces, up)
        if share >= MIN_SHARE and quarter_turns(seen @ axes) == turn:
            found.append((share * _held(poses, seen, turn), turn, seen, share))
    if documented is not None:  # where it is right and the floor not in view, walls must not take its place
        up, share = _surface_up(surfaces, documented)
        turn = quarter_turns(up @ axes)
        found.append((DOCUMENTED * max(share, MIN_SHARE) * _held(poses, up, turn), turn, up, share))
    best = max(found, key=lambda one: one[0], default=None)
    return best[1:] if best is not None and best[3] >= MIN_SHARE else None


def _held(poses: Array, up: Vector, turn: int) -> float:
    """How much speaks for level cameras that turn about up and hardly move along it, their images upright or turned."""
    up_in_camera = poses[:, :3, :3].transpose(0, 2, 1) @ up
    sway = np.sqrt(np.square(up_in_camera[:, turn % 2]).mean() + up_in_camera[:, 2].var())
    away = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    rise = (away @ up).std() / max(np.sqrt(np.square(away).sum(axis=1).mean()), LEAST_WAY_M)
    return float((1.0 if turn else USUAL) / ((sway + STEADY) ** 2 * (rise + STILL)))


def _turn_held(poses: Array) -> int:
    """The turn of the images by poses alone: upright, unless cameras clearly pan and walk as cameras on a side do.

    Their pitch says on which side: people look down more than up.
    """
    axes = poses[:, :3, :2].mean(axis=0)  # looking around turns about up, and that axis of the image stays
    across, down = np.linalg.norm(axes, axis=0)
    if across - down < PANS and not (across - down > PANS_LITTLE and _walks_sideways(poses, axes)):
        return 0
    up = -axes[:, 0] * np.copysign(1, poses[:, :3, 2].mean(axis=0) @ axes[:, 0])
    return 1 if axes[:, 0] @ up > 0 else 3


def _walks_sideways(poses: Array, axes: Array) -> bool:
    """Whether cameras move along the up of upright ones, and far less along the up of those on a side."""
    away = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    lying_m, upright_m = np.sqrt(np.square(away @ axes).mean(axis=0)) / np.linalg.norm(axes, axis=0)
    return bool(upright_m > WALKS_M and upright_m > WALKS_TIMES * lying_m)


def _camera_up(poses: Array, turn: int) -> tuple[Vector, str]:
    """Up as the cameras have it that are held so. Raises InputError if they contradict each other."""
    found = _up_by(poses, turn)
    if found is None:
        raise InputError("the cameras' own up directions cancel out, so up cannot be guessed; give it with --up X,Y,Z")
    return found


def _up_by(poses: Array, turn: int) -> tuple[Vector, str] | None:
    """The direction least along the level axes if the cameras look around, else the mean of the axes that point up."""
    mean_up = (poses[:, :3, :2] @ UP_IN_IMAGE[turn]).mean(axis=0)
    length = float(np.linalg.norm(mean_up))
    if length < 0.1:
        return None
    mean_up /= length
    level = poses[:, :3, turn % 2]
    spread, directions = np.linalg.eigh(level.T @ level / len(poses))
    axis = np.asarray(directions[:, 0] * np.copysign(1, directions[:, 0] @ mean_up), dtype=np.float64)
    look_around = spread[1] > 0.05 and spread[0] < spread[1] / 5  # yaw varies by > 13 degrees, roll much less
    if look_around and axis @ mean_up > np.cos(np.radians(CONE_DEG)):
        return axis, f"their {'xy'[turn % 2]} axes taken as horizontal"
    return np.asarray(mean_up, dtype=np.float64), "their mean up"


def _surfaces(poses: Array, camera: Camera, depth_of: Callable[[int], Array | None]) -> _Surfaces | None:
    """Surface samples of frames spread over the recording, or None if none of them has depth."""
    chosen = np.unique(np.linspace(0, len(poses) - 1, FRAMES).round().astype(int))
    depths = ((int(i), depth_of(int(i))) for i in chosen)
    parts = [oriented(poses[i], camera, depth) for i, depth in depths if depth is not None]
    if not parts:
        return None
    points, normals = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Surfaces(points, normals, len(parts))


def oriented(world_from_camera: Array, camera: Camera, depth_m: Array) -> tuple[Array, Array]:
    """World points and unit normals (m, 3), towards the camera, of a depth image (H, W), by central differences."""
    stride = max(1, camera.width // SAMPLES_ACROSS)
    points = backproject(depth_m, camera, stride)
    centre = points[1:-1, 1:-1]
    along_x = points[1:-1, 2:] - points[1:-1, :-2]
    along_y = points[2:, 1:-1] - points[:-2, 1:-1]
    normals = np.cross(along_y, along_x)
    lengths = np.linalg.norm(normals, axis=-1)
    reach = 12 * stride / camera.fx * centre[..., 2]  # six times the spacing on a frontal plane: beyond lies an edge
    smooth = (np.linalg.norm(along_x, axis=-1) < reach) & (np.linalg.norm(along_y, axis=-1) < reach) & (lengths > 0)
    centre, normals = centre[smooth], normals[smooth] / lengths[smooth, None]
    facing = np.copysign(1, -np.einsum("ij,ij->i", normals, centre))
    rotation = np.asarray(world_from_camera[:3, :3], dtype=np.float32)
    return transform(world_from_camera, centre), (normals * facing[:, None]) @ rotation.T


def _surface_up(surfaces: _Surfaces, guess: Vector) -> tuple[Vector, float]:
    """The mode of the normals near the guess, refined on flat layers, and the share of normals that agree with it."""
    normals = surfaces.normals
    near = normals[_near(normals, guess, CONE_DEG)]
    if len(near) < MIN_SAMPLES:
        return guess, 0.0
    seeds = near[:: max(1, len(near) // 200)]
    votes = np.count_nonzero(near @ seeds.T > np.cos(np.radians(AGREE_DEG)), axis=0)
    up = _direction(seeds[votes.argmax()])
    for band_deg in (15, 12, 10, 8, 8, 8):
        up = _direction(near[_near(near, up, band_deg)].mean(axis=0))
    for _ in range(4):
        up = _flattened(surfaces.level_points(up), up)
    return up, float(np.mean(_near(normals, up, AGREE_DEG)))


def _flattened(points: Array, up: Vector) -> Vector:
    """The up along which the layers of points are thinnest: one plane fit pooled over all layers."""
    heights = points @ up
    layers = _layers(heights)
    if not len(layers):
        return up
    scatter = np.zeros((3, 3))
    for centre in layers:
        layer = points[np.abs(heights - centre) < LAYER_M].astype(np.float64)
        layer -= layer.mean(axis=0)
        scatter += layer.T @ layer
    scatter += 1e-3 * np.trace(scatter) * (np.eye(3) - np.outer(up, up))  # a narrow strip must not tip over
    _, directions = np.linalg.eigh(scatter)
    axis = _direction(directions[:, 0] * np.copysign(1, directions[:, 0] @ up))
    return axis if axis @ up > np.cos(np.radians(AGREE_DEG)) else up


def _layers(heights: Array) -> Vector:
    """Heights, lowest first, at which points pile up: local peaks of the histogram with enough support."""
    if len(heights) < MIN_SAMPLES:
        return np.empty(0)
    low, high = np.percentile(heights, (0.1, 99.9))
    edges = np.arange(low - 10 * BIN_M, high + 11 * BIN_M, BIN_M)
    counts = np.convolve(np.histogram(heights, edges)[0], np.ones(3), mode="same")
    window = np.lib.stride_tricks.sliding_window_view(np.pad(counts, 4), 9).max(axis=1)
    peaks = (counts == window) & (counts >= MIN_SHARE * len(heights))
    return np.asarray(edges[:-1][peaks] + BIN_M / 2, dtype=np.float64)


def _find_floor(poses: Array, surfaces: _Surfaces | None, up: Vector) -> _Floor:
    cameras_m = poses[:, :3, 3] @ up
    camera_m = float(np.median(cameras_m))
    heights = np.empty(0) if surfaces is None else surfaces.level_points(up) @ up
    layers = _layers(heights)
    here = layers[layers > cameras_m.min() - BELOW_M]
    if not len(layers):
        floor_m = camera_m - ASSUMED_CAMERA_HEIGHT_M
        lack = "there is no depth" if surfaces is None else "no horizontal surface was seen"
        return _Floor(floor_m, (
            f"floor assumed {ASSUMED_CAMERA_HEIGHT_M} m below the cameras, at {floor_m:.3f} m along up ({lack}); "
            "override with --floor M"
        ))  # fmt: skip
    floor_m = float(here[0] if len(here) else layers[-1])
    for _ in range(3):
        floor_m = float(np.median(heights[np.abs(heights - floor_m) < LAYER_M]))
    below = 0.0 if surfaces is None else float(np.mean(surfaces.points @ up < floor_m - 0.1))
    doubtful = below > BELOW_SHARE and floor_m - 0.1 < layers[0]
    doubt = f" (but {below:.0%} of the points lie below it: was the floor in view?)" if doubtful else ""
    return _Floor(floor_m, (
        f"floor estimated at {floor_m:.3f} m along up, {camera_m - floor_m:.2f} m below the cameras: "
        f"the lowest large horizontal surface{doubt}; override with --floor M"
    ), not doubtful)  # fmt: skip


def _near(normals: Array, up: Vector, degrees: float) -> npt.NDArray[np.bool_]:
    return np.asarray(normals @ up.astype(normals.dtype) > np.cos(np.radians(degrees)))


def _direction(vector: Sequence[float] | Array) -> Vector:
    try:
        values = np.asarray(vector, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (3,) or not np.isfinite(values).all() or not np.linalg.norm(values) > 0:
        raise InputError(f"up must be three finite numbers that are not all zero, got {vector!r}")
    return np.asarray(values / np.linalg.norm(values), dtype=np.float64)


def _height(floor_m: float) -> float:
    if not isinstance(floor_m, int | float) or not np.isfinite(floor_m):
        raise InputError(f"floor_m must be a finite height in metres, got {floor_m!r}")
    return float(floor_m)


def _rotation_to_z(up: Vector) -> npt.NDArray[np.float64]:
    """The smallest rotation that takes the unit vector ``up`` to +z."""
    x, y, z = up
    sideways = x * x + y * y
    if z < 0 and sideways < 1e-24:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    scale = (
        1 / (1 + z) if z > 0 else (1 - z) / sideways
    )  # the same number; each form loses its digits where the other holds
    return np.asarray(np.eye(3) + cross + cross @ cross * scale, dtype=np.float64)
