"""A recording from your own code: writes a folder of frames and poses that `cartier map` reads.

python examples/room.py OUT
"""

import math
import sys

import numpy as np

from cartier import Camera, Frame
from cartier.recordings.folder import save

CAMERA = Camera(320, 240, 240.0, 240.0, 159.5, 119.5)


class Room:
    """An empty room of 4 m x 4 m with a red box on the floor, seen by a camera that turns in its middle."""

    name, camera, truth, notes = "a red box in a room", CAMERA, None, ("rendered by examples/room.py",)

    def __len__(self) -> int:
        return 24

    def fingerprint(self) -> str:
        return "examples/room.py, version 1"

    def __getitem__(self, index: int) -> Frame:
        yaw, tilt = math.tau * index / len(self), 0.45
        forward = np.array([math.cos(yaw) * math.cos(tilt), math.sin(yaw) * math.cos(tilt), -math.sin(tilt)])
        right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose[:3, 3] = 0.0, 0.0, 1.5

        u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
        rays = (
            np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1) @ pose[:3, :3].T
        )
        _, depth = slabs(pose[:3, 3], rays, (-2, -2, 0), (2, 2, 2.5))
        near, far = slabs(pose[:3, 3], rays, (1.2, -0.3, 0), (1.7, 0.3, 0.6))
        hit = (near <= far) & (near > 0)
        rgb = np.full((*depth.shape, 3), 200, np.uint8)
        rgb[hit] = 190, 30, 30
        return Frame(index, index / 10, rgb, np.where(hit, near, depth).astype(np.float32), pose, CAMERA)


def slabs(
    eye: np.ndarray, rays: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays enter and leave a box."""
    with np.errstate(divide="ignore"):
        t = np.stack([(np.array(low) - eye) / rays, (np.array(high) - eye) / rays])
    return t.min(0).max(-1), t.max(0).min(-1)


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    save(Room(), sys.argv[1])
