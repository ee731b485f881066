"""Benchmark of `cartier doctor`: false alarms on sound recordings, injected faults found and repaired, and time.

python benchmarks/doctor.py [--quick] [--json FILE]    Two processes, one thread each; about a quarter of an hour.
Sound: all seven built-in homes and twenty generated ones, exact and with sensor noise, cameras from 0.2 to 1.6 m,
single walks and two walks joined. Faults: each once in each of three recordings at full
size, and in turn in the single walks.
The kitchen and the AI2-THOR frames are read from ../shared; a line says so if they are absent.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import json
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "doctor"))

from faulty_recordings import INJECTED, LEVEL_BELOW_M, Kept, Thor, Walk, joined

from cartier import plugins
from cartier.contracts import Recording
from cartier.doctor import examine, repair
from cartier.errors import InputError
from cartier.recordings.folder import save
from cartier_dollhouse.recording import DollhouseRecording

SHARED = Path(__file__).resolve().parents[2] / "shared" / "recordings"
LONG = 1000
HOMES = (*plugins.make("worlds", "dollhouse").homes(), *map(str, range(101, 121)))
EYES_M = (0.2, 0.3, 0.6, 1.0, 1.5, 1.6)
QUICK_HOMES, QUICK_EYES_M = ("studio", "104"), (0.3, 1.5)
UNSEEN_LOW = "unity"  # not seen by a low camera that looks straight ahead: mirrored looks like upside down

Row = dict[str, Any]


def tried(sound: Recording, injected: str) -> Row:
    """The result for one injected fault (or ``nothing``): faults found, and whether the repaired recording is sound."""
    fault, inject = INJECTED.get(injected, ("", lambda recording: recording))
    faulty = inject(sound)
    report = examine(faulty)
    names = [f.fault for f in report.faults]
    row: Row = {"injected": injected, "right": names == ([fault] if fault else []), "found": names, "repaired": None}
    if not names:
        return row | {"right": row["right"] and (bool(fault) or report.ok), "notes": list(report.notes[1:])}
    try:
        repaired = repair(faulty, report)
    except InputError:
        return row
    again = examine(repaired)
    return row | {"repaired": again.ok, "frames": len(repaired), "of": len(sound)}


def words(row: Row) -> str:
    verdict = "right" if row["right"] else f"WRONG: {', '.join(row['found'] or row['notes']) or 'nothing'}"
    if not row["found"]:
        return verdict
    if row["repaired"] is None:
        return f"{verdict}, not repairable"
    return f"{verdict}, {'repaired' if row['repaired'] else 'NOT repaired'} ({row['frames']} of {row['of']} frames)"


def home_rows(task: tuple[int, str, tuple[float, ...]]) -> list[Row]:
    """The results in one home: sound walks by height and sensor, alone and joined, and one fault after the other."""
    number, home, eyes_m = task
    walks = Walk(home, 0), Walk(home, 1)
    rows: list[Row] = []
    turn = number * len(eyes_m) * 2  # so that homes, heights and faults mix
    for eye_m in eyes_m:
        injected = [name for name in INJECTED if eye_m >= LEVEL_BELOW_M or name != UNSEEN_LOW]
        for sensor in (False, True):
            first, second = (walk.seen(eye_m, sensor) for walk in walks)
            here = {"home": home, "eye_m": eye_m, "sensor": sensor}
            rows.append(here | {"joined": False} | tried(first, "nothing"))
            rows.append(here | {"joined": True} | tried(joined(first, second), "nothing"))
            rows.append(here | {"joined": False} | tried(first, injected[turn % len(injected)]))
            turn += 1
    return rows


def false_alarms(homes: tuple[str, ...], eyes_m: tuple[float, ...]) -> list[Row]:
    """Rows of all homes, two at a time; each failure is printed as soon as it is known."""
    rows: list[Row] = []
    start = time.perf_counter()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for some in pool.imap_unordered(home_rows, [(n, home, eyes_m) for n, home in enumerate(homes)]):
            rows += some
            print(f"{some[0]['home']}: {len(some)} tried, {time.perf_counter() - start:.0f} s", flush=True)
            for row in some:
                if not row["right"] or row.get("notes") or row["repaired"] is False:
                    where = f"{row['eye_m']:g} m{' sensor' * row['sensor']}{' joined' * row['joined']}"
                    print(f"    {where}, {row['injected']}: {words(row)} {'; '.join(row.get('notes', []))}", flush=True)
    return rows


def print_false_alarms(rows: list[Row], eyes_m: tuple[float, ...]) -> None:
    sound = [row for row in rows if row["injected"] == "nothing"]
    kinds = [(sensor, both) for sensor in (False, True) for both in (False, True)]
    print("\nFalse alarms over sound recordings\n")
    heads = [f"{'sensor' if sensor else 'exact'}, {'joined' if both else 'one walk'}" for sensor, both in kinds]
    print("| camera at | " + " | ".join(heads) + " |\n|" + "---|" * 5)
    for eye_m in eyes_m:
        some = [[r for r in sound if (r["eye_m"], r["sensor"], r["joined"]) == (eye_m, *kind)] for kind in kinds]
        print(f"| {eye_m:g} m | " + " | ".join(f"{sum(not r['right'] for r in c)} of {len(c)}" for c in some) + " |")
    print(
        "\nFaults put into single walks\n\n| injected | tried | named, and nothing else | repaired |\n|---|---|---|---|"
    )
    for injected in INJECTED:
        some_rows = [row for row in rows if row["injected"] == injected]
        if not some_rows:
            continue
        repairable = [row for row in some_rows if row["repaired"] is not None]
        repaired = f"{sum(row['repaired'] for row in repairable)} of {len(repairable)}" if repairable else "none can be"
        print(f"| {injected} | {len(some_rows)} | {sum(row['right'] for row in some_rows)} | {repaired} |")


def recordings() -> dict[str, Recording]:
    """Three at full size; the kitchen with its depth moved onto its colour, because as it came it is not sound."""
    found: dict[str, Recording] = {"dollhouse studio": Kept(plugins.make("worlds", "dollhouse").explore("studio"))}
    if SHARED.is_dir():
        raw = plugins.open_recording(SHARED / "kitchen_7scenes")
        report = examine(raw)
        print(f"kitchen as it came: {'; '.join([f.evidence for f in report.faults] + list(report.notes[1:]))}")
        found["kitchen"] = Kept(repair(raw, report))
        found["thor_house10"] = Kept(Thor(SHARED / "thor_house10"))
    else:
        print(f"left out: the kitchen and the AI2-THOR frames, for {SHARED} is absent")
    return found


def table(them: dict[str, Recording]) -> list[dict[str, str]]:
    """A row for each fault: what was found in each recording, and whether the repaired recording is sound."""
    rows = []
    for injected, (fault, _) in {"nothing": ("", None), **INJECTED}.items():
        found = {name: words(tried(recording, injected)) for name, recording in them.items()}
        rows.append({"injected": injected, "fault": fault} | found)
    return rows


def long_walk() -> Recording:
    """A thousand frames of a smooth walk through the kitchen of the dollhouse, a twentieth of a step each."""
    from scipy.spatial.transform import Rotation, Slerp

    world: Any = plugins.make("worlds", "dollhouse")
    walk = world.explore("kitchen_diner")
    steps = range(20, 20 + LONG // 20 + 1)
    frames = [walk[i].world_from_camera for i in steps]
    at, there = np.arange(len(frames)), np.linspace(0, len(frames) - 1, LONG)
    poses = np.tile(np.eye(4), (LONG, 1, 1))
    poses[:, :3, :3] = Slerp(at, Rotation.from_matrix([p[:3, :3] for p in frames]))(there).as_matrix()
    poses[:, :3, 3] = np.stack([np.interp(there, at, [p[k, 3] for p in frames]) for k in range(3)], axis=1)
    return DollhouseRecording(world.scene("kitchen_diner"), walk.camera, poses)


def timing() -> Row:
    with tempfile.TemporaryDirectory() as folder:
        save(long_walk(), Path(folder) / "long")
        recording = plugins.open_recording(Path(folder) / "long")
        start, start_cpu = time.perf_counter(), time.process_time()
        report = examine(recording)
        seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - start_cpu
    return {
        "frames": len(recording),
        "size": f"{recording.camera.width}x{recording.camera.height}",
        "seconds": round(seconds, 2),
        "cpu_seconds": round(cpu_seconds, 2),
        "sound": report.ok,
    }


def main() -> None:
    options = Parser(__doc__)
    options.add_argument("--quick", action="store_true", help="two homes, two heights, and no full-size table")
    options.add_argument("--json", type=Path, help="write the tables and the time to this file, too")
    chosen = options.parse_args()
    homes, eyes_m = (QUICK_HOMES, QUICK_EYES_M) if chosen.quick else (HOMES, EYES_M)
    results: dict[str, Any] = {"false_alarms": false_alarms(homes, eyes_m)}
    print_false_alarms(results["false_alarms"], eyes_m)
    if not chosen.quick:
        results["table"] = table(recordings())
        columns = list(results["table"][0])
        print("\n| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
        for row in results["table"]:
            print("| " + " | ".join(row[c] for c in columns) + " |")
        results["timing"] = timing()
        print(f"\n{json.dumps(results['timing'])}")
    if chosen.json:
        chosen.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    run_script(main)
