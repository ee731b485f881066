"""Training of the parser (understanding/parser.npz) on marked requests; needs torch.

    python tools/understanding/train_parser.py [--limit N] [--out FILE] [--hold FILE...] [--temperature T]

Prints, for held-out files of marked requests, the share of clauses with the right act, of lines with every span right,
the F1 of spans, the temperature that fits their acts and the calibration error. ``--limit`` takes so many written lines
(for a learning curve). A fixed seed gives the same weights on the same machine.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script
from samples import act_only, needs, templated, varied, written

from cartier.understanding.parser import FITTED
from cartier.understanding.parser import Parser as Fitted

WRITTEN = Path(__file__).parent / "written"


def main() -> None:
    """Train and report."""
    parser = Parser(__doc__)
    parser.add_argument("--limit", type=int, help="how many written lines to learn from (default: all)")
    parser.add_argument("--templates", type=int, default=6000, help="templated lines, at most as many as are written")
    parser.add_argument("--needs", type=int, default=2500, help="requests that name nothing (default: %(default)s)")
    parser.add_argument("--passes", type=int, default=8, help="passes over all lines (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=FITTED, help="where to write the weights")
    parser.add_argument("--hold", type=Path, nargs="*", default=[], help="files that are reported on, not learnt from")
    parser.add_argument("--temperature", type=float, help="of the acts (default: fitted to the held-out files, or 1)")
    parser.add_argument("--folder", type=Path, default=WRITTEN, help="folder of the written lines")
    options = parser.parse_args()
    from parser_training import ready, report, temperature, train  # needs torch

    held, rng = {file.resolve() for file in options.hold}, random.Random(0)
    learnt = written(sorted(f for f in options.folder.glob("*.txt") if f.resolve() not in held))
    if options.limit:
        learnt = rng.sample(learnt, options.limit)
    templates = templated(min(options.templates, max(len(learnt), 2000)), 1)
    acts = [*act_only(), *rng.sample(needs(), options.needs)]
    print(f"{len(learnt)} written lines, {len(templates)} templates, {len(acts)} needs and acts", flush=True)
    variants = [*learnt, *(varied(s, rng) for s in learnt), *(varied(s, rng) for s in [*templates, *acts])]
    network = train([r for r in map(ready, variants) if r is not None], options.passes)
    fit = [r for r in map(ready, written(options.hold)) if r is not None]
    degree = options.temperature or (temperature(network, fit) if fit else 1.0)
    network.save(options.out, degree)
    print(f"temperature {degree:.2f}")
    fitted = Fitted(options.out)
    for file in options.hold:
        report(fitted, written([file]), file.stem)
    report(fitted, templated(300, 99), "templates")


if __name__ == "__main__":
    run_script(main)
