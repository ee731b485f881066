"""Figures of a run: the distance to the object, and the share of right objects. Same numbers, same bytes."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cartier_bench.queries import TYPES
from cartier_bench.rows import title
from cartier_bench.tables import PAPER_MEAN_M, Summary, grouped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind people; the shapes tell the types apart in black and white.
LOOKS = {"explicit": ("#0072B2", "o"), "implicit": ("#E69F00", "s"), "conversational": ("#009E73", "D")}
INK, FAINT = "#22262e", "#6b7280"
STEP = 0.24  # between the types of one method, where methods are 1 apart
GAP = 0.45  # more between groups of methods


def distance_png(summary: Summary, made_by: Mapping[str, str]) -> bytes:
    """Mean distance (m) with its interval for each method and type; the paper's own means as hollow marks."""
    methods = summary["methods"]
    figure, axes, rows = _lines(methods)
    drawn: set[str] = set()
    for name, y in rows.items():
        for kind, x in methods[name].items():
            at, paper = y + _offset(kind), PAPER_MEAN_M.get(name, {}).get(kind)
            if paper is not None:
                axes.plot(paper, at, LOOKS[kind][1], mfc="white", mec=LOOKS[kind][0], ms=5.5, zorder=3.5)
                drawn.add("paper")
            if x["distance_mean_m"] is not None:
                _dot(axes, kind, at, x["distance_mean_m"], x["distance_mean_ci"])
                drawn.add(kind)
    axes.set_xlim(left=0)
    axes.set_xlabel("mean distance to the nearest acceptable object (m), answers with a place, 95 % interval")
    _legend(axes, drawn)
    return _finish(figure, axes, f"How far from the object: {summary['objects_from']}", made_by)


def match_png(summary: Summary, made_by: Mapping[str, str]) -> bytes:
    """Share of answers that name an acceptable object, with its interval, for each method and type."""
    methods = summary["methods"]
    figure, axes, rows = _lines(methods)
    for name, y in rows.items():
        for kind, x in methods[name].items():
            at, share = y + _offset(kind), 100 * x["match"]
            low, high = (100 * end for end in x["match_ci"])
            axes.barh(at, share, 0.9 * STEP, color=LOOKS[kind][0], zorder=2)
            axes.plot([low, high], [at, at], color=INK, lw=1.2, zorder=3)
            axes.annotate(
                f"{share:.0f}", (max(high, share), at), (5, 0), textcoords="offset points", va="center", fontsize=8,
                color=INK
            )  # fmt: skip
    axes.set_xlim(0, 107)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("answers that name an acceptable object (%), 95 % interval")
    _legend(axes, {kind for kinds in methods.values() for kind in kinds}, bars=True)
    return _finish(figure, axes, f"How often the right object: {summary['objects_from']}", made_by)


def _lines(methods: Summary) -> tuple[Figure, Axes, dict[str, float]]:
    """A figure with one line per method from the top down, in groups."""
    from matplotlib.figure import Figure

    rows: dict[str, float] = {}
    y = 0.0
    captions: dict[str, float] = {}
    for words, group in grouped(methods).items():
        captions[words] = y - 0.68
        for name in group:
            rows[name] = y
            y += 1
        y += GAP
    figure = Figure(figsize=(9, 1.7 + 0.56 * y), layout="constrained")
    axes = figure.subplots()
    for words, at in captions.items():
        axes.annotate(
            words, (0, at), (-10, 0), ("axes fraction", "data"), textcoords="offset points", ha="right", va="center",
            fontsize=9, style="italic", color=FAINT, annotation_clip=False,
        )  # fmt: skip
    axes.set_yticks(list(rows.values()), [textwrap.shorten(title(name), 32) for name in rows], fontsize=10)
    axes.set_ylim(max(rows.values()) + 0.55, -0.95)
    return figure, axes, rows


def _dot(axes: Axes, kind: str, y: float, value: float, ends: Any) -> None:
    colour, shape = LOOKS[kind]
    axes.plot(ends, [y, y], color=colour, lw=2, solid_capstyle="round", zorder=3)
    axes.plot(value, y, shape, color=colour, mec="white", mew=0.8, ms=7.5, zorder=4, clip_on=False)


def _offset(kind: str) -> float:
    return (TYPES.index(kind) - (len(TYPES) - 1) / 2) * STEP


def _legend(axes: Axes, drawn: set[str], bars: bool = False) -> None:
    from matplotlib.lines import Line2D

    looks = {kind: (colour, "s" if bars else shape) for kind, (colour, shape) in LOOKS.items() if kind in drawn}
    marks = [
        Line2D([], [], color=colour, marker=shape, ls="", ms=8, label=kind) for kind, (colour, shape) in looks.items()
    ]
    if "paper" in drawn:
        hollow: Any = {"mfc": "white", "mec": FAINT, "marker": "o", "ls": "", "ms": 6}
        marks.append(Line2D([], [], label="the paper: other scenes,\nother detector", **hollow))
    axes.legend(
        handles=marks, loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=9.5, labelspacing=0.8
    )


def _finish(figure: Figure, axes: Axes, heading: str, made_by: Mapping[str, str]) -> bytes:
    axes.grid(axis="x", color="#e2e5ea", zorder=0)
    axes.set_axisbelow(True)
    axes.tick_params(axis="y", length=0, pad=10)
    axes.tick_params(colors=INK)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    figure.suptitle(heading, x=0.02, ha="left", fontsize=14, weight="bold", color=INK)
    said = " · ".join(f"{part}: {name}" for part, name in made_by.items())
    figure.text(0.02, -0.01, textwrap.fill(said, 130), va="top", fontsize=8, color=FAINT, parse_math=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, bbox_inches="tight", facecolor="white", metadata={"Software": None})
    return buffer.getvalue()
