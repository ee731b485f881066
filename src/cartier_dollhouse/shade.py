"""Shading of hit points: one look-up in the textures, one on the light map, one product."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cartier_dollhouse.atlas import Atlas, face_normals
from cartier_dollhouse.light import UNIT
from cartier_dollhouse.materials import Material
from cartier_dollhouse.model import Triangles
from cartier_dollhouse.textures import SIZE

LEVELS = SIZE.bit_length()  # 256, 128, … 1
FIT = (0.02, SIZE - 0.02)  # texels that a picture that fills its part spans
Array = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]


class Shader:
    """The look of every triangle of a scene. ``light`` are the atlas' texels, packed bytes."""

    def __init__(
        self, mesh: Triangles, atlas: Atlas, light: npt.NDArray[np.uint32], materials: list[Material], focal_px: float
    ) -> None:
        corners = mesh.vertices[mesh.faces]
        self.normals = face_normals(corners)
        self.heights = np.einsum("mx,mx->m", corners[:, 0], self.normals)
        self.light = light
        self.textures, first = _texture_store(materials)
        uv, density = _texture_coordinates(mesh, materials)
        coordinates = np.concatenate([uv, atlas.corner_st], 2)
        self.coordinates = np.concatenate(
            [coordinates[:, 0], coordinates[:, 1] - coordinates[:, 0], coordinates[:, 2] - coordinates[:, 0]], 1
        ).astype(np.float32)
        self.places = np.stack([first[mesh.part], atlas.base, atlas.stride], 1).astype(np.int32)
        self.density = (density[mesh.part] / focal_px) ** 2
        self.footprint = self.density.astype(np.float32)

    def look_from(self, eye: npt.NDArray[np.float64]) -> None:
        """Take a viewpoint: how far each triangle's plane is says how slantingly it is seen."""
        away = np.abs(self.normals @ eye.astype(np.float32) - self.heights)
        self.footprint = (self.density / np.maximum(away, 1e-3)).astype(np.float32)

    def shade(self, prim: npt.NDArray[np.int32], u: Array, v: Array, z: Array) -> npt.NDArray[np.uint8]:
        """Colours (n, 4) of hits; where ``prim`` is -1 they mean nothing."""
        which = prim.astype(np.intp)
        row = np.ascontiguousarray(self.coordinates.take(which, 0, mode="wrap").T)
        row[4:8] *= u
        row[8:] *= v
        row[:4] += row[4:8]
        row[:4] += row[8:]
        column, line, s, t = row[:4].astype(np.int32)
        texture, light, stride = np.ascontiguousarray(self.places.take(which, 0, mode="wrap").T)
        texture += self._texel(column, line, which, z)
        t *= stride
        t += s
        t += light
        colours, lights = self.textures.take(texture, mode="clip"), self.light.take(t, mode="clip")
        seen = np.multiply(colours.view(np.uint8), lights.view(np.uint8), dtype=np.uint16)
        seen >>= UNIT.bit_length() - 1
        np.minimum(seen, 255, out=seen)
        return np.asarray(seen.astype(np.uint8).reshape(-1, 4))

    def _texel(self, column: Ints, line: Ints, which: npt.NDArray[np.intp], z: Array) -> Ints:
        """The texel's number in its material's store, at the level where a texel is about as large as the pixel.

        The area that a pixel sees grows with z² and with 1/cos, which is z/height of the eye above the plane: the level
        is half the exponent of that area in texels, read from the bits of the float.
        """
        area = self.footprint.take(which, mode="wrap")
        area *= z
        area *= z
        area *= z
        level = area.view(np.int32)
        level >>= 24
        level -= 63
        np.clip(level, 0, LEVELS - 1, out=level)
        column &= SIZE - 1
        column >>= level
        line &= SIZE - 1
        line >>= level
        line <<= LEVELS - 1 - level
        line += column
        line += _OFFSETS.take(level)
        return line


_OFFSETS = np.concatenate([[0], np.cumsum([(SIZE >> level) ** 2 for level in range(LEVELS - 1)])]).astype(np.int32)


def _texture_store(materials: list[Material]) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64]]:
    """All textures with their smaller versions as packed pixels, and where each part's begins."""
    different = {m.name: m for m in materials}
    size = int(_OFFSETS[-1]) + 1
    begin = {name: number * size for number, name in enumerate(different)}
    store = np.concatenate([_levels(m.texture) for m in different.values()])
    return store, np.array([begin[m.name] for m in materials], np.int64)


def _levels(texture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint32]:
    levels: list[npt.NDArray[np.uint32]] = []
    image: Array = texture.astype(np.float32)
    while True:
        packed = np.zeros((*image.shape[:2], 4), np.uint8)
        packed[..., :3] = np.round(image)
        levels.append(packed.reshape(-1, 4).view(np.uint32).ravel())
        if len(image) == 1:
            return np.concatenate(levels)
        image = (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]) / np.float32(4)


def _texture_coordinates(
    mesh: Triangles, materials: list[Material]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Texels (M, 3, 2) of each triangle's corners, none negative, and each part's texels per metre."""
    uv = mesh.uv_m[mesh.faces].astype(np.float64)
    low, high = np.full((len(materials), 2), np.inf), np.full((len(materials), 2), -np.inf)
    np.minimum.at(low, mesh.part, uv.min(1))
    np.maximum.at(high, mesh.part, uv.max(1))
    span = np.maximum(high - low, 1e-6)
    tile = np.array([m.tile_m for m in materials])
    fit = tile == 0
    scale = np.where(fit[:, None], (FIT[1] - FIT[0]) / span, SIZE / np.where(fit, 1, tile)[:, None])
    shift = np.where(fit[:, None], FIT[0] - low * scale, 0)
    texels = uv * scale[mesh.part][:, None] + shift[mesh.part][:, None]
    texels -= SIZE * np.floor(texels.min(1, keepdims=True) / SIZE)
    return texels, np.sqrt(scale.prod(1))
