"""Atomic writes and locks: a kill, a full disk or a second process leaves the old content or the new, never a part."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cartier.errors import InputError
from cartier.io.files import json_bytes

TEMPORARY = ".cartier-temporary"
"""The file that marks a folder as a half-written one of ours, which may be deleted."""
CANNOT_SYNC = (errno.EINVAL, errno.EBADF, errno.ENOTSUP, errno.EACCES)  # what says that a platform has no such sync
PART = re.compile(r"\..+-[0-9a-f]{8}\.part")
"""The names under which ``write_file`` writes."""


def sweep_parts(file: Path) -> None:
    """Delete what killed calls of ``write_file`` left beside a file; the caller must hold the lock of the file."""
    left = file.parent.iterdir() if file.parent.is_dir() else ()
    for path in [path for path in left if PART.fullmatch(path.name) and path.name.startswith(f".{file.name[:80]}-")]:
        with suppress(OSError):
            path.unlink()


def write_json(path: Path, value: Any) -> None:
    """Write ``json_bytes`` to a file, atomically."""
    write_file(path, json_bytes(value))


def write_file(path: Path, data: bytes) -> None:
    """Write a file atomically, by writing beside it and renaming. Raises InputError if it cannot be written."""
    with _written_beside(path, data) as beside:
        beside.replace(path)


def create_file(path: Path, data: bytes) -> bool:
    """Write a file atomically unless there is one: whether it was written. Raises InputError if it cannot be."""
    if path.exists():
        return False
    try:
        with _written_beside(path, data) as beside:
            path.hardlink_to(beside)
    except InputError as error:
        if not isinstance(error.__cause__, FileExistsError):
            raise
        return False
    return True


@contextmanager
def replaced_file(path: Path) -> Iterator[Path]:
    """A path beside ``path``: the file that the block writes there takes the name once it is on the disk.

    Raises InputError if it cannot be written.
    """
    with _beside(path) as beside:
        yield beside
        sync(beside)
        beside.replace(path)


@contextmanager
def _written_beside(path: Path, data: bytes) -> Iterator[Path]:
    """A file with the data beside ``path``, for a block that gives it that name."""
    with _beside(path) as beside:
        with beside.open("xb") as file:
            file.write(data)
            with suppress(OSError):
                shutil.copymode(path, beside)  # who may read the old file may read the new one
            file.flush()
            os.fsync(file.fileno())
        yield beside


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A free name beside ``path``; a file that the block leaves there is deleted."""
    beside = path.with_name(f".{path.name[:80]}-{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield beside
        finally:
            beside.unlink(missing_ok=True)
        sync(path.parent)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error


def sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk, where the platform can. Raises OSError if that fails."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:  # Windows opens no folder
        return
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in CANNOT_SYNC:
            raise
    finally:
        os.close(handle)


def append_line(path: Path, line: str) -> None:
    """Append one line to a log; see ``append_lines``."""
    append_lines(path, [line])


def append_lines(path: Path, lines: Sequence[str]) -> None:
    """Append lines to a log: on the disk when this returns, or, with an error, none of them.

    A line that a kill cut short is ended first. One process writes at a time, and links are not followed.

    Raises InputError if the file cannot be written.
    """
    try:
        with opened_log(path) as log:
            size = os.lseek(log, 0, os.SEEK_END)
            os.lseek(log, max(0, size - 1), os.SEEK_SET)
            whole = size == 0 or os.read(log, 1) == b"\n"
            if size == 0:
                sync(path.parent)
            append_whole(log, "".join(f"{line}\n" for line in (lines if whole else ("", *lines))).encode())
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error


def keep_newest(path: Path, most_bytes: int) -> None:
    """Take the older half off a log of more than so many bytes. Raises InputError if that cannot be written."""
    if path.stat().st_size <= most_bytes:
        return
    with opened_log(path) as log, os.fdopen(os.dup(log), "rb") as file:
        file.seek(-min(most_bytes // 2, os.fstat(log).st_size), os.SEEK_END)
        write_file(path, file.read().partition(b"\n")[2])


@contextmanager
def opened_log(path: Path) -> Iterator[int]:
    """The descriptor of a log, made if there is none, that no other process or thread appends to or replaces meanwhile.

    Links are not followed. Raises InputError for what is no file, and OSError.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    while True:
        log = os.open(path, flags, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(log).st_mode):
                raise InputError(f"{path} is no file: nothing was added to it")
            _lock(log)
            if path.exists() and os.path.samestat(os.fstat(log), path.lstat()):  # else it was replaced meanwhile
                yield log
                return
        finally:
            os.close(log)


def _lock(file: int) -> None:
    """Wait for the lock of an open file, which its closing gives back. Windows and some network disks have none."""
    with suppress(ImportError, OSError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX)


def append_whole(file: int, data: bytes, on_disk: bool = True) -> None:
    """Append to an open file all of the data, or, with an OSError, nothing; ``on_disk`` waits until it is there."""
    end = os.lseek(file, 0, os.SEEK_END)
    try:
        left = memoryview(data)
        while left:  # of what is too much for the disk it takes a part, and says so only when asked again
            left = left[os.write(file, left) :]
        if on_disk:
            os.fsync(file)
    except BaseException:
        os.ftruncate(file, end)
        os.lseek(file, end, os.SEEK_SET)
        raise


@contextmanager
def locked(target: Path, wait_s: float = 0.0, told: Callable[[str], None] | None = None) -> Iterator[None]:
    """Hold the lock of ``target``, the file ``.NAME.lock`` beside it; a killed process releases it.

    ``told`` is called with one line if it has to wait. Raises InputError if another process has not released the lock
    after ``wait_s`` seconds, or if it cannot be made.
    """
    from filelock import FileLock, Timeout  # 20 ms that asking a home need not pay

    target = target.absolute()
    busy = f"another cartier is writing {target}"
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        lock = FileLock(target.parent / f".{target.name}.lock", is_singleton=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            if told and wait_s:
                told(f"{busy}: waiting for it to end")
            lock.acquire(timeout=wait_s)
    except Timeout as error:
        raise InputError(f"{busy}: try again when it has ended") from error
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        if lock.lock_counter == 1:  # no outer block of this process holds it
            with suppress(OSError):
                Path(lock.lock_file).unlink()
        lock.release()


def check_ours(target: Path, marker: str) -> None:
    """Raises InputError if something is at ``target`` that ``replaced_folder`` would refuse to replace."""
    if target.exists() and not (target / marker).is_file() and not _is_empty_folder(target):
        raise InputError(f"{target} exists and is not ours (it holds no {marker}): choose another folder")


@contextmanager
def replaced_folder(target: Path, marker: str) -> Iterator[Path]:
    """A temporary folder beside ``target`` that takes its place when the block succeeds, and is deleted otherwise.

    An old ``target`` is replaced only if it holds the file ``marker`` or nothing: only our own folders are ever
    deleted. A kill between the two renames leaves the old folder beside, as ``.NAME-….old``; the next replacement puts
    it back first. Raises InputError if there is something else, or if it cannot be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with locked(target):
            _tidy(target, marker)
            check_ours(target, marker)
            new = Path(tempfile.mkdtemp(prefix=f".{target.name[:80]}-", suffix=".new", dir=target.parent))
            try:
                (new / TEMPORARY).touch()
                yield new
                (new / TEMPORARY).unlink()
                new.chmod(0o777 & ~_umask())
                _sync_tree(new)
                old = new.with_suffix(".old")
                if target.exists():
                    target.replace(old)
                new.replace(target)
                sync(target.parent)
                shutil.rmtree(old, ignore_errors=True)
            finally:
                shutil.rmtree(new, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from error


def _tidy(target: Path, marker: str) -> None:
    """Put back what a kill between two renames left beside, and delete what was half-written; needs the lock."""
    beside = f".{target.name[:80]}-"
    left = [p for p in target.parent.iterdir() if p.name.startswith(beside) and p.suffix in (".new", ".old")]
    for folder in left:
        if folder.suffix == ".old" and (folder / marker).is_file():
            if target.exists():
                shutil.rmtree(folder)
            else:
                folder.replace(target)
        elif (folder / TEMPORARY).is_file() or (folder / marker).is_file():  # or it was whole, and not yet renamed
            shutil.rmtree(folder)
        elif folder.suffix == ".new" and _is_empty_folder(folder):  # killed before it was marked
            folder.rmdir()


def _is_empty_folder(folder: Path) -> bool:
    return folder.is_dir() and not any(folder.iterdir())


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def _sync_tree(root: Path) -> None:
    for folder, _, names in os.walk(root):
        for name in names:
            sync(Path(folder) / name)
        sync(Path(folder))
