"""Coloured point cloud of a home, in the form in which it is stored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.io.files import read_npz

MAX_POINTS = 60_000
SIDE_M = 0.03  # the side of the smallest voxels
STEP_M = 0.005  # the resolution of saved positions: 16 bits reach 327 m
FAR_M = 1e8  # no map lies farther from its origin


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The points that depth showed, one per voxel.

    Args:
        xyz_m: (N, 3) float64, positions in the map frame.
        rgb: (N, 3) uint8, colours.
        side_m: The side of a voxel.
    """

    xyz_m: npt.NDArray[np.float64]
    rgb: npt.NDArray[np.uint8]
    side_m: float


def read_cloud(data: bytes) -> PointCloud:
    """Read the cloud that a ``CloudMapper`` saved. Raises InputError if it is damaged."""
    return parse_cloud(data)[0]


def parse_cloud(data: bytes) -> tuple[PointCloud, npt.NDArray[np.uint8], npt.NDArray[np.float64]]:
    """Read the cloud, its samples per point (N,), and its lowest corner (3,). Raises InputError if it is damaged."""
    arrays = read_npz(data, where="the point cloud")
    try:
        xyz, rgb, weight = arrays["xyz"], arrays["rgb"], arrays["weight"]
        low, side = arrays["low_m"].astype(np.float64), float(arrays["side_m"])
        count = len(xyz)
        shapes = xyz.shape == rgb.shape == (count, 3) and weight.shape == (count,) and low.shape == (3,)
        kinds = xyz.dtype == np.uint16 and rgb.dtype == weight.dtype == np.uint8
        if not (shapes and kinds and 0 < count <= MAX_POINTS and np.abs(low).max() <= FAR_M and SIDE_M <= side < 100):
            raise ValueError("arrays of another kind")
        if not weight.all():
            raise ValueError("points of no samples")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the point cloud is damaged ({error}): map the recording again") from error
    return PointCloud(low + xyz * STEP_M, rgb, side), weight, low
