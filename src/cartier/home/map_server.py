"""Nav2 map_server files: a floor plan as PGM and YAML, and back."""

from __future__ import annotations

import numpy as np

from cartier.errors import InputError
from cartier.types import FREE, OCCUPIED, UNKNOWN, Array, OccupancyGrid

_PIXELS = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}


def pgm(grid: OccupancyGrid) -> bytes:
    """The cells as a PGM image; its first row has the largest y."""
    pixels = np.full(grid.cells.shape, _PIXELS[UNKNOWN], np.uint8)
    for value, pixel in _PIXELS.items():
        pixels[grid.cells == value] = pixel
    rows, cols = grid.cells.shape
    return b"P5\n%d %d\n255\n" % (cols, rows) + pixels[::-1].tobytes()


def yaml(grid: OccupancyGrid, image: str) -> bytes:
    """The YAML file that map_server is given; ``image`` is the name of the PGM beside it.

    ``free_thresh`` is 0.196, not Nav2's default of 0.25: unknown is written as 205, that is 0.19608 occupied, which a
    threshold of 0.25 would read as free.
    """
    # YAML reads 1e-05 as text
    resolution, x, y = (np.format_float_positional(v, trim="0") for v in (grid.resolution_m, *grid.origin_xy))
    return (
        f"image: {image}\nmode: trinary\nresolution: {resolution}\norigin: [{x}, {y}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    ).encode()


def grid_from(data: bytes, resolution_m: float, origin_xy: tuple[float, float], height_m: Array) -> OccupancyGrid:
    """Read the floor plan from a PGM that ``pgm`` wrote. Raises InputError if it is damaged."""
    try:
        magic, size, depth, pixels = data.split(b"\n", 3)
        cols, rows = (int(v) for v in size.split())
        if magic != b"P5" or depth != b"255" or min(rows, cols) < 1 or len(pixels) != rows * cols:
            raise ValueError(f"{len(pixels)} pixels for a {cols}x{rows} P5 image")
    except ValueError as error:
        raise InputError(f"the floor plan's image is damaged ({str(error)[:80]})") from error
    image = np.frombuffer(pixels, np.uint8).reshape(rows, cols)[::-1]
    cells = np.full(image.shape, UNKNOWN, np.int8)
    cells[image == _PIXELS[FREE]] = FREE
    cells[image == _PIXELS[OCCUPIED]] = OCCUPIED
    return OccupancyGrid(cells, resolution_m, origin_xy, height_m)
