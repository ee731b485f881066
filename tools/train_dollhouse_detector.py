"""Training of the dollhouse detector that ships: `render` makes shards of homes, `train` learns, `export` writes.

Usage:  python tools/train_dollhouse_detector.py render DATA/train --first 100000 --homes 2000
        python tools/train_dollhouse_detector.py render DATA/held-back --first 95000 --homes 48
        python tools/train_dollhouse_detector.py train DATA RUN --minutes 145
        python tools/train_dollhouse_detector.py closer DATA RUN --minutes 60
        python tools/train_dollhouse_detector.py begin RUN src/cartier_dollhouse/network DATA
        python tools/train_dollhouse_detector.py calibrate RUN DATA/held-back
        python tools/train_dollhouse_detector.py export RUN src/cartier_dollhouse/network
        python tools/calibrate_existence.py src/cartier_dollhouse/network

It sees RGB alone. `closer` trains the second stage, which names each place, over a trained network; `begin` reads
exported ones back, to be trained on. `calibrate` makes scores probabilities, name by name; `export` writes the network,
the words that its features understand, and names.json; tools/calibrate_existence.py sets there how sure a map may be of
what is seen. Both calibrations work on generated homes that were held back. All may be stopped and started again; only
torch and onnx are needed besides cartier. The seven built-in homes are never looked at:
benchmarks/dollhouse_detector.py measures on them.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script


def parser() -> Parser:
    made = Parser(__doc__)
    commands = made.add_subparsers(dest="command", required=True, parser_class=Parser)
    sub = commands.add_parser("render", description="Render generated homes into shards of frames.")
    sub.add_argument("folder", type=Path, help="for the shards")
    sub.add_argument("--first", type=int, required=True, help="number of the first home")
    sub.add_argument("--homes", type=int, required=True, help="how many homes")
    sub.add_argument("--keep", type=int, default=700, help="shards to keep; older ones go (default: %(default)s)")
    sub.add_argument("--close", action="store_true", help="small things from near")
    for command, what in (("train", "Train the network."), ("closer", "Train the second stage over it.")):
        sub = commands.add_parser(command, description=what)
        sub.add_argument("data", type=Path, help="folder with train/, the rendered shards")
        sub.add_argument("run", type=Path, help="folder of the checkpoints")
        sub.add_argument("--minutes", type=float, default=65, help="of training in all (default: %(default)s)")
        sub.add_argument("--seed", type=int, default=0, help="of weights and batches (default: %(default)s)")
        sub.add_argument("--threads", type=int, default=1, help="of torch (default: %(default)s)")
    sub = commands.add_parser("begin", description="Make checkpoints from an exported network.")
    sub.add_argument("run", type=Path, help="folder of the checkpoints")
    sub.add_argument("folder", type=Path, help="of an exported network")
    sub.add_argument("data", type=Path, help="folder with train/, the rendered shards")
    sub = commands.add_parser("export", description="Write the network, its words and names.json.")
    sub.add_argument("run", type=Path, help="folder of the checkpoints")
    sub.add_argument("folder", type=Path, help="to write to")
    sub = commands.add_parser("calibrate", description="Make scores n_observable, name by name.")
    sub.add_argument("run", type=Path, help="folder of the checkpoints")
    sub.add_argument("shards", type=Path, help="rendered ones that were held back")
    sub.add_argument("--max-frames", type=int, default=130, help="of each walk (default: %(default)s)")
    return made


def main() -> None:
    asked = parser().parse_args()
    if asked.command == "render":
        from _detector_views import render_into

        render_into(asked.folder, asked.first, asked.homes, asked.keep, asked.close)
        return
    import _detector_training as training
    import torch

    torch.set_num_threads(getattr(asked, "threads", 1))
    if asked.command == "closer":
        training.closer_run(asked.data, asked.run, asked.minutes, asked.seed)
    elif asked.command == "begin":
        training.begin(asked.run, asked.folder, asked.data)
    elif asked.command == "export":
        training.export_run(asked.run, asked.folder)
    elif asked.command == "calibrate":
        training.calibrate_run(asked.run, asked.shards, asked.max_frames)
    else:
        training.train(asked.data, asked.run, asked.minutes, asked.seed)


if __name__ == "__main__":
    run_script(main)
