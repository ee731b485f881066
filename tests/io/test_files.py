"""Bounded reads: only plain files are opened, and arrays are bounded by their headers before they are read."""

from __future__ import annotations

import io
import os
import socket
import tracemalloc
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier.errors import CartierError, InputError, brief
from cartier.io.files import check_file, read_bytes, read_json, read_npy, read_npz, read_text, typed

ARRAYS = {
    "frames": np.arange(5, dtype=np.int32),
    "boxes_xyxy": np.linspace(0, 9, 20, dtype=np.float32).reshape(5, 4),
    "texts": np.array(["mug", "Café table"]),
    "cells": np.array([(1, 2.5), (3, 4.5)], [("row", "<i4"), ("height_m", "<f4")]),
    "nothing": np.empty((0, 4), np.float16),
}


def npz(arrays: dict[str, Any] = ARRAYS, packed: bool = True) -> bytes:
    out = io.BytesIO()
    (np.savez_compressed if packed else np.savez)(out, **arrays)
    return out.getvalue()


def npy(header: str, data: bytes = b"", version: int = 1) -> bytes:
    head = header.encode("latin1")
    size = len(head).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + size + head + data


def zipped(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


def one_line(error: pytest.ExceptionInfo[InputError]) -> None:
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


@pytest.mark.parametrize("packed", [True, False])
def test_arrays_come_back_from_a_file_and_from_memory(tmp_path: Path, packed: bool) -> None:
    (tmp_path / "a.npz").write_bytes(npz(packed=packed))
    for source in (tmp_path / "a.npz", npz(packed=packed)):
        found = read_npz(source)
        assert list(found) == list(ARRAYS)
        for name, array in ARRAYS.items():
            assert found[name].dtype == array.dtype and np.array_equal(found[name], array)
    np.save(tmp_path / "a.npy", ARRAYS["cells"])
    assert np.array_equal(read_npy(tmp_path / "a.npy"), ARRAYS["cells"])


def test_a_flipped_bit_anywhere_is_one_line_or_harmless(tmp_path: Path) -> None:
    """Every bit of a small archive in turn: 69 of 400 gave a traceback once."""
    data = npz({"a": np.arange(3, dtype=np.int16), "b": np.array(["x"])})
    refused = 0
    for place in range(len(data) * 8):
        broken = bytearray(data)
        broken[place // 8] ^= 1 << place % 8
        try:
            read_npz(bytes(broken))
        except InputError as error:
            refused += 1
            assert str(error).startswith("the archive of arrays is damaged (") and len(str(error)) < 200
    assert refused > len(data) * 3


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_cut_archive_is_one_line(tmp_path: Path, share: float) -> None:
    data = npz()
    (tmp_path / "a.npz").write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match=r"a\.npz is damaged") as caught:
        read_npz(tmp_path / "a.npz")
    one_line(caught)


def test_a_bomb_is_refused_by_its_headers(tmp_path: Path) -> None:
    """1.5 MB took 3.1 GB once; it is the sum that counts, and nothing is unpacked before all are checked."""
    bomb = npz({f"a{i}": np.zeros(8_000_000) for i in range(5)})
    assert len(bomb) < 400_000
    tracemalloc.start()
    with pytest.raises(InputError, match="claim more than 256 MiB"):
        read_npz(bomb)
    assert tracemalloc.get_traced_memory()[1] < 4_000_000
    tracemalloc.stop()
    assert len(read_npz(bomb, max_bytes=400_000_000)) == 5
    (tmp_path / "a.npy").write_bytes(npy("{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999,), }\n"))
    with pytest.raises(InputError, match=r"the shape \(999999999999,\) does not fit its"):
        read_npy(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("header", "fault"),
    [
        ("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", "holds object"),
        ("{'descr': [('a', '|O')], 'fortran_order': False, 'shape': (1,), }", "holds"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }", "does not fit"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904, 4), }", "does not fit"),
        ("{'descr': '|V0', 'fortran_order': False, 'shape': (999999999999,), }", "holds"),
        ("{'descr': '<M8[s]', 'fortran_order': False, 'shape': (1,), }", "holds datetime64"),
        ("{'descr': '<f8', 'fortran_order': False, 'shape': (1, ", "damaged"),
        ("(" * 9000, "damaged"),
        ("-" * 9000 + "1", "damaged"),
        ("{'descr': __import__('os').system('false'), 'fortran_order': False, 'shape': (1,), }", "damaged"),
        ("", "damaged"),
    ],
)
def test_headers_that_numpy_never_wrote(tmp_path: Path, header: str, fault: str) -> None:
    data = npy(header + "\n", bytes(8))
    (tmp_path / "a.npy").write_bytes(data)
    for read in (lambda: read_npz(zipped({"a.npy": data})), lambda: read_npy(tmp_path / "a.npy")):
        with pytest.raises(InputError, match=fault) as caught:
            read()
        one_line(caught)


