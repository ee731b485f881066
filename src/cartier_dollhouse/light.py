"""Static light, baked once per scene: sun and sky through the windows, a warm lamp per room, shadows, one bounce.

Light is in units in which 1 makes a white wall white. Without embreex nothing is in shadow and nothing bounces.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.atlas import Array, Atlas, tangents
from cartier_dollhouse.materials import Material
from cartier_dollhouse.model import Scene, Triangles
from cartier_dollhouse.trace import Tracer, tracer

SUN = np.array([3.4, 2.9, 2.2])
SKY = np.array([2.6, 2.9, 3.3])  # radiance of a window
LAMP = np.array([1.55, 1.30, 1.02])
SHADE = np.array([0.30, 0.23, 0.15])  # a small lamp
AMBIENT = np.array([0.30, 0.29, 0.28])  # what has bounced more than once
SUN_HEIGHT, SUN_ASKEW = math.radians(34), math.radians(28)
BOUNCES = 12  # rays per node
GOLDEN = math.pi * (3 - math.sqrt(5))
LIFT_M = 0.004  # rays start so far off their surface
ROUND_M = 0.015  # … and off round ones, whose triangles hide behind each other
FAR_M = 100.0
UNIT = 128  # the byte that stands for light 1


def bake(scene: Scene, mesh: Triangles, atlas: Atlas, materials: list[Material]) -> npt.NDArray[np.uint32]:
    """The light of each texel as packed bytes r, g, b: a texture's bytes times these, over UNIT, are what is seen."""
    passes = np.array([m.glow > 0 or m.name.startswith("glass") for m in materials])
    rays = tracer(mesh, np.flatnonzero(~passes[mesh.part]))
    sun = _sun(scene)
    still = _lamps(scene, mesh, atlas, rays) + _windows(scene, atlas, rays)
    facing = np.maximum(atlas.normals @ sun, 0)
    lit = _sun_at(atlas.nodes + LIFT_M * atlas.normals, facing, sun[None], rays)
    if rays is None:
        still += AMBIENT * (1.0 + 0.35 * atlas.normals[:, 2:])
    else:
        direct = _blend(atlas, still + np.outer(lit, SUN))
        still = still + _bounce(scene, mesh, atlas, materials, rays, direct)
    light = _blend(atlas, still) + _fine_sun(atlas, lit, facing, sun, rays)[:, None] * SUN
    return _packed(_toned(light, _exposure(still)))


def plain(atlas: Atlas) -> npt.NDArray[np.uint32]:
    """Light that only tells surfaces apart by how they lie: at once, without a bake."""
    light = 0.62 + 0.22 * atlas.normals @ (0.31, -0.42, 0.85)
    return _packed(_blend(atlas, np.repeat(light[:, None], 3, 1)))


def _blend(atlas: Atlas, values: npt.NDArray[np.floating]) -> Array:
    """Values (K, C) of the nodes at the texels (L, C)."""
    result = np.empty((len(atlas.texel_nodes), values.shape[1]), np.float32)
    for channel, single in enumerate(np.ascontiguousarray(values.T, dtype=np.float32)):
        result[:, channel] = np.einsum("lk,lk->l", single.take(atlas.texel_nodes), atlas.texel_weights)
    return result


def _exposure(light: npt.NDArray[np.floating]) -> float:
    """Brings the usual light of the home to the same level: a dark home is filmed with an open iris."""
    seen = light.mean(1)
    seen = seen[seen > 0.02]
    return float(np.clip(0.80 / np.percentile(seen, 70), 0.4, 4.0)) if len(seen) else 1.0


def _toned(light: Array, exposure: float) -> Array:
    """Films the light: highlights roll off instead of burning out."""
    return np.asarray((1.75 * (1 - np.exp(light * (-exposure / 1.45)))) ** (1 / 2.2), dtype=np.float32)


def _packed(light: Array) -> npt.NDArray[np.uint32]:
    texels = np.zeros((len(light), 4), np.uint8)
    texels[:, :3] = np.clip(light * UNIT + 0.5, 0, 255)
    return texels.view(np.uint32).ravel()


def _sun(scene: Scene) -> npt.NDArray[np.float64]:
    """Towards the sun (3,): it shines on the side of the home with the most glass, a little askew."""
    glass: dict[float, float] = {}
    for opening in scene.openings:
        if opening.kind == "window":
            heading = _outwards(scene, opening.start, opening.end)
            glass[heading] = glass.get(heading, 0) + math.dist(opening.start, opening.end)
    heading = (max(glass, key=lambda side: (round(glass[side], 3), side)) if glass else -math.pi / 2) + SUN_ASKEW
    flat = math.cos(SUN_HEIGHT)
    return np.array([flat * math.cos(heading), flat * math.sin(heading), math.sin(SUN_HEIGHT)])


