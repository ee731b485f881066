"""What the doctor finds: every fault put into three recordings, and the time that he takes for 1,000 frames.

python benchmarks/doctor.py [--json FILE]    One thread. For one core: taskset -c 0 python benchmarks/doctor.py
The kitchen and the AI2-THOR frames are read from ../shared and left out, aloud, where that is absent.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "doctor"))

from faulty_recordings import INJECTED, Kept, Thor

from cartier import plugins
from cartier.contracts import Recording
from cartier.doctor import examine, mend
from cartier.errors import InputError
from cartier.recordings.folder import save
from cartier.worlds.dollhouse.recording import DollhouseRecording

SHARED = Path(__file__).resolve().parents[2] / "shared" / "recordings"
LONG = 1000


def homes() -> dict[str, Recording]:
    """The three recordings; the kitchen with its depth moved onto its colour, because as it came it is not sound."""
    found: dict[str, Recording] = {"dollhouse studio": Kept(plugins.make("worlds", "dollhouse").explore("studio"))}
    if SHARED.is_dir():
        raw = plugins.open_recording(SHARED / "kitchen_7scenes")
        report = examine(raw)
        print(f"kitchen as it came: {', '.join(f'{f.fault} ({f.evidence})' for f in report.faults)}")
        found["kitchen"] = Kept(mend(raw, report))
        found["thor_house10"] = Kept(Thor(SHARED / "thor_house10"))
    else:
        print(f"left out: the kitchen and the AI2-THOR frames, because {SHARED} is absent")
    return found


def table(recordings: dict[str, Recording]) -> list[dict[str, str]]:
    """A row for each fault: what was found in each recording, and whether the mended recording is sound."""
    rows = [{"injected": "nothing", "fault": ""} | {n: found(r, r, []) for n, r in recordings.items()}]
    for injected, (fault, inject) in INJECTED.items():
        row = {"injected": injected, "fault": fault}
        rows.append(row | {n: found(r, inject(r), [fault]) for n, r in recordings.items()})
    return rows


def found(sound: Recording, faulty: Recording, wanted: list[str]) -> str:
    report = examine(faulty)
    names = [f.fault for f in report.faults]
    verdict = "right" if names == wanted else f"WRONG: {', '.join(names) or 'nothing'}"
    if not names:
        return verdict
    try:
        mended = mend(faulty, report)
        return (
            f"{verdict}, mended ({len(mended)} of {len(sound)} frames)"
            if examine(mended).ok
            else f"{verdict}, NOT mended"
        )
    except InputError:
        return f"{verdict}, told how"


def long_walk() -> Recording:
    """A thousand frames of a smooth walk through the kitchen of the dollhouse, a twentieth of a step each."""
    from scipy.spatial.transform import Rotation, Slerp

    world = plugins.make("worlds", "dollhouse")
    walk = world.explore("kitchen_diner")
    steps = range(20, 20 + LONG // 20 + 1)
    frames = [walk[i].world_from_camera for i in steps]
    at, there = np.arange(len(frames)), np.linspace(0, len(frames) - 1, LONG)
    poses = np.tile(np.eye(4), (LONG, 1, 1))
    poses[:, :3, :3] = Slerp(at, Rotation.from_matrix([p[:3, :3] for p in frames]))(there).as_matrix()
    poses[:, :3, 3] = np.stack([np.interp(there, at, [p[k, 3] for p in frames]) for k in range(3)], axis=1)
    return DollhouseRecording(world.scene("kitchen_diner"), walk.camera, poses)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--json", type=Path, help="write the table and the time there as well")
    chosen = options.parse_args()
    rows = table(homes())
    columns = list(rows[0])
    print("\n| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
    for row in rows:
        print("| " + " | ".join(row[c] for c in columns) + " |")
    with tempfile.TemporaryDirectory() as folder:
        save(long_walk(), Path(folder) / "long")
        recording = plugins.open_recording(Path(folder) / "long")
        start, start_cpu = time.perf_counter(), time.process_time()
        report = examine(recording)
        seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    size = f"{recording.camera.width}x{recording.camera.height}"
    timing = {
        "frames": len(recording),
        "size": size,
        "seconds": round(seconds, 2),
        "cpu_seconds": round(cpu_seconds, 2),
        "sound": report.ok,
    }
    print(f"\n{json.dumps(timing)}")
    if chosen.json:
        chosen.json.write_text(json.dumps({"table": rows, "timing": timing}, indent=1) + "\n")


if __name__ == "__main__":
    main()
