"""Files that may be damaged, half-written or shared: read with one clear line on a fault, written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import json
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from cartier.errors import InputError

MAX_JSON_BYTES = 256 * 1024 * 1024
TEMPORARY = ".cartier-temporary"
"""The file that says of a folder that it is a half-written one of ours, which may be deleted."""


def read_json(path: Path) -> Any:
    """The value in a JSON file, or an InputError that names file, line and fault."""
    return parse_json(read_bytes(path, MAX_JSON_BYTES), path)


def parse_json(data: bytes, where: Path | str) -> Any:
    """The value in JSON text, or an InputError that says where it came from, the line and the fault."""
    try:
        return json.loads(data.decode("utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{where} line {error.lineno}: not valid JSON ({error.msg})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{where} is not UTF-8 text") from error
    except (RecursionError, ValueError) as error:  # nested without end, or a number of thousands of digits
        raise InputError(f"{where} is no file of cartier's ({str(error)[:80]})") from error


def read_bytes(path: Path, most: int, follow_link: bool = True) -> bytes:
    """A regular file's content. Raises InputError if it is missing, no regular file, or longer than ``most`` bytes."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | (0 if follow_link else getattr(os, "O_NOFOLLOW", 0))
    try:
        with os.fdopen(os.open(path, flags), "rb") as file:
            kind = os.fstat(file.fileno())
            if not stat.S_ISREG(kind.st_mode):
                raise InputError(f"{path} is no file")
            data = file.read(most + 1) if kind.st_size <= most else b""
            if kind.st_size > most or len(data) > most:
                raise InputError(f"{path} is larger than {most // 2**20} MiB; that is no file of cartier's")
            return data
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error


def json_bytes(value: Any) -> bytes:
    """Pretty JSON as UTF-8, with a newline at the end; NaN is refused because JSON has none."""
    return (json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def write_json(path: Path, value: Any) -> None:
    """``json_bytes`` into a file, whole or not at all."""
    write_file(path, json_bytes(value))


def write_file(path: Path, data: bytes) -> None:
    """Write beside and rename: a kill or a full disk leaves the older file whole. Raises InputError if it cannot be written."""
    beside = path.with_name(f".{path.name[:80]}-{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with beside.open("xb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
        sync_folder(path.parent)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error


def sync_folder(folder: Path) -> None:
    """See that the names in a folder are on the disk; where folders cannot be opened for that, nothing is done."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def append_line(path: Path, line: str) -> None:
    """Append a line to a log that is kept for people; one that a kill cut short is ended first. Never through a link.

    Raises InputError if that is not possible.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        with os.fdopen(os.open(path, flags, 0o666), "r+b", buffering=0) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise InputError(f"{path} is no file: nothing was added to it")
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - 1))
            ended = size == 0 or file.read(1) == b"\n"
            file.write(("" if ended else "\n").encode() + line.encode() + b"\n")
            os.fsync(file.fileno())
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error


def npz_bytes(**arrays: Any) -> bytes:
    """Named arrays as a compressed NPZ; equal arrays give equal bytes."""
    import numpy as np

    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def sha256_of(*files: Path) -> str:
    """sha256 (hex) over the bytes of some files, one after another."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()


@contextmanager
def locked(target: Path, wait_s: float = 0.0, told: Callable[[str], None] | None = None) -> Iterator[None]:
    """Nobody else who asks for the lock of ``target`` has it meanwhile; a killed process leaves it free.

    The lock is the file ``.NAME.lock`` beside the target. ``told`` hears one line if it has to wait.
    Raises InputError if another process has not released it after ``wait_s`` seconds, or if none can be made.
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
        if lock.lock_counter == 1:  # nobody of ours goes on holding it
            with suppress(OSError):
                Path(lock.lock_file).unlink()
        lock.release()


@contextmanager
def replaced_folder(target: Path, marker: str) -> Iterator[Path]:
    """A temporary folder beside ``target`` that takes its place when the block ends well, and vanishes when it does not.

    An old ``target`` is replaced only if it holds the file ``marker`` or nothing: only our own folders are ever deleted. A kill
    between the two renames leaves the old folder beside, as ``.NAME-….old``; the next replacement puts it back first.
    Raises InputError if there is something else, or if the disk does not let it be written.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with locked(target):
            _tidy(target, marker)
            if target.exists() and not (target / marker).is_file() and not _is_empty_folder(target):
                raise InputError(f"{target} exists and is not ours (it holds no {marker}): choose another folder")
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
                sync_folder(target.parent)
                shutil.rmtree(old, ignore_errors=True)
            finally:
                shutil.rmtree(new, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror or error}") from error


def _tidy(target: Path, marker: str) -> None:
    """Under the lock: put back what a kill between two renames left beside, and delete what we left half-written."""
    beside = f".{target.name[:80]}-"
    left = [p for p in target.parent.iterdir() if p.name.startswith(beside) and p.suffix in (".new", ".old")]
    for folder in left:
        if folder.suffix == ".old" and (folder / marker).is_file():
            if target.exists():
                shutil.rmtree(folder)
            else:
                folder.replace(target)
        elif (folder / TEMPORARY).is_file():
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
            with suppress(OSError), (Path(folder) / name).open("rb") as file:
                os.fsync(file.fileno())
        sync_folder(Path(folder))


def read_rows(file: Path, keys: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of a JSON-lines file that a run appends to; [] if there is none yet.

    A last line that a kill cut short is taken off the file. Raises InputError for a damaged line elsewhere.
    """
    if not file.exists():
        return []
    rows, read = [], 0
    lines = read_bytes(file, MAX_JSON_BYTES).splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            if not line.endswith(b"\n") or any(key not in row for key in keys):
                raise ValueError
            rows.append(row)
            read += len(line)
        except (ValueError, TypeError, RecursionError):
            if number < len(lines):
                raise InputError(
                    f"{file} line {number} is damaged: delete the line, and the run makes it again"
                ) from None
            os.truncate(file, read)
    return rows


def read_npz(data: bytes, where: str) -> dict[str, Any]:
    """The arrays in an NPZ's bytes; raises InputError if it is damaged."""
    import zlib
    from zipfile import BadZipFile

    import numpy as np

    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, KeyError, EOFError, NotImplementedError, BadZipFile, zlib.error) as error:
        raise InputError(f"{where} is damaged ({str(error)[:80]})") from error
