"""Integrity of a saved home: every file against the checksum that it was written with."""

from __future__ import annotations

from pathlib import Path

from cartier.doctor._report import Fault, Report
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.map_server import yaml
from cartier.home.store import MANIFEST, NAV2, Store, blob_file
from cartier.io.files import read_bytes

MAX_YAML_BYTES = 1 << 16
AGAIN = "map the recording again"


def is_home(path: str | Path) -> bool:
    """Whether the folder holds a mapped home, damaged or not."""
    return (Path(path) / MANIFEST).is_file()


def examine_home(folder: str | Path) -> Report:
    """Report the damaged files of a saved home: each is compared with its checksum, and all are loaded.

    The only fault is ``damaged_file``, once for each file.
    """
    store = Store(folder)
    faults = [_damaged(line) for line in store.faults()]
    if not faults:
        try:
            home = Home.load(folder)
        except InputError as error:
            faults.append(_damaged(str(error)))
        else:
            faults += _floor_plan(store, home)
    notes = () if faults else (f"{1 + len(store.manifest()['blobs'])} files read, all as they were written",)
    return Report(Path(folder).name, 0, tuple(faults), notes)


def _damaged(line: str) -> Fault:
    return Fault("damaged_file", line.removesuffix(f": {AGAIN}"), AGAIN)


def _floor_plan(store: Store, home: Home) -> list[Fault]:
    """The YAML file with which Nav2 loads the floor plan; cartier itself never reads it."""
    if home.grid is None:
        return []
    file, picture = store.folder / NAV2, store.manifest()["blobs"]["occupancy.pgm"]
    try:
        if read_bytes(file, MAX_YAML_BYTES) == yaml(home.grid, blob_file("occupancy.pgm", picture)):
            return []
        what = f"{file} does not describe this home's floor plan"
    except InputError as error:
        what = str(error)
    return [Fault("damaged_file", what, "write it again with cartier.Home.load(HOME).save(HOME)")]
