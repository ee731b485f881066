"""Benchmark of routes: drives under rules in true homes, and sentences against the typed rules that they mean.

python benchmarks/routes.py [--drives 240] [--homes 6] [--seed 0] [files …]
Drives: the seven built-in homes and generated ones, all with rugs and narrow doors, on their true floor plans (ground
truth: what a perfect map would show). Each drive goes to a random object under one to three random rules. The path,
point by point, is checked against the true polygons: rooms, rugs, and the boxes of objects. "Crossed": points of a hard
rule's area that the robot's centre enters without having asked. Where the planner asks instead, a flood fill over the
plan decides whether there was a way. Files: lines ``ACT ANSWER + RULE … :: words`` (tools/understanding/README.md);
by default the held-out ones, of which only totals may be looked at. A sentence counts where kind, target, strength and
scope of all rules are the very ones that its writer wrote down.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import random
import statistics
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from command_line import Parser, run_script
from scipy import ndimage

sys.path.append(str(Path(__file__).parents[1] / "tools" / "understanding"))

from home_text import inventory
from markup import read

from cartier import plugins
from cartier.evaluation.true_home import true_objects
from cartier.geometry import box_distance
from cartier.navigation.layers import AVOID_OBJECT_M, FLAT_M, KEEP_AWAY_M, SLOW_NEAR_M, VIA_M, RouteMap
from cartier.navigation.planning import traversable
from cartier.navigation.routes import RoutePlan, plan_route
from cartier.reasoners import embedded
from cartier.route_rules import FLOOR_KINDS, RouteRule, RouteTarget
from cartier.spatial.doors import find_doors
from cartier.types import FREE, Place, RobotModel, Room
from cartier.worlds.dollhouse.floors import kinds_at
from cartier.worlds.dollhouse.model import Scene
from cartier.worlds.dollhouse.place import Plan

HELD_OUT = Path(__file__).parents[1] / "tools" / "understanding" / "held_out" / "routes"
FIRST_GENERATED = 70_001
OPTIONS = "+rugs+narrow"
POINT_M = 0.01
EDGE_M = 0.05  # a cell: rules are obeyed to within one
KINDS = ("avoid", "keep-away", "slow-near", "prefer", "via", "only-through")
Points = npt.NDArray[np.float64]


class Home(NamedTuple):
    """A home's truth: the scene, what a perfect map of it would show, and where a robot fits."""

    scene: Scene
    site: RouteMap
    plan: Plan


def true_home(name: str) -> Home:
    """The true floor plan with its kinds of floor, rooms, doors and objects."""
    world: Any = plugins.make("worlds", "dollhouse")
    scene: Scene = world.scene(name)
    plan = Plan(scene, RobotModel.radius_m)
    grid = plan.grid()
    xy = grid.centre(np.argwhere(np.ones(grid.cells.shape, bool))).reshape(*grid.cells.shape, 2)
    grid = replace(grid, floor_kinds=kinds_at(scene, xy))
    rooms = []
    for number, room in enumerate(scene.rooms):
        x1, y1, x2, y2 = room.box
        inside = (xy[..., 0] > x1) & (xy[..., 0] < x2) & (xy[..., 1] > y1) & (xy[..., 1] < y2)
        rooms.append(Room(number, room.name, room.kind, np.argwhere(inside).astype(np.int32)))
    return Home(scene, RouteMap(grid, rooms, true_objects(scene), find_doors(rooms, grid)), plan)


def random_rules(home: Home, rng: random.Random) -> list[RouteRule]:
    """One to three rules about random rooms, kinds of floor and objects."""
    scene = home.scene
    floors = {room.floor.partition(":")[0] for room in scene.rooms} & set(FLOOR_KINDS)
    floors |= {"rug"} if scene.rugs else set()
    found = []
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.choice(KINDS)
        targets: list[RouteTarget] = []
        if kind in ("avoid", "prefer", "via", "only-through"):
            targets += [RouteTarget("room", (room.name,)) for room in scene.rooms]
        if kind in ("avoid", "prefer"):
            targets += [RouteTarget("floor", (floor,)) for floor in sorted(floors)] * 2
        if kind in ("avoid", "keep-away", "slow-near", "via"):
            low = [obj.id for obj in home.site.objects if obj.box_min[2] < 0.4]
            targets += [RouteTarget("object", ids=(number,)) for number in rng.sample(low, min(6, len(low)))]
        strength = "soft" if kind == "prefer" else rng.choice(("hard", "hard", "soft"))
        found.append(RouteRule(kind, rng.choice(targets), strength))  # type: ignore[arg-type]
    return found