def test_archives_that_numpy_never_wrote() -> None:
    good = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }\n", bytes(8))
    assert list(read_npz(zipped({"a.npy": good}))) == ["a"]
    cases = {
        "a member is packed in a way": zipped({"a.npy": good}, zipfile.ZIP_BZIP2),
        "2 members, where up to 100 of different names": zipped({"a.npy": good, "a": good}),
        "101 members": zipped({f"{i}.npy": good for i in range(101)}),
        "magic string": zipped({"a.npy": b"x" * 80}),
    }
    for fault, data in cases.items():
        with pytest.raises(InputError, match=fault) as caught:
            read_npz(data, where="map.npz")
        one_line(caught)
        assert str(caught.value).startswith("map.npz is damaged")


def test_only_plain_files_are_opened(tmp_path: Path) -> None:
    """A pipe would never end; a folder, a socket and a device are no files either."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "zero").symlink_to("/dev/zero")
    (tmp_path / "nowhere").symlink_to("gone")
    (tmp_path / "circle").symlink_to("circle")
    with socket.socket(socket.AF_UNIX) as listening:
        here = Path.cwd()
        os.chdir(tmp_path)  # a socket's path has 108 bytes at most
        try:
            listening.bind("socket")
        finally:
            os.chdir(here)
        faults = {
            "pipe": "a pipe", "folder": "a folder", "zero": "a device", "nowhere": "is missing",
            "circle": "cannot be read", "socket": "a socket", "none": "is missing",
            "a\0b": "cannot be read", "x" * 300: "cannot be read",
        }  # fmt: skip
        for name, fault in faults.items():
            for read in (
                check_file,
                read_json,
                read_npz,
                read_npy,
                lambda p: read_text(p, 99),
                lambda p: read_bytes(p, 9),
            ):
                with pytest.raises(InputError, match=fault) as caught:
                    read(tmp_path / name)
                assert "\n" not in str(caught.value)


def test_text_is_bounded_and_utf_8(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes("\ufeffmug\nCafé".encode())
    assert read_text(tmp_path / "a", 100) == "mug\nCafé"
    with pytest.raises(InputError, match="is larger than 11 bytes"):
        read_text(tmp_path / "a", 11)
    (tmp_path / "b").write_bytes(b"mug\n\xff")
    with pytest.raises(InputError, match="b line 2: not UTF-8 text"):
        read_text(tmp_path / "b", 100)


def test_messages_are_one_printable_line() -> None:
    assert str(CartierError("a\nb\x1b[31mc\u2028d")) == "a b [31mc d"
    assert str(InputError(f"{Path('rgb/a.jpg')} is empty")) == "rgb/a.jpg is empty"


def test_what_is_quoted_is_brief() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    assert brief("a\nb" * 9) == "a b" + "a b" * 8
    assert len(brief("x" * 10**6)) == 100 and len(brief(list(range(10**5)), 40)) == 40
    assert brief(10**5000) == "int" and brief(deep) == "list"


@dataclass(frozen=True)
class Row:
    name: str
    size_m: float
    parts: tuple[tuple[str, int], ...] = ()
    room: int | None = None


def test_json_becomes_what_the_types_say() -> None:
    value = [
        {"name": "mug", "size_m": 1, "parts": [["ear", 2]], "room": None},
        {"name": "bed", "size_m": 2.5, "room": 3},
    ]
    assert typed(value, tuple[Row, ...]) == (Row("mug", 1.0, (("ear", 2),)), Row("bed", 2.5, (), 3))


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": 5}, {"size_m": "1"}, {"size_m": True}, {"size_m": float("nan")}, {"size_m": 10**400}, {"size_m": None},
        {"parts": {}}, {"parts": [["ear"]]}, {"parts": [["ear", 2, 3]]}, {"parts": [["ear", 2.0]]},
        {"room": "kitchen"}, {"room": True}, {"more": 1},
    ],
)  # fmt: skip
def test_json_of_another_type_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises((TypeError, ValueError, OverflowError)):
        typed({"name": "mug", "size_m": 1.0} | wrong, Row)
