"""Benchmark of routes: drives under rules in true homes, sentences against the typed rules that they mean, floor kinds.

python benchmarks/routes.py [--drives 240] [--seed 0] [--floors HOME … | --nav2 | --mapped HOME …] [files …]
Drives and sentences are those of ``cartier bench routes`` (cartier_bench/route_drives.py, route_sentences.py);
only totals of the held-out sentences may be looked at. ``--floors`` walks through homes of the dollhouse with rugs, and
compares the kind of floor in each cell of the map with the truth, with true labels and from pixels; thresholds were set
on the studio, 77101 and 77102, which therefore tell nothing. ``--nav2`` exports true homes for Nav2 under random
standing rules, starts on each folder as Nav2 would (tests/nav2_reader.py), and compares the shortest routes by the
exported costs, by Nav2's scorers and on the grid, between all pairs of nodes. ``--mapped`` drives under orders about
kinds of floor on maps from pixels (boxes are ground truth), and counts who crosses what is forbidden.
"""

from __future__ import annotations

import os
import random

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from command_line import Parser, run_script

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("tools", "tests")]
import numpy as np
from fit_floor_kinds import measure

import nav2_reader
from cartier import plugins
from cartier.errors import InputError
from cartier.navigation.layers import SOFT_AVOID, RouteMap, ruled_area
from cartier.navigation.planning import traversable
from cartier.navigation.routes import plan_route
from cartier.navigation.search import cheapest
from cartier.pipeline import map_home
from cartier.reasoners import embedded
from cartier.types import Place, RobotModel
from cartier.types.route_rules import FLOOR_KINDS, RouteRule
from cartier_bench import suite
from cartier_bench.route_drives import EDGE_M, dense
from cartier_bench.route_homes import Home, home_names, off_m, random_rules, true_home
from cartier_bench.route_run import DRIVES, RouteSettings, routes
from cartier_bench.route_sentences import sentence_lines
from cartier_dollhouse.floors import RUGS
from cartier_ros import nav2

FLOOR_HOMES = ("77201", "77202", "77203", "77204")
"""Of these no weight and no threshold knows anything."""
SAME_M = 2e-3  # lengths are written to 0.1 mm, and a route has up to twenty edges


def nav2_folders(seed: int) -> None:
    """Export every home without rules and under three sets of them, and read the folders as Nav2 does."""
    rng, totals = random.Random(seed), dict.fromkeys(("folders", "start", "nodes", "apart", "pairs", "agree"), 0)
    longer = list[float]()
    for name in home_names():
        home = true_home(name)
        for rules in ([], *(random_rules(home, rng) for _ in range(3))):
            standing = [replace(rule, scope="standing") for rule in rules]
            with tempfile.TemporaryDirectory() as folder:
                for file, data in nav2.files(home.site, standing, home.scene.start_xy).items():
                    Path(folder, file).write_bytes(data)
                named = Path(folder, "graph.geojson").read_text().count('"name": ') - 1  # and the graph's own
                totals["folders"] += 1
                try:
                    graph, _, params = nav2_reader.start(Path(folder))
                except nav2_reader.Refused as error:
                    print(f"{name}: {error}")
                    continue
            totals["start"] += 1
            totals["nodes"] += len(graph[0])
            totals["apart"] += len(graph[0].keys() - {edge["startid"] for edge in graph[1]})
            longer += longer_than_grid(home.site, standing, graph, named)
            for begin in graph[0]:
                ours = nav2_reader.routes_from(graph, begin, lambda edge: float(edge["cost"]))
                theirs = nav2_reader.routes_from(graph, begin, nav2_reader.nav2_cost(graph, params["route_server"]))
                totals["pairs"] += len(graph[0]) - 1
                totals["agree"] += sum(
                    end in ours and end in theirs and abs(ours[end][0] - theirs[end][0]) < SAME_M
                    for end in graph[0] if end != begin
                )  # fmt: skip
    print(
        f"{totals['folders']} exported folders of {len(home_names())} homes (ground truth); Nav2's reader starts on "
        f"{totals['start']}; nodes {totals['nodes']}, without an edge {totals['apart']}; pairs of nodes "
        f"{totals['pairs']}, same shortest route {totals['agree']}"
    )
    print(
        f"{len(longer)} routes by the exported costs against the cheapest path on the grid: "
        f"{statistics.median(longer) - 1:+.1%} at the median, {max(longer) - 1:+.1%} at most"
    )