def off_m(rule: RouteRule, home: Home) -> Callable[[Points], Points]:
    """How far points (k, 2) are from the true area of a rule (m), negative inside, without its margin."""
    target, scene = rule.target, home.scene
    assert target is not None
    if target.kind == "object":
        boxes = [obj for obj in home.site.objects if obj.id in target.ids]
        areas = np.array([[*obj.box_min[:2], *obj.box_max[:2]] for obj in boxes])
    elif target.kind == "room":
        areas = np.array([room.box for room in scene.rooms if room.name in target.names])
    elif target.names == ("rug",):
        areas = np.array([rug.box for rug in scene.rugs])
    else:
        areas = np.array([room.box for room in scene.rooms if room.floor.partition(":")[0] in target.names])

    def away(points: Points) -> Points:
        outside = np.stack([box_distance(points, area[:2], area[2:]) for area in areas]).min(0)
        x, y = points.T
        depth = np.max([np.min([x - a[0], a[2] - x, y - a[1], a[3] - y], axis=0) for a in areas], axis=0)
        if target.kind == "floor" and target.names != ("rug",) and scene.rugs:  # a rug hides what it lies on
            on_rug = kinds_at(scene, points) == FLOOR_KINDS.index("rug")
            depth = np.where(on_rug, -1.0, depth)
            outside = np.where(on_rug, 1.0, outside)
        far: Points = np.where(outside > 0, outside, -depth)
        return far

    return away


def margin_m(rule: RouteRule, home: Home) -> float:
    """How far from its true area a rule to avoid or to keep away reaches."""
    if rule.kind == "keep-away":
        return KEEP_AWAY_M
    tall = [obj for obj in home.site.objects if rule.target and obj.id in rule.target.ids and obj.box_max[2] > FLAT_M]
    return AVOID_OBJECT_M if tall else 0.0


def dense(path: Points) -> Points:
    """Points (k, 2) along a path, a centimetre apart."""
    parts = [np.linspace(a, b, max(2, int(np.linalg.norm(b - a) / POINT_M) + 1)) for a, b in pairwise(path)]
    return np.concatenate(parts) if parts else path


class Outcome(NamedTuple):
    """What came of a drive under rules: a verdict for each rule, and figures of the drive."""

    verdicts: list[tuple[str, str]]
    asked: bool
    collided: bool
    longer_m: float
    ms: float


def driven(home: Home, place: Place, rules: Sequence[RouteRule]) -> Outcome | None:
    """Plan a drive and check it; None for a place that cannot be reached even without rules."""
    start, robot = home.scene.start_xy, RobotModel()
    free = plan_route(home.site, place, start, robot)
    if free.goal is None:
        return None
    begin = time.perf_counter()
    planned = plan_route(home.site, place, start, robot, rules)
    ms = (time.perf_counter() - begin) * 1e3
    if planned.goal is None:
        verdict = "asked" if _no_way(home, planned, free) else "asked in vain"
        return Outcome([(_name(rule), verdict) for rule in planned.blocking], True, False, 0.0, ms)
    points = dense(planned.goal.path)
    verdicts = [(_name(rule), _verdict(rule, home, points, planned, free)) for rule in rules]
    collided = not all(home.plan.free((x, y)) for x, y in points[::5])
    return Outcome(verdicts, False, collided, planned.goal.length_m - free.goal.length_m, ms)


def _name(rule: RouteRule) -> str:
    assert rule.target is not None
    return f"{rule.kind} {rule.target.kind}, {rule.strength}"


