"""Interruption test of every writing command, killed or with a full disk at each event and byte: old or new is left.

    python benchmarks/interruptions.py             all commands that write, at all events and bytes
    python benchmarks/interruptions.py map --every 5

Full at a byte: no file may grow beyond it, and of a write that would, the system takes a part, as on a disk that
fills up. What adds more than 400 bytes to a file is cut at 400 places. What was said to be done must be there.

After each interruption what is there is read (the old or the new content, or nothing where there was nothing), the
command is run again, and the result must be what an undisturbed run gives, with nothing left beside it.
"""

from __future__ import annotations

import collections
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import numpy as np
from command_line import Parser, run_script

import cartier
import cartier.cli
from cartier.errors import CartierError
from cartier.recordings import folder as own_format
from cartier.types import Frame
from interrupted import KILLED, content, run
from synthetic import THINGS, RoomRecording, walk


@dataclass(frozen=True)
class Case:
    """A command that writes ``result`` below a work folder, what is there before, and how to read what is there
    after."""

    arguments: Callable[[Path], list[object]]
    before: Callable[[Path], None]
    result: Callable[[Path], Any]
    exact: bool = True  # whether two runs give the same bytes
    again: bool = True  # whether a second run gives what one gives


def cases(made: Path) -> dict[str, Case]:
    """``made`` holds two recordings, a home, and a faulty recording."""

    def home(work: Path) -> Any:
        return _read(lambda: cartier.Home.load(work / "h")) if (work / "h").exists() else None

    def recording(work: Path) -> Any:
        return _read(lambda: cartier.open_recording(work / "h").fingerprint()) if (work / "h").exists() else None

    def rows(work: Path) -> Any:
        kept = work / "h" / "results.jsonl"
        return None if not (work / "h" / "report.md").is_file() else [json.loads(r)["object"] for r in kept.open()]

    def nothing(work: Path) -> None: ...

    def told(work: Path) -> Any:
        home = cartier.Home.load(work / "h")
        answers = work / "h" / "answers.jsonl"
        lines = answers.read_text().splitlines() if answers.exists() else []
        assert home.corrected is not None
        return [(obj.id, obj.names) for obj in home.objects], len(home.rules), len(home.corrected.log), len(lines)

    def with_home(work: Path) -> None:
        shutil.copytree(made / "home", work / "h")

    detector = ["--detector", made / "truth.py"]
    maps = ["map", made / "second", *detector, "-o"]
    bench = bench_of(made)
    return {
        "map": Case(lambda w: ["map", made / "first", *detector, "-o", w / "h"], nothing, home),
        "map-over": Case(lambda w: [*maps, w / "h"], with_home, home),
        "append": Case(lambda w: [*maps, w / "h", "--append"], with_home, home),
        "convert": Case(lambda w: ["convert", made / "first", "-o", w / "h"], nothing, recording),
        "record": Case(lambda w: ["record", "dollhouse:studio", "-o", w / "h"], nothing, recording),
        "doctor": Case(lambda w: ["doctor", made / "faulty", "--fix", "-o", w / "h"], nothing, recording),
        **{
            name: Case(lambda w, of=words: [of[0], w / "h", *of[1:]], with_home, told, exact=False, again=False)
            for name, words in {
                "forget": ("forget", "0"), "name": ("name", "0", "the throne"), "undo": ("undo",),
                "rule": ("ask", "never drive past the bed", "--reasoner", "embedded"),
                "answer": ("ask", "go to the bed", "--reasoner", "embedded"),
            }.items()
        },
        "bench": Case(lambda w: [*bench, "--queries", made / "ask.jsonl", "-o", w / "h"], nothing, rows, exact=False),
    }  # fmt: skip


@dataclass
class Inverted(RoomRecording):
    """Frames of a walk with camera_from_world for their poses: a fault that the doctor knows how to mend."""

    def __getitem__(self, index: int) -> Frame:
        frame = super().__getitem__(index)
        return replace(frame, world_from_camera=np.linalg.inv(frame.world_from_camera))


def bench_of(made: Path) -> list[str | Path]:
    """A bench of one home by one index."""
    words = "bench paper --homes studio --methods object_depth --detector ground_truth --maps"
    return [*words.split(), made / "maps"]


