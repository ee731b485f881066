"""Bounded reads of files that may be hostile or damaged; each fault is an InputError of one line."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import stat
import zipfile
from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import IO, Any, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief, printable

MAX_JSON_BYTES = 256 * 1024 * 1024
NPY_KINDS = "biufSUV"  # of numpy's dtypes; no objects, which only pickle can read
MAX_ARRAYS_BYTES = 256 * 1024 * 1024
MAX_ARRAYS = 100


def read_json(path: Path) -> Any:
    """The value in a JSON file, or an InputError that names file, line and fault."""
    return parse_json(read_bytes(path, MAX_JSON_BYTES), path)


def parse_json(data: bytes, where: Path | str) -> Any:
    """The value in JSON text, or an InputError with ``where``, the line and the fault."""
    try:
        return json.loads(text_of(data, where))
    except json.JSONDecodeError as error:
        raise InputError(f"{where} line {error.lineno}: not valid JSON ({error.msg})") from error
    except (RecursionError, ValueError) as error:  # nested without end, or a number of thousands of digits
        raise InputError(f"{where} is no file of cartier's ({brief(error)})") from error


def typed(value: Any, kind: Any) -> Any:
    """Convert a parsed JSON value to a type: a dataclass from its fields, a tuple from a list, a finite number.

    In texts, what cannot be printed becomes blanks. ``Any`` takes any value as it is.

    Raises TypeError or ValueError for a value of another type.
    """
    parts = get_args(kind)
    if isinstance(kind, type) and is_dataclass(kind):
        if not isinstance(value, dict):
            raise TypeError(f"{brief(value)} is no {kind.__name__}")
        kinds = _hints(kind)
        return kind(**{name: typed(part, kinds.get(name)) for name, part in value.items()})
    if get_origin(kind) is tuple:
        if not isinstance(value, list) or (parts[-1] is not ... and len(parts) != len(value)):
            raise TypeError(f"{brief(value)} is no list of {kind}")
        each = parts[:1] * len(value) if parts[-1] is ... else parts
        return tuple(map(typed, value, each))
    if kind is Any:
        return value
    if get_origin(kind) is dict:
        if not isinstance(value, dict):
            raise TypeError(f"{brief(value)} is no table")
        return {name: typed(part, parts[1]) for name, part in value.items()}
    if NoneType in parts:
        return None if value is None else typed(value, next(part for part in parts if part is not NoneType))
    if kind is float and type(value) in (int, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} is no finite number")
        return float(value)
    if type(value) is not kind:
        raise TypeError(f"{brief(value)} is no {getattr(kind, '__name__', kind)}")
    return printable(value) if kind is str else value


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def check_file(path: Path, max_bytes: int | None = None) -> None:
    """Raises InputError unless there is a plain file of at most ``max_bytes``: a pipe or a device may never end."""
    try:
        about = path.stat()
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing") from error
    except (OSError, ValueError) as error:  # a name with a null byte in it
        raise InputError(f"{path} cannot be read ({_why(error)})") from error
    if not stat.S_ISREG(about.st_mode):
        what = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe, a socket or a device"
        raise InputError(f"{path} is {what}, where a file belongs")
    if max_bytes is not None and about.st_size > max_bytes:
        raise InputError(f"{path} is larger than {_size(max_bytes)}, which is more than it should ever hold")


def read_bytes(path: Path, max_bytes: int, follow_link: bool = True, begin: int = 0) -> bytes:
    """The bytes, from byte ``begin`` on, of a plain file no larger than ``max_bytes``, or an InputError."""
    check_file(path, max_bytes)
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | (0 if follow_link else getattr(os, "O_NOFOLLOW", 0))), "rb") as file:
            size = os.fstat(file.fileno()).st_size  # read() allocates as much as it is asked for
            file.seek(begin)
            return file.read(max(0, min(max_bytes, size) - begin))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({_why(error)})") from error


def read_text(path: Path, max_bytes: int) -> str:
    """The UTF-8 text of a plain file no larger than ``max_bytes``, or an InputError."""
    return text_of(read_bytes(path, max_bytes), path)


def text_of(data: bytes, where: Path | str) -> str:
    """UTF-8 text, or an InputError with ``where`` and the line."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{where} line {line}: not UTF-8 text") from error


