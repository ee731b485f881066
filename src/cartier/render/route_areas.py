"""Areas of route rules and the way without them, drawn on a floor plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cartier.errors import InputError
from cartier.home import Home
from cartier.navigation.layers import ruled_area
from cartier.render.plan_key import PATH
from cartier.types import Answer
from cartier.types.route_rules import RouteRule

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AREAS = {
    "avoid": ("#d1495b", "to avoid"), "keep-away": ("#d1495b", "to avoid"), "slow-near": ("#edae49", "slowly"),
    "prefer": ("#3b8ea5", "to pass or prefer"), "only-through": ("#3b8ea5", "to pass or prefer"),
    "via": ("#3b8ea5", "to pass or prefer"),
}  # fmt: skip
"""The colour of a rule's area and what the key calls it."""
OPACITY = 0.3


def draw_rules(axes: Axes, home: Home, answer: Answer) -> list[Any]:
    """Draw the areas of the rules that hold for an answer's drive, and the way without them; entries for the key."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    route = answer.goal.route if answer.goal is not None else None
    rules: Sequence[RouteRule] = route.rules + route.breaks if route is not None else answer.selection.rules
    told = dict[str, Any]()
    for rule in rules:
        if rule.kind in AREAS and _draw_area(axes, home, rule):
            colour, name = AREAS[rule.kind]
            told[name] = Patch(fc=colour, alpha=OPACITY, label=name)
    if route is not None and answer.goal is not None and route.shortest_m < answer.goal.length_m:
        axes.plot(*route.shortest.T, color=PATH, lw=1.5, ls=(0, (2, 2)), zorder=3.5)
        told["shortest"] = Line2D([], [], color=PATH, lw=1.5, ls=(0, (2, 2)), label="way without rules")
    return list(told.values())


def _draw_area(axes: Axes, home: Home, rule: RouteRule) -> bool:
    from matplotlib.colors import to_rgb

    if home.route_map is None:
        return False
    try:
        area = ruled_area(rule, home.route_map)
    except InputError:  # what it is about is no longer there
        return False
    grid = home.route_map.grid
    image = np.zeros((*area.shape, 4))
    image[area] = (*to_rgb(AREAS[rule.kind][0]), OPACITY)
    (x, y), (rows, cols) = grid.origin_xy, area.shape
    extent = (x, x + cols * grid.resolution_m, y, y + rows * grid.resolution_m)
    axes.imshow(image, extent=extent, origin="lower", interpolation="nearest", zorder=2.5)
    return True
