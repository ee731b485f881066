"""Benchmark of the embedded dollhouse detector: boxes, objects, distances, and frames per second on one core.

python benchmarks/dollhouse_detector.py [HOME …] [--seed 0] [--max-frames 800] [--sensor KIND] [--sheet FILE]
    (default: the seven homes that no training saw)
Per home: AP50 over its types; recall of the types of which a thing of 400 px or more was seen, and precision, of the
list of confirmed objects; the mean distance from where a name is located to the nearest true thing of that name, from
pixels and with ground-truth detections. Goals: AP50 0.5, recall 0.85, precision 0.9, 0.2 m, 8 frames/s. Then what the
dense features are worth: the share of cells whose nearest name is right, of all and as a mean over types, and how far
from the nearest true thing VLMaps finds each name that was there to be seen: from pixels, with the labels of the
detector, with those of the truth.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

from cartier import plugins
from cartier.contracts import Recording
from cartier.detectors.boxes import iou
from cartier.labels import display_name
from cartier.mapping.object_map import ObjectMap
from cartier.types import Detections, DetectorScoreModel, Frame

LOW = 1e-4  # scores from here on make the precision-recall curve
LEAST_PX = 256  # visible pixels at 640 x 480 that make a true box; of smaller ones neither hits nor misses count
LISTED_PX = 400
DENSE_STEP = 3  # every third frame is enough for cells and maps
MAPS = {"from pixels": "embedded:pixels", "labels of the detector": "embedded", "labels of the truth": "embedded"}


class Kept:
    """A recording whose frames are rendered once and kept, 4 MB each: made for one home at a time."""

    def __init__(self, recording: Recording) -> None:
        self.name, self.truth = recording.name.removeprefix("dollhouse "), recording.truth
        self._frames = cache(recording.__getitem__)
        self._length = len(recording)

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, number: int) -> Frame:
        if not 0 <= number < self._length:
            raise IndexError(number)
        return self._frames(number)


def _no_cells() -> Any:
    return np.zeros(2, int)


@dataclass
class Outputs:
    """What a detector gave in a home, beside the truth. ``hits``: per name, (score, right) of boxes; ``boxes``: true
    ones per name."""

    name: str
    found: list[Detections] = field(default_factory=list)
    hits: dict[str, list[tuple[float, bool]]] = field(default_factory=lambda: defaultdict(list))
    boxes: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    pixels: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    """The most that was seen of one thing of each name in one frame."""
    cells: dict[str, Any] = field(default_factory=lambda: defaultdict(_no_cells))
    """Per name, how many cells were right and how many there are; "" is what is no thing."""


def run_detector(recording: Recording | Kept, detector: Any, least: float = 0.5) -> Outputs:
    """Every frame of a recording through a detector (made with a threshold of ``LOW``) and through the truth.

    A box is right that overlaps the true one by ``least``.
    """
    truth = plugins.make("detectors", "ground_truth", truth=recording.truth, min_pixels=1)
    outputs = Outputs(recording.name)
    for number in range(len(recording)):
        frame = recording[number]
        found, true = detector.detect(frame), truth.detect(frame)
        assert true.masks is not None
        outputs.found.append(found)
        match(found, true, true.masks.sum((1, 2)), outputs, least)
    return outputs


def match(found: Detections, true: Detections, pixels: Any, outputs: Outputs, least: float = 0.5) -> None:
    """Best score first, each box to the true one of its name that it overlaps most, by ``least``, if none had it
    before."""
    names, counted = np.array(true.labels), pixels >= LEAST_PX
    for name, count in zip(true.labels, pixels.tolist(), strict=True):
        outputs.boxes[name] += count >= LEAST_PX
        outputs.pixels[name] = max(outputs.pixels[name], count)
    free = np.ones(len(true), bool)
    for box, score, name in zip(found.boxes_xyxy, found.scores.tolist(), found.labels, strict=True):
        overlap = np.where(names == name, iou(box, true.boxes_xyxy), 0) if len(true) else np.zeros(0)
        best = np.where(free, overlap, 0)
        if len(best) and best.max() >= least:
            free[best.argmax()] = False
            if counted[best.argmax()]:
                outputs.hits[name].append((score, True))
        elif not ((overlap >= 0.3) & ~counted).any():
            outputs.hits[name].append((score, False))


def average_precision(hits: Sequence[tuple[float, bool]], boxes: int) -> float:
    """The area under the precision-recall curve, its precision made monotonic (as COCO does)."""
    if not hits:
        return 0.0
    right = np.array([ok for _, ok in sorted(hits, key=lambda hit: -hit[0])], float)
    recall = np.cumsum(right) / boxes
    precision = np.maximum.accumulate((np.cumsum(right) / np.arange(1, len(right) + 1))[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0) * precision))


def ap50(all_outputs: Sequence[Outputs]) -> dict[str, float]:
    """Per name of which there are true boxes."""
    hits, boxes = defaultdict[str, list[tuple[float, bool]]](list), defaultdict[str, int](int)
    for outputs in all_outputs:
        for name, count in outputs.boxes.items():
            boxes[name] += count
        for name, some in outputs.hits.items():
            hits[name] += some
    return {name: average_precision(hits[name], count) for name, count in boxes.items() if count}


def index_of(recording: Recording | Kept, found: Sequence[Detections], score_model: DetectorScoreModel) -> Any:
    """ObjectDepth of a recording and its detections."""
    objects, index = ObjectMap(score_model), plugins.make("indexes", "object_depth")
    for number, detections in enumerate(found):
        objects.add(recording[number], detections.keep(detections.scores >= score_model.zero_weight_score))
    objects.merge_and_prune()
    index.set_objects(objects.objects())
    return index


def listed(outputs: Outputs, names: Sequence[str]) -> tuple[float, float]:
    """Recall over names of which 400 px or more were seen, and precision: the share of listed names that were there to
    be seen."""
    there = {name for name, pixels in outputs.pixels.items() if pixels >= LISTED_PX}
    right = [name for name in names if outputs.pixels.get(name, 0) > 0]
    return len(there & set(names)) / max(1, len(there)), len(right) / max(1, len(names))


def distances(recording: Recording | Kept, index: Any, names: Sequence[str] | None = None) -> list[float]:
    """From where each name (by default each listed one) is located to the middle of the nearest true thing of that name
    (m); not of names that are not there."""
    result = []
    for name in index.names() if names is None else names:
        middles = [
            (np.array(t.box_min) + t.box_max) / 2 for t in recording.truth or () if display_name(t.label) == name
        ]
        if middles:
            result.append(min(float(np.linalg.norm(np.array(index.locate(name).position) - m)) for m in middles))
    return result


def dense_features(recording: Recording | Kept, detector: Any, outputs: Outputs, encoder: Any) -> dict[str, Any]:
    """The cells of every third frame into ``outputs``, and the VLMaps index of ``MAPS`` that these frames make."""
    names = list(detector.model.names)
    vectors = encoder.text([*names, *detector.model.around])
    truth = plugins.make("detectors", "ground_truth", truth=recording.truth)
    maps: dict[str, Any] = {name: plugins.make("indexes", "vlmaps", encoder=made_by) for name, made_by in MAPS.items()}
    true_names = {obj.id: display_name(obj.label) for obj in recording.truth or ()}
    for number in range(0, len(recording), DENSE_STEP):
        frame = recording[number]
        features = encoder.image(frame)
        assert frame.instances is not None
        rows, columns = (
            ((np.arange(cells) + 0.5) * pixels / cells).astype(int)
            for cells, pixels in zip(features.shape[:2], frame.instances.shape, strict=True)
        )
        shown, nearest = frame.instances[np.ix_(rows, columns)], (features @ vectors.T).argmax(2)
        for obj in np.unique(shown):
            name, mine = true_names.get(int(obj), ""), shown == obj
            right = nearest[mine] == names.index(name) if name else nearest[mine] >= len(names)
            outputs.cells[name] += int(right.sum()), len(right)
        found = outputs.found[number].keep(outputs.found[number].scores >= detector.model.score_model.threshold)
        for name, index in maps.items():
            index.add(frame, truth.detect(frame) if name == "labels of the truth" else found)
    return maps


def report_cells(all_outputs: Sequence[Outputs], far: dict[str, list[float]]) -> None:
    """What the dense features are worth, over all homes."""
    cells: dict[str, Any] = defaultdict(_no_cells)
    for outputs in all_outputs:
        for name, counts in outputs.cells.items():
            cells[name] += counts
    shares = {name: right / count for name, (right, count) in cells.items()}
    right, count = np.sum(list(cells.values()), axis=0)
    objs = [shares[name] for name in cells if name]
    print(f"cells: {right / count:.3f} of all are right, {shares['']:.3f} of walls and floors, {np.mean(objs):.3f} as "
          f"a mean over {len(objs)} types")  # fmt: skip
    for name, metres in far.items():
        print(f"VLMaps {name}: {len(metres)} names found at {np.mean(metres):.2f} m on average, median "
              f"{np.median(metres):.2f} m, {np.mean(np.array(metres) <= 1):.0%} within 1 m")  # fmt: skip


def report(recordings: Sequence[Recording], detector: Any) -> None:
    """The table, one line per home, and the total."""
    all_outputs, rows = [], []
    encoder = plugins.make("encoders", "embedded", model="pixels", threads=1)
    mapped: dict[str, list[float]] = {name: [] for name in MAPS}
    print(f"detector: {detector.name}, (sha256 {detector.sha256[:12]})")
    print("home               frames  AP50  recall  precision  distance  (ground truth)")
    for walk in recordings:
        recording = Kept(walk)
        outputs = run_detector(recording, detector)
        all_outputs.append(outputs)
        index = index_of(recording, outputs.found, detector.model.score_model)
        exact = plugins.make("detectors", "ground_truth", truth=recording.truth)
        for name, made in dense_features(recording, detector, outputs, encoder).items():
            mapped[name] += distances(recording, made, [n for n, px in outputs.pixels.items() if px >= LISTED_PX])
        best = index_of(recording, [exact.detect(recording[i]) for i in range(len(recording))], exact.score_model)
        recall, precision = listed(outputs, index.names())
        far, bound = (float(np.mean(distances(recording, it) or [np.nan])) for it in (index, best))
        rows.append((float(np.mean(list(ap50([outputs]).values()))), recall, precision, far, bound))
        print(
            f"{recording.name:18} {len(recording):6}  {rows[-1][0]:.2f}  {recall:6.2f}  {precision:9.2f}  {far:6.2f} m "
            f" {bound:8.2f} m",
            flush=True,
        )
        missed = sorted({n for n, p in outputs.pixels.items() if p >= LISTED_PX} - set(index.names()))
        print(
            f"    missed: {', '.join(missed) or 'none'}; invented: "
            f"{', '.join(n for n in index.names() if not outputs.pixels.get(n)) or 'none'}"
        )
    types = ap50(all_outputs)
    mean = np.nanmean(np.array(rows), axis=0)
    print(
        f"all: AP50 over {len(types)} types {np.mean(list(types.values())):.3f}; means of homes: recall {mean[1]:.2f}, "
        f"precision {mean[2]:.2f}, distance {mean[3]:.2f} m (ground truth {mean[4]:.2f} m)"
    )
    ordered = sorted(types.items(), key=lambda item: item[1])
    report_cells(all_outputs, mapped)
    print("lowest AP50:", ", ".join(f"{name} {value:.2f}" for name, value in ordered[:25]))
    print("highest AP50:", ", ".join(f"{name} {value:.2f}" for name, value in ordered[:-16:-1]))


def sheet(recordings: Sequence[Recording], detector: Any, path: Path) -> None:
    """A picture: of each home the frame in which most is to be seen, found boxes in green, the truth that was missed in
    red."""
    from PIL import Image, ImageDraw

    tiles = []
    for recording in recordings:
        truth = plugins.make("detectors", "ground_truth", truth=recording.truth, min_pixels=LISTED_PX)
        richest = max(range(0, len(recording), 5), key=lambda i: len(truth.detect(recording[i])))
        frame = recording[richest]
        found, true = detector.detect(frame), truth.detect(frame)
        found = found.keep(found.scores >= detector.model.score_model.threshold)
        image = Image.fromarray(frame.rgb)
        draw = ImageDraw.Draw(image)
        draw.text((6, 4), recording.name.removeprefix("dollhouse "), fill="black", font_size=18)
        for box, name in zip(true.boxes_xyxy, true.labels, strict=True):
            same = [k for k, label in enumerate(found.labels) if label == name]
            if not len(same) or iou(box, found.boxes_xyxy[same]).max() < 0.5:
                draw.rectangle(box.tolist(), outline=(200, 40, 40))
                draw.text((box[0] + 2, box[3] - 14), name, fill=(200, 40, 40), font_size=12)
        for box, name, score in zip(found.boxes_xyxy, found.labels, found.scores, strict=True):
            draw.rectangle(box.tolist(), outline=(20, 150, 40), width=2)
            draw.text((box[0] + 3, box[1] + 1), f"{name} {score:.2f}", fill=(0, 90, 20), font_size=13)
        tiles.append(np.asarray(image))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % 2)
    rows = [np.hstack(tiles[k : k + 2]) for k in range(0, len(tiles), 2)]
    Image.fromarray(np.vstack(rows)).save(path, quality=80)


def speed(frame: Frame) -> float:
    """Frames per second of 640 x 480 on one thread, by the processor's time, the median of thirty."""
    detector = plugins.make("detectors", "embedded", threads=1)
    times = []
    for _ in range(33):
        again = replace(frame, rgb=frame.rgb.copy())  # the outputs for an image are cached
        start = time.process_time()
        detector.detect(again)
        times.append(time.process_time() - start)
    return 1 / float(np.median(times[3:]))


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("homes", nargs="*", help="built-in homes, or numbers (default: the seven built-in ones)")
    parser.add_argument("--seed", type=int, default=0, help="of the walks (default: %(default)s)")
    parser.add_argument("--max-frames", type=int, default=800, help="of each walk (default: %(default)s)")
    parser.add_argument("--sensor", default="exact", metavar="KIND", help="exact, depth-camera or phone")
    parser.add_argument("--sheet", type=Path, help="a contact sheet of detections goes there (.jpg, .png)")
    asked = parser.parse_args()
    world = plugins.make("worlds", "dollhouse")
    detector = plugins.make("detectors", "embedded", threshold=LOW, threads=1)
    how = {"seed": asked.seed, "sensor": asked.sensor, "max_frames": asked.max_frames}
    walks = [world.explore(home, **how) for home in asked.homes or world.homes()]
    print(f"{speed(walks[0][0]):.1f} frames/s of 640 x 480 on one thread")
    report(walks, detector)
    if asked.sheet:
        sheet(walks, detector, asked.sheet)


if __name__ == "__main__":
    run_script(main)
