"""Light map atlas: large flat faces share a lattice of light nodes, small and round ones use their corners.

Light is computed at *nodes* (points with a normal) and read from *texels* between them, at most FINE times as many per
direction, so that a frame needs one gather per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cartier_dollhouse.model import Triangles

STEP_M = 0.11  # between the nodes of a lattice
FINE = 4  # texels per lattice cell and direction
LARGE_M = 0.12  # a flat triangle with a longer edge gets a lattice
FILLED = 0.5  # share of its rectangle that a shape should cover
CREASE = 0.72  # cosine: a sharper edge than this stays an edge
INSET = 0.01  # texels: keeps what rounding does to a coordinate from leaving the patch

Array = npt.NDArray[np.float32]
Doubles = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Atlas:
    """``corner_st`` (M, 3, 2): light coordinates of each triangle's corners in texels of its patch; texel (s, t) of
    triangle m is number ``base[m] + int(t) * stride[m] + int(s)``.

    ``nodes``, ``normals`` (K, 3) is where light is computed. A texel blends four of them: ``texel_nodes`` (L, 4) with
    ``texel_weights`` (L, 4). ``beside`` (K, 4) are the nodes before and after along s and along t (itself where there
    is none); ``phase`` (K,) counts 0 to 8 over every 3 by 3 nodes of a lattice, so that neighbours can sample
    differently. ``wide`` (L,) are texels of triangles so large, yet lit by their corners, that a shadow can lie between
    the corners.
    """

    corner_st: Array
    base: Ints
    stride: Ints
    nodes: Array
    normals: Array
    texel_nodes: npt.NDArray[np.int32]
    texel_weights: Array
    beside: npt.NDArray[np.int32]
    phase: Ints
    wide: npt.NDArray[np.bool_]


def make_atlas(mesh: Triangles) -> Atlas:
    """Lay out all triangles of a scene."""
    corners = mesh.vertices[mesh.faces]
    flat, corner_normals, welded = _corner_normals(mesh, corners)
    edges = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).max(1)
    lattice = flat & (edges > LARGE_M) & (np.linalg.norm(face_normals(corners), axis=1) > 0.5)
    builder = _Builder(corners)
    builder.add_lattices(np.flatnonzero(lattice), corner_normals[:, 0], welded)
    builder.add_corners(np.flatnonzero(~lattice), corner_normals, welded)
    return builder.atlas()


def face_normals(corners: Array) -> Array:
    """Unit normals (M, 3) of triangles (M, 3, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-20), dtype=np.float32)


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors across each normal that turn smoothly with it (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z >= 0, 1.0, -1.0).astype(np.float32)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1)
    return first, np.stack([b, sign + y * y * a, -y], 1)


def _keys(*columns: npt.NDArray[np.floating] | Ints, step: float = 1.0) -> Ints:
    """Rows that are equal after rounding get equal numbers, 0 to the count of kinds."""
    mixed = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        mixed = (mixed ^ np.round(column / step).astype(np.int64).astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return np.asarray(np.unique(mixed, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _corner_normals(mesh: Triangles, corners: Array) -> tuple[npt.NDArray[np.bool_], Array, Ints]:
    """Which faces are flat, the normal to light each corner by (M, 3, 3), and which corners are one point (M, 3)."""
    plain = face_normals(corners)
    welded = _keys(*corners.reshape(-1, 3).T.astype(np.float64), np.repeat(mesh.part, 3) * 1e-4, step=1e-4)
    here, there = _pairs(welded)
    facing, other = plain[here // 3], plain[there // 3]
    same = np.einsum("px,px->p", facing, other) > CREASE
    here, share = here[same], other[same] * _angles(corners).ravel()[there[same], None]
    total = np.stack([np.bincount(here, share[:, axis], 3 * len(plain)) for axis in range(3)], 1)
    mean = (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)).reshape(-1, 3, 3)
    soft = np.einsum("mcx,mx->mc", mean, plain) < 0.9998
    normals = np.where(soft[..., None], mean, plain[:, None]).astype(np.float32)
    return ~soft.any(1), normals, welded.reshape(-1, 3)


def _pairs(group: Ints) -> tuple[Ints, Ints]:
    """All ordered pairs of elements of the same group, each with itself too."""
    order = np.argsort(group, kind="stable")
    count = np.bincount(group)
    start = np.cumsum(count) - count
    size = count[group]
    here = np.repeat(np.arange(len(group)), size)
    within = np.arange(len(here)) - np.repeat(np.cumsum(size) - size, size)
    return here, order[start[group[here]] + within]


def _angles(corners: Array) -> Array:
    """Each triangle's angles (M, 3): as weights they make a normal blind to how a face is cut into triangles."""
    ahead, back = np.roll(corners, -1, 1) - corners, np.roll(corners, 1, 1) - corners
    cosine = np.einsum("mcx,mcx->mc", ahead, back)
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=2), cosine), dtype=np.float32)


