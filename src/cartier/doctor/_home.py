"""Whether the files of a mapped home are as they were written."""

from __future__ import annotations

from pathlib import Path

from cartier.doctor._report import Fault, Report
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.map_server import yaml
from cartier.home.store import MANIFEST, Store, blob_file
from cartier.io.files import read_bytes

MAX_YAML_BYTES = 1 << 16
AGAIN = "map the recording again"
NAV2 = "occupancy.yaml"


def is_home(path: str | Path) -> bool:
    """Whether there is a mapped home, damaged or not."""
    return (Path(path) / MANIFEST).is_file()


def examine_home(folder: str | Path) -> Report:
    """Read every file of a saved home and say which are damaged: each is compared with its checksum, and all are loaded.

    The only fault is ``damaged_file``, once for each file.
    """
    store = Store(folder)
    told = store.faults()
    faults = [Fault("damaged_file", line.removesuffix(f": {AGAIN}"), AGAIN) for line in told]
    if not faults:
        try:
            home = Home.load(folder)
        except InputError as error:
            faults.append(Fault("damaged_file", str(error).removesuffix(f": {AGAIN}"), AGAIN))
        else:
            faults += _floor_plan(store, home)
    notes = () if faults else (f"{1 + len(store.manifest()['blobs'])} files read, all as they were written",)
    return Report(Path(folder).name, 0, tuple(faults), notes)


def _floor_plan(store: Store, home: Home) -> list[Fault]:
    """The file that tells Nav2 where the map's picture is: cartier never reads it, but a robot does."""
    if home.grid is None:
        return []
    file, picture = store.folder / NAV2, store.manifest()["blobs"]["occupancy.pgm"]
    try:
        if read_bytes(file, MAX_YAML_BYTES) == yaml(home.grid, blob_file("occupancy.pgm", picture)):
            return []
        what = f"{file} does not describe this home's floor plan"
    except InputError as error:
        what = str(error)
    return [Fault("damaged_file", what, "cartier.Home.load(HOME).save(HOME) writes it anew")]
