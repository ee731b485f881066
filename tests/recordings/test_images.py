from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cartier.errors import InputError
from cartier.io import images
from cartier.types import Camera

CAMERA = Camera(256, 256, 200.0, 200.0, 127.5, 127.5)


def claim(width: int, height: int) -> bytes:
    """A PNG that claims a size and holds next to nothing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0" * 99)) + chunk(b"IEND", b"")


def test_every_depth_value_survives(tmp_path: Path) -> None:
    values = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    Image.fromarray(values).save(tmp_path / "a.png")
    depth = images.read_depth(tmp_path / "a.png", CAMERA)
    none = (values == 0) | (values == 65535)
    assert np.array_equal(np.isnan(depth), none)
    assert np.abs(depth - values / 1000)[~none].max() < 4e-6
    images.write_depth(tmp_path / "b.png", depth)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "b.png")), np.where(none, 0, values))


def test_depth_that_does_not_fit_is_none(tmp_path: Path) -> None:
    depth = np.full((256, 256), 1.5, np.float32)
    depth[0, :6] = (np.nan, np.inf, -1, 0.0004, 65.535, 1e6)
    images.write_depth(tmp_path / "a.png", depth)
    back = images.read_depth(tmp_path / "a.png", CAMERA)
    assert np.isnan(back[0, :6]).all()
    assert np.all(back[1:] == np.float32(1.5))


def test_instances_survive_or_are_refused(tmp_path: Path) -> None:
    ids = np.arange(65536, dtype=np.int32).reshape(256, 256)
    images.write_instances(tmp_path / "a.png", ids)
    assert np.array_equal(images.decode_instances((tmp_path / "a.png").read_bytes(), CAMERA, "a.png"), ids)
    for bad in (-1, 65536):
        with pytest.raises(InputError, match="0 to 65535"):
            images.write_instances(tmp_path / "b.png", np.full((256, 256), bad, np.int32))


@pytest.mark.parametrize("mode", ["L", "RGBA", "P", "CMYK"])
def test_colour_of_any_kind_becomes_rgb(tmp_path: Path, mode: str) -> None:
    path = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    Image.new("RGB", (256, 256), (204, 204, 204)).convert(mode).save(path)
    rgb = images.read_rgb(path, CAMERA)
    assert rgb.shape == (256, 256, 3)
    assert np.abs(rgb.astype(int) - 204).max() <= 3


def test_colour_and_depth_mixed_up_is_said(tmp_path: Path) -> None:
    Image.new("RGB", (256, 256)).save(tmp_path / "colour.png")
    Image.fromarray(np.ones((256, 256), np.uint16)).save(tmp_path / "depth.png")
    with pytest.raises(InputError, match="is it a depth image"):
        images.read_rgb(tmp_path / "depth.png", CAMERA)
    with pytest.raises(InputError, match=r"16-bit grey PNG \(depth in millimetres\), but it is a RGB PNG"):
        images.read_depth(tmp_path / "colour.png", CAMERA)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"", "is empty"),
        (b"GIF89a" + b"\0" * 99, "not a JPEG or PNG"),
        (claim(256, 256), "damaged or truncated"),
        (claim(300, 256), "is 300x256 px, but the camera's images are 256x256"),
        (claim(9000, 9000), "claims more than 67 megapixels, which is no camera image"),
        (claim(60000, 60000), "claims more than"),
        (None, "is missing"),
    ],
)
def test_a_bad_image_is_named_in_one_line(tmp_path: Path, content: bytes | None, fault: str) -> None:
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=fault) as caught:
        images.read_rgb(path, CAMERA)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_damage_anywhere_is_an_input_error_or_an_image(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    camera = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)
    pixels = rng.integers(0, 255, (24, 32, 3), dtype=np.uint8)
    path = tmp_path / f"a.{suffix}"
    Image.fromarray(pixels).save(path)
    whole = path.read_bytes()
    faults = 0
    for _ in range(400):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged[: rng.integers(1, len(whole) + 1)] if rng.random() < 0.5 else damaged)
        try:
            assert images.read_rgb(path, camera).shape == (24, 32, 3)
        except InputError as error:
            faults += 1
            assert "\n" not in str(error)
    assert faults > 100