def _outwards(scene: Scene, start: tuple[float, float], end: tuple[float, float]) -> float:
    """The heading from the nearest room through an opening."""
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    across = math.atan2(end[1] - start[1], end[0] - start[0]) + math.pi / 2

    def outside(heading: float) -> float:
        px, py = x + 0.4 * math.cos(heading), y + 0.4 * math.sin(heading)
        return min(  # metres from the nearest room
            (max(a - px, px - c, 0) + max(b - py, py - d, 0) for a, b, c, d in (room.box for room in scene.rooms)),
            default=0.0,
        )

    return round(across if outside(across) > outside(across - math.pi) else across - math.pi, 3)


def _sun_at(
    points: npt.NDArray[np.floating], facing: Array, suns: npt.NDArray[np.float64], rays: Tracer | None
) -> Array:
    """How much sun falls on points (K, 3): the cosine where it is seen, averaged over points of its disc (n, 3)."""
    lit = np.where(facing > 0.02, facing, 0).astype(np.float32)
    if rays is None:
        return 0 * lit
    which = np.flatnonzero(lit)
    for_all = np.tile(points[which], (len(suns), 1))
    seen = ~rays.blocked(for_all, np.repeat(suns, len(which), 0), FAR_M)
    lit[which] *= seen.reshape(len(suns), -1).mean(0)
    return lit


def _fine_sun(atlas: Atlas, lit: Array, facing: Array, sun: npt.NDArray[np.float64], rays: Tracer | None) -> Array:
    """Sun per texel (L,): blended from the nodes, and traced anew, softly, where a shadow's edge runs between them."""
    result = _blend(atlas, lit[:, None])[:, 0]
    shares = (lit / np.maximum(facing, 1e-3))[atlas.texel_nodes]
    edge = np.flatnonzero((shares.max(1) - shares.min(1) > 0.5) | atlas.wide)
    if rays is None or not len(edge):
        return result
    numbers, weights = atlas.texel_nodes[edge], atlas.texel_weights[edge, :, None]
    lift = np.where(atlas.wide[edge], ROUND_M, LIFT_M)[:, None]
    points = ((atlas.nodes[numbers] + lift[:, None] * atlas.normals[numbers]) * weights).sum(1)
    towards = (facing[numbers] * weights[..., 0]).sum(1)
    first, second = tangents(sun[None].astype(np.float32))
    disc = 0.012 * np.array([[1, 0.3], [-0.3, 1], [-1, -0.3], [0.3, -1], [0.2, -0.2]])
    result[edge] = _sun_at(points, towards, sun + disc @ np.concatenate([first, second]), rays)
    return result


def _reach(atlas: Atlas, at: npt.NDArray[np.float64], axis: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64]:
    """cos(at the node) cos(at the light) / distance² (K,) of a small light; all round where it has no axis."""
    way = at - atlas.nodes
    square = np.einsum("kx,kx->k", way, way)
    distance = np.sqrt(square) + 1e-9
    falls = np.maximum(np.einsum("kx,kx->k", way, atlas.normals), 0) / distance
    leaves = 1.0 if axis is None else np.clip(-(way @ axis) / distance, 0, 1)
    return np.asarray(falls * leaves / np.maximum(square, 0.06), dtype=np.float64)


def _shine(
    atlas: Atlas,
    spots: npt.NDArray[np.float64],
    axis: npt.NDArray[np.float64] | None,
    least: float,
    rays: Tracer | None,
) -> npt.NDArray[np.float64]:
    """What a light made of ``spots`` (n, 3) gives each node (K,), with its shadows; less than ``least`` counts as
    nothing."""
    middle = _reach(atlas, spots.mean(0), axis)
    which = np.flatnonzero(middle > least)
    total = np.zeros(len(atlas.nodes))
    if rays is None:
        total[which] = middle[which]
        return total
    starts = (atlas.nodes + LIFT_M * atlas.normals)[which]
    for spot in spots:
        total[which] += np.where(rays.blocked(starts, spot - starts, 0.995), 0, middle[which]) / len(spots)
    return total


