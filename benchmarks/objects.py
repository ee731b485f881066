"""Benchmark of the object map against ground truth: with ground-truth detections, and from pixels.

python benchmarks/objects.py [HOME …] [--generated 20] [--sensor KIND] [--labels]
    (default: the seven built-in homes; a number is a generated one; --sensor depth-camera or phone adds the
    faults of one: coarse depth, holes, flying pixels, image noise, drifting poses)
Objects and true things are matched one to one, by label, where an object's middle lies at most 0.5 m from the thing's
true box. Precision is over what is confirmed, recall over things of 400 px or more in some frame; a listed thing of
fewer is no fault. Entries: confirmed objects per true thing that has any. Invented: confirmed, and no thing of that
name is within 0.5 m. Shuffled, twice: the share of confirmed objects that another order of the frames, or the same
frames again, lose and add. Then the boxes (boxes.py; needs `pip install '.[test]'`, for shapely), rooms and relations
(spatial.py). Nothing was fitted on any of these homes.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from boxes import ALONG_WALLS, DBSCAN, LAST_VIEW, OURS, BoxCounts, PeerBoxes, print_boxes
from command_line import Parser, run_script
from scipy.optimize import linear_sum_assignment

from cartier import plugins
from cartier.geometry import box_distance
from cartier.labels import display_name
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.occupancy import OccupancyMapper
from cartier.mapping.walls import walls_yaw
from cartier.types import (
    Array,
    Camera,
    Detections,
    DetectorScoreModel,
    Frame,
    MapObject,
    OccupancyGrid,
    OrientedBox,
    TrueObject,
)
from spatial import DETECTORS, Contacts, Figures, Mapped

SAME_M = 0.5
SHOWN_PX = 400
FIRST_GENERATED = 70_001  # neither the detector nor its score_model was made on homes from here on
BUDGET = 30, 300  # detections in a frame, and objects known, of which the cost is measured


def one_to_one(objects: Sequence[MapObject], truth: Sequence[TrueObject], named: bool = True) -> dict[int, int]:
    """The things that objects are, both by their place in the lists; ``named``: only of the same name."""
    cost = np.full((len(objects), len(truth)), 1e6)
    for k, obj in enumerate(truth):
        low, high = np.array(obj.box_min), np.array(obj.box_max)
        for i, mapped in enumerate(objects):
            far = float(box_distance(np.array(mapped.position), low, high))
            if far <= SAME_M and (not named or mapped.label == display_name(obj.label)):
                cost[i, k] = far + 0.2 * float(np.linalg.norm(np.array(mapped.position) - (low + high) / 2))
    return {int(i): int(k) for i, k in zip(*linear_sum_assignment(cost), strict=True) if cost[i, k] < 1e6}


def changed(before: Sequence[MapObject], after: Sequence[MapObject]) -> int:
    """How many confirmed objects of one map have no counterpart in the other one, lost and new together."""
    one, other = ([obj for obj in objects if obj.confirmed] for objects in (before, after))
    as_things = [TrueObject(o.id, o.label, o.box_min, o.box_max) for o in one]
    same = one_to_one(other, as_things)
    return len(one) + len(other) - 2 * len(same)


@dataclass
class Home:
    """One home, mapped by one detector in all variants."""

    true_objects: list[TrueObject]
    pixels: Array
    """In how many pixels each thing was shown at best."""
    maps: dict[str, tuple[MapObject, ...]]
    ms: float
    bytes_per_object: float
    peer_boxes: dict[int, dict[str, Array]]
    """Boxes (2, 3) by the peers, of each object of "every frame"."""


@dataclass
class Counts:
    """Sums over homes; each figure is one of them over another."""

    sums: dict[str, float] = field(default_factory=dict)
    told: list[tuple[float, bool]] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    boxes: dict[str, BoxCounts] = field(default_factory=lambda: defaultdict(BoxCounts))

    def add(self, home: Home) -> None:
        seen = [obj for obj, pixels in zip(home.true_objects, home.pixels, strict=True) if pixels > 0]
        shown = {k for k, pixels in enumerate(home.pixels[home.pixels > 0]) if pixels >= SHOWN_PX}
        every = home.maps["every frame"]
        listed = [obj for obj in every if obj.confirmed]
        is_of, blind = one_to_one(listed, seen), one_to_one(listed, seen, named=False)
        near = [self._nearest(mapped, seen) for mapped in listed]
        entries = [k for k in near if k is not None]
        kinds = {display_name(seen[k].label) for k in shown}
        for name, value in {
            "listed": len(listed), "right": len(is_of), "blind": len(blind), "shown": len(shown),
            "found": len(shown & set(is_of.values())), "found blind": len(shown & set(blind.values())),
            "entries": len(entries), "entered": len(set(entries)), "invented": near.count(None), "kinds": len(kinds),
            "exact": sum(self._exact(kind, listed, seen, shown, is_of) for kind in kinds),
        }.items():  # fmt: skip
            self._count(name, value)
        fewer = [obj for obj in home.maps["every 4th"] if obj.confirmed]
        self._count("listed of 4th", len(fewer))
        self._count("invented of 4th", sum(self._nearest(mapped, seen) is None for mapped in fewer))
        for variant in ("shuffled", "twice"):
            self._count(variant, changed(every, home.maps[variant]))
        real = one_to_one(every, seen)
        self.told += [(mapped.probability, i in real) for i, mapped in enumerate(every)]
        own = {obj.id: np.array([obj.box_min, obj.box_max]) for obj in every}
        large = [k in shown for k in range(len(seen))]
        for kind in (OURS, LAST_VIEW, DBSCAN):
            boxes = [home.peer_boxes.get(obj.id, {}).get(kind, own[obj.id]) for obj in every]
            self.boxes[kind].add(every, np.array(boxes).reshape(-1, 2, 3), seen, large)
        self.boxes[ALONG_WALLS].add(every, [obj.oriented or _upright(obj) for obj in every], seen, large)

    def _count(self, name: str, value: float) -> None:
        self.sums[name] = self.sums.get(name, 0) + value

    def _exact(
        self, kind: str, listed: Sequence[MapObject], seen: Sequence[TrueObject], shown: set[int], is_of: dict[int, int]
    ) -> bool:
        """Whether as many of a kind are listed as were shown; those that were shown too small may be listed or not."""
        want = sum(display_name(seen[k].label) == kind for k in shown)
        got = sum(
            mapped.label == kind and is_of.get(i) not in set(is_of.values()) - shown for i, mapped in enumerate(listed)
        )
        if want != got:
            self.wrong.append(f"{kind} {got}/{want}")
        return want == got

    @staticmethod
    def _nearest(mapped: MapObject, seen: Sequence[TrueObject]) -> int | None:
        far = [
            (float(box_distance(np.array(mapped.position), np.array(obj.box_min), np.array(obj.box_max))), k)
            for k, obj in enumerate(seen) if display_name(obj.label) == mapped.label
        ]  # fmt: skip
        least, nearest = min(far, default=(np.inf, 0))
        return nearest if least <= SAME_M else None

    def print(self, title: str, ms: Sequence[float], sizes: Sequence[float]) -> None:
        of = {name: float(value) for name, value in self.sums.items()}
        rows = {
            "precision / recall": f"{of['right'] / of['listed']:.3f} / {of['found'] / of['shown']:.3f}",
            "  whatever the label": f"{of['blind'] / of['listed']:.3f} / {of['found blind'] / of['shown']:.3f}",
            "entries per true thing": f"{of['entries'] / of['entered']:.3f}",
            "exact count per home and type": f"{of['exact'] / of['kinds']:.3f} of {of['kinds']:.0f}",
            "invented, every 4th frame → every frame": f"{of['invented of 4th'] / of['listed of 4th']:.3f} → "
            f"{of['invented'] / of['listed']:.3f} of {of['listed']:.0f}",
            "changed by shuffling / by the same again": f"{of['shuffled'] / of['listed']:.3f} / "
            f"{of['twice'] / of['listed']:.3f}",
            "calibration error (ECE)": f"{_ece(self.told):.3f} over {len(self.told)} objects",
            "cost": f"{np.median(ms):.2f} ms a frame (most {max(ms):.2f}), {np.median(sizes):.0f} bytes an object",
        }
        print(f"\n{title}")
        for name, value in rows.items():
            print(f"  {name:42}{value}")
        print("  probability: of such objects really there")
        for low, high, chosen in _bins(self.told):
            print(f"    {low:.1f} to {high:.1f}: {chosen[:, 1].mean():.2f} of {len(chosen)}")
        if self.wrong:
            print(f"  counts that are wrong (listed/shown): {', '.join(sorted(self.wrong)[:30])}")


def _upright(obj: MapObject) -> OrientedBox:
    """The axis-aligned box of an object as an oriented one."""
    low, high = np.array(obj.box_min), np.array(obj.box_max)
    return OrientedBox(tuple((low + high) / 2), tuple(high - low), 0.0)


def _bins(told: Sequence[tuple[float, bool]]) -> list[tuple[float, float, Array]]:
    rows = np.array(told, float)
    tenth = np.minimum((rows[:, 0] * 10).astype(int), 9)
    return [(k / 10, (k + 1) / 10, rows[tenth == k]) for k in range(10) if (tenth == k).any()]


def _ece(told: Sequence[tuple[float, bool]]) -> float:
    return sum(abs(float((chosen[:, 0] - chosen[:, 1]).sum())) for *_, chosen in _bins(told)) / len(told)


def walked(name: str, sensor: str = "exact") -> tuple[OccupancyGrid, dict[str, Home]]:
    """A home's floor plan, and what each detector makes of its walk: three times, since frames are not kept."""
    world: Any = plugins.make("worlds", "dollhouse")
    recording, objs = world.explore(name, sensor=sensor), world.scene(name).truth()
    n, floor, found = len(recording), OccupancyMapper(), dict[int, Detections]()
    truth = plugins.make("detectors", "ground_truth", truth=objs, source=name)
    pixels_only = plugins.make("detectors", "embedded", threads=1)
    detectors = {"ground_truth": truth, "embedded": pixels_only}
    maps = {key: defaultdict[str, ObjectMap](partial(ObjectMap, made.score_model)) for key, made in detectors.items()}
    peers = {key: PeerBoxes() for key in detectors}
    pixels, spent = np.zeros(max(t.id for t in objs) + 1, np.int64), dict.fromkeys(detectors, 0.0)
    shuffled = np.random.default_rng(0).permutation(n)
    for turn, order in (("every frame", np.arange(n)), ("twice", np.arange(n)), ("shuffled", shuffled)):
        for number in order.tolist():
            frame = recording[number]
            if turn == "every frame":
                floor.add(frame)
                found[number] = pixels_only.detect(frame)
                assert frame.instances is not None
                pixels = np.maximum(pixels, np.bincount(frame.instances.ravel(), minlength=len(pixels))[: len(pixels)])
            for key, of in maps.items():
                detections = found[number] if key == "embedded" else truth.detect(frame)
                begin = time.process_time()
                ids = of[turn].add(frame, detections)
                if turn == "every frame":
                    spent[key] += time.process_time() - begin
                    peers[key].add(frame, detections, ids.tolist())
                if turn == "every frame" and number % 4 == 0:
                    of["every 4th"].add(frame, detections)
        if turn == "every frame":
            for of in maps.values():
                of["twice"] = deepcopy(of[turn])
    homes, grid = {}, floor.grid()
    assert grid is not None
    yaw = walls_yaw(grid)
    for key, of in maps.items():
        size = sum(map(len, of["every frame"].state().values())) / max(1, len(of["every frame"]))
        for made in of.values():
            made.consolidate(yaw)
        listed = {turn: made.objects(yaw) for turn, made in of.items()}
        peer_boxes = {obj.id: peers[key].boxes(obj) for obj in listed["every frame"]}
        homes[key] = Home(list(objs), pixels[[t.id for t in objs]], listed, spent[key] / n * 1e3, size, peer_boxes)
    return grid, homes


