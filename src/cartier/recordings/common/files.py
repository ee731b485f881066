"""Files of a recording: what a folder holds, checked names and numbers, CSV tables, and the content hash."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path, PurePosixPath

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError, brief
from cartier.io.files import check_file, read_text

READERS = 4
"""Threads that may ask a reader of image files for frames at once: each opens its own files."""
MAX_TABLE_BYTES = 1 << 26  # a pose takes some 150 bytes: two hours at 60 Hz
ABSOLUTE = re.compile(r"[/\\]|[A-Za-z]:[/\\]")
MAX_NUMBER = 1e30  # nanoseconds fit, and squares stay finite


def names_in(folder: Path, optional: bool = False) -> set[str]:
    """The names in a folder; none if it is ``optional`` and missing. Raises InputError if it cannot be read."""
    if optional and not folder.is_dir():
        return set()
    try:
        return {entry.name for entry in folder.iterdir()}
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror})") from error


def relative(root: Path, *paths: Path | None) -> list[str]:
    """The paths that are not None as POSIX names below ``root``."""
    return [path.relative_to(root).as_posix() for path in paths if path is not None]


def link_notes(root: Path, names: Collection[str]) -> list[str]:
    """What to note of links that lead out of a recording's folder. Raises InputError for one that leads to no file.

    A subset of frames is usually made of links. A map made of a stranger's recording would pass on what its links lead
    to: so archives that hold such links are refused (``hints``), and whoever maps a folder is told of them.
    """
    home = _real(root)
    moved = {folder for folder in {(root / name).parent for name in names} if not _real(folder).is_relative_to(home)}
    outside = [path for path in (root / name for name in names) if path.parent in moved or _leads_out(path, home)]
    for path in outside:
        check_file(path)
    if not outside:
        return []
    count = "1 file is a link that leads" if len(outside) == 1 else f"{len(outside)} files are links that lead"
    return [f"{count} out of the recording's folder, such as {outside[0].relative_to(root).as_posix()}"]


def _leads_out(path: Path, home: Path) -> bool:
    return path.is_symlink() and not _real(path).is_relative_to(home)


def _real(path: Path) -> Path:
    return Path(os.path.realpath(path))  # unlike resolve, it takes links that run in a circle


def inside(name: object, where: str, root: Path, suffixes: Sequence[str] = ("",)) -> str:
    """A file name relative to a recording's folder. Raises InputError if it leads out; links: ``link_notes``.

    Windows' separators are taken, and an absolute path is taken from the first of its folders that lies in ``root``:
    recordings are moved, also from machine to machine. ``suffixes`` are those that the name may lack.
    """
    if not isinstance(name, str) or not _is_name(name):
        raise InputError(f"{where}: {brief(name, 60)!r} is no file name")
    path = PurePosixPath(name.replace("\\", "/"))
    if absolute(name) and ".." not in path.parts:
        tails = [PurePosixPath(*path.parts[i:]) for i in range(1, len(path.parts))]
        there = (tail for tail in tails if any(root.joinpath(f"{tail}{suffix}").is_file() for suffix in suffixes))
        below = (tail for tail in tails[:-1] if root.joinpath(tail.parent).is_dir())  # a file that is missing there
        path = next(there, None) or next(below, path)
    if absolute(str(path)) or ".." in path.parts:
        raise InputError(f"{where}: {brief(name, 80)!r} leads out of the recording's folder")
    return path.as_posix()


def _is_name(name: str) -> bool:
    try:
        parts = name.replace("\\", "/").encode().split(b"/")
    except UnicodeEncodeError:  # half of a character
        return False
    return bool(name) and "\0" not in name and len(name) < 1000 and max(map(len, parts)) <= 255


def absolute(name: object) -> bool:
    """Whether a name is an absolute path, here or on Windows."""
    return isinstance(name, str) and ABSOLUTE.match(name) is not None


def absolute_notes(names: Iterable[object], file: str) -> list[str]:
    """What to note of absolute paths, which ``inside`` took from the folder's own files."""
    first = next((name for name in names if absolute(name)), None)
    if first is None:
        return []
    return [
        f"{file} has absolute paths, such as {brief(first, 60)!r}: the files of the same names in this folder were read"
    ]


