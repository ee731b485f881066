"""Export of homes to other programs: GLB, PLY, MCAP, GeoJSON, CSV, JSON, and a folder for Nav2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from cartier import plugins
from cartier.errors import InputError, MissingExtra
from cartier.exports import _glb, _mcap, _ply, tables
from cartier.home import Home
from cartier.io.atomic import write_file

WRITERS: Mapping[str, Callable[[Home], bytes]] = {
    ".glb": _glb.write, ".ply": _ply.write, ".mcap": _mcap.write,
    ".geojson": tables.geojson, ".csv": tables.csv, ".json": tables.json,
}  # fmt: skip
BESIDE: Mapping[str, tuple[str, Callable[[Home], bytes | None]]] = {
    ".mcap": (".layout.json", lambda home: _mcap.layout()), ".ply": (".points.ply", _ply.points),
}  # fmt: skip
NAV2 = "nav2"


def export(home: Home, file: Path) -> list[Path]:
    """Write a home in the format of the suffix; returns the files written. Raises InputError for an unknown suffix.

    An MCAP comes with a layout for Lichtblick or Foxglove, a PLY with the point cloud if there is one. A path that ends
    in "nav2" is a folder for Nav2.
    """
    if NAV2 in (file.name, file.suffix.removeprefix(".")):
        written: list[Path] = plugins.neighbour("exports", NAV2)(home, file)
        return written
    writer = WRITERS.get(file.suffix.lower())
    if writer is None:
        raise InputError(f"{file} has no known suffix: there are {', '.join(WRITERS)}, and nav2 for a folder")
    try:
        data = writer(home)
    except ModuleNotFoundError as error:
        raise MissingExtra(f"{file.suffix} needs the package 'mcap': {plugins.install('export', 'mcap')}") from error
    write_file(file, data)
    suffix, also = BESIDE.get(file.suffix.lower(), ("", lambda home: None))
    if (more := also(home)) is None:
        return [file]
    beside = file.with_suffix(suffix)
    write_file(beside, more)
    return [file, beside]
