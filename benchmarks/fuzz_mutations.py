"""Mutations of ``fuzz.py``: what a bad disk, a bad program or a bad person would do to a file."""

from __future__ import annotations

import contextlib
import json
import os
import re
import socket
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random
from typing import Any

from fuzz_contents import become_another_picture, change_npy_head, claim_a_picture, huge_picture, put_floats

Change = Callable[[Path, Random, list[Path]], None]
"""Breaks the first argument; the last are the other files, to take parts from."""

NUMBERS = (
    "0", "-1", "1e30", "-1e30", "1e-30", "1e308", "1e999", "-0.0", "nan", "NaN", "Infinity", "-inf", "4294967295",
    "2147483648", "9223372036854775808", "18446744073709551615", "1" + "0" * 400, "9" * 5000, "0.5", "3", "65536",
    "100000", "1:1:1:1:1:1", "0x7f",
)  # fmt: skip
WORDS = (
    "", "null", "true", "\x00", "\x1b[2J", "a\nb", "../../etc/passwd", "/dev/zero", "x" * 100_000, "\u202e\ufdfa",
    "\ud800", "é" * 300, "$(reboot)", "%s%n", "{{7*7}}", "__import__('os')",
    "!!python/object/apply:os.system ['false']", "&a *a", "-" * 5000, "'", '"',
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 100000.0, [0, 0], "[/x]", "\x1b[2J", 1e30, 1e-30, float("nan"), float("inf"), 10**400,
    2**31, 2**63, 2**64, 10**4000, "", "\x00", "x" * 100_000, "a\nb", [], {}, [[]], [{}], {"a": None}, [1, "a", None],
    [[1, 2], [3]], list(range(10_000)), "NaN", "\ud800",
)  # fmt: skip
TEXT = (".json", ".jsonl", ".yaml", ".csv", ".txt", ".toml", "", ".pgm")
TOKEN = re.compile(rb'-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|"[^"\n]{0,80}"|[A-Za-z_]{2,40}')
DEEP = 100_000
REACH = 200_000


def break_something(folder: Path, rng: Random) -> str:
    """Break one to three files of a folder, and say which and how."""
    said: list[str] = []
    for number in range(rng.choice((1, 1, 1, 2, 3))):
        file = _any_file(folder, rng)
        if file is None:
            break
        change = rng.choice(_changes(file))
        others = [other for other in sorted(folder.rglob("*")) if other.is_file() and other != file]
        said.append(f"{change.__name__} {file.relative_to(folder)}")
        try:
            change(file, rng, others)
        except Exception:
            if number == 0:  # else it may be broken beyond that already
                raise
    return ", ".join(said)