def _lamps(scene: Scene, mesh: Triangles, atlas: Atlas, rays: Tracer | None) -> npt.NDArray[np.float64]:
    """Ceiling light in every room, and the small lamps that stand about."""
    total = np.zeros((len(atlas.nodes), 3))
    disc = 0.14 * np.array([[1, 0.2, 0], [-0.2, 1, 0], [-1, -0.2, 0], [0.2, -1, 0]])
    for room in scene.rooms:
        x1, y1, x2, y2 = room.box
        along_x, count = x2 - x1 > y2 - y1, max(1, round((x2 - x1) * (y2 - y1) / 14))
        for number in range(count):
            share = (number + 0.5) / count
            x, y = (share, 0.5) if along_x else (0.5, share)
            at = np.array([x1 + x * (x2 - x1), y1 + y * (y2 - y1), scene.height_m - 0.1])
            total += _shine(atlas, at + disc, np.array([0, 0, -1.0]), 0.004, rays)[:, None] * LAMP
    glowing = [number for number, name in enumerate(mesh.materials) if name.partition(":")[0] == "light"]
    for part in glowing[:60]:
        points = mesh.vertices[mesh.faces[mesh.part == part]].reshape(-1, 3)
        middle = (points.min(0) + points.max(0)) / 2
        total += _shine(atlas, middle[None].astype(np.float64), None, 0.02, rays)[:, None] * SHADE
    return total


def _windows(scene: Scene, atlas: Atlas, rays: Tracer | None) -> npt.NDArray[np.float64]:
    """Soft light of the sky through each window."""
    total = np.zeros((len(atlas.nodes), 3))
    for opening in scene.openings:
        if opening.kind != "window":
            continue
        heading = _outwards(scene, opening.start, opening.end)
        (x1, y1), (x2, y2) = opening.start, opening.end
        shares = np.array([[0.2, 0.3], [0.8, 0.2], [0.5, 0.55], [0.25, 0.8], [0.8, 0.75]])
        spots = np.column_stack(
            [
                x1 + shares[:, 0] * (x2 - x1),
                y1 + shares[:, 0] * (y2 - y1),
                opening.bottom_m + shares[:, 1] * (opening.top_m - opening.bottom_m),
            ]
        )
        area = math.dist(opening.start, opening.end) * (opening.top_m - opening.bottom_m)
        inwards = -np.array([math.cos(heading), math.sin(heading), 0.0])
        total += area / math.pi * _shine(atlas, spots, inwards, 0.01, rays)[:, None] * SKY
    return total


def _bounce(
    scene: Scene, mesh: Triangles, atlas: Atlas, materials: list[Material], rays: Tracer, direct: Array
) -> npt.NDArray[np.float64]:
    """Light (K, 3) that comes from other surfaces, by a few rays over each node's hemisphere."""
    albedo = np.array([m.albedo for m in materials])[mesh.part].astype(np.float32)
    glow = np.array([m.glow for m in materials])[mesh.part].astype(np.float32)
    windows = any(opening.kind == "window" for opening in scene.openings)
    sky = 0 * SKY if windows else 0.3 * SKY  # what comes through windows is counted already
    first, second = tangents(atlas.normals)
    starts = atlas.nodes + LIFT_M * atlas.normals
    total = np.zeros((len(starts), 3), np.float32)
    for number in range(BOUNCES):
        share = (number + 0.1 + 0.1 * atlas.phase) / BOUNCES  # nine nodes take turns, their mean sees all directions
        radius, turn = np.sqrt(share), number * GOLDEN + atlas.phase * (2 * math.pi / 9)
        x, y, up = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - share)
        way = x[:, None] * first + y[:, None] * second + up[:, None] * atlas.normals
        prim, u, v, distance = rays.hits(starts, way)
        u, v = u[:, None], v[:, None]
        st = atlas.corner_st[prim]
        s, t = (st[:, 0] * (1 - u - v) + st[:, 1] * u + st[:, 2] * v).T
        texel = atlas.base[prim] + t.astype(np.int64) * atlas.stride[prim] + s.astype(np.int64)
        near = np.minimum(distance / 0.9, 1)[:, None]  # light that has bounced often is weak in corners
        back = albedo[prim] * (direct[texel] + near * AMBIENT) + glow[prim, None]
        total += np.where(prim[:, None] >= 0, back, sky).astype(np.float32)
    for before, after in ((0, 1), (2, 3)):
        total = (total + total[atlas.beside[:, before]] + total[atlas.beside[:, after]]) / np.float32(3)
    return np.asarray(total / BOUNCES, dtype=np.float64)