def prepare(made: Path) -> None:
    whole = walk()
    for name, poses in (("first", whole.poses[:8]), ("second", whole.poses[8:])):
        own_format.save(RoomRecording(poses, THINGS, name=name), made / name)
    (made / "truth.py").write_text(
        '"""True boxes."""\nfrom synthetic import THINGS, TrueBoxes\n\ndef make():\n    return TrueBoxes(THINGS)\n'
    )
    own_format.save(Inverted(whole.poses, THINGS), made / "faulty")
    asked = {"id": "a", "type": "explicit", "target": "bed", "accept": ["bed"], "text": "go to the bed"}
    (made / "ask.jsonl").write_text(json.dumps(asked) + "\n")
    assert run(["map", made / "first", "--detector", made / "truth.py", "-o", made / "home"], made)[0] == 0
    assert run(["name", made / "home", "1", "mine"], made)[0] == 0
    assert run([*bench_of(made), "--queries", made / "ask.jsonl", "-o", made / "warm"], made)[0] == 0


def _read(open_it: Callable[[], Any]) -> Any:
    """What a reader gets: a home's answer to everything, or the one line of a refusal."""
    try:
        read = open_it()
    except CartierError as error:
        return f"refused: {error}"
    if isinstance(read, cartier.Home):
        places = {(name, obj): index.locate(obj) for name, index in read.indexes.items() for obj in read.names}
        return (read.id, read.objects, places, dict(read.photos), dict(read.growth))
    return read


KILL, ERROR, FULL = "kill", "I/O error", "full at byte"
FAULTS = ("HALF", "exit code", "DIFFERENT", "LEFT", "SAID DONE")
MOST_CUTS = 400


def written(work: Path, before: dict[Path, bytes]) -> list[int]:
    """The sizes at which a file that grew was cut, or at which one that was made anew is."""
    cuts = {0}
    for file, data in contents(work).items():
        old = before.get(file, b"")
        begin = len(old) if data.startswith(old) else 0
        cuts |= set(range(begin, len(data) + 1, max(1, (len(data) - begin) // MOST_CUTS))) if data != old else set()
    return sorted(cuts)


def contents(work: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in (work / "h").rglob("*") if file.is_file()}


def sweep(case: Case, base: Path, every: int, how: str) -> collections.Counter[str]:
    """Interrupt a command before each of its events or bytes; what came of it, counted."""
    work = base / "work"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    case.before(work)
    old, before = case.result(work), contents(work)
    code, events, told = run(case.arguments(work), work)
    assert code == 0, told
    new, whole, names = case.result(work), content(work / "h"), sorted(p.name for p in work.iterdir())
    found: collections.Counter[str] = collections.Counter()
    for nth in (written(work, before) if how == FULL else range(1, events + 1))[::every]:
        shutil.rmtree(work)
        work.mkdir()
        case.before(work)
        full_at = nth if how == FULL else None
        code, _, told = run(case.arguments(work), work, 0 if how == FULL else nth, how == ERROR, full_at)
        stopped = code == KILLED if how == KILL else code in (0, 1)
        lines = [line for line in told.splitlines() if line.startswith("cartier: ")]
        state = case.result(work)
        left = "new" if state == new else "old" if state == old else f"HALF at {nth}"
        if code == 0 and state != new and "was not saved" not in told:  # an answer that was given, and is not kept
            left += f", SAID DONE at {nth}"
        if not stopped or (how != KILL and code == 1 and len(lines) != 1):
            left += f", exit code {code} at {nth}: {told.strip().splitlines()[-1:]}"
        code, _, told = run(case.arguments(work), work)
        refused = code == 1 and "exists" in told and left == "new"  # done already, and said so
        same = (
            refused
            or not case.again
            or (code == 0 and (content(work / "h") == whole if case.exact else case.result(work) == new))
        )
        beside = sorted(p.name for p in work.iterdir() if not p.name.endswith(".lock"))
        again = "the same again" if same else f"DIFFERENT at {nth} ({told.strip()[-100:]})"
        found[f"{left}; {again}" + ("" if refused or beside == names else f"; LEFT {beside}")] += 1
    shutil.rmtree(work)
    return found


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("cases", nargs="*", help=f"{', '.join(cases(Path()))} (default: all)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="interrupt only every N-th event")
    given = parser.parse_args()
    if unknown := set(given.cases) - set(cases(Path())):
        parser.error(f"no case {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        (base / "made").mkdir()
        prepare(base / "made")
        known, faults = cases(base / "made"), 0
        for name in given.cases or known:
            for how in (KILL, ERROR, FULL):
                begin = time.perf_counter()
                found = sweep(known[name], base, given.every, how)
                print(f"{name:9} {how:12} {sum(found.values()):4} times  {time.perf_counter() - begin:5.0f} s")
                for what, count in found.most_common():
                    print(f"    {count:4} {what}", flush=True)
                    faults += count * any(
                        word in what for word in ("HALF", "exit code", "DIFFERENT", "LEFT", "SAID DONE")
                    )
    print("old or new after each, the same again" if not faults else f"{faults} FAULTS")
    sys.exit(bool(faults))


if __name__ == "__main__":
    run_script(main)
