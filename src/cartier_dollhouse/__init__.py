"""Dollhouse world: seven furnished homes built in, and one generated from each whole number; no download.

What is rendered is a simulation with exact truth: colour, depth, instance ids and true boxes come from the same
triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from cartier.errors import BackendError
from cartier.types import Frame, Goal, TrueObject

if TYPE_CHECKING:
    from cartier_dollhouse.drive import Drive
    from cartier_dollhouse.model import Scene
    from cartier_dollhouse.place import Plan
    from cartier_dollhouse.recording import DollhouseRecording

KEPT = 4  # homes in memory


def make(width: int = 640, height: int = 480, fov: float = 62.0, radius_m: float = 0.2) -> Dollhouse:
    """The world of built-in homes. ``fov`` is the camera's vertical field of view in degrees.

    Raises BackendError for an impossible option.
    """
    for ok, message in (
        (0 < width <= 4096 and 0 < height <= 4096, f"width and height must be 1 to 4096 px, got {width}x{height}"),
        (20 <= fov <= 120, f"fov must be 20 to 120 degrees (vertical), got {fov:g}"),
        (0.05 <= radius_m <= 1, f"radius_m must be 0.05 to 1 m, got {radius_m:g}"),
    ):
        if not ok:
            raise BackendError(f"dollhouse: {message}")
    return Dollhouse(width, height, fov, radius_m)


class Dollhouse:
    """Obeys the World contract. A home is a built-in name, a whole number (generated from it) or a path to a .yaml
    file."""

    name = "dollhouse"

    def __init__(self, width: int, height: int, fov: float, radius_m: float) -> None:
        self._size, self._fov, self._radius_m = (width, height), fov, radius_m
        self._scenes: dict[str, Scene] = {}
        self._plans: dict[str, Plan] = {}

    def homes(self) -> list[str]:
        """The built-in ones."""
        from cartier_dollhouse.scene import homes

        return homes()

    def scene(self, home: str) -> Scene:
        """A home as it is built. Raises InputError for an unknown name or a faulty file."""
        from cartier_dollhouse.scene import load_home

        if home not in self._scenes:
            scene = load_home(home)
            for old in list(self._scenes)[: 1 - KEPT]:
                self._scenes.pop(old), self._plans.pop(old, None)
            self._scenes[home] = scene
        return self._scenes[home]

    def explore(
        self,
        home: str,
        seed: int = 0,
        sensor: str = "exact",
        drive: bool = False,
        max_frames: int = 800,
        stop: Callable[[], bool] | None = None,
        **unknown: Any,
    ) -> DollhouseRecording:
        """A robot's walk through a home that it does not know, or (``drive``) one that a person steers with the
        keyboard.

        ``sensor`` is "exact", or disturbs depth, image and poses as those of a real "depth-camera" or "phone" are, by
        ``seed``; another seed is another walk as well. ``stop`` is asked before each step. Frames are rendered when
        they are asked for. Raises InputError for an unknown home or sensor, when ``stop`` says so, or if nothing can be
        steered; BackendError for an unknown option.
        """
        from cartier_dollhouse.recording import DollhouseRecording, pinhole
        from cartier_dollhouse.sensor import sensor_of

        if unknown:
            known = "seed, sensor, drive, max_frames, stop"
            raise BackendError(f"exploring the dollhouse has no option {next(iter(unknown))!r}; it has {known}")
        if max_frames < 1:
            raise BackendError(f"dollhouse: max_frames must be 1 or more, got {max_frames}")
        disturbing = sensor_of(sensor, seed)
        scene, camera = self.scene(home), pinhole(*self._size, self._fov)
        if drive:
            from cartier_dollhouse.teleop import steer

            poses, note = steer(scene, camera, self._radius_m), "steered by a person"
        else:
            from cartier_dollhouse.explore import explore

            walk = explore(scene, camera, self._radius_m, seed=seed, max_frames=max_frames, stop=stop)
            poses = walk.poses
            note = f"explored by itself (seed {seed}): {walk.coverage:.1%} of the reachable floor, {walk.bumps} bumps"
            note += "" if walk.complete else f"; ended early, after {max_frames} frames"
        return DollhouseRecording(scene, camera, poses, disturbing, [note])

    def objects(self, home: str) -> list[TrueObject]:
        """All furnishings of a home with their true boxes."""
        return self.scene(home).truth()

    def drive(self, scene: Scene, start_xy: Sequence[float], goal: Goal, radius_m: float) -> Drive:
        """What comes of a goal in a home. Raises InputError if the robot fits at neither end."""
        from cartier_dollhouse.drive import drive

        return drive(scene, start_xy, goal, radius_m)

    def frame_at(self, scene: Scene, goal: Goal, eye_m: float) -> Frame:
        """What the camera of a robot at a goal shows."""
        from cartier_dollhouse.drive import frame_at

        return frame_at(scene, goal, eye_m=eye_m)

    def free(self, home: str, xy: Sequence[float]) -> bool:
        """Whether the robot can stand at a point."""
        from cartier_dollhouse.place import Plan

        x, y = map(float, xy)
        if home not in self._plans:
            self._plans[home] = Plan(self.scene(home), self._radius_m)
        return self._plans[home].free((x, y))
