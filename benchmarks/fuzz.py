"""Fuzz test of every file format that the program reads: each case in its own process, bounded in time and memory.

python benchmarks/fuzz.py [--minutes 10 | --cases 500] [--jobs 2] [--kinds home,tum] [--without home] [--first 0]
python benchmarks/fuzz.py --replay tum:17        the same files again, in this process, with the traceback
Outcomes: ok; refused in one line; unclear (a line too long, or several); traceback; hang (over 10 s); killed; memory
(over 1 GiB).
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import json
import os
import resource
import selectors
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from command_line import Parser, run_script

from cartier.errors import CartierError

if TYPE_CHECKING:
    from fuzz_kinds import Kind

HERE = Path(__file__).parent
LIMIT_S = 10.0
MEMORY_MB = 1024
MAX_LINE = 1500  # of a message, without the folder's name
GOOD = ("ok", "refused")
OUTCOMES = (*GOOD, "unclear", "traceback", "hang", "killed", "memory")


@dataclass(frozen=True)
class Case:
    """What came of reading one broken folder."""

    kind: str
    seed: int
    outcome: str
    said: str
    seconds: float
    memory_mb: float

    @property
    def name(self) -> str:
        return f"{self.kind}:{self.seed}"


@dataclass(frozen=True)
class Running:
    """A child that reads one."""

    kind: str
    seed: int
    pid: int
    pipe: int
    begun: float
    folder: Path


@cache
def kinds() -> dict[str, Kind]:
    """All kinds of files, by name."""
    tests = HERE.parent / "tests"  # before this folder, which has a bags.py, too
    sys.path[:0] = [str(tests / part) for part in ("", "recordings", "detectors", "bench")]
    sys.path.append(str(HERE))
    from fuzz_kinds import KINDS

    return KINDS


def read(kind: str, folder: Path) -> tuple[str, str]:
    """The outcome of reading a folder in this process, and what was said."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # NaN that nobody looked for
            kinds()[kind].read(folder)
        return "ok", ""
    except CartierError as error:
        text = str(error)
        clear = "\n" not in text and len(text.replace(str(folder), "")) <= MAX_LINE
        return ("refused" if clear else "unclear"), text[:1000]
    except MemoryError:
        return "memory", traceback.format_exc()[-1500:]
    except BaseException:
        return "traceback", traceback.format_exc()[-1500:]


def broken(kind: str, seed: int, good: Path, folder: Path) -> str:
    """Copy a good folder and break the copy; the same seed breaks it in the same way. Says how."""
    shutil.copytree(good, folder)
    from fuzz_mutations import break_something

    return break_something(folder, Random(f"{kind}:{seed}"))


