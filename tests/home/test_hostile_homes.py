"""Homes whose checksums are right and whose content is not, as who means harm would make them: refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cartier
from cartier.errors import InputError
from cartier.home.store import Store
from cartier.render.sheet import draw_sheet
from synthetic import THINGS, TrueBoxes, walk


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("homes") / "sound"
    cartier.map_home(walk(), TrueBoxes(THINGS)).save(folder)
    return folder


def signed(sound: Path, folder: Path, blob: str, change: Callable[[bytes], bytes]) -> Path:
    """A copy with one blob, or the manifest (""), changed, and every checksum made anew."""
    store = Store(sound)
    about = store.manifest()
    blobs = {name: store.get(name, about) for name in about["blobs"]}
    if blob:
        blobs[blob] = change(blobs[blob])
    else:
        about = json.loads(change(json.dumps(about).encode()))
    Store(folder).put(about, blobs, {})
    return folder


def value(path: str, to: Any) -> Callable[[bytes], bytes]:
    """JSON with another value at a path like ``0/views/0/label``."""

    def change(data: bytes) -> bytes:
        whole = json.loads(data)
        *way, last = [int(part) if part.isdigit() else part for part in path.split("/")]
        inner = whole
        for part in way:
            inner = inner[part]
        inner[last] = to
        return json.dumps(whole).encode()

    return change


@pytest.mark.parametrize(
    ("path", "to"),
    [
        ("0", []), ("0/label", 5), ("0/views/0", 7), ("0/views/0/surface", [1.0]), ("0/views/0/box_xyxy", [1, 2]),
        ("0/position", [1.0]),
        ("0/position/0", float("nan")), ("0/box_min/0", 1e999), ("0/probability", None), ("0/confirmed", "yes"),
        ("0/labels", [["mug"]]),
        ("0/unheard", 1),
    ],
)  # fmt: skip
def test_objects_that_are_none_are_refused(sound: Path, tmp_path: Path, path: str, to: Any) -> None:
    with pytest.raises(InputError, match="is damaged") as caught:
        cartier.Home.load(signed(sound, tmp_path / "h", "objects.json", value(path, to)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("path", "to"), [("settings", ["ab"]), ("camera", [1]), ("start_xy", 3), ("rooms", [1]), ("grid/resolution_m", 0)]
)
def test_manifests_that_are_none_are_refused(sound: Path, tmp_path: Path, path: str, to: Any) -> None:
    with pytest.raises(InputError, match="is damaged"):
        cartier.Home.load(signed(sound, tmp_path / "h", "", value(path, to)))


@pytest.mark.parametrize(
    ("blob", "path", "to"),
    [
        ("growth/object_map.json", "labels", ["one"]), ("growth/object_map.json", "together", [[1e999, 1, 1]]),
        ("growth/object_map.json", "next_id", None), ("", "settings/recordings", [{"sha256": "a", "frames": 1}]),
        ("", "settings/recordings", 5),
    ],
)  # fmt: skip
def test_what_growing_needs_is_checked(sound: Path, tmp_path: Path, blob: str, path: str, to: Any) -> None:
    home = cartier.Home.load(signed(sound, tmp_path / "h", blob, value(path, to)))
    with pytest.raises(InputError):
        cartier.Mapper(TrueBoxes(THINGS), onto=home)


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: b"BM" + data, lambda data: data[: len(data) // 2]])
def test_a_photo_that_is_none_is_said(sound: Path, tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    obj = cartier.Home.load(sound).objects[0]
    photo = f"photos/{obj.views[0].frame:06d}.jpg"
    home = cartier.Home.load(signed(sound, tmp_path / "h", photo, damage))
    place = cartier.Place(obj.label, obj.position, 1.0, obj.views[0].frame)
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        home.evidence(place)
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        draw_sheet(home, tmp_path / "sheet.png")
