"""Training of the embedded reasoner's scorer: ``python tools/train_scorer.py REFERENCE MINILM``.

REFERENCE holds thor_object_types.json and lvis_v1_categories.json, from which lists of objects are drawn; MINILM is the
folder with model.safetensors of all-MiniLM-L6-v2 (see build_text_encoder.py). Without it nothing is trained: what ships
is put to the test anew. Needs torch, onnx, safetensors.

Whole styles are held back: what ships is fitted on some of them to know when nothing serves (fit_decision.py), and put
to the others, which no training saw, for the table of docs/embedded.md.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("reference", type=Path, help="folder with thor_object_types.json and lvis_v1_categories.json")
    parser.add_argument(
        "minilm", type=Path, nargs="?", help="folder with model.safetensors; without it nothing is trained"
    )
    parser.add_argument("--outcomes", type=Path, metavar="FILE", help="keep every outcome of the table there")
    options = parser.parse_args()
    from _scorer_training import train_and_report

    train_and_report(options.reference, options.minilm, options.outcomes)


if __name__ == "__main__":
    run_script(main)
