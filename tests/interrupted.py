"""Run a command of cartier in a forked child that is killed, or meets an I/O error or a full disk, at any moment."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import resource
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

EVENTS = {"open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.link", "tempfile.mkdtemp"}
KILLED = -9


def run(
    arguments: Sequence[object], within: Path, nth: int = 0, error: bool = False, full_at: int | None = None
) -> tuple[int, int, str]:
    """(exit code, events under ``within``, what was printed to standard error) of one command.

    Before the ``nth`` event that may change a file under ``within`` the process is killed, or with ``error`` gets one
    OSError (a full disk); 0 lets it run to its end. No file may grow beyond ``full_at`` bytes: of a write that would,
    the system takes a part. An unexpected exception gives the exit code 99.
    """
    told_to, log = os.pipe()
    child = os.fork()
    if child == 0:
        if full_at is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (full_at, full_at))
        _child([str(a) for a in arguments], within, nth, error, log)
    os.close(log)
    with os.fdopen(told_to, errors="replace") as pipe:
        told = pipe.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    counted = re.search(r"EVENTS (\d+)\n$", told)
    return code, int(counted[1]) if counted else 0, told.split("EVENTS ")[0]


def _child(arguments: list[str], within: Path, nth: int, error: bool, log: int) -> None:
    from cartier import cli

    count = 0

    def hook(event: str, given: tuple[object, ...]) -> None:
        nonlocal count
        if event not in EVENTS or not given or isinstance(given[0], int | None):
            return
        if event == "open" and not _writes(given):
            return
        if not Path(os.fsdecode(given[0])).absolute().is_relative_to(within):  # type: ignore[arg-type]
            return
        count += 1
        if count == nth and error:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if count == nth:
            os.kill(os.getpid(), 9)

    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(log, 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)  # not pytest's
    sys.argv = ["cartier", *arguments]
    sys.addaudithook(hook)
    code = 0
    try:
        cli.main()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 99
    sys.stderr.flush()
    os.write(2, f"EVENTS {count}\n".encode())
    os._exit(code)


def _writes(given: tuple[object, ...]) -> bool:
    """Whether an audit event of ``open`` (path, mode, flags) opens for writing."""
    mode, flags = given[1], given[2]
    return bool(set(mode) & set("wax+")) if isinstance(mode, str) else isinstance(flags, int) and bool(flags & 3)


def content(folder: Path) -> str | None:
    """A digest of all names and bytes in a folder, without the answers that people got; None if there is no folder."""
    if not folder.exists():
        return None
    digest = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "answers.jsonl"):
        digest.update(f"{file.relative_to(folder)}\0{hashlib.sha256(file.read_bytes()).hexdigest()}\0".encode())
    return digest.hexdigest()