def _any_file(folder: Path, rng: Random) -> Path | None:
    """One file; each kind (folder and suffix) as likely as any other, however many images there are."""
    kinds: dict[tuple[Path, str], list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.is_symlink():
            kinds.setdefault((path.parent, path.suffix), []).append(path)
    return rng.choice(kinds[rng.choice(sorted(kinds))]) if kinds else None


def _changes(file: Path) -> list[Change]:
    begin = file.read_bytes()[:16]
    changes: list[Change] = [flip_bits, put_run, cut, repeat, claim_a_size, swap, become_no_file]
    if file.suffix in TEXT or file.name == "metadata":
        changes += [put_value, put_value, put_value, nest, drop_a_line, many_lines]
    if file.suffix in (".json", ".jsonl") or file.name == "metadata":
        changes += [put_json] * 4
    if begin.startswith(b"\x89PNG"):
        changes += [claim_a_picture, huge_picture]
    if begin.startswith(b"\xff\xd8\xff"):
        changes += [become_another_picture] * 5
    if begin.startswith(b"PK"):
        changes += [change_a_member] * 5 + [huge_member]
    if begin.startswith(b"\x93NUMPY"):
        changes += [change_npy_head] * 3
    if begin.startswith(b"SQLite"):
        changes += [change_a_row] * 3
    return changes


def flip_bits(file: Path, rng: Random, others: list[Path]) -> None:
    data = bytearray(file.read_bytes())
    for _ in range(rng.choice((1, 1, 2, 8)) if data else 0):
        data[_place(data, rng)] ^= 1 << rng.randrange(8)
    file.write_bytes(data)


def put_run(file: Path, rng: Random, others: list[Path]) -> None:
    """A run of other bytes over, or in between of, what is there."""
    data = file.read_bytes()
    at, size = _place(data, rng), rng.choice((1, 2, 4, 16, 300, 5000))
    run = (
        rng.choice((b"\0", b"\xff", b"9", b" ", b"[", rng.randbytes(1))) * size
        if rng.random() < 0.7
        else rng.randbytes(size)
    )
    file.write_bytes(data[:at] + run + data[at + (size if rng.random() < 0.5 else 0) :])


def cut(file: Path, rng: Random, others: list[Path]) -> None:
    data = file.read_bytes()
    at = rng.choice((0, 1, len(data) // 2, max(0, len(data) - 1), _place(data, rng)))
    file.write_bytes(data[:at] if rng.random() < 0.8 else data[at:])


def repeat(file: Path, rng: Random, others: list[Path]) -> None:
    data = file.read_bytes()
    begin, end = sorted((_place(data, rng), _place(data, rng)))
    file.write_bytes(data[:end] + data[begin:end] * rng.choice((1, 2, 50)) + data[end:])


def claim_a_size(file: Path, rng: Random, others: list[Path]) -> None:
    """A number of four or eight bytes, of either order, over what is there."""
    data = bytearray(file.read_bytes())
    number = rng.choice(
        (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 28, 1 << 24, 10**6, 1 << 40, (1 << 63) - 1, (1 << 64) - 1)
    )
    form = rng.choice(("<I", ">I", "<Q", ">Q", "<H"))
    size = struct.calcsize(form)
    at = _place(data, rng)
    data[at : at + size] = struct.pack(form, number % (1 << (8 * size)))
    file.write_bytes(data)


def swap(file: Path, rng: Random, others: list[Path]) -> None:
    """Another file's bytes, or a part of them, in place of its own."""
    if others:
        other = rng.choice(others).read_bytes()
        data = file.read_bytes()
        at = _place(data, rng)
        file.write_bytes(other if rng.random() < 0.6 else data[:at] + other[at:])


def become_no_file(file: Path, rng: Random, others: list[Path]) -> None:
    """A pipe, a folder, a socket, a link or nothing at all in its place."""
    file.unlink()
    targets = ("/dev/zero", "/dev/null", "/dev/full", "/proc/self/mem", "/etc/passwd", file.name, "nowhere", "..", "/")
    kind = rng.choice(("pipe", "folder", "link", "link", "link", "socket", "nothing"))
    if kind == "pipe":
        os.mkfifo(file)
    elif kind == "folder":
        file.mkdir()
    elif kind == "link":
        file.symlink_to(rng.choice((*targets, *(str(other) for other in others[:3]))))
    elif kind == "socket":
        here = Path.cwd()
        os.chdir(file.parent)  # its path has 108 bytes at most
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(file.name)
        os.chdir(here)


def put_value(file: Path, rng: Random, others: list[Path]) -> None:
    """A hostile number or word in place of some of those that are there."""
    data = file.read_bytes()
    tokens = list(TOKEN.finditer(data, 0, REACH))
    value = rng.choice(NUMBERS if rng.random() < 0.6 else WORDS).encode("utf-8", "surrogatepass")
    for token in sorted(rng.sample(tokens, min(len(tokens), rng.choice((1, 1, 1, 5)))), key=lambda m: -m.start()):
        quoted = token[0].startswith(b'"') and rng.random() < 0.7
        data = data[: token.start()] + (b'"' + value + b'"' if quoted else value) + data[token.end() :]
    file.write_bytes(data)


def put_json(file: Path, rng: Random, others: list[Path]) -> None:
    """A hostile value at any place of a JSON value; of JSON lines, in any line."""
    lines = (
        file.read_text(encoding="utf-8").splitlines() if file.suffix == ".jsonl" else [file.read_text(encoding="utf-8")]
    )
    at = rng.randrange(len(lines)) if lines else 0
    root = {"": json.loads(lines[at])}
    places = list(_places(root))
    held, key = rng.choice(places)
    how = rng.random()
    if how < 0.75:
        held[key] = rng.choice(VALUES)
    elif how < 0.85:
        held[key] = [held[key]] * rng.choice((1, 2, 1000))
    elif held is not root:
        del held[key]
    lines[at] = json.dumps(root[""], ensure_ascii=rng.random() < 0.9)
    file.write_text("\n".join(lines), encoding="utf-8", errors="surrogatepass")


def _places(value: Any) -> Iterable[tuple[Any, Any]]:
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in list(keys)[:200]:
        yield value, key
        yield from _places(value[key])


def nest(file: Path, rng: Random, others: list[Path]) -> None:
    """Brackets without end at some token, in the way of JSON, TOML or YAML."""
    data = file.read_bytes()
    tokens = list(TOKEN.finditer(data, 0, REACH))
    opened, closed = rng.choice(
        ((b"[", b"]"), (b'{"a":', b"}"), (b"{a: ", b"}"), (b"- ", b""), (b"(", b")"), (b"<", b">"))
    )
    depth = rng.choice((30, 500, 990, 5000, DEEP))
    at = rng.choice(tokens).span() if tokens else (0, 0)
    file.write_bytes(
        data[: at[0]] + opened * depth + b"1" + closed * (depth if rng.random() < 0.5 else 0) + data[at[1] :]
    )


def drop_a_line(file: Path, rng: Random, others: list[Path]) -> None:
    lines = file.read_bytes().splitlines(keepends=True)
    if lines:
        lines[rng.randrange(len(lines))] = rng.choice((b"", b"\n", b",,,,\n", b"\xff\xfe\n", b"#\n", b"\x00\n"))
    file.write_bytes(b"".join(lines))


def many_lines(file: Path, rng: Random, others: list[Path]) -> None:
    lines = file.read_bytes().splitlines(keepends=True)
    if lines:
        at = rng.randrange(len(lines))
        lines[at] = lines[at][:2000] * rng.choice((2, 1000, 20_000))
    file.write_bytes(b"".join(lines)[: 4 << 20])


def change_a_member(file: Path, rng: Random, others: list[Path]) -> None:
    """A member of a zip broken inside, with the right checksum around it."""
    members = _members(file)
    if not members:
        return
    inner = file.with_name(f".{file.name}.member")
    name = rng.choice(sorted(members))
    inner.write_bytes(members[name])
    changes: list[Change] = [flip_bits, put_run, cut, claim_a_size, repeat]
    changes += [change_npy_head] * 6 + [put_floats] * 6 if members[name].startswith(b"\x93NUMPY") else [put_value] * 3
    rng.choice(changes)(inner, rng, [])
    members[name] = inner.read_bytes()
    inner.unlink()
    if rng.random() < 0.1:
        members[rng.choice(("", "../a.npy", "a" * 3000, "a\x00b.npy"))] = members.pop(name)
    _write_members(file, members, rng.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED, zipfile.ZIP_BZIP2)))


def huge_member(file: Path, rng: Random, others: list[Path]) -> None:
    """A member that claims a gigabyte, and unpacks to a third of one or less."""
    members = _members(file)
    name = rng.choice([*sorted(members), "more.npy"])
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (134217728,), }".ljust(117) + b"\n"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for other, data in members.items():
            if other != name:
                archive.writestr(other, data)
        with archive.open(name, "w", force_zip64=True) as out:
            out.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head)
            for _ in range(rng.choice((8, 8, 320))):
                out.write(bytes(1 << 20))