def _verdict(rule: RouteRule, home: Home, points: Points, planned: RoutePlan, free: RoutePlan) -> str:
    """Whether a path obeys a rule, by the truth; at a start or a goal within its area nothing can be asked."""
    assert planned.goal is not None and free.goal is not None
    far = off_m(rule, home)(points)
    if rule.kind == "slow-near":
        near = off_m(rule, home)(planned.goal.path) < SLOW_NEAR_M - EDGE_M
        route = planned.goal.route
        return "obeyed" if route is not None and (route.speed[near] < 1).all() else "broken"
    if rule.kind == "via":
        passed = float(far.min()) <= VIA_M + EDGE_M
        return "obeyed" if passed else "told" if planned.notes else "broken"
    crossed = far < margin_m(rule, home) - EDGE_M
    if rule.kind in ("prefer", "only-through"):
        crossed = far > EDGE_M
        before = float((off_m(rule, home)(dense(free.goal.path)) > EDGE_M).mean())
        return "weighed" if float(crossed.mean()) <= before + 0.02 else "worse"
    if rule.strength == "soft":
        free_points = dense(free.goal.path)
        inside_m = [float((off_m(rule, home)(p) < margin_m(rule, home) - EDGE_M).sum()) for p in (points, free_points)]
        return "weighed" if inside_m[0] <= inside_m[1] * 1.05 + 5 else "worse"
    inside = np.flatnonzero(crossed)
    outside = np.flatnonzero(~crossed)
    if not len(inside):
        return "obeyed"
    if not len(outside) or inside[-1] < outside[0] or inside[0] > outside[-1]:
        return "at an end"
    middle = inside[(inside > outside[0]) & (inside < outside[-1])]
    return "at an end" if not len(middle) else "broken"


def _no_way(home: Home, planned: RoutePlan, free: RoutePlan) -> bool:
    """Whether a flood fill, too, finds no way from the start to where the free way ends under the blocking rules."""
    assert free.goal is not None
    grid, robot = home.site.grid, RobotModel()
    open_cells = traversable(grid, robot.radius_m)
    cells = np.argwhere(open_cells)
    xy = grid.centre(cells)
    ends = np.array([free.goal.path[0], free.goal.path[-1]])
    for rule in planned.blocking:
        away = off_m(rule, home)
        shut = away(xy) > EDGE_M if rule.kind == "only-through" else away(xy) < margin_m(rule, home)
        near_end = np.min([np.hypot(*(xy - end).T) for end in ends], axis=0) < 0.3
        keep = ~shut | near_end
        open_cells[tuple(cells[~keep].T)] = False
    parts, _ = ndimage.label(open_cells & (grid.cells == FREE), np.ones((3, 3)))
    one, other = (parts[tuple(cell)] for cell in grid.cell(ends))
    return bool(one == 0 or other == 0 or one != other)


def drives(names: Sequence[str], count: int, seed: int) -> None:
    """Drive, and print a table."""
    rng, homes = random.Random(seed), [true_home(name + OPTIONS) for name in names]
    verdicts: dict[str, Counter[str]] = defaultdict(Counter)
    done = list[Outcome]()
    tried = 0
    while len(done) < count and tried < 20 * count:
        home = homes[tried % len(homes)]
        tried += 1
        obj = rng.choice(home.site.objects)
        place = Place(obj.label, obj.position, 1.0, -1, box_min=obj.box_min, box_max=obj.box_max, object_id=obj.id)
        outcome = driven(home, place, random_rules(home, rng))
        if outcome is None:
            continue
        done.append(outcome)
        for name, verdict in outcome.verdicts:
            verdicts[name][verdict] += 1
    columns = ("obeyed", "weighed", "asked", "asked in vain", "told", "at an end", "worse", "broken")
    print(f"{len(done)} drives in {len(homes)} homes (ground truth: their true floor plans)\n")
    print(f"| rule | {' | '.join(columns)} |\n|---|{'---:|' * len(columns)}")
    for name in sorted(verdicts):
        print(f"| {name} | {' | '.join(str(verdicts[name][c] or '') for c in columns)} |")
    broken = sum(v["broken"] for name, v in verdicts.items() if name.endswith("hard"))
    print(f"\nhard rules broken without having asked: {broken}; drives that hit something: "
          f"{sum(o.collided for o in done)}; asked: {sum(o.asked for o in done)}")  # fmt: skip
    detours = [o.longer_m for o in done if o.longer_m > 0.05]
    print(f"detours: {len(detours)}, {statistics.median(detours or [0]):.2f} m at the median")
    spent = [outcome.ms for outcome in done]
    print(f"planning: {statistics.median(spent):.0f} ms at the median, {max(spent):.0f} ms at most")


