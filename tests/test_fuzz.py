"""A slice of benchmarks/fuzz.py: broken files are read, or refused in one line, in little time and memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).parents[1] / "benchmarks" / "fuzz.py"


def fuzz(*options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, FUZZ, *options], capture_output=True, text=True, timeout=300)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it forks, and limits the address space")
@pytest.mark.no_cover  # too many rounds to trace each line
@pytest.mark.parametrize("cases", [64, pytest.param(160, marks=pytest.mark.slow)])  # one or more of each kind
def test_no_broken_file_is_a_traceback_a_wait_or_a_gigabyte(cases: int) -> None:
    done = fuzz("--cases", str(cases), "--first", "20")
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-3000:]
    assert f"\n{cases} cases in " in done.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it forks, and limits the address space")
def test_the_fuzz_itself_sees_what_goes_wrong(tmp_path: Path) -> None:
    """Readers that fail in each way, in place of ours."""
    (tmp_path / "faulty.py").write_text(FAULTY.format(fuzz=str(FUZZ.parent)))
    done = subprocess.run([sys.executable, tmp_path / "faulty.py"], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    said = dict(line.split() for line in done.stdout.splitlines())
    assert said == {
        "good": "ok", "refuses": "refused", "rambles": "unclear", "breaks": "traceback", "waits": "hang",
        "dies": "killed", "eats": "memory",
    }  # fmt: skip


FAULTY = """
import os, sys, tempfile, time
from pathlib import Path
sys.path.append({fuzz!r})
import fuzz
from cartier.errors import InputError

def refuse(text):
    raise InputError(text)

def write(path):
    path.mkdir()
    (path / "a.txt").write_text("1 2 3")

readers = dict(
    good=lambda path: None, refuses=lambda path: refuse("no"), rambles=lambda path: refuse("x" * 9999),
    breaks=lambda path: 1 / 0, waits=lambda path: time.sleep(60),
    dies=lambda path: os.abort(), eats=lambda path: bytearray(3 << 30),
)
fuzz.LIMIT_S = 1.0
fuzz.kinds().clear()
from fuzz_kinds import Kind
for name, read in readers.items():
    fuzz.kinds()[name] = Kind(write, read)
with tempfile.TemporaryDirectory() as folder:
    goods = {{name: Path(folder) / name for name in readers}}
    for good in goods.values():
        write(good)
    for case in fuzz.run([(name, 0) for name in readers], goods, 2):
        print(case.kind, case.outcome)
"""
