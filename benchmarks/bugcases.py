"""The small inputs after public bug reports on clocks, lenses, names and detectors' files, against their right values.

python benchmarks/bugcases.py FOLDER      a folder of cases, each with a README.md and its input
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from command_line import Parser, run_script

from cartier import plugins
from cartier.errors import CartierError
from cartier.types import Camera, Frame


def opened(case: Path) -> list[Frame]:
    recording = plugins.open_recording(case / "input")
    return [recording[i] for i in range(len(recording))]


def corrected(case: Path) -> bool:
    frames, first = opened(case), min((case / "input/keyframes/corrected_cameras").iterdir())
    x_m = json.loads(first.read_text())["t_03"]
    return (
        len(frames) == 6
        and frames[0].camera == Camera(80, 60, 60, 60, 39.5, 29.5)
        and frames[0].world_from_camera[0, 3] == x_m
    )


def clock(case: Path) -> bool:
    truth = json.loads((case / "truth.json").read_text())["world_from_camera_by_image_in_the_order_of_recording"]
    notes = plugins.open_recording(case / "input").notes
    off_m = [np.abs(f.world_from_camera - true).max() for f, true in zip(opened(case), truth[:3], strict=True)]
    return max(off_m) < 0.01 and any("time goes back by 0.3 s after 0.2 s" in note for note in notes)


def refused(case: Path) -> bool:
    try:
        return not opened(case)
    except CartierError as error:
        return "transforms_train.json" in str(error) and "no camera poses" not in str(error)


def own_names(case: Path) -> bool:
    black, camera = np.zeros((640, 640, 3), np.uint8), Camera(640, 640, 500, 500, 319.5, 319.5)
    detector = plugins.make("detectors", "onnx", model=case / "model.onnx")
    return detector.detect(Frame(0, 0.0, black, None, np.eye(4), camera)).labels == ("part 56",)


CASES: dict[str, Callable[[Path], bool]] = {
    "B01": corrected,
    "B03": lambda case: opened(case)[0].camera == Camera(40, 30, 60, 60, 19.5, 14.5),
    "B04": clock,
    "B05": lambda case: len(opened(case)) == 6,
    "B06": lambda case: len(opened(case)) == 6 and opened(case)[0].depth_m is not None,
    "B07": refused,
    "B18": own_names,
}


def main() -> int:
    parser = Parser(__doc__)
    parser.add_argument("folder", type=Path, help="the folder of the cases")
    cases = [case for case in sorted(parser.parse_args().folder.iterdir()) if case.name[:3] in CASES]
    right = {case.name: CASES[case.name[:3]](case) for case in cases}
    print("\n".join(f"{name:45} {'right' if is_right else 'WRONG'}" for name, is_right in right.items()))
    return int(not all(right.values()))


if __name__ == "__main__":
    run_script(main)