def change_a_row(file: Path, rng: Random, others: list[Path]) -> None:
    """A value of a database in place of another one."""
    base = sqlite3.connect(file)
    tables = [name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    table = rng.choice(tables)
    columns = [row[1] for row in base.execute(f"PRAGMA table_info('{table}')")]
    value = rng.choice((None, -1, 2**62, "x", "x" * 5000, b"\x00" * 100, 1.5, b"", "\x1b[2J"))
    where = rng.choice(("", "WHERE rowid = 1", "WHERE rowid % 2 = 0"))
    with contextlib.suppress(sqlite3.IntegrityError):  # a number's column takes no text
        base.execute(f"UPDATE OR REPLACE '{table}' SET {rng.choice(columns)} = ? {where}", (value,))
    base.commit()
    base.close()


def _members(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        if sum(member.file_size for member in archive.infolist()) > 32 << 20:
            raise ValueError("a huge member is in it already")
        return {name: archive.read(name) for name in archive.namelist()}


def _write_members(file: Path, members: dict[str, bytes], method: int) -> None:
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name or "x"), data, method)


def _place(data: bytes | bytearray, rng: Random) -> int:
    """A place in the bytes; heads and tails, which say what the rest is, more often than their share."""
    if not data:
        return 0
    reach = min(len(data), rng.choice((64, 512, 4096, len(data), len(data))))
    return rng.choice((rng.randrange(reach), len(data) - 1 - rng.randrange(reach)))
