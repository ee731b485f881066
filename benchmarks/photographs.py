"""Benchmark of detectors on photographs of household objects: AP50, and precision and recall, by name.

python benchmarks/photographs.py [DETECTOR …] [--photos ../shared/photos] [--part even|odd] [--least 3]
A detector is what `cartier map --detector` takes. The photographs are COCO's, with boxes in YOLO's text format
(labels/*.txt: class, cx, cy, w, h as fractions of the image); a box is right that has the name and overlaps the true
one by half. Names of which there are fewer than `--least` boxes are only in the sums.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script
from dollhouse_detector import average_precision
from PIL import Image

from cartier import specs
from cartier.detectors.boxes import iou
from cartier.detectors.sidecar import coco80, read_sidecar
from cartier.models import photos as shipped
from cartier.types import Camera, Frame

SHARED = Path(__file__).resolve().parents[2] / "shared"
HOUSEHOLD = [name for name in read_sidecar(shipped.FOLDER / shipped.MEMBERS[0][1]).labels if name]
PARTS = {"even": 0, "odd": 1}  # the first chose the settings of the detector `photos`, the second did not
LOW = 0.02  # scores from here on make the precision-recall curve


@dataclass(frozen=True)
class Photo:
    frame: Frame
    names: tuple[str, ...]
    boxes_xyxy: Any


@dataclass
class Matched:
    """``hits``: per name, (score, right) of detections; ``boxes``: per name, the best right score (or 0) of each true
    box."""

    hits: dict[str, list[tuple[float, bool]]] = field(default_factory=lambda: defaultdict(list))
    boxes: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))


def photographs(folder: Path, part: str = "all") -> Iterator[Photo]:
    """The photographs of a folder, or every other one, with their true boxes; ends the program where there are none."""
    if not (folder / "images").is_dir():
        raise SystemExit(f"{folder} holds no images: give a folder of COCO photographs with --photos")
    if not any((folder / "labels").glob("*.txt")):
        raise SystemExit(f"{folder} holds no labels/*.txt: the true boxes of its images")
    names = coco80()
    for number, path in enumerate(sorted((folder / "images").iterdir())):
        if part in PARTS and number % 2 != PARTS[part]:
            continue
        rgb = np.asarray(Image.open(path).convert("RGB"))
        height, width = rgb.shape[:2]
        told = folder / "labels" / f"{path.stem}.txt"
        rows = np.loadtxt(told, ndmin=2) if told.is_file() and told.stat().st_size else np.zeros((0, 5))
        kinds, middle, half = rows[:, 0].astype(int), rows[:, 1:3], rows[:, 3:5] / 2
        boxes = np.hstack([middle - half, middle + half]) * [width, height, width, height]
        kept = [k for k, kind in enumerate(kinds) if names[kind] in HOUSEHOLD]
        side = max(width, height)
        camera = Camera(width, height, side, side, width / 2, height / 2)
        yield Photo(
            Frame(number, 0.0, rgb, None, np.eye(4), camera), tuple(str(names[kinds[k]]) for k in kept), boxes[kept]
        )


def match(photo: Photo, detector: Any, matched: Matched) -> None:
    """Best score first, each detection to the free true box of its name that it overlaps most, by half at least."""
    found, names = detector.detect(photo.frame), np.array(photo.names)
    best = np.zeros(len(names))
    for box, score, name in zip(found.boxes_xyxy, found.scores.tolist(), found.labels, strict=True):
        if name in HOUSEHOLD:
            overlap = (
                np.where((names == name) & (best == 0), iou(box, photo.boxes_xyxy), 0) if len(names) else np.zeros(1)
            )
            right = bool(overlap.max() >= 0.5)
            matched.hits[name].append((score, right))
            if right:
                best[overlap.argmax()] = score
    for name, score in zip(photo.names, best.tolist(), strict=True):
        matched.boxes[name].append(score)


def table(matched: Matched, threshold: float, least: int) -> str:
    rows = ["| name | boxes | AP50 | precision | recall |", "|---|---|---|---|---|"]
    means = []
    for name in sorted(matched.boxes, key=lambda name: -len(matched.boxes[name])):
        boxes, hits = matched.boxes[name], matched.hits[name]
        means.append(average_precision(hits, len(boxes)))
        if len(boxes) >= least:
            rows.append(f"| {name} | {len(boxes)} | {means[-1]:.2f} | {_rates(hits, len(boxes), threshold)} |")
    every = sum(map(len, matched.boxes.values()))
    hits = [hit for some in matched.hits.values() for hit in some]
    rows.append(f"| **mean over {len(means)} names** | {every} | **{np.mean(means):.3f}** | | |")
    others = [hit for name, some in matched.hits.items() if name != "person" for hit in some]
    rows.append(
        f"| **all boxes** | {every} | {average_precision(hits, every):.3f} | {_rates(hits, every, threshold)} |"
    )
    left = every - len(matched.boxes["person"])
    rows.append(
        f"| **all but persons** | {left} | {average_precision(others, left):.3f} | {_rates(others, left, threshold)} |"
    )
    return "\n".join(rows)


def _rates(hits: list[tuple[float, bool]], boxes: int, threshold: float) -> str:
    counted = [right for score, right in hits if score >= threshold]
    precision = f"{np.mean(counted):.2f} of {len(counted)}" if counted else "–"
    return f"{precision} | {f'{sum(counted) / boxes:.2f}' if boxes else '–'}"


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("detectors", nargs="*", default=["photos"], help="as of cartier map (default: photos)")
    parser.add_argument("--photos", type=Path, default=SHARED / "photos", help="folder with images/ and labels/")
    parser.add_argument("--least", type=int, default=3, help="boxes of a name that has a row (default: %(default)s)")
    parser.add_argument("--part", choices=["all", *PARTS], default="all", help="every other photograph, by name")
    options = parser.parse_args()
    photos = list(photographs(options.photos, options.part))
    if not any(photo.names for photo in photos):
        raise SystemExit(f"{options.photos} holds no box of a household name in the part {options.part!r}")
    for spec in options.detectors:
        usual = specs.detector(spec, None)  # type: ignore[arg-type]  # only ground truth reads the recording
        detector, matched = specs.detector(spec, None, threshold=LOW), Matched()  # type: ignore[arg-type]
        begin = time.process_time()
        for photo in photos:
            usual.detect(photo.frame)
        cost = (time.process_time() - begin) / len(photos)
        for photo in photos:
            match(photo, detector, matched)
        threshold = usual.score_model.threshold
        print(f"\n{spec}: {len(photos)} photographs, {1e3 * cost:.0f} ms each, score {threshold:g} and more\n")
        print(table(matched, threshold, options.least))


if __name__ == "__main__":
    run_script(main)