class _Builder:
    """Collects patches one family after the other."""

    def __init__(self, corners: Array) -> None:
        self.corners = corners
        self.st = np.zeros((len(corners), 3, 2), np.float32)
        self.base, self.stride = np.zeros(len(corners), np.int64), np.ones(len(corners), np.int64)
        self.nodes: list[Array] = []
        self.normals: list[Array] = []
        self.texel_nodes: list[npt.NDArray[np.int32]] = []
        self.texel_weights: list[Array] = []
        self.beside: list[npt.NDArray[np.int32]] = []
        self.phase: list[Ints] = []
        self.wide: list[npt.NDArray[np.bool_]] = []
        self.node_count = self.texel_count = 0

    def atlas(self) -> Atlas:
        return Atlas(
            self.st, self.base, self.stride, np.concatenate(self.nodes), np.concatenate(self.normals),
            np.concatenate(self.texel_nodes), np.concatenate(self.texel_weights),
            np.concatenate(self.beside), np.concatenate(self.phase), np.concatenate(self.wide),
        )  # fmt: skip

    def _take(
        self, nodes: Array, normals: Array, numbers: npt.NDArray[np.int32], weights: Array, beside: Ints, phase: Ints
    ) -> None:
        self.nodes.append(nodes)
        self.normals.append(normals)
        self.texel_nodes.append(numbers)
        self.texel_weights.append(weights)
        self.beside.append(beside.astype(np.int32))
        self.phase.append(phase)
        self.node_count += len(nodes)
        self.texel_count += len(numbers)

    def add_lattices(self, which: Ints, normals: Array, welded: Ints) -> None:
        """Triangles that touch and lie in one plane share a rectangle, along the first one's first edge."""
        if not len(which):
            return
        corners, normal = self.corners[which].astype(np.float64), normals[which].astype(np.float64)
        offset = np.einsum("mx,mx->m", corners[:, 0], normal)
        plane = _keys(*normal.T, offset * 10, step=1e-2)
        group = _touching(plane, welded[which])
        first, along, across, st, low, high = _rectangles(corners, normal, group)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        sparse = np.bincount(group, area) < FILLED * (high - low).prod(1)  # rings and combs: one rectangle per quad
        longest = _longest_middle(corners)
        group = _keys(
            np.where(sparse[group], -1 - plane, group), *(np.where(sparse[group], x, 0) * 1e3 for x in longest.T)
        )
        first, along, across, st, low, high = _rectangles(corners, normal, group)
        counts = np.clip(np.ceil((high - low) / STEP_M), 1, 200).astype(np.int64)  # cells along s and t
        texels = counts * FINE
        unit = (st - low[group, None]) / np.maximum(high - low, 1e-9)[group, None]
        self.st[which] = INSET + unit * (texels[group, None] - 2 * INSET)
        size = texels.prod(1)
        self.base[which] = self.texel_count + (np.cumsum(size) - size)[group]
        self.stride[which] = texels[group, 0]
        height = offset[first]

        grid, row, col = _cells(counts + 1)
        margin = np.minimum(0.02, 0.15 * (high - low))
        at = low[grid] + (high - low)[grid] * np.stack([col, row], 1) / counts[grid]
        at = np.clip(at, (low + margin)[grid], (high - margin)[grid])
        nodes = along[grid] * at[:, :1] + across[grid] * at[:, 1:] + normal[first][grid] * height[grid, None]
        start = self.node_count + np.cumsum((counts + 1).prod(1)) - (counts + 1).prod(1)
        own, wide = self.node_count + np.arange(len(grid)), counts[grid, 0] + 1
        last = counts[grid]
        beside = np.stack(
            [own - (col > 0), own + (col < last[:, 0]), own - wide * (row > 0), own + wide * (row < last[:, 1])], 1
        )
        phase = row % 3 * 3 + col % 3
        patch, row, col = _cells(texels)
        numbers, weights = _bilinear(row, col, wide_of=(counts[:, 0] + 1)[patch], start=start[patch])
        self.wide.append(np.zeros(len(numbers), np.bool_))
        self._take(nodes.astype(np.float32), normals[which][first][grid], numbers, weights, beside, phase)

    def add_corners(self, which: Ints, normals: Array, welded: Ints) -> None:
        """Each triangle has a square of its own, blended from its three corners, which neighbours share."""
        if not len(which):
            return
        corner_normals, points = normals[which].reshape(-1, 3), self.corners[which]
        node = _keys(welded[which].reshape(-1) * 0.05, *corner_normals.T, step=0.05)
        first = np.unique(node, return_index=True)[1]
        inside = (0.94 * points + 0.06 * points.mean(1, keepdims=True)).reshape(-1, 3)
        node = node.reshape(-1, 3) + self.node_count
        across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        extent = np.sqrt(np.linalg.norm(across, axis=1))
        longest = np.linalg.norm(points - np.roll(points, 1, 1), axis=2).max(1)
        side = np.select([extent > 0.2, (extent > 0.1) | (longest > 0.2), extent > 0.03], [16, 12, 5], 3)
        self.st[which] = INSET + np.array([[0, 0], [1, 0], [0, 1]]) * (side[:, None, None] - 2 * INSET)
        self.base[which] = self.texel_count + np.cumsum(side**2) - side**2
        self.stride[which] = side
        owner, row, col = _cells(np.stack([side, side], 1))
        u, v = (col + 0.5) / side[owner], (row + 0.5) / side[owner]
        over = np.maximum(u + v, 1)  # texels past the third edge repeat the edge
        u, v = u / over, v / over
        weights = np.stack([1 - u - v, u, v, np.zeros_like(u)], 1)
        numbers = node[owner][:, [0, 1, 2, 2]].astype(np.int32)
        self.wide.append(side[owner] >= 8)
        own = np.repeat(self.node_count + np.arange(len(first))[:, None], 4, 1)
        self._take(
            inside[first], corner_normals[first], numbers, weights.astype(np.float32), own, np.zeros(len(own), np.int64)
        )


