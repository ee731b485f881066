"""Mutation tests of mechanisms: faults are put into the source one at a time, and the tests must notice each.

python benchmarks/mutants.py [--group association] [--group existence] [--json mutants.json]

The mutations are kept in ``benchmarks/mutants/GROUP.toml``: each removes or inverts one mechanism (a term of a score, a
gate, a limit), and each bug that is found adds one. Tools that mutate every operator, such as mutmut and cosmic-ray,
make thousands of mutants, most of them equivalent or trivial, and do not say which mechanism is untested. Run it before
each release.

An entry names the file in ``src``, a text that occurs exactly once in it, and what takes its place.
``tests`` names the tests to run, of one entry or of the whole group. The exit code is 1 where tests
fail without any mutation, where a text is not found exactly once, and where a mutant cannot be imported.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import hypothesis
import pytest
from command_line import Parser, run_script
from hypothesis import Phase

HERE = Path(__file__).resolve().parent
PASSED, FAILED = 0, 1  # exit codes of pytest
WHOLE = ("-x", "-q", "-p", "no:cacheprovider", "-m", "")  # the long sweeps, too
UNTESTED = 70  # exit code of a run that did not test the copy of the source
HEAVY = [
    "numpy",
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "scipy.special",
    "hypothesis.strategies",
    "PIL.Image",
    "pydantic",
]


@dataclass(frozen=True)
class Mutant:
    """One fault: ``replace`` stands where ``find`` stood, exactly once, in ``file`` below ``src``."""

    group: str
    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]


def main() -> int:
    options = parsed()
    mutants = [m for m in read(options.root) if not options.group or m.group in options.group]
    mutants = [m for m in mutants if not options.name or m.name in options.name]
    if not mutants:
        print("no such group or name", file=sys.stderr)
        return 1
    wrong = [line for mutant in mutants if (line := misfit(mutant, options.root))]
    if wrong:
        print(*wrong, sep="\n", file=sys.stderr)
        return 1
    for name in HEAVY:
        importlib.import_module(name)
    hypothesis.settings.register_profile(  # a failure is enough: it need not be made small
        "mutants", derandomize=True, database=None, deadline=None, phases=(Phase.explicit, Phase.generate)
    )
    outcomes: dict[Mutant, str] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        shutil.copytree(options.root / "src", folder, dirs_exist_ok=True)
        for tests in dict.fromkeys(mutant.tests for mutant in mutants):
            code, printed = run(options.root, folder, tests, options.timeout_s)
            if code != PASSED:
                print(f"without any mutation {' '.join(tests)} fails:\n{printed}", file=sys.stderr)
                return 1
        for number, mutant in enumerate(mutants, 1):
            begin = time.perf_counter()
            outcomes[mutant] = outcome(mutant, options.root, Path(folder), options.timeout_s)
            took = time.perf_counter() - begin
            print(
                f"{number}/{len(mutants)} {mutant.group}: {mutant.name}: {outcomes[mutant]} ({took:.0f} s)", flush=True
            )
    print("\n" + table(outcomes))
    if options.json:
        rows = [asdict(mutant) | {"outcome": result} for mutant, result in outcomes.items()]
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(any(result.startswith("broken") for result in outcomes.values()))


def parsed() -> argparse.Namespace:
    parser = Parser(__doc__)
    parser.add_argument("--group", action="append", help="only this group; may be given more than once")
    parser.add_argument("--name", action="append", help="only the mutant of this name; may be given more than once")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every mutant with its outcome")
    parser.add_argument(
        "--root", type=Path, default=HERE.parent, help="the checkout that is tested (default: this one)"
    )
    parser.add_argument("--timeout-s", type=float, default=180.0, help="for the tests of one mutant (default: 180)")
    return parser.parse_args()


def read(root: Path) -> list[Mutant]:
    """All mutants of ``benchmarks/mutants/``, group by group."""
    groups = {
        file.stem: tomllib.loads(file.read_text()) for file in sorted((root / "benchmarks/mutants").glob("*.toml"))
    }
    return [
        Mutant(group, **row | {"tests": tuple(row.get("tests") or kept.get("tests", ()))})
        for group, kept in groups.items()
        for row in kept["mutant"]
    ]


def misfit(mutant: Mutant, root: Path) -> str:
    """Why a mutant cannot be made, or nothing."""
    file = root / "src" / mutant.file
    if not file.is_file():
        return f"{mutant.name}: there is no {mutant.file}"
    count = file.read_text().count(mutant.find)
    return "" if count == 1 else f"{mutant.name}: its text occurs {count} times in {mutant.file}, not once"


def outcome(mutant: Mutant, root: Path, folder: Path, timeout_s: float) -> str:
    """ "killed", "survived", or "broken" and why, for a mutant that cannot even be imported."""
    file = folder / mutant.file
    whole = file.read_text()
    try:
        text = whole.replace(mutant.find, mutant.replace)
        compile(text, mutant.file, "exec")
        file.write_text(text)
        Path(importlib.util.cache_from_source(file)).unlink(missing_ok=True)
        code, printed = run(root, str(folder), mutant.tests, timeout_s)
    except SyntaxError as error:
        return f"broken: {error}"
    finally:
        file.write_text(whole)
    if code not in (PASSED, FAILED):
        return f"broken: pytest ended with {code}: {printed[-300:]}"
    return "survived" if code == PASSED else "killed"


def run(root: Path, folder: str, tests: Sequence[str], timeout_s: float) -> tuple[int, str]:
    """The exit code of pytest with ``folder`` on the path, and what it printed; too long counts as a failure.

    It runs in a fork of this process, which has loaded the heavy libraries: five times as fast as a new one.
    """
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            os.dup2(output.fileno(), 1)
            os.dup2(output.fileno(), 2)
            os.chdir(root)
            within = os.pathsep.join([folder, *filter(None, [os.environ.get("PYTHONPATH")])])  # for child processes
            os.environ |= {"PYTHONPATH": within, "OMP_NUM_THREADS": "1"}
            sys.path.insert(0, folder)
            sys.dont_write_bytecode = True
            for name in [name for name in sys.modules if name.partition(".")[0].startswith("cartier")]:
                del sys.modules[name]  # command_line.py has imported the whole one
            code = UNTESTED
            try:
                ended = int(pytest.main([*WHOLE, "--hypothesis-profile=mutants", *tests]))
                tested = (sys.modules["cartier"].__file__ or "").startswith(folder)
                code = ended if tested else UNTESTED
            finally:
                sys.stdout.flush()
                os._exit(code)
        code = waited(child, timeout_s)
        output.seek(0)
        return code, output.read()[-3000:].decode(errors="replace")


def waited(child: int, timeout_s: float) -> int:
    """The exit code of a child, or that of failed tests if it had to be ended."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return FAILED


def table(outcomes: dict[Mutant, str]) -> str:
    """Markdown: one row a group, survivors by name."""
    rows = ["| group | mutants | killed | survivors |", "|---|---:|---:|---|"]
    for group in dict.fromkeys(mutant.group for mutant in outcomes):
        mine = {mutant.name: result for mutant, result in outcomes.items() if mutant.group == group}
        left = [name for name, result in mine.items() if result != "killed"]
        rows.append(f"| {group} | {len(mine)} | {len(mine) - len(left)} | {'; '.join(left) or 'none'} |")
    return "\n".join(rows)


if __name__ == "__main__":
    run_script(main)
