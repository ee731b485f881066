"""Names on a picture of the floor plan, so placed that none overlap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def write_names(figure: Figure, axes: Axes, names: Sequence[tuple[str, Sequence[float]]], every: bool = True) -> None:
    """Write each name beside its place so that none overlap; a line leads from the place to a name far from it.

    A name that finds no room is written smaller; without ``every`` it is left out.
    """
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2, foreground="white")]  # legible on dark cells, too
    frame = axes.get_window_extent()
    taken: list[tuple[float, float, float, float]] = []
    renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    steps = [(r, math.radians(turn)) for r in (7, 14, 24, 38, 56, 80, 110, 150) for turn in range(15, 375, 30)]
    for name, position in sorted(names, key=lambda named: -len(named[0])):
        at = axes.transData.transform(tuple(position[:2]))
        for size in (7.5, 6.0, 5.0) if every else (7.5,):
            text = axes.text(0, 0, name, fontsize=size, color="#1f3f66", zorder=8, path_effects=halo)
            box = text.get_window_extent(renderer)
            wide, tall = box.width + 2, box.height + 1
            spots = (
                (at[0] + r * math.cos(a) - (wide if math.cos(a) < 0 else 0), at[1] + r * math.sin(a) - tall / 2)
                for r, a in steps
            )
            free = next(((x, y) for x, y in spots if _fits(x, y, wide, tall, frame, taken)), None)
            if free is not None:
                break
            text.remove()
        if free is None:
            continue
        taken.append((free[0], free[1], free[0] + wide, free[1] + tall))
        text.set_position(tuple(axes.transData.inverted().transform((free[0] + 1, free[1] + 2))))
        near = np.clip(at, free, (free[0] + wide, free[1] + tall))
        if math.dist(at, near) > 9:
            ends = axes.transData.inverted().transform([at, near])
            axes.plot(*ends.T, color="#1f3f66", lw=0.4, alpha=0.7, zorder=7)
        axes.plot(*position[:2], ".", color="#1f3f66", ms=2.5, zorder=7)


def _fits(x: float, y: float, wide: float, tall: float, frame: Any, taken: Sequence[tuple[float, ...]]) -> bool:
    inside = frame.x0 < x and x + wide < frame.x1 and frame.y0 < y and y + tall < frame.y1
    return inside and all(x + wide < a or c < x or y + tall < b or d < y for a, b, c, d in taken)
