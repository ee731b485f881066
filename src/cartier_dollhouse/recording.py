"""Recording of a walk through a scene; each frame is rendered on demand."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, frame_number
from cartier.types import Camera, Frame, TrueObject
from cartier_dollhouse.model import Scene, triangles
from cartier_dollhouse.render import Renderer, View

if TYPE_CHECKING:
    from cartier_dollhouse.sensor import Sensor

Poses = npt.NDArray[np.float64]

EYE_M = 1.5  # height of the camera above the floor, as in the paper
STEP_S = 0.5  # time between two frames: a quarter of a metre at half a metre per second


def pinhole(width: int = 640, height: int = 480, fov_deg: float = 62.0) -> Camera:
    """The robot's camera; ``fov_deg`` is the vertical field of view."""
    focal = height / 2 / math.tan(math.radians(fov_deg) / 2)
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def look(xy: Sequence[float] | Poses, yaw: float, down: float, eye_m: float = EYE_M) -> Poses:
    """world_from_camera (4, 4) of a camera above a point that looks along ``yaw`` and ``down`` from the level (rad)."""
    ahead = np.array([math.cos(yaw) * math.cos(down), math.sin(yaw) * math.cos(down), -math.sin(down)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    pose[:3, 3] = (float(xy[0]), float(xy[1]), eye_m)
    return pose


@lru_cache(maxsize=2)
def lit_renderer(scene: Scene, camera: Camera) -> Renderer:
    """The full renderer of a scene; baking its light takes longer than a frame, so the last two are kept."""
    return Renderer(scene, camera)


class DollhouseRecording:
    """Obeys the Recording contract. Nothing is kept of a frame once it was handed out.

    With a ``sensor``, images, depth and the poses that are told are disturbed; what is rendered follows the true
    ``poses`` (N, 4, 4). ``notes`` are added to those that say how the frames came about.
    """

    def __init__(
        self, scene: Scene, camera: Camera, poses: Poses, sensor: Sensor | None = None, notes: Sequence[str] = ()
    ) -> None:
        self.name = f"dollhouse {scene.name}"
        self.camera = camera
        self.truth: Sequence[TrueObject] | None = scene.truth()
        self.notes: Sequence[str] = [
            f"a simulation: the dollhouse's home {scene.name!r}, with its true objects",
            f"sensor disturbed on purpose: {sensor}" if sensor else "sensor exact: no noise, no holes, no drift",
            *notes,
        ]
        self._scene: Scene | None = scene
        self._sensor = sensor
        self._true_poses = np.array(poses, dtype=np.float64)
        self._poses = np.array(sensor.drift(self._true_poses)) if sensor else self._true_poses.copy()
        self._poses.setflags(write=False)
        self._fingerprint: str | None = None

    def __len__(self) -> int:
        return len(self._poses)

    def __getitem__(self, index: int) -> Frame:
        """Raises InputError once the recording was closed."""
        i = frame_number(index, len(self), self.name)
        view = self._view(i)
        return Frame(
            index=i,
            time_s=i * STEP_S,
            rgb=view.rgb,
            depth_m=view.depth_m,
            world_from_camera=self._poses[i],
            camera=self.camera,
            instances=view.instances,
        )

    def fingerprint(self) -> str:
        """Over the scene's triangles, the camera, the poses and the sensor's settings."""
        if self._fingerprint is None:
            self._fingerprint = self._hash()
        return self._fingerprint

    def close(self) -> None:
        """Let go of the home; frames can be had no more."""
        self._scene = None

    def _open_scene(self) -> Scene:
        if self._scene is None:
            raise InputError(f"{self.name} was closed, so its frames are gone: explore the home again")
        return self._scene

    def _view(self, i: int) -> View:
        view = lit_renderer(self._open_scene(), self.camera).render(self._true_poses[i])
        return self._sensor.corrupt(view, i) if self._sensor else view

    def _hash(self) -> str:
        scene = self._open_scene()
        mesh = triangles(scene)
        truth = [(t.id, t.label) for t in self.truth or ()]
        total = hashlib.sha256(f"dollhouse 1 {scene.name} {self.camera} {self._sensor} {truth}".encode())
        for array in (mesh.vertices, mesh.faces, mesh.uv_m, mesh.instance, mesh.part, self._true_poses):
            total.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
        total.update("\0".join(mesh.materials).encode())
        return total.hexdigest()