def sentences(files: Sequence[Path]) -> Iterator[tuple[str, bool, dict[str, bool], bool]]:
    """For each line with rules: its sort, whether all is exact, and whether each part is."""
    reasoner = embedded.make()
    for file in files:
        for line in read(file):
            texts = [text for wishes in line.rules for text in wishes]
            if not texts or any(text.startswith("!") for text in texts):  # "!": the writer's target is not checked
                continue
            wanted = [RouteRule.parse(text) for text in texts]
            lifting = line.acts[0] == "lift"
            known = inventory(line.home)
            standing = tuple(replace(rule, scope="standing", id=f"r{k}") for k, rule in enumerate(wanted) if lifting)
            chosen = reasoner.select(line.text, replace(known, rules=standing), list(line.context))
            parts = [chosen, *chosen.next]
            got = [rule for part in parts for rule in (part.lifts if lifting else part.rules)]
            unknown = [rule for rule in wanted if rule.target is not None and rule.target.kind == "none"]
            if unknown and chosen.status == "clarify":
                wanted = [rule for rule in wanted if rule not in unknown]
            right = {name: _same(got, wanted, name) for name in ("kind", "target", "strength", "scope")}
            if lifting:
                right["strength"] = right["scope"] = True
                exact = {rule.id for rule in got} == {rule.id for rule in standing}
            else:
                exact = set(got) == set(wanted)
            sort = "takes back" if lifting else "only a rule" if line.acts[0] == "rule" else "goal and rule"
            yield sort, exact, right, len(wanted) > 1


def _same(got: Sequence[RouteRule], wanted: Sequence[RouteRule], name: str) -> bool:
    def part(rule: RouteRule) -> str:
        value = getattr(rule, name)
        return value.text if isinstance(value, RouteTarget) else str(value)

    return Counter(map(part, got)) == Counter(map(part, wanted))


def print_sentences(files: Sequence[Path]) -> None:
    rows: dict[str, list[tuple[bool, dict[str, bool]]]] = defaultdict(list)
    for sort, exact, right, several in sentences(files):
        for key in (sort, *(["several rules"] if several else []), "all"):
            rows[key].append((exact, right))
    if not rows:
        print("\nno sentences with rules were given")
        return
    print("\n| sentences | lines | exact | kind | target | strength | scope |\n|---|---:|---:|---:|---:|---:|---:|")
    for sort, of in sorted(rows.items(), key=lambda row: row[0] == "all"):
        parts = [f"{np.mean([right[name] for _, right in of]):.0%}" for name in ("kind", "target", "strength", "scope")]
        print(f"| {sort} | {len(of)} | {np.mean([exact for exact, _ in of]):.1%} | {' | '.join(parts)} |")


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="sentences (default: the held-out ones)")
    parser.add_argument("--drives", type=int, default=240, help="how many (default: %(default)s)")
    parser.add_argument("--homes", type=int, default=6, help="generated homes (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the drives (default: %(default)s)")
    options = parser.parse_args()
    world: Any = plugins.make("worlds", "dollhouse")
    if options.drives:
        drives(
            [*world.homes(), *(str(FIRST_GENERATED + k) for k in range(options.homes))], options.drives, options.seed
        )
    print_sentences(options.files or sorted(HELD_OUT.glob("*.txt")))


if __name__ == "__main__":
    run_script(main)