def cost_ms() -> float:
    """A frame (640 x 480) with 30 detections of 300 known objects that are all in view: the median of 50."""
    rng, camera, pose = np.random.default_rng(0), Camera(640, 480, 500, 500, 319.5, 239.5), np.eye(4)
    left, top = (a.ravel() * 32.0 for a in np.meshgrid(np.arange(20), np.arange(15)))
    boxes = np.stack([left + 4, top + 4, left + 28, top + 28], axis=1)
    depth_m = np.full((480, 640), 4.0, np.float32)
    for x1, y1, x2, y2 in boxes.astype(int):
        depth_m[y1:y2, x1:x2] = rng.uniform(2, 3)
    known, times = ObjectMap(DetectorScoreModel()), []
    for number in range(100):
        pose[:3, 3] = rng.normal(0, 0.02, 3)
        some = rng.choice(300, 30, replace=False) if number >= 50 else np.arange(number % 10, 300, 10)
        frame = Frame(number, number / 10, np.zeros((480, 640, 3), np.uint8), depth_m, pose, camera)
        seen = Detections(number, boxes[some], np.full(30, 0.9), tuple(f"kind {k % 40}" for k in some))
        begin = time.process_time()
        known.add(frame, seen)
        times.append(time.process_time() - begin)
    assert len(known) == 300
    return float(np.median(times[50:])) * 1e3


