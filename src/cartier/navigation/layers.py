"""Cost layers of routes: functions from the floor plan to the extra cost of each cell, and the areas of route rules.

A path costs its length times 1 plus the sum of all layers. So a layer of 2 says that a metre there is as bad as three
elsewhere, and ``inf`` makes a wall.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.route_rules import RouteTarget
from cartier.types import Door, MapObject, OccupancyGrid, Room

Mask = npt.NDArray[np.bool_]
Cost = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RouteMap:
    """What route rules are about: the floor plan (with its kinds of floor), rooms, objects and doors of a home."""

    grid: OccupancyGrid
    rooms: Sequence[Room] = ()
    objects: Sequence[MapObject] = ()
    doors: Sequence[Door] = ()


CostLayer = Callable[[RouteMap], Cost]
"""The extra cost (rows, cols) of each cell, per metre: 0 or more, inf for a wall."""


def area_of(target: RouteTarget, site: RouteMap) -> Mask:
    """The cells (rows, cols) that a target covers. Raises InputError if the home lacks what it names."""
    raise NotImplementedError
