"""Coloured point cloud from depth, thinned to one point per voxel: for display, not for measurement.

Points above door height are left out, so that no ceiling hides the room below it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cartier.geometry import ray_slopes, transform
from cartier.home.point_cloud import MAX_POINTS, SIDE_M, STEP_M, parse_cloud
from cartier.io.files import npz_bytes
from cartier.types import Frame

ROOMY = 0.9  # of as many points as may be, so many are left when voxels get larger
LOW_M, HIGH_M = -0.5, 2.2  # heights that are kept
RANGE_M = 5.0  # depth beyond is too noisy
COLUMNS = 40  # image columns that are sampled in one frame; other frames sample others
FLYING = 0.05  # a pixel whose neighbour's depth differs by more of its own lies on an edge
PENDING = 150_000  # samples that wait until they are merged all at once
MAX_WEIGHT = 255


class CloudMapper:
    """Grows a point cloud frame by frame. Memory is bounded: when there are too many points, voxels get larger.

    A point is the mean, in place and colour, of all samples in its voxel.
    """

    def __init__(self) -> None:
        self.side_m = SIDE_M
        self._frames = 0
        self._origin = np.zeros(3)
        self._points = np.zeros((0, 7), np.float32)  # x, y, z from the origin (m), red, green, blue, how many samples
        self._new: list[npt.NDArray[np.float32]] = []

    def add(self, frame: Frame) -> None:
        """Take in one frame with depth."""
        assert frame.depth_m is not None
        if not self._frames and not len(self._points):
            self._origin[:2] = frame.world_from_camera[:2, 3]
        row, col, z = self._sample(frame.depth_m)
        self._frames += 1
        across, down = ray_slopes(frame.camera)
        pose = frame.world_from_camera.copy()
        pose[:3, 3] -= self._origin
        samples = np.ones((len(z), 7), np.float32)
        samples[:, :3] = transform(pose, np.stack([across[col] * z, down[row] * z, z], axis=1))
        samples[:, 3:6] = frame.rgb[row, col]
        self._new.append(samples[(samples[:, 2] >= LOW_M) & (samples[:, 2] <= HIGH_M)])
        if sum(map(len, self._new)) > PENDING:
            self._merge()

    def _sample(
        self, depth_m: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.float32]]:
        """Rows, columns and depths of a lattice of pixels, another one in each frame, without those on edges."""
        stride = max(1, depth_m.shape[1] // COLUMNS)
        shifts = (int(self._frames * step % 1 * stride) for step in (0.7549, 0.5698))  # even over two dimensions
        rows, cols = (np.arange(first, size - 1, stride) for first, size in zip(shifts, depth_m.shape, strict=True))
        z, right, below = (depth_m[np.ix_(rows + down, cols + across)] for down, across in ((0, 0), (0, 1), (1, 0)))
        with np.errstate(invalid="ignore"):  # NaN is no depth
            whole = (z > 0) & (z <= RANGE_M) & (abs(right - z) <= FLYING * z) & (abs(below - z) <= FLYING * z)
        row, col = np.nonzero(whole)
        return rows[row], cols[col], z[whole]

    def _merge(self) -> None:
        """The samples that wait become part of the points."""
        every = np.concatenate([self._points, *self._new])
        if len(every) == len(self._points):
            return
        self._new = []
        bits = len(every).bit_length()
        while True:
            cells = np.floor(every[:, :3].T / np.float32(self.side_m)).astype(np.int64)
            x, y, z = (each - each.min() for each in cells)
            key = (x * (y.max() + 1) + y) * (z.max() + 1) + z
            ordered = np.sort(key << bits | np.arange(len(key)))  # faster than argsort, and always the same
            voxel, order = ordered >> bits, ordered & ((1 << bits) - 1)
            first = np.flatnonzero(np.append(True, voxel[1:] != voxel[:-1]))
            if len(first) <= MAX_POINTS:
                break
            self.side_m *= math.sqrt(len(first) / (ROOMY * MAX_POINTS))  # surfaces: as many as 1 / side²
        every = every[order]
        every[:, :6] *= every[:, 6:]
        self._points = np.add.reduceat(every, first, axis=0)
        self._points[:, :6] /= self._points[:, 6:]
        np.minimum(self._points[:, 6], MAX_WEIGHT, out=self._points[:, 6])  # so that new colours come through

    @property
    def empty(self) -> bool:
        """Whether there is no point yet."""
        return not len(self._points) and not any(map(len, self._new))

    def state(self) -> bytes:
        """What ``restore`` and ``read_cloud`` read, of a cloud that is not empty."""
        self._merge()
        points = self._points
        low = np.floor(points[:, :3].min(0) / self.side_m) * self.side_m  # so that a restored cloud has the same voxels
        return npz_bytes(
            xyz=np.round((points[:, :3] - low) / STEP_M).astype(np.uint16),
            rgb=np.round(points[:, 3:6]).astype(np.uint8),
            weight=points[:, 6].astype(np.uint8), low_m=self._origin + low, side_m=np.array(self.side_m),
        )  # fmt: skip

    def restore(self, data: bytes) -> None:
        """Go on from ``state``. Raises InputError if it is none."""
        cloud, weight, low = parse_cloud(data)
        self.side_m, self._origin = cloud.side_m, np.array([low[0], low[1], 0.0])
        self._points = np.column_stack([cloud.xyz_m - self._origin, cloud.rgb, weight]).astype(np.float32)
