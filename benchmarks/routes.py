"""Benchmark of routes: drives under rules in true homes, sentences against the typed rules that they mean, floor kinds.

python benchmarks/routes.py [--drives 240] [--seed 0] [--floors HOME … | --nav2 | --mapped] [files …]
Drives and sentences are those of ``cartier bench --suite routes`` (evaluation/route_drives.py, route_sentences.py);
only totals of the held-out sentences may be looked at. ``--floors`` walks through homes of the dollhouse with rugs, and
compares the kind of floor in each cell of the map with the truth, with true labels and from pixels; thresholds were set
on the studio, 77101 and 77102, which therefore tell nothing. ``--nav2`` exports true homes for Nav2 under random
standing rules, starts on each folder as Nav2 would (tests/nav2_reader.py), and compares the shortest routes by the
exported costs, by Nav2's scorers and on the grid, between all pairs of nodes.
"""

from __future__ import annotations

import os
import random

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from command_line import Parser, run_script

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("tools", "tests")]
import numpy as np
from fit_floor_kinds import measure

import nav2_reader
from cartier.evaluation.route_homes import home_names, random_rules, true_home
from cartier.evaluation.route_run import DRIVES, report, run
from cartier.exports import nav2
from cartier.navigation.layers import SOFT_AVOID, RouteMap
from cartier.navigation.planning import traversable
from cartier.navigation.search import cheapest
from cartier.reasoners import embedded
from cartier.route_rules import RouteRule
from cartier.types import RobotModel

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


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="sentences (default: the held-out ones)")
    parser.add_argument("--drives", type=int, default=DRIVES, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the drives (default: %(default)s)")
    parser.add_argument("--floors", nargs="*", metavar="HOME", help="kinds of floor, in these homes or four others")
    parser.add_argument("--frames", type=int, default=400, help="of each walk at most (default: %(default)s)")
    parser.add_argument("--nav2", action="store_true", help="exported folders, read as Nav2 does")
    options = parser.parse_args()
    if options.nav2:
        nav2_folders(options.seed)
        return
    if options.floors is not None:
        measure(options.floors or FLOOR_HOMES, options.frames, sensor="exact")
        return
    with tempfile.TemporaryDirectory() as folder:
        print(report(run(Path(folder), (), options.files, embedded.make(), options.seed, options.drives)))


if __name__ == "__main__":
    run_script(main)
