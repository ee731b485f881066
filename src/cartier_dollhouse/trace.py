"""Ray casting against a scene's triangles with embreex, in tiles (three times as fast as one call per frame)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.model import Triangles

TILE = 8192
Array = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]


def available() -> bool:
    """Whether embreex can be imported: Linux on aarch64 has no wheel."""
    try:
        import embreex  # noqa: F401
    except ImportError:
        return False
    return True


@dataclass(eq=False)
class Tracer:
    """Some of a mesh's triangles, ready for rays; hits name triangles by their number in the whole mesh."""

    scene: Any
    mesh: Any  # embreex frees the triangles with it
    numbers: npt.NDArray[np.int64]

    def blocked(
        self, starts: npt.NDArray[np.floating], ways: npt.NDArray[np.floating], reach: float
    ) -> npt.NDArray[np.bool_]:
        """Whether anything is met on rays (N, 3) within ``reach`` times the length of ``ways``."""
        result = np.empty(len(starts), np.bool_)
        for some in _tiles(len(starts)):
            start, way = _single(starts[some]), _single(ways[some])
            limits = np.full(len(start), reach, np.float32)
            result[some] = self.scene.run(start, way, limits, query="OCCLUDED") >= 0
        return result

    def hits(self, starts: Array, ways: Array) -> tuple[npt.NDArray[np.int64], Array, Array, Array]:
        """Triangle (-1: none), barycentric u and v, and distance in lengths of ``ways``, each (N,)."""
        prim, u, v, far = np.empty(len(starts), np.int64), *(np.empty(len(starts), np.float32) for _ in range(3))
        for some in _tiles(len(starts)):
            found = self.scene.run(_single(starts[some]), _single(ways[some]), query="INTERSECT", output=True)
            number = found["primID"]
            missed = number < 0
            prim[some] = np.where(missed, -1, self.numbers[number])
            u[some], v[some] = np.where(missed, 0, found["u"]), np.where(missed, 0, found["v"])
            far[some] = found["tfar"]
        return prim, u, v, far


def tracer(mesh: Triangles, which: npt.NDArray[np.int64] | None = None) -> Tracer | None:
    """The mesh (or those triangles of it), or None where embreex is missing."""
    if not available():
        return None
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    numbers = np.arange(len(mesh.faces)) if which is None else which
    vertices, faces = mesh.vertices, np.ascontiguousarray(mesh.faces[numbers])
    if which is not None:  # embree copies all vertices that it is given
        used, again = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], again.reshape(-1, 3).astype(np.int32)
    scene = EmbreeScene()
    return Tracer(scene, TriangleMesh(scene, vertices, faces), numbers)


def _tiles(count: int) -> list[slice]:
    return [slice(start, min(start + TILE, count)) for start in range(0, count, TILE)]


def _single(values: npt.NDArray[np.floating]) -> Array:
    return np.ascontiguousarray(values, dtype=np.float32)
