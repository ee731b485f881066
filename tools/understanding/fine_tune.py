"""Training of the parser together with its own four layers (parser.npz, parser_layers.npz); needs torch and onnx.

    python tools/understanding/fine_tune.py [--passes N] [--out FOLDER] [--hold FILE...]

Goes on from what ships, on a GPU where there is one. The layers begin as they ship: the need scorer's with low-rank
changes. What was learned is written as changes of rank 64 of the scorer's layers (their singular vectors), in int8.
train_parser.py then trains the parser's top layers alone, on a CPU.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

from cartier.understanding.parser import FITTED


def main() -> None:
    """Train and write."""
    parser = Parser(__doc__)
    parser.add_argument("--passes", type=int, default=14, help="passes over all lines (default: %(default)s)")
    parser.add_argument("--templates", type=int, default=6000, help="templates of each sort (default: %(default)s)")
    parser.add_argument("--lines", type=int, help="so many lines alone, to try it out")
    parser.add_argument("--out", type=Path, default=FITTED.parent, metavar="FOLDER", help="where to write the weights")
    parser.add_argument("--hold", type=Path, nargs="*", default=[], help="files that are not learnt from")
    options = parser.parse_args()
    from fine_tuning import train  # needs torch

    held = {file.resolve() for file in options.hold}
    train(options.passes, options.templates, options.lines, held, options.out)


if __name__ == "__main__":
    run_script(main)
