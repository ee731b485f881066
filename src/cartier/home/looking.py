"""Visual question answering over a home: its photographs, its log of detections and its floor plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from cartier.types import Detections, Inventory, RobotModel, Selection, VisualTrace
from cartier.vision.permission import Look

if TYPE_CHECKING:
    from cartier.home.entity import Home
    from cartier.vision.look import Photographs


def photographs_of(home: Home) -> Photographs:
    """The stored photographs of a home, with all that the detector found in their frames."""
    from cartier.vision.look import Photographs  # Pillow, which answers from the list do not need

    def detections() -> Mapping[int, Detections]:
        log = home.detections()
        return {} if log is None else {number: frame.detections for number, frame in log.looked().items()}

    return Photographs(home.photos, detections)


def look_for_answer(
    home: Home,
    query: str,
    selection: Selection,
    inventory: Inventory,
    allowed: Look,
    from_xy: tuple[float, float],
    robot: RobotModel,
) -> tuple[Selection, VisualTrace, tuple[str, ...]] | None:
    """What the photographs change in an answer, how, and what the person is told; None if they are not needed."""
    from cartier.vision.look import Surroundings, look

    around = Surroundings(home.grid, from_xy, robot)
    return look(allowed, query, selection, inventory, photographs_of(home), around)