def start(kind: str, seed: int, good: Path, place: Path) -> Running:
    """Fork a child that breaks a copy and reads it, with a gigabyte more of address space than it begins with."""
    folder = place / f"{kind}-{seed}" / "home"
    folder.parent.mkdir()
    receive, send = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            os.close(receive)
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            how = broken(kind, seed, good, folder) if seed >= 0 else shutil.copytree(good, folder) and "nothing"
            before_mb = _peak_mb()
            _limit_memory()
            outcome, said = read(kind, folder)
            told = {"outcome": outcome, "said": said, "how": how, "memory_mb": max(0.0, _peak_mb() - before_mb)}
            os.write(send, json.dumps(told).encode())
        except BaseException:
            os.write(send, json.dumps({"fuzz": traceback.format_exc()}).encode())
        finally:
            os._exit(0)
    os.close(send)
    return Running(kind, seed, pid, receive, time.monotonic(), folder)


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << (20 if sys.platform == "darwin" else 10))


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + (MEMORY_MB << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def finish(child: Running, late: bool) -> Case:
    """What a child said; where it said nothing, how it ended."""
    if late:
        os.kill(child.pid, signal.SIGKILL)
    with os.fdopen(child.pipe, "rb") as pipe:
        data = b"" if late else pipe.read()
    _, status = os.waitpid(child.pid, 0)
    shutil.rmtree(child.folder.parent, ignore_errors=True)
    seconds = time.monotonic() - child.begun
    if not data:
        outcome = "hang" if late else "killed"
        said = f"no end after {LIMIT_S:g} s" if late else f"signal {os.WTERMSIG(status)}"
        return Case(child.kind, child.seed, outcome, said, seconds, 0.0)
    told = json.loads(data)
    if "fuzz" in told:
        raise RuntimeError(f"{child.kind}:{child.seed} could not be broken: {told['fuzz']}")
    return Case(child.kind, child.seed, told["outcome"], f"[{told['how']}] {told['said']}", seconds, told["memory_mb"])


def run(cases: Iterable[tuple[str, int]], goods: dict[str, Path], jobs: int) -> Iterator[Case]:
    """The outcome of each (kind, seed), as they come in; ``jobs`` of them are read at a time."""
    waiting = iter(cases)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as place, selectors.DefaultSelector() as ready:
        running: dict[int, Running] = {}
        while True:
            while len(running) < jobs and (following := next(waiting, None)) is not None:
                child = start(*following, goods[following[0]], Path(place))
                running[child.pipe] = child
                ready.register(child.pipe, selectors.EVENT_READ)
            if not running:
                return
            first = min(child.begun for child in running.values())
            done = {key.fd for key, _ in ready.select(max(0.0, first + LIMIT_S - time.monotonic()))}
            late = {fd for fd, child in running.items() if time.monotonic() - child.begun > LIMIT_S} - done
            for fd in done | late:
                ready.unregister(fd)
                yield finish(running.pop(fd), fd in late)


def _made(kind: str, folder: Path) -> bool:
    try:
        kinds()[kind].write(folder / kind)
    except BaseException as error:  # pytest's skip is no Exception
        if "Skipped" not in type(error).__name__:
            raise
        return False
    return True


def _made_in_a_child(kind: str, folder: Path) -> bool:
    pid = os.fork()
    if pid == 0:
        try:
            os._exit(not _made(kind, folder))
        except BaseException:
            traceback.print_exc()
            os._exit(2)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if code not in (0, 1):
        raise RuntimeError(f"a good {kind} cannot be made")
    return code == 0


def make_goods(names: Sequence[str], folder: Path) -> dict[str, Path]:
    """A good folder of each kind, made and read once; kinds that lack a package are left out.

    In this process, so that what is imported and cached here need not be in every child; not what starts threads, which
    a fork does not carry over.
    """
    goods = {}
    for kind in names:
        make = _made_in_a_child if kinds()[kind].starts_threads else _made
        if make(kind, folder):
            goods[kind] = folder / kind
    for kind, good in goods.items():
        if kinds()[kind].starts_threads:
            outcome, said = next((case.outcome, case.said) for case in run([(kind, -1)], goods, 1))
        else:
            outcome, said = read(kind, good)
        if outcome != "ok":
            raise RuntimeError(f"a good {kind} is not read: {outcome}: {said}")
    return goods


def table(cases: Sequence[Case]) -> str:
    """Counts by kind and outcome, with the peak memory and the longest time."""
    lines = [f"{'kind':28}" + "".join(f"{name:>10}" for name in OUTCOMES) + f"{'peak MB':>10}{'longest s':>10}"]
    by_kind: dict[str, list[Case]] = {}
    for case in cases:
        by_kind.setdefault(case.kind, []).append(case)
    for kind, mine in [*by_kind.items(), ("all", list(cases))]:
        count = Counter(case.outcome for case in mine)
        peak, longest = max(c.memory_mb for c in mine), max(c.seconds for c in mine)
        lines.append(f"{kind:28}" + "".join(f"{count[name]:10}" for name in OUTCOMES) + f"{peak:10.0f}{longest:10.1f}")
    return "\n".join(lines)


def replay(name: str) -> int:
    kind, _, seed = name.rpartition(":")
    with tempfile.TemporaryDirectory(prefix="fuzz-good-") as goods:
        good = make_goods([kind], Path(goods))[kind]
        folder = Path(tempfile.mkdtemp(prefix="fuzz-replay-")) / "home"
        print(broken(kind, int(seed), good, folder), "in", folder, flush=True)
        outcome, said = read(kind, folder)
        print(outcome, said, sep="\n")
    return 0 if outcome in GOOD else 1


def main() -> int:
    """1 if anything but a good outcome came of a case."""
    options = Parser(__doc__)
    options.add_argument("--minutes", type=float, default=10.0, help="for how long (default: %(default)s)")
    options.add_argument("--cases", type=int, help="so many, however long they take")
    options.add_argument("--jobs", type=int, default=2, help="files read at a time (default: %(default)s)")
    options.add_argument("--kinds", default=",".join(kinds()), help="kinds of files, by commas (default: all)")
    options.add_argument("--without", default="", help="kinds to leave out")
    options.add_argument("--first", type=int, default=0, help="the first seed")
    options.add_argument("--replay", metavar="KIND:SEED", help="one case again, with its traceback")
    asked = options.parse_args()
    wanted = [asked.replay.rpartition(":")[0]] if asked.replay else asked.kinds.split(",")
    if unknown := [kind for kind in wanted if kind not in kinds()]:
        options.error(f"no kind {', '.join(unknown)}; there are {', '.join(kinds())}")
    if asked.replay:
        return replay(asked.replay)
    names = [name for name in asked.kinds.split(",") if name not in asked.without.split(",")]
    with tempfile.TemporaryDirectory(prefix="fuzz-good-") as folder:
        goods = make_goods(names, Path(folder))
        print(f"{len(goods)} kinds; not here: {', '.join(sorted(set(names) - set(goods))) or 'none'}", flush=True)
        begun = time.monotonic()

        def broken_ones() -> Iterator[tuple[str, int]]:
            number = 0
            while number < asked.cases if asked.cases else time.monotonic() - begun < 60 * asked.minutes:
                yield list(goods)[number % len(goods)], asked.first + number // len(goods)
                number += 1

        cases = []
        for case in run(broken_ones(), goods, asked.jobs):
            cases.append(case)
            if case.outcome not in GOOD:
                print(f"{case.outcome} {case.name} {case.seconds:.1f} s: {case.said}\n", flush=True)
    print(table(cases))
    bad = [case.name for case in cases if case.outcome not in GOOD]
    print(f"{len(cases)} cases in {(time.monotonic() - begun) / 60:.1f} minutes; {len(bad)} failures: {' '.join(bad)}")
    return 1 if bad else 0


if __name__ == "__main__":
    run_script(main)