def numbers(words: Sequence[object], where: str, finite: bool = True) -> list[float]:
    """Numbers of text or JSON. Raises InputError for others, and if ``finite`` for NaN, infinity and huge values."""
    try:
        values = [float(word) for word in words]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: {brief(error)}") from error
    if finite and not all(abs(value) <= MAX_NUMBER for value in values):  # false for NaN too
        raise InputError(f"{where}: NaN, infinity or a senseless size where a number belongs")
    return values


def read_cells(path: Path, notes: list[str]) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The names in a CSV file's first line, and each row's line number and cells, as many as there are names.

    A row of more or fewer cells, such as the last of an app that was stopped, is left out and counted in ``notes``.
    """
    every = enumerate(read_text(path, MAX_TABLE_BYTES).splitlines(), 1)
    lines = [(number, line.split(",")) for number, line in every if line.strip()]
    names = [name.strip() for name in lines[0][1]] if lines else []
    odd = [(number, cells) for number, cells in lines[1:] if len(cells) != len(names)]
    if odd:
        says = f"line {odd[0][0]} has {len(odd[0][1])} values for {len(names)} columns"
        if len(odd) == len(lines) - 1:
            raise InputError(f"{path}: none of its {len(odd)} rows fits its first line: {says}")
        notes.append(f"{len(odd)} rows of {path.name} left out: {says}")
    return names, [(number, cells) for number, cells in lines[1:] if len(cells) == len(names)]


def read_table(
    path: Path, wanted: Sequence[str], optional: Sequence[str], notes: list[str], poses: Collection[str] = ()
) -> dict[str, npt.NDArray[np.float64]]:
    """The wanted columns of a CSV file by the names in its first line. Raises InputError if one is missing.

    An ``optional`` column is given if it is filled in every row. Other columns are not read: the apps add new ones and
    leave them empty. ``notes`` gets those of ``read_cells``. The columns ``poses`` may hold NaN and infinity.
    """
    names, rows = read_cells(path, notes)
    lack = [name for name in wanted if name not in names]
    if lack:
        columns = f"{', '.join(wanted)}; {', '.join(lack)} is missing"
        raise InputError(f"{path}: its first line must name the columns {columns}")
    if not rows:
        raise InputError(f"{path} holds no row")
    at = {name: names.index(name) for name in (*wanted, *optional) if name in names}
    at = {name: i for name, i in at.items() if name in wanted or all(cells[i].strip() for _, cells in rows)}
    values = np.array(
        [numbers([cells[i] for i in at.values()], f"{path} line {number}", finite=False) for number, cells in rows]
    )
    values[np.isinf(values)] = np.nan
    right = (np.abs(values) <= MAX_NUMBER) | (~np.isfinite(values) & np.array([name in poses for name in at]))
    if not right.all():
        numbers([np.nan], f"{path} line {rows[int(right.all(axis=1).argmin())][0]}")
    return dict(zip(at, values.T, strict=True))


def content_hash(settings: str, root: Path, names: Iterable[str]) -> str:
    """sha256 (hex) over the reader's settings and each file's name below ``root``, size and bytes, read in pieces."""
    return hash_of(settings, ((name, *_hashed(root / name)) for name in names))


def hash_of(settings: str, files: Iterable[tuple[str, int, bytes]]) -> str:
    """sha256 (hex) over a reader's settings and the name, size and sha256 of each file."""
    total = hashlib.sha256(settings.encode())
    for name, size, content in files:
        total.update(f"\0{name}\0{size}\0".encode() + content)
    return total.hexdigest()


def _hashed(path: Path) -> tuple[int, bytes]:
    check_file(path)
    try:
        with path.open("rb") as file:
            content = hashlib.file_digest(file, "sha256")
            return file.tell(), content.digest()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error


def read_fields(head: object, names: Sequence[str], where: str, finite: bool = True) -> list[float]:
    """The numbers that a JSON object holds under some names. Raises InputError if one is missing or no number."""
    lack = [name for name in names if not isinstance(head, dict) or name not in head]
    if not isinstance(head, dict) or lack:
        raise InputError(f"{where} lacks {', '.join(lack[:6])}")
    return numbers([head[name] for name in names], where, finite)
