"""Renderer of a dollhouse: colour, exact depth and exact instance of each pixel, on one CPU core.

Window panes are left out of the picture: a robot looks through them into a garden, at no depth. Other glass (a shower
door, a table top, a vase) is pale and opaque, so that colour, depth and instance always speak of the same surface.
Mirrors are grey.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cartier.errors import BackendError, check_pose
from cartier.geometry import ray_slopes
from cartier.types import Array, Camera
from cartier_dollhouse import light as lights
from cartier_dollhouse.atlas import make_atlas
from cartier_dollhouse.materials import material
from cartier_dollhouse.model import Scene, Triangles, triangles
from cartier_dollhouse.outdoors import outdoors
from cartier_dollhouse.shade import Shader
from cartier_dollhouse.trace import TILE, tracer
from cartier_dollhouse.zbuffer import ZBuffer

_Hits = tuple[
    slice,
    npt.NDArray[np.float32],
    npt.NDArray[np.int32],
    npt.NDArray[np.float32],
    npt.NDArray[np.float32],
    npt.NDArray[np.float32],
]
"""Which pixels, their rays in the world, triangle (-1: none), barycentric u and v, z-depth."""


@dataclass(frozen=True, eq=False)
class View:
    """One picture: ``rgb`` (H, W, 3) uint8; ``depth_m`` (H, W) float32, NaN where nothing is; ``instances`` (H, W)
    int32.

    ``hard`` (H, W) marks what depth sensors fail on: glass, mirrors, screens, black.
    """

    rgb: npt.NDArray[np.uint8]
    depth_m: npt.NDArray[np.float32]
    instances: npt.NDArray[np.int32]
    hard: npt.NDArray[np.bool_]


class Renderer:
    """Looks into a scene with a camera. ``engine`` is "embree", "numpy", or None for embree where it is installed.

    ``light`` bakes sun, sky, lamps and shadows when the first picture is asked for; without it surfaces are only told
    apart.
    """

    def __init__(self, scene: Scene, camera: Camera, light: bool = True, engine: str | None = None) -> None:
        if engine not in (None, "embree", "numpy"):
            raise BackendError(f"there is no rendering engine {engine!r}: choose embree or numpy")
        self.scene, self.camera, self._light = scene, camera, light
        self.mesh = _without_panes(triangles(scene))
        self.materials = [material(name) for name in self.mesh.materials]
        self._tracer = None if engine == "numpy" else tracer(self.mesh)
        if engine == "embree" and self._tracer is None:
            raise BackendError(
                "the embree engine needs the package embreex, which is not installed: use engine='numpy'"
            )
        self.engine = "numpy" if self._tracer is None else "embree"
        self._zbuffer = ZBuffer(self.mesh.vertices[self.mesh.faces], camera) if self._tracer is None else None
        x, y = ray_slopes(camera)
        self._rays = np.ones((camera.height * camera.width, 3), np.float32)  # unit forward: distance along is z-depth
        self._rays[:, 0] = np.tile(x, camera.height)
        self._rays[:, 1] = np.repeat(y, camera.width)
        self._starts = np.empty((TILE, 3), np.float32)
        self._instance = np.append(self.mesh.instance, 0).astype(np.int32)
        self._hard = np.append(np.array([m.hard for m in self.materials])[self.mesh.part], False)
        self._shader: Shader | None = None

    def render(self, world_from_camera: Array) -> View:
        """The picture from a pose (4, 4)."""
        pose = check_pose(world_from_camera)
        shader = self._looks()
        shader.look_from(pose[:3, 3])
        count = len(self._rays)
        rgb = np.empty((count, 3), np.uint8)
        depth = np.empty(count, np.float32)
        instances = np.empty(count, np.int32)
        hard = np.empty(count, np.bool_)
        for some, ways, prim, u, v, z in self._hits(pose):
            colours = shader.shade(prim, u, v, z)
            missed = np.flatnonzero(prim < 0)
            if len(missed):
                colours[missed, :3] = outdoors(ways[missed])
                z[missed] = np.nan
            rgb[some], depth[some] = colours[:, :3], z
            instances[some], hard[some] = self._instance.take(prim, mode="wrap"), self._hard.take(prim, mode="wrap")
        shape = (self.camera.height, self.camera.width)
        return View(rgb.reshape(*shape, 3), depth.reshape(shape), instances.reshape(shape), hard.reshape(shape))

    def depth(self, world_from_camera: Array) -> npt.NDArray[np.float32]:
        """The z-depth (H, W) alone, NaN where nothing is: no colours are worked out."""
        depth = np.empty(len(self._rays), np.float32)
        for some, _, prim, _, _, z in self._hits(check_pose(world_from_camera)):
            depth[some] = np.where(prim < 0, np.nan, z)
        return depth.reshape(self.camera.height, self.camera.width)

    def _hits(self, pose: npt.NDArray[np.float64]) -> Iterator[_Hits]:
        """What every pixel meets, tile by tile."""
        turned = np.ascontiguousarray(pose[:3, :3].T, dtype=np.float32)
        tiles = [slice(start, min(start + TILE, len(self._rays))) for start in range(0, len(self._rays), TILE)]
        if self._zbuffer is not None:
            seen, *where = self._zbuffer.hits(pose)
            for some in tiles:
                yield some, self._rays[some] @ turned, seen[some], where[0][some], where[1][some], where[2][some]
            return
        assert self._tracer is not None
        self._starts[:] = pose[:3, 3]
        for some in tiles:
            ways = self._rays[some] @ turned
            found = self._tracer.scene.run(self._starts[: len(ways)], ways, query="INTERSECT", output=True)
            prim, u, v, z = found["primID"], found["u"], found["v"], found["tfar"]
            if prim.min() < 0:
                missed = prim < 0
                u[missed] = v[missed] = z[missed] = 0
            yield some, ways, prim, u, v, z

    def _looks(self) -> Shader:
        """The colours of the scene, made when first needed: a depth camera never pays for them."""
        if self._shader is None:
            atlas = make_atlas(self.mesh)
            bake = lights.bake(self.scene, self.mesh, atlas, self.materials) if self._light else lights.plain(atlas)
            self._shader = Shader(self.mesh, atlas, bake, self.materials, self.camera.fx)
        return self._shader


def _without_panes(mesh: Triangles) -> Triangles:
    """Glass that belongs to the house, not to a furnishing in it, is air."""
    glass = np.array([name.partition(":")[0] == "glass" for name in mesh.materials])
    keep = ~(glass[mesh.part] & (mesh.instance == 0))
    return replace(mesh, faces=mesh.faces[keep], instance=mesh.instance[keep], part=mesh.part[keep])
