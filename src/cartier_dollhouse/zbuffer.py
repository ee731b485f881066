"""Z-buffer in numpy with the same pixels as embreex: slower, for platforms without an embreex wheel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier.geometry import ray_slopes
from cartier.types import Camera

SMALL_PX = 1024  # triangles with a smaller image rectangle are drawn together
BATCH_PX = 1 << 20
Array = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]


class ZBuffer:
    """Which triangle each pixel sees. ``corners`` (M, 3, 3) are in the world."""

    def __init__(self, corners: npt.NDArray[np.float32], camera: Camera) -> None:
        self.corners, self.camera = corners.astype(np.float64), camera
        self.x, self.y = (slopes.astype(np.float64) for slopes in ray_slopes(camera))

    def hits(self, world_from_camera: Array) -> tuple[npt.NDArray[np.int32], Singles, Singles, Singles]:
        """Triangle (H * W,) or -1, barycentric u and v, and z-depth of each pixel; 0 where there is none.

        A pixel's ray d = (x, y, 1) meets the plane of p0, p1, p2 at z = p0·(p1×p2) / Σe with e0 = d·(p1×p2) and so on,
        inside where all e have one sign: linear in x and y, and true for triangles that reach behind the camera too.
        """
        points = (self.corners - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
        number, low, high = self._in_view(points)
        p0, p1, p2 = points[number].transpose(1, 0, 2)
        edges = np.stack([np.cross(p1, p2), np.cross(p2, p0), np.cross(p0, p1)], 1)
        volume = np.einsum("mx,mx->m", p0, edges[:, 0])
        size = high - low
        area = size.prod(1)
        nearest = np.zeros(self.camera.height * self.camera.width)  # 1 / z
        seen = np.full(len(nearest), -1)
        for some in self._batches(area):
            self._draw(some, edges, volume, low, size, nearest, seen)
        hit = seen >= 0
        u, v, z = np.zeros((3, len(seen)), np.float32)
        pixel = np.flatnonzero(hit)
        e = self._edge_values(edges[seen[pixel]], pixel % self.camera.width, pixel // self.camera.width)
        total = e.sum(1)
        u[pixel], v[pixel], z[pixel] = e[:, 1] / total, e[:, 2] / total, volume[seen[pixel]] / total
        return np.where(hit, number[seen], -1).astype(np.int32), u, v, z

    def _in_view(self, points: Array) -> tuple[Ints, Ints, Ints]:
        """Triangles that may be seen, with the first and the last-plus-one (column, row) of their image rectangles."""
        z = points[..., 2]
        keep = z.max(1) > 1e-6
        for axis, slopes in ((0, self.x), (1, self.y)):
            keep &= ~(points[..., axis] < slopes[0] * z).all(1) & ~(points[..., axis] > slopes[-1] * z).all(1)
        number = np.flatnonzero(keep)
        points, z = points[number], z[number]
        limits = np.array([self.camera.width, self.camera.height])
        whole = z.min(1) < 1e-3  # reaches behind the camera: anywhere in the image
        pixels = points[..., :2] / np.maximum(z, 1e-3)[..., None] * (self.camera.fx, self.camera.fy)
        pixels += (self.camera.cx, self.camera.cy)
        low = np.clip(np.ceil(pixels.min(1) - 1e-6), 0, limits).astype(np.int64)
        high = np.clip(np.floor(pixels.max(1) + 1e-6) + 1, 0, limits).astype(np.int64)
        low[whole], high[whole] = 0, limits
        drawn = (high > low).all(1)
        return number[drawn], low[drawn], high[drawn]

    def _batches(self, area: Ints) -> list[Ints]:
        """Large triangles one by one, then the small ones, about BATCH_PX pixels at a time."""
        small = np.flatnonzero(area <= SMALL_PX)
        groups = np.cumsum(area[small]) // BATCH_PX
        cuts = np.flatnonzero(np.diff(groups)) + 1
        return [np.array([one]) for one in np.flatnonzero(area > SMALL_PX)] + [
            some for some in np.split(small, cuts) if len(some)
        ]

    def _edge_values(self, edges: Array, column: Ints, row: Ints) -> Array:
        return np.asarray(
            edges[:, :, 0] * self.x[column][:, None] + edges[:, :, 1] * self.y[row][:, None] + edges[:, :, 2]
        )

    def _draw(
        self, which: Ints, edges: Array, volume: Array, low: Ints, size: Ints, nearest: Array, seen: Ints
    ) -> None:
        """Try these triangles on all pixels of their rectangles."""
        area = size[which].prod(1)
        owner = np.repeat(which, area)
        within = np.arange(int(area.sum())) - np.repeat(np.cumsum(area) - area, area)
        column = low[owner, 0] + within % size[owner, 0]
        row = low[owner, 1] + within // size[owner, 0]
        if len(which) == 1:
            x, y, edge = self.x[column], self.y[row], edges[which[0]]
            e = np.stack([x * a + y * b + c for a, b, c in edge], 1)
        else:
            e = self._edge_values(edges[owner], column, row)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = e.sum(1) / volume[owner]
        inside = ((e >= 0).all(1) | (e <= 0).all(1)) & (inverse > 0) & np.isfinite(inverse)
        pixel, inverse, owner = (row * self.camera.width + column)[inside], inverse[inside], owner[inside]
        closer = inverse > nearest[pixel]
        pixel, inverse, owner = pixel[closer], inverse[closer], owner[closer]
        order = np.argsort(inverse, kind="stable")  # of several in one pixel, the last and nearest stays
        nearest[pixel[order]] = inverse[order]
        seen[pixel[order]] = owner[order]
