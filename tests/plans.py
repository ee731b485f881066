"""Floor plans drawn box by box, for tests of rooms and doors."""

from __future__ import annotations

import numpy as np

from cartier.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Box = tuple[float, float, float, float]
LEFT, RIGHT = (0.0, 0.0, 4.0, 3.0), (4.1, 0.0, 7.0, 3.0)
DOOR = (4.0, 1.0, 4.1, 1.9)


class Plan:
    """A floor plan of 5 cm cells, drawn box by box (x1, y1, x2, y2); unknown where nothing was drawn."""

    def __init__(self, width: float = 10.0, height: float = 8.0) -> None:
        self.cells = np.full((round((height + 2) * 20), round((width + 2) * 20)), UNKNOWN, np.int8)
        self.height_m = np.zeros(self.cells.shape, np.float16)

    def draw(self, box: Box, value: int, height_m: float = 0.0) -> Plan:
        x1, y1, x2, y2 = (round((v + 1) * 20) for v in box)
        self.cells[y1:y2, x1:x2], self.height_m[y1:y2, x1:x2] = value, height_m
        return self

    def rooms(self, *boxes: Box, wall_m: float = 2.2) -> Plan:
        for x1, y1, x2, y2 in boxes:
            self.draw((x1 - 0.1, y1 - 0.1, x2 + 0.1, y2 + 0.1), OCCUPIED, wall_m)
        for box in boxes:
            self.draw(box, FREE)
        return self

    def grid(self) -> OccupancyGrid:
        return OccupancyGrid(self.cells, 0.05, (-1.0, -1.0), self.height_m)


def flat(lintel_m: float = 2.15, wall_m: float = 2.2) -> Plan:
    return Plan().rooms(LEFT, RIGHT, wall_m=wall_m).draw(DOOR, FREE, lintel_m)
