"""Mutations of ``fuzz.py`` for pictures and arrays: sound files of another size, kind or content than is due."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path
from random import Random

import numpy as np
from PIL import Image


def claim_a_picture(file: Path, rng: Random, others: list[Path]) -> None:
    """Another size, depth or kind of pixels in a PNG's head, with the right checksum."""
    data = bytearray(file.read_bytes())
    at, values = rng.choice(((16, (0, 1, 65535, 1 << 20, (1 << 31) - 1)), (20, (0, 1, 65535, 1 << 20, (1 << 31) - 1))))
    if rng.random() < 0.6:
        data[at : at + 4] = struct.pack(">I", rng.choice(values))
    else:
        data[24:26] = bytes((rng.choice((1, 2, 4, 8, 16, 3, 0)), rng.choice((0, 2, 3, 4, 6, 1, 9))))
    data[29:33] = struct.pack(">I", zlib.crc32(bytes(data[12:29])))
    file.write_bytes(data)


def huge_picture(file: Path, rng: Random, others: list[Path]) -> None:
    """A sound PNG of many black pixels in few bytes."""
    width, height, depth, kind, size = rng.choice(
        ((30_000, 5_000, 8, 0, 1), (12_000, 9_000, 16, 0, 2), (100_000, 1_000, 8, 2, 3), (7_000, 7_000, 8, 2, 3))
    )
    packer = zlib.compressobj(1)
    row = bytes(1 + width * size)
    packed = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">2I5B", width, height, depth, kind, 0, 0, 0)
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b""))


def become_another_picture(file: Path, rng: Random, others: list[Path]) -> None:
    """A picture of another format or size under a JPEG's name. Of an EPS, Pillow would start Ghostscript."""
    kind = rng.choice(("EPS", "JPEG", "WEBP", "GIF", "BMP", "TIFF", "PPM", "DIB", "TGA", "PNG", "PDF"))
    size = rng.choice(((1, 1), (2, 300), (40, 30), (16, 16)))
    Image.new(rng.choice(("RGB", "L")), size).save(file, kind)


def put_floats(file: Path, rng: Random, others: list[Path]) -> None:
    """Numbers that no map holds, in place of some of an array's, or of one field of a structured one."""
    array = np.load(file)
    if array.dtype.names:
        field = rng.choice([name for name in array.dtype.names if array.dtype[name].base.kind in "fiu"])
        part = array[field]
    else:
        part = array
    flat, value = part.reshape(-1), rng.choice((float("nan"), float("inf"), -1e30, 1e30, 0, -1, 1e6, 3e4, 1e-30))
    chosen = (
        slice(None) if rng.random() < 0.3 else slice(rng.randrange(max(1, flat.size)), None, rng.choice((1, 3, 100)))
    )
    with np.errstate(all="ignore"):
        if flat.dtype.kind in "iu":
            least, most = (int(v) for v in (np.iinfo(flat.dtype).min, np.iinfo(flat.dtype).max))
            value = max(least, min(most, int(value) if np.isfinite(value) else most))
        if flat.dtype.kind in "fiub":
            flat[chosen] = value
    if array.dtype.names:
        array[field] = flat.reshape(part.shape)
    else:
        array = flat.reshape(array.shape)
    with file.open("wb") as out:
        np.save(out, array)


def change_npy_head(file: Path, rng: Random, others: list[Path]) -> None:
    """Another kind or shape of numbers in an NPY's head, or no head at all."""
    data = file.read_bytes()
    (size,) = struct.unpack_from("<H", data, 8)
    head = data[10 : 10 + size].decode("latin1")
    how = rng.randrange(4)
    if how == 0:
        kind = rng.choice(("|O", "<f8", "<i2", "|V0", "<U1000000", "<M8[s]", ">f4", "|S1", "<c16", "|b1"))
        head = re.sub(r"'descr': .*?, 'fortran", lambda _: f"'descr': '{kind}', 'fortran", head)
    elif how == 1:
        shape = rng.choice(
            ("(-1,)", "(1000000000000,)", "()", "(0, 4611686018427387904)", "(3, 3, 3, 3, 3)", "(1.5,)", "(1,)", "7")
        )
        head = re.sub(r"'shape': \(.*?\)", lambda _: f"'shape': {shape}", head)
    elif how == 2:
        head = rng.choice(("(" * 5000, "-" * 5000 + "1", "{", "", "7", "{'a': 1}", "'" * 300, "[" * 50_000))
    else:
        head = re.sub(r"\d+", lambda _: rng.choice(("0", "2", "99", str(2**62), "7")), head)
    text = head.encode("latin1")
    file.write_bytes(data[:8] + struct.pack("<H", len(text) % 65536) + text + data[10 + size :])
