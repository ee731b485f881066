"""The doctor's picture: two overlapping frames, and how far their depths lie apart as given and as mended."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartier.contracts import Recording
from cartier.doctor._edges import Registration, zoomed
from cartier.doctor._report import Exhibit, Report
from cartier.errors import InputError
from cartier.render.picture import save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORST_M = 0.3


def draw_report(recording: Recording, report: Report, file: Path) -> None:
    """Write a PNG (or what the suffix names) that shows the findings. Raises InputError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 8.2), layout="constrained")
    axes = figure.subplots(2, 2)
    if report.exhibit is None:
        _draw_frames_alone(axes, recording, report)
    else:
        for place, number in zip(axes[0], (report.exhibit.a, report.exhibit.b), strict=True):
            _show_frame(place, recording, number)
        moved = report.cure.registration if report.cure else None
        if moved is None:
            _draw_exhibit(figure, axes[1], report.exhibit)
        else:
            for place, number in zip(axes[1], (report.exhibit.a, report.exhibit.b), strict=True):
                _show_frame(place, recording, number, moved)
    words = (
        [f"{f.fault}: {f.evidence}" for f in report.faults]
        or list(report.notes[1:])
        or ["nothing is wrong with this recording"]
    )
    title = "\n".join(textwrap.fill(line, 130) for line in words[:4])
    figure.suptitle(title, x=0.02, ha="left", fontsize=11, weight="bold")
    figure.supxlabel(f"{report.name} · {' · '.join(report.notes)}", fontsize=8, color="#555555", x=0.02, ha="left")
    save_figure(figure, file)


def _draw_exhibit(figure: Any, axes: Any, shown: Exhibit) -> None:
    for place, off, title in zip(axes, (shown.given, shown.mended), ("as given", "as mended"), strict=True):
        picture = place.imshow(off, cmap="magma_r", vmin=0, vmax=WORST_M)
        known = off[np.isfinite(off)]
        median = f"median {np.median(known) * 100:.1f} cm" if known.size else "nothing falls into the image"
        place.set(xticks=[], yticks=[])
        place.set_title(f"depth of frame {shown.a} carried into {shown.b}, {title}: {median}", fontsize=10)
    figure.colorbar(picture, ax=list(axes), shrink=0.7, label=f"apart by (m; {WORST_M} and more dark)")


def _draw_frames_alone(axes: Any, recording: Recording, report: Report) -> None:
    numbers = np.linspace(0, report.frames - 1, min(4, report.frames)).astype(int).tolist()
    for place in axes.ravel():
        place.axis("off")
    for place, number in zip(axes.ravel(), numbers, strict=False):
        _show_frame(place, recording, number)


def _show_frame(place: Axes, recording: Recording, number: int, moved: Registration | None = None) -> None:
    """A colour image with the edges of its depth drawn over it, moved or as given."""
    place.axis("off")
    place.set_title(f"frame {number}, with the edges of its depth{' as mended' if moved else ''}", fontsize=10)
    try:
        frame = recording[number]
    except InputError as error:
        place.text(0.5, 0.5, textwrap.fill(str(error), 50), ha="center", va="center")
        return
    place.imshow(frame.rgb)
    if frame.depth_m is not None:
        edges = _outline(frame.depth_m if moved is None else zoomed(frame.depth_m, moved.zoom, moved.dx, moved.dy))
        place.imshow(np.ma.masked_equal(edges, 0), cmap="cool", vmin=0, vmax=1, alpha=0.9)


def _outline(depth_m: Any) -> Any:
    """Where the depth steps: drawn over the colour, it shows whether the two lie on each other."""
    with np.errstate(invalid="ignore"):
        across = np.abs(np.diff(depth_m, axis=1, prepend=depth_m[:, :1])) > 0.06 * depth_m
        down = np.abs(np.diff(depth_m, axis=0, prepend=depth_m[:1])) > 0.06 * depth_m
    return (across | down).astype(np.uint8)