def report(title: str, names: Sequence[str], sensor: str, by_label: bool) -> None:
    counts, spatial = {key: Counts() for key in DETECTORS}, {key: Figures() for key in DETECTORS}
    ms, sizes = ({key: list[float]() for key in DETECTORS} for _ in range(2))
    world: Any = plugins.make("worlds", "dollhouse")
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for name, (grid, homes) in zip(names, pool.map(partial(walked, sensor=sensor), names), strict=True):
            print(f"{name} …", end=" ", flush=True)
            scene = world.scene(name)
            contacts, pixels = Contacts(scene), np.zeros(max(obj.id for obj in scene.things) + 1, np.int64)
            for key, home in homes.items():
                pixels[[obj.id for obj in home.true_objects]] = home.pixels
                counts[key].add(home)
                spatial[key].add(Mapped(scene, grid, home.maps["every frame"], pixels), contacts)
                ms[key].append(home.ms)
                sizes[key].append(home.bytes_per_object)
    for key, detector in DETECTORS.items():
        counts[key].print(f"{title}, {detector}", ms[key], sizes[key])
        print_boxes(counts[key].boxes, by_label)
        spatial[key].print("rooms and relations")


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("homes", nargs="*", help="built-in homes, or numbers (default: the seven built-in ones)")
    parser.add_argument("--generated", type=int, default=20, metavar="N", help="generated homes (default: %(default)s)")
    parser.add_argument("--sensor", default="exact", metavar="KIND", help="exact, depth-camera or phone")
    parser.add_argument("--labels", action="store_true", help="boxes by label")
    options = parser.parse_args()
    print(f"a frame with 30 detections of 300 known objects in view: {cost_ms():.1f} ms")
    report(
        "built-in homes" if not options.homes else "homes",
        options.homes or plugins.make("worlds", "dollhouse").homes(),
        options.sensor,
        options.labels,
    )
    if options.generated and not options.homes:
        report(
            "generated homes",
            [str(FIRST_GENERATED + k) for k in range(options.generated)],
            options.sensor,
            options.labels,
        )


if __name__ == "__main__":
    run_script(main)