def _rectangles(
    corners: Doubles, normal: Doubles, group: Ints
) -> tuple[Ints, Doubles, Doubles, Doubles, Doubles, Doubles]:
    """Of each group its first triangle, its axes along and across, and its bounds along them; and st (M, 3, 2) of all
    corners."""
    first = np.unique(group, return_index=True)[1]
    along = corners[first, 1] - corners[first, 0]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    across = np.cross(normal[first], along)
    st = np.stack([np.einsum("mcx,mx->mc", corners, axis[group]) for axis in (along, across)], -1)
    low, high = np.full((len(first), 2), np.inf), np.full((len(first), 2), -np.inf)
    np.minimum.at(low, group, st.min(1))
    np.maximum.at(high, group, st.max(1))
    return first, along, across, st, low, high


def _longest_middle(corners: Doubles) -> Doubles:
    """The middle (M, 3) of each triangle's longest edge: the two halves of a rectangle share it."""
    nexts = np.roll(corners, -1, 1)
    longest = np.linalg.norm(nexts - corners, axis=2).argmax(1)
    each = np.arange(len(corners))
    return np.asarray((corners[each, longest] + nexts[each, longest]) / 2)


def _touching(plane: Ints, welded: Ints) -> Ints:
    """Numbers triangles (M,) so that those of one plane which share corners (M, 3), at once or through others, are
    equal."""
    corner = _keys(np.repeat(plane, 3), welded.ravel())
    triangle = np.repeat(np.arange(len(plane)), 3)
    size = max(len(plane), int(corner.max()) + 1)
    shares = coo_array((np.ones(len(corner), np.int8), (triangle, corner)), shape=(size, size)).tocsr()
    labels = connected_components(shares @ shares.T, directed=False)[1][: len(plane)]
    return np.asarray(np.unique(labels, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _cells(sizes: Ints) -> tuple[Ints, Ints, Ints]:
    """For rectangles of (columns, rows): the rectangle, row and column of each of all their cells, row by row."""
    count = sizes.prod(1)
    owner = np.repeat(np.arange(len(sizes)), count)
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return owner, within // sizes[owner, 0], within % sizes[owner, 0]


def _bilinear(row: Ints, col: Ints, wide_of: Ints, start: Ints) -> tuple[npt.NDArray[np.int32], Array]:
    """The four nodes around each texel and their weights, in lattices ``wide_of`` nodes wide that begin at
    ``start``."""
    share = ((np.arange(FINE) + 0.5) / FINE).astype(np.float32)
    u, v = share[col % FINE], share[row % FINE]
    numbers, weights = np.empty((len(row), 4), np.int32), np.empty((len(row), 4), np.float32)
    numbers[:, 0] = start + row // FINE * wide_of + col // FINE
    numbers[:, 1] = numbers[:, 0] + 1
    numbers[:, 2] = numbers[:, 0] + wide_of
    numbers[:, 3] = numbers[:, 2] + 1
    weights[:, 3] = u * v
    weights[:, 2] = v - weights[:, 3]
    weights[:, 1] = u - weights[:, 3]
    weights[:, 0] = 1 - u - weights[:, 2]
    return numbers, weights
