"""Training of the parser (understanding/parser.npz) on marked requests; needs torch.

    python tools/understanding/train_parser.py [--limit N] [--begin FILE] [--average FILE] [--out FILE] [--hold FILE...]

Prints, for held-out files of marked requests, the share of clauses with the right act, of lines with every span right,
the F1 of spans, the temperature that fits their acts and the calibration error. ``--limit`` takes so many written lines
(for a learning curve). A fixed seed gives the same weights on the same machine.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script
from samples import act_only, hidden_alarms, needs, routed, templated, varied, written

from cartier.understanding.parser import FITTED
from cartier.understanding.parser import Parser as Fitted
from cartier.understanding.tags import ROUTE_NOUNS, ROUTE_WORDS

WRITTEN = Path(__file__).parent / "written"
ROUTE_TAGS = frozenset(f"B-{role}" for role in (*ROUTE_NOUNS, *ROUTE_WORDS))
ROUTES_AGAIN = 3
"""How often more a written line about the way is learnt: they are few, and their words vary most."""


def main() -> None:
    """Train and report."""
    parser = Parser(__doc__)
    parser.add_argument("--limit", type=int, help="how many written lines that say nothing of the way (default: all)")
    parser.add_argument("--templates", type=int, default=6000, help="templated lines, at most as many as are written")
    parser.add_argument("--routes", type=int, default=6000, help="templated lines about the way (default: %(default)s)")
    parser.add_argument("--needs", type=int, default=2500, help="requests that name nothing (default: %(default)s)")
    parser.add_argument("--passes", type=int, default=8, help="passes over all lines (default: %(default)s)")
    parser.add_argument("--begin", type=Path, metavar="FILE", help="go on from these weights (default: from nothing)")
    parser.add_argument("--average", type=Path, metavar="FILE", help="mix with these weights, whose skills stay")
    parser.add_argument("--share", type=float, default=0.5, help="of the weights of --average (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=FITTED, help="where to write the weights")
    parser.add_argument("--hold", type=Path, nargs="*", default=[], help="files that are reported on, not learnt from")
    parser.add_argument("--temperature", type=float, help="of the acts (default: fitted to the held-out files, or 1)")
    parser.add_argument("--folder", type=Path, default=WRITTEN, help="folder of the written lines")
    options = parser.parse_args()
    from parser_training import ready, report, temperature, train  # needs torch

    held, rng = {file.resolve() for file in options.hold}, random.Random(0)
    learnt = written(sorted(f for f in options.folder.glob("*.txt") if f.resolve() not in held))
    about_routes = [s for s in learnt if s.tags is not None and ROUTE_TAGS & set(s.tags)]
    if options.limit:
        others = [s for s in learnt if s not in about_routes]
        learnt = [*about_routes, *rng.sample(others, options.limit)]
    templates = [*templated(min(options.templates, max(len(learnt), 2000)), 1), *routed(options.routes, 2)]
    acts = [*act_only(), *hidden_alarms(rng), *rng.sample(needs(), options.needs)]
    print(f"{len(learnt)} written lines, {len(templates)} templates, {len(acts)} needs and acts", flush=True)
    again = about_routes * ROUTES_AGAIN
    variants = [*learnt, *(varied(s, rng) for s in [*(learnt if not options.limit else []), *again, *templates, *acts])]
    network = train([r for r in map(ready, variants) if r is not None], options.passes, begin=options.begin)
    fit = [r for r in map(ready, written(options.hold)) if r is not None]
    degree = options.temperature or (temperature(network, fit) if fit else 1.0)
    network.save(options.out, degree)
    if options.average:
        average(options.out, options.average, options.share)
    print(f"temperature {degree:.2f}")
    fitted = Fitted(options.out)
    for file in options.hold:
        report(fitted, written([file]), file.stem)
    report(fitted, templated(300, 99), "templates")


def average(file: Path, other: Path, share: float) -> None:
    """Put the means of two networks' weights into the first's file (WiSE-FT, Wortsman et al. 2022)."""
    with np.load(file, allow_pickle=False) as ours, np.load(other, allow_pickle=False) as theirs:
        means = {
            name: ((1 - share) * ours[name].astype(np.float32) + share * theirs[name]).astype(ours[name].dtype)
            for name in ours
        }
    np.savez(file, **means)


if __name__ == "__main__":
    run_script(main)