def longer_than_grid(site: RouteMap, rules: Sequence[RouteRule], graph: nav2_reader.Graph, named: int) -> list[float]:
    """What routes from the first node to rooms and doors cost, as shares of the cheapest paths on the grid."""
    area = nav2.areas_of(rules, site).cost
    fits = traversable(site.grid, RobotModel.radius_m) & (area < nav2.FORBIDDEN)
    cost = np.where(fits, 1 + SOFT_AVOID * (area > 0), np.inf)
    begin, *ends = (tuple(site.grid.cell(np.array(xy))) for xy in list(graph[0].values())[:named])
    routes, found = nav2_reader.routes_from(graph, 0, lambda edge: float(edge["cost"])), []
    for number, end in enumerate(ends, 1):
        goal = np.zeros(cost.shape, bool)
        goal[end] = True
        path = cheapest(cost, begin, [goal])
        assert path is not None
        found.append(routes[number][0] / (path.cost * site.grid.resolution_m))
    return found


def mapped_drives(homes: Sequence[str], drives: int, frames: int, seed: int) -> None:
    """Drive on the maps of homes with rugs, each time never over one kind of floor; judge by the true floor."""
    rng, told = random.Random(seed), Counter[str]()
    world = plugins.make("worlds", "dollhouse", width=320, height=240)
    for name in homes:
        true = true_home(f"{name}+{RUGS}")
        walk = world.explore(f"{name}+{RUGS}", max_frames=frames)
        boxes = plugins.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse")
        home = map_home(walk, boxes)
        site = home.route_map
        assert site is not None and site.grid.floor_kinds is not None
        fits = np.argwhere(traversable(site.grid, RobotModel.radius_m))
        kinds = sorted({room.floor.partition(":")[0] for room in true.scene.rooms} & {*FLOOR_KINDS} | {"rug"})
        things = [obj for obj in home.objects if obj.confirmed]
        own = Counter[str]()
        while own.total() < drives // len(homes):
            rule, obj = RouteRule.parse(f"avoid floor:{rng.choice(kinds)} hard drive"), rng.choice(things)
            start = site.grid.centre(fits[rng.randrange(len(fits))])
            place = Place(obj.label, obj.position, 1.0, -1, box_min=obj.box_min, box_max=obj.box_max, object_id=obj.id)
            own[outcome(true, site, place, start, rule)] += 1
            own.pop("no way without it", None)
        print(f"{name}: {len(walk)} frames, {(site.grid.floor_kinds[tuple(fits.T)] == 0).mean():.0%} of the floor "
              f"unknown: {dict(sorted(own.items()))}", flush=True)  # fmt: skip
        told += own
    print(f"{told.total()} drives never over a kind of floor, on mapped homes: {dict(sorted(told.items()))}")


def outcome(true: Home, site: RouteMap, place: Place, start: np.ndarray, rule: RouteRule) -> str:
    """What came of a drive under an order; what lies in the forbidden area at its ends does not count."""
    if plan_route(site, place, start.tolist(), RobotModel()).goal is None:
        return "no way without it"
    planned = plan_route(site, place, start.tolist(), RobotModel(), [rule])
    if planned.goal is None:
        return "asked"
    try:
        ruled_area(rule, site)
    except InputError:
        return "said that the map shows none"
    inside = off_m(rule, true)(dense(planned.goal.path)) < -EDGE_M
    ends = np.flatnonzero(~inside)
    crossed = len(ends) and inside[ends[0] : ends[-1]].any()
    return f"{'crossed' if crossed else 'obeyed'}{', said that it may cross' if planned.doubts else ''}"


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="sentences (default: the held-out ones)")
    parser.add_argument("--drives", type=int, default=DRIVES, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the drives (default: %(default)s)")
    parser.add_argument("--floors", nargs="*", metavar="HOME", help="kinds of floor, in these homes or four others")
    parser.add_argument("--frames", type=int, default=400, help="of each walk at most (default: %(default)s)")
    parser.add_argument("--nav2", action="store_true", help="exported folders, read as Nav2 does")
    parser.add_argument("--mapped", nargs="*", metavar="HOME", help="drives on maps of these homes or four others")
    options = parser.parse_args()
    if options.mapped is not None:
        mapped_drives(options.mapped or FLOOR_HOMES, options.drives, options.frames, options.seed)
        return
    if options.nav2:
        nav2_folders(options.seed)
        return
    if options.floors is not None:
        measure(options.floors or FLOOR_HOMES, options.frames, sensor="exact")
        return
    with tempfile.TemporaryDirectory() as folder:
        settings = RouteSettings(home_names(), options.seed, options.drives)
        suite.run(Path(folder), routes(settings, sentence_lines(options.files), embedded.make()))
        print(Path(folder, "report.md").read_text("utf-8"))


if __name__ == "__main__":
    run_script(main)
