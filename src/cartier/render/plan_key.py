"""Key to a picture of the floor plan: legend, scale bar and the line that says what made it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WALL_M = 1.5  # occupied cells that reach higher are walls, as on the page
FREE_FLOOR, WALL, FURNITURE, NOT_SEEN = (250, 250, 247), (74, 78, 89), (196, 194, 186), (228, 229, 232)
OBJECT, CHOSEN, PATH = "#3b6ea8", "#d1495b", "#1b998b"
LENGTHS_M = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
BAR_SHARE = 0.12  # of the picture's width, at least


def add_title_and_key(
    figure: Figure, title: str, caption: str, *, grid: bool, boxes: bool = False, answer: bool = False,
    more: Sequence[Any] = (),
) -> None:  # fmt: skip
    """Write a title above the picture, below it a caption and the legend of what is drawn; they cover none of it."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def patch(rgb: tuple[int, int, int], name: str) -> Patch:
        return Patch(fc=tuple(v / 255 for v in rgb), ec="#777777", lw=0.5, label=name)

    handles: list[Any] = []
    if grid:
        floor = ((WALL, "wall"), (FURNITURE, "furniture"), (FREE_FLOOR, "free floor"), (NOT_SEEN, "not seen"))
        handles += [patch(rgb, name) for rgb, name in floor]
    if boxes:
        handles.append(Patch(fc=(*(v / 255 for v in (59, 110, 168)), 0.25), ec=OBJECT, label="object"))
    handles.append(Line2D([], [], marker="o", ls="", color=PATH, mfc="white", mew=2, label="start"))
    if answer:
        handles.append(Line2D([], [], marker=">", color=PATH, lw=2.5, label="way and robot"))
        handles.append(Line2D([], [], marker="*", ls="", ms=11, color=CHOSEN, label="answer"))
    handles += more
    across = max(3, int(figure.get_figwidth() / 1.15))
    legend = figure.legend(
        handles=handles, loc="lower left", ncols=min(across, len(handles)), fontsize=8, frameon=False,
        title=caption, title_fontsize=8, alignment="left", columnspacing=1.2, handlelength=1.4,
    )  # fmt: skip
    legend.get_title().set_color("#555555")
    lines = textwrap.fill(title, max(24, int(figure.get_figwidth() * 7)))
    heading = figure.suptitle(lines, fontsize=13, x=0.02, y=0.99, ha="left", va="top", weight="bold")
    renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    heading.set_in_layout(False)
    below, above = (part.get_window_extent(renderer).height / figure.bbox.height + 0.02 for part in (legend, heading))
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0, below, 1, 1 - below - above))
    figure.draw_without_rendering()  # the layout fits only the second time: the first changes the axes' aspect


def add_scale_bar(axes: Axes) -> None:
    """Draw a bar of a round length into the lower right corner."""
    (left, right), (low, _) = axes.get_xlim(), axes.get_ylim()
    length = next((m for m in LENGTHS_M if m >= BAR_SHARE * (right - left)), LENGTHS_M[-1])
    end, y = right - 0.02 * (right - left), low + 0.02 * (right - left)
    axes.plot([end - length, end], [y, y], color="#333333", lw=3, solid_capstyle="butt", zorder=9)
    axes.text(end - length - 0.01 * (right - left), y, f"{length:g} m", ha="right", va="center", fontsize=8, zorder=9)
