"""Live sessions: delays, pairing, questions meanwhile, the same home as offline, kills and memory.

python benchmarks/live.py [--home studio] [--seconds 40] [--kills 20] [--long 10000] [--json live.json]

A robot's walk through a home of the dollhouse, a simulation, is rendered at 15 Hz and 640x480 and played in its own
time. The detector is the embedded one. Seconds depend on the computer and on what else it does.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import struct
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, print_parts, run_script

import cartier
from cartier import Live, plugins
from cartier.contracts import Recording
from cartier.home import Home
from cartier.io.spool import Spool
from cartier.pipeline import map_home
from cartier.recordings.common.poses import interpolated
from cartier.recordings.folder import save
from cartier.sources import open_source
from cartier.specs import detector, detector_for, reasoner
from cartier.types import Camera, Frame, TrueObject
from cartier.types.streams import Stamped
from cartier_dollhouse import Dollhouse
from cartier_dollhouse.recording import STEP_S, DollhouseRecording

HZ = 15.0
COUNTS = struct.Struct("<II")
QUESTIONS = ("where is the sofa?", "let me sit down", "how many chairs are there?", "is there a piano?", "I am thirsty")


class Walk:
    """A walk of the dollhouse's robot, with poses between those that it chose, ``hz`` times a second."""

    notes: Sequence[str]
    truth: Sequence[TrueObject] | None
    camera: Camera

    def __init__(self, home: str, seconds: float, width: int, height: int, hz: float = HZ) -> None:
        from scipy.spatial.transform import Rotation

        world: Dollhouse = plugins.make("worlds", "dollhouse", width=width, height=height)
        coarse: DollhouseRecording = world.explore(home, max_frames=int(seconds / STEP_S) + 1)
        poses = np.array([coarse[i].world_from_camera for i in range(len(coarse))])
        at_s = np.arange(len(poses)) * STEP_S
        turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
        self.times_s = np.arange(0, at_s[-1], 1 / hz)
        fine = interpolated(np.column_stack([at_s, poses[:, :3, 3], turns]), self.times_s).matrices()
        self._frames = DollhouseRecording(world.scene(home), coarse.camera, fine)
        self.name, self.camera, self.truth = self._frames.name, self._frames.camera, self._frames.truth
        self.notes = self._frames.notes

    def __len__(self) -> int:
        return len(self.times_s)

    def __getitem__(self, index: int) -> Frame:
        return replace(self._frames[index], time_s=float(self.times_s[index]))

    def fingerprint(self) -> str:
        return self._frames.fingerprint()


def rss_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20


def told(home: Home) -> list[tuple[Any, ...]]:
    return [(o.id, o.label, o.position, o.box_min, o.box_max, o.confirmed) for o in home.objects]


def detects(recording: Recording) -> Any:
    return detector(detector_for(recording)[0], recording)


def at_real_time(folder: Path, recording: Recording, answers: Any) -> tuple[dict[str, Any], Home]:
    """One session at the recording's own speed, with questions meanwhile."""
    session = Live(open_source(f"bag:{folder}@1"), detects(recording))
    begin, first_s, asked_s = time.monotonic(), None, list[float]()
    session.start()
    number = 0
    while session.running():
        time.sleep(0.2)
        if session.state().as_of_s is None:
            continue
        now = time.monotonic()
        session.ask(QUESTIONS[number % len(QUESTIONS)], answers)
        number += 1
        first_s = time.monotonic() - begin if first_s is None else first_s
        asked_s.append(time.monotonic() - now)
    in_time, begin = session.state(), time.monotonic()
    home, state = session.wait(), session.state()
    asked_s.sort()
    left_out = sum(state.dropped.values())
    return {
        "frames": len(recording), "frames with depth and pose": state.frames_in, "left out, by reason": state.dropped,
        "every one has a reason": state.frames_in + left_out >= len(recording), "looked at in time": in_time.looked,
        "looked at after the end": state.looked - in_time.looked, "which took, s": time.monotonic() - begin,
        "delay p50, s": state.delay_p50_s, "delay p95, s": state.delay_p95_s,
        "first answer after, s": first_s, "ask p50, ms": 1e3 * statistics.median(asked_s),
        "ask p95, ms": 1e3 * asked_s[int(0.95 * len(asked_s))], "floor seen": state.floor_seen,
    }, home  # fmt: skip


def same_objects(live: Home, offline: Home) -> tuple[float, int]:
    """The share of the offline home's confirmed objects within 0.3 m of one of that label, and wrong others."""
    known = [o for o in offline.objects if o.confirmed]
    mine = [o for o in live.objects if o.confirmed]

    def among(obj: Any, others: Sequence[Any]) -> bool:
        near = (np.linalg.norm(np.subtract(obj.position, o.position)) for o in others if o.label == obj.label)
        return min(near, default=np.inf) <= 0.3

    return sum(among(o, mine) for o in known) / len(known), sum(not among(o, offline.objects) for o in mine)


