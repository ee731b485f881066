"""Traction: what driving on a kind of floor costs, by the robot's wheels or by a file of the user's."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np

from cartier.errors import InputError, brief
from cartier.io.files import read_text
from cartier.navigation.layers import Cost, CostLayer, RouteMap
from cartier.types import RobotModel
from cartier.types.route_rules import FLOOR_KINDS

DEFAULTS = Path(__file__).with_name("traction.toml")
MAX_BYTES = 100_000

Traction = tuple[tuple[str, float], ...]


def traction_of(wheels: str) -> Traction:
    """The costs for ``RobotModel.traction``, of wheels that are known or of a TOML file ``kind = cost``.

    Raises InputError for other wheels, and for a file that is none.
    """
    if wheels.endswith(".toml"):
        return _costs(_read(Path(wheels)), wheels)
    known = _read(DEFAULTS)
    if wheels not in known:
        raise InputError(
            f"there are no wheels {brief(wheels, 40)!r}: known are {', '.join(known)}, or give a .toml file"
        )
    return _costs(known[wheels], wheels)


def traction_layer(robot: RobotModel) -> CostLayer:
    """The cost of each cell by the kind of its floor; unknown floor costs what the robot says of it, by default 0."""
    by_kind = np.zeros(len(FLOOR_KINDS))
    for kind, cost in robot.traction:
        by_kind[FLOOR_KINDS.index(kind)] = cost

    def layer(site: RouteMap) -> Cost:
        kinds = site.grid.floor_kinds
        return np.full(site.grid.cells.shape, by_kind[0]) if kinds is None else by_kind[kinds]

    return layer


def _read(file: Path) -> dict[str, object]:
    try:
        return tomllib.loads(read_text(file, MAX_BYTES))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{file}: {error}") from error


def _costs(told: object, where: str) -> Traction:
    if not isinstance(told, dict):
        raise InputError(f"{where}: one line a kind of floor, as carpet = 0.8")
    for kind, cost in told.items():
        if isinstance(cost, bool) or not isinstance(cost, int | float):
            raise InputError(f"{where}: {brief(kind, 40)} must be a number, as carpet = 0.8")
    traction = tuple((str(kind), float(cost)) for kind, cost in told.items())
    try:
        RobotModel(traction=traction)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return traction