def read_npz(source: Path | bytes, max_bytes: int = MAX_ARRAYS_BYTES, where: str = "") -> dict[str, npt.NDArray[Any]]:
    """The arrays of an NPZ file (or of one in memory, which ``where`` names in errors) by name.

    The headers of all members are checked before the first one is unpacked: the kind of the numbers, the shapes and the
    sizes, which together may reach ``max_bytes``. Raises InputError for a missing, large or damaged file.
    """
    where = where or (str(source) if isinstance(source, Path) else "the archive of arrays")
    if isinstance(source, Path):
        check_file(source, max_bytes)
    try:
        with zipfile.ZipFile(source if isinstance(source, Path) else io.BytesIO(source)) as archive:
            members = archive.infolist()
            names = [member.filename.removesuffix(".npy") for member in members]
            if len(set(names)) < len(names) or len(names) > MAX_ARRAYS:
                raise ValueError(f"{len(names)} members, where up to {MAX_ARRAYS} of different names may be")
            if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
                raise ValueError("a member is packed in a way that numpy does not write")
            left = max_bytes
            for member in members:
                with archive.open(member) as file:
                    left -= _array_bytes(file, member.file_size)
                if left < 0:
                    raise ValueError(f"its arrays claim more than {_size(max_bytes)}")
            found = {}
            for name, member in zip(names, members, strict=True):
                with archive.open(member) as file:
                    found[name] = np.lib.format.read_array(file, allow_pickle=False)
                    file.read(1)  # at its end the checksum is compared
            return found
    except Exception as error:  # zipfile's, zlib's, tokenize's and numpy's share no base class
        raise InputError(f"{where} is damaged ({_why(error)})") from error


def read_npy(path: Path, max_bytes: int = MAX_ARRAYS_BYTES) -> npt.NDArray[Any]:
    """The array of an NPY file; its header is checked first. Raises InputError for a missing or damaged file."""
    check_file(path, max_bytes)
    try:
        with path.open("rb") as file:
            _array_bytes(file, path.stat().st_size)
            file.seek(0)
            return np.asarray(np.lib.format.read_array(file, allow_pickle=False))
    except Exception as error:  # as in read_npz
        raise InputError(f"{path} is damaged ({_why(error)})") from error


def _array_bytes(file: IO[bytes], size: int) -> int:
    """The bytes that the array in an NPY stream of ``size`` bytes takes, by its header; ValueError if they differ."""
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"an array is of version {version}")
    shape, _, dtype = readers[version](file)
    if dtype.kind not in NPY_KINDS or dtype.hasobject or not dtype.itemsize:
        raise ValueError(f"an array holds {brief(dtype, 40)}, which is no number or text")
    claimed = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or claimed != size - file.tell():
        raise ValueError(f"an array of the shape {brief(shape, 40)} does not fit its {size} bytes")
    return claimed


def npz_bytes(**arrays: Any) -> bytes:
    """Named arrays as a compressed NPZ; equal arrays give equal bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def json_bytes(value: Any) -> bytes:
    """Pretty JSON as UTF-8, with a newline at the end; NaN is refused because JSON has none."""
    return (json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def sha256_of(*files: Path) -> str:
    """sha256 (hex) over the bytes of some files, one after another."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()


def read_rows(file: Path, keys: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of a JSON-lines file that a run appends to; [] if there is none yet.

    A last line that a kill cut short is removed from the file. Raises InputError for a damaged line elsewhere.
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
                mend = "delete the line, and the run makes it again"
                raise InputError(f"{file} line {number} is damaged: {mend}") from None
            os.truncate(file, read)
    return rows


def _why(error: BaseException) -> str:
    """A fault in a few words."""
    return (error.strerror if isinstance(error, OSError) else None) or brief(error) or type(error).__name__


def _size(size: int) -> str:
    return f"{size // 2**30} GiB" if size >= 2**30 else f"{size // 2**20} MiB" if size >= 2**20 else f"{size} bytes"
