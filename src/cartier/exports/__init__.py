"""Export of homes to other programs: GLB, PLY, GeoJSON, CSV, JSON; and what packages beside this one write."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from cartier import plugins
from cartier.errors import InputError
from cartier.exports import _glb, _ply, tables
from cartier.home import Home
from cartier.io.atomic import write_file

WRITERS: Mapping[str, Callable[[Home], bytes]] = {
    ".glb": _glb.write, ".ply": _ply.write, ".geojson": tables.geojson, ".csv": tables.csv, ".json": tables.json,
}  # fmt: skip
ADDED = (".mcap", "nav2")  # by entry points of the group cartier.exports


def export(home: Home, file: Path) -> list[Path]:
    """Write a home in the format of the suffix; returns the files written. Raises InputError for an unknown suffix.

    An MCAP comes with a layout for Lichtblick or Foxglove, a PLY with the point cloud if there is one. A path that ends
    in "nav2" is a folder for Nav2.
    """
    for kind in ADDED:
        if kind in (file.name, file.suffix.lower(), file.suffix.removeprefix(".")):
            return list(plugins.neighbour("exports", kind.removeprefix("."))(home, file))
    writer = WRITERS.get(file.suffix.lower())
    if writer is None:
        raise InputError(
            f"{file} has no known suffix: there are {', '.join((*WRITERS, '.mcap'))}, and nav2 for a folder"
        )
    write_file(file, writer(home))
    if file.suffix.lower() != ".ply" or (points := _ply.points(home)) is None:
        return [file]
    beside = file.with_suffix(".points.ply")
    write_file(beside, points)
    return [file, beside]
