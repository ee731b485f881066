"""Files that may be damaged or half-written: read JSON with one clear line on a fault, write folders all or nothing."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cartier.errors import InputError

MAX_JSON_BYTES = 256 * 1024 * 1024


def read_json(path: Path) -> Any:
    """The value in a JSON file, or an InputError that names file, line and fault."""
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise InputError(f"{path} is larger than {MAX_JSON_BYTES // 2**20} MiB; that is no file of cartier's")
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path} line {error.lineno}: not valid JSON ({error.msg})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text") from error
    except (RecursionError, ValueError) as error:  # nested without end, or a number of thousands of digits
        raise InputError(f"{path} is no file of cartier's ({str(error)[:80]})") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error


def write_json(path: Path, value: Any) -> None:
    """Pretty, UTF-8, with a newline at the end; NaN is refused because JSON has none."""
    path.write_text(json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def sha256_of(*files: Path) -> str:
    """sha256 (hex) over the bytes of some files, one after another."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()


@contextmanager
def replaced_folder(target: Path, marker: str) -> Iterator[Path]:
    """A temporary folder beside ``target`` that takes its place when the block ends well, and vanishes when it does not.

    An old ``target`` is replaced only if it holds the file ``marker``: nothing but our own folders is ever deleted.
    Between the two renames of a replacement a kill leaves the old folder as ``.NAME.old``; ``recover_folder`` restores it.
    """
    recover_folder(target)
    if target.exists() and not (target / marker).is_file() and not (target.is_dir() and not any(target.iterdir())):
        raise InputError(f"{target} exists and holds no {marker}: choose another folder, or delete it yourself")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary, old = target.parent / f".{target.name}.new", target.parent / f".{target.name}.old"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        yield temporary
        if target.exists():
            target.replace(old)
        temporary.replace(target)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def recover_folder(target: Path) -> None:
    """Undo a replacement that was killed between its two renames."""
    old = target.parent / f".{target.name}.old"
    if old.is_dir():
        if target.exists():
            shutil.rmtree(old)
        else:
            old.replace(target)


def read_rows(file: Path, keys: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of a JSON-lines file that a run appends to; [] if there is none yet.

    A last line that a kill cut short is taken off the file. Raises InputError for a damaged line elsewhere.
    """
    if not file.is_file():
        return []
    rows, lines = [], file.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            if not line.endswith("\n") or any(key not in row for key in keys):
                raise ValueError
            rows.append(row)
        except (ValueError, TypeError):
            if number < len(lines):
                raise InputError(
                    f"{file} line {number} is damaged: delete the line, and the run makes it again"
                ) from None
            file.write_text("".join(lines[:-1]), encoding="utf-8")
    return rows
