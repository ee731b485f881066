"""Evidence image of a report: two overlapping frames, and how far their depths differ as given and as repaired."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cartier.contracts import Recording
from cartier.doctor._consistency import Pairs, motions, turns_deg
from cartier.doctor._diagnosis import Diagnosis, small_camera
from cartier.doctor._report import EvidencePair, Report
from cartier.doctor.hypotheses import Reading
from cartier.errors import InputError
from cartier.mapping.samples import Samples
from cartier.recordings.common.edges import Registration
from cartier.render.floor_plan import save_figure
from cartier.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN_M = 0.3  # depth difference at the dark end of the colours
EDGE_STEP = 0.06  # relative step of depth that is drawn as an edge


def evidence_pair(samples: Samples, diagnosis: Diagnosis) -> EvidencePair | None:
    """Of the pairs of frames that overlap in the repaired recording, the one that agrees best; None without any."""
    pairs, reading = diagnosis.repaired.pairs, diagnosis.reading
    if not len(pairs):
        return None
    motion = motions(reading.shifted(samples.poses, samples.index), pairs)
    small = small_camera(samples, reading.camera(samples.camera))
    score = np.nan_to_num(Pairs(samples, pairs).agreement(motion, reading.depth_scale, small).met)
    turned = np.minimum(turns_deg(motion), 30) / 100  # two different views show more than two equal ones
    a, b = (int(i) for i in pairs[int((score + turned).argmax())])
    given = _difference_m(samples, Reading(reading.level), a, b)
    return EvidencePair(int(samples.index[a]), int(samples.index[b]), given, _difference_m(samples, reading, a, b))


def _difference_m(samples: Samples, reading: Reading, a: int, b: int) -> Array:
    """How far a's depth, carried into b, differs from b's, at b's pixels (h, w); NaN where no point falls."""
    camera = small_camera(samples, reading.camera(samples.camera))
    image = np.full(samples.depth_m.shape[1:], np.nan, np.float32)
    pairs = np.array([[a, b]])
    motion = motions(reading.shifted(samples.poses, samples.index), pairs)
    z, u, v, inside = (x[0] for x in Pairs(samples, pairs, image.size).carry(motion, reading.depth_scale, camera))
    order = np.argsort(-z[inside])  # the nearest is written last and stays
    image[v[inside][order], u[inside][order]] = z[inside][order]
    return np.asarray(np.abs(image - samples.depth_m[b] * np.float32(reading.depth_scale)), dtype=np.float32)


def draw_report(recording: Recording, report: Report, file: Path) -> None:
    """Write the report as an image, in the format of the suffix. Raises InputError if it cannot be written."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 8.2), layout="constrained")
    axes = figure.subplots(2, 2)
    if report.pair is None:
        for place in axes.ravel():
            place.axis("off")
        numbers = np.linspace(0, report.frames - 1, min(4, report.frames)).astype(int).tolist()
        for place, number in zip(axes.ravel(), numbers, strict=False):
            _show_frame(place, recording, number)
    else:
        moved = report.repair.registration if report.repair else None
        for top, bottom, number in zip(*axes, (report.pair.a, report.pair.b), strict=True):
            _show_frame(top, recording, number)
            if moved is not None:
                _show_frame(bottom, recording, number, moved)
        if moved is None:
            _show_differences(figure, axes[1], report.pair)
    words = [f"{f.fault}: {f.evidence}" for f in report.faults] or list(report.notes[1:]) or ["no fault found"]
    title = "\n".join(textwrap.fill(line, 130) for line in words[:4])
    figure.suptitle(title, x=0.02, ha="left", fontsize=11, weight="bold")
    figure.supxlabel(f"{report.name} · {' · '.join(report.notes)}", fontsize=8, color="#555555", x=0.02, ha="left")
    save_figure(figure, file)


def _show_differences(figure: Any, axes: Any, pair: EvidencePair) -> None:
    for place, off_m, title in zip(axes, (pair.given, pair.repaired), ("as given", "as repaired"), strict=True):
        picture = place.imshow(off_m, cmap="magma_r", vmin=0, vmax=SHOWN_M)
        known = off_m[np.isfinite(off_m)]
        median = f"median {np.median(known) * 100:.1f} cm" if known.size else "no point falls into the image"
        place.set(xticks=[], yticks=[])
        place.set_title(f"depth of frame {pair.a} carried into {pair.b}, {title}: {median}", fontsize=10)
    figure.colorbar(picture, ax=list(axes), shrink=0.7, label=f"depth difference (m; {SHOWN_M} and more dark)")


def _show_frame(place: Axes, recording: Recording, number: int, moved: Registration | None = None) -> None:
    """A colour image with the edges of its depth drawn over it: if the depth is registered, they lie on each other."""
    place.axis("off")
    place.set_title(f"frame {number}, with the edges of its depth{' as repaired' if moved else ''}", fontsize=10)
    try:
        frame = recording[number]
    except InputError as error:
        place.text(0.5, 0.5, textwrap.fill(str(error), 50), ha="center", va="center")
        return
    place.imshow(frame.rgb)
    if frame.depth_m is not None:
        depth_m = frame.depth_m if moved is None else moved.register(frame.depth_m)
        with np.errstate(invalid="ignore"):
            across = np.abs(np.diff(depth_m, axis=1, prepend=depth_m[:, :1])) > EDGE_STEP * depth_m
            down = np.abs(np.diff(depth_m, axis=0, prepend=depth_m[:1])) > EDGE_STEP * depth_m
        edges = np.ma.masked_equal((across | down).astype(np.uint8), 0)
        place.imshow(edges, cmap="cool", vmin=0, vmax=1, alpha=0.9)