def played_whole(folder: Path, recording: Recording) -> Home:
    """The home of a stream that is kept up with."""
    session = Live(open_source(f"bag:{folder}@max"), detects(recording))
    session.start()
    return session.wait()


def kills(folder: Path, count: int, seed: int = 0) -> dict[str, Any]:
    """Sessions killed at random moments: keyframes that were counted and are not on the disk; every tenth goes on."""
    rng, lost, counted, put_off, whole = random.Random(seed), list[int](), 0, 0, 0
    with tempfile.TemporaryDirectory() as temporary:
        for number in range(count):
            spool = Path(temporary) / f"home{number}.spool"
            told, tell = os.pipe()
            if (child := os.fork()) == 0:
                _counting(folder, spool, tell)
            os.close(tell)
            time.sleep(rng.uniform(0.2, 4.0))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            with os.fdopen(told, "rb") as pipe:
                said = pipe.read()[-COUNTS.size :]
            keyframes, postponed = COUNTS.unpack(said) if len(said) == COUNTS.size else (0, 0)
            kept = Spool(spool).keyframes() if spool.exists() and spool.stat().st_size else ()
            lost.append(max(0, keyframes - len(kept)))
            counted, put_off = counted + keyframes, put_off + postponed
            if number % 10 == 0:
                session = Live(open_source(f"bag:{folder}@max"), detects(plugins.open_recording(folder)), spool=spool)
                session.start()
                whole += bool(session.wait().objects) and session.state().resumed == len(kept)
                session.saved()
    return {
        "kills": count, "keyframes counted": counted, "of them put off": put_off, "lost": sum(lost),
        "gone on": -(-count // 10), "whole": whole,
    }  # fmt: skip


def _counting(folder: Path, spool: Path, tell: int) -> None:
    """Map in a process that is to be killed, and say how many keyframes are counted."""
    session = Live(open_source(f"bag:{folder}@2"), detects(plugins.open_recording(folder)), spool=spool)
    session.start()
    said = (0, 0)
    while True:
        state = session.state()
        if (state.keyframes, state.postponed) != said:
            said = state.keyframes, state.postponed
            os.write(tell, COUNTS.pack(*said))
        time.sleep(0.002)


class Round:
    """Obeys the Source contract: the same frames round and round, with rising stamps."""

    name, waits, recording, notes = "round", True, None, ()

    def __init__(self, recording: Recording, count: int) -> None:
        self._frames, self._count, self.marks = [recording[i] for i in range(len(recording))], count, list[float]()

    def __iter__(self) -> Any:
        for number in range(self._count):
            if number in (self._count // 5, self._count - 1):
                self.marks.append(rss_mb())
            frame = replace(self._frames[number % len(self._frames)], index=number, time_s=number / HZ)
            yield Stamped(frame, round(number / HZ * 1e9))

    def close(self) -> None:
        self._count = 0


def memory(count: int) -> dict[str, Any]:
    """Memory (MB) after a fifth of a long stream and at its end; small pictures, true boxes."""
    walk = Walk("studio", 8, 160, 120)
    source = Round(walk, count)
    session = Live(source, detector("ground_truth", walk))
    session.start()
    session.wait()
    first, last = source.marks
    return {"frames": count, "MB after a fifth": first, "MB at the end": last, "growth": last / first - 1}


def main() -> None:
    options = Parser(__doc__)
    options.add_argument("--home", default="studio", help="a home of the dollhouse")
    options.add_argument("--seconds", type=float, default=40, help="how long the robot drives")
    options.add_argument("--kills", type=int, default=20, help="how many sessions are killed")
    options.add_argument("--long", type=int, default=10_000, help="how many frames the test of memory has")
    options.add_argument("--json", type=Path, help="write the results here")
    given = options.parse_args()
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "walk"
        save(Walk(given.home, given.seconds, 640, 480), folder)
        recording = plugins.open_recording(folder)
        answers = reasoner("embedded")
        answers.select("warm up", cartier.Inventory.of(("chair",)))
        result["real time"], live = at_real_time(folder, recording, answers)
        offline = map_home(recording, detects(recording))
        share, wrong = same_objects(live, offline)
        result["real time"] |= {"objects of the offline map": share, "objects that it has not": wrong}
        result["kept up with"] = {"the home of map": told(played_whole(folder, recording)) == told(offline)}
        result["kill -9"] = kills(folder, given.kills)
    result["memory"] = memory(given.long)
    print_parts(result, 32, given.json)


if __name__ == "__main__":
    run_script(main)
