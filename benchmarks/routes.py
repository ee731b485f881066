"""Benchmark of routes: drives under rules in true homes, sentences against the typed rules that they mean, floor kinds.

python benchmarks/routes.py [--drives 240] [--seed 0] [--floors HOME …] [files …]
Drives and sentences are those of ``cartier bench --suite routes`` (evaluation/route_drives.py, route_sentences.py);
only totals of the held-out sentences may be looked at. ``--floors`` walks through homes of the dollhouse with rugs, and
compares the kind of floor in each cell of the map with the truth, with true labels and from pixels; thresholds were set
on the studio, 77101 and 77102, which therefore tell nothing.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import sys
import tempfile
from pathlib import Path

from command_line import Parser, run_script

sys.path.append(str(Path(__file__).parents[1] / "tools"))
from fit_floor_kinds import measure

from cartier.evaluation.route_run import DRIVES, report, run
from cartier.reasoners import embedded

FLOOR_HOMES = ("77201", "77202", "77203", "77204")
"""Of these no weight and no threshold knows anything."""


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="sentences (default: the held-out ones)")
    parser.add_argument("--drives", type=int, default=DRIVES, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the drives (default: %(default)s)")
    parser.add_argument("--floors", nargs="*", metavar="HOME", help="kinds of floor, in these homes or four others")
    parser.add_argument("--frames", type=int, default=400, help="of each walk at most (default: %(default)s)")
    options = parser.parse_args()
    if options.floors is not None:
        measure(options.floors or FLOOR_HOMES, options.frames, sensor="exact")
        return
    with tempfile.TemporaryDirectory() as folder:
        print(report(run(Path(folder), (), options.files, embedded.make(), options.seed, options.drives)))


if __name__ == "__main__":
    run_script(main)
