"""Homes whose checksums are right and whose content is not, as who means harm would make them: refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import cartier
from cartier import plugins
from cartier.cli import main
from cartier.errors import InputError
from cartier.home.store import Store
from cartier.io.files import npz_bytes, read_npz
from cartier.render.sheet import draw_sheet
from cartier.serving.homes import Homes
from cartier.serving.operations import Operations
from cartier.serving.page import one_file
from hostile import write_signed
from synthetic import THINGS, TrueBoxes
from synthetic import small_walk as walk


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
    write_signed(folder, about, blobs)
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
        ("0/labels", [["mug"]]), ("0/unheard", 1), ("0/id", -1), ("0/id", 10**30), ("0/room", 77),
        ("0/position/0", 1e30), ("0/box_min/0", 99.0), ("0/probability", 1.5), ("0/n_detected", -1),
        ("0/first_seen_s", 1e300), ("0/label", "x" * 100_000), ("0/names", ["x" * 100_000]), ("0/aliases", [-1]),
        ("0/views/0/box_xyxy", [5, 5, 4, 9]), ("0/views/0/box_xyxy", [-1e30, 5, 4, 9]), ("0/views/0/frame", -1),
        ("0/oriented", 7),
        ("0/oriented", {"middle": [0, 0, 1e30], "size": [1, 1, 1], "yaw": 0, "seen": []}),
        ("0/oriented", {"middle": [0, 0, 0], "size": [1, -1, 1], "yaw": 0, "seen": []}),
        ("0/oriented", {"middle": [0, 0, 0], "size": [1, 1, 1], "yaw": 0, "seen": ["up"]}),
        ("0/views/0/size_px2", -1), ("0/views/0/score", 1e300), ("0/views/0/camera", [1e30, 0, 0]),
    ],
)  # fmt: skip
def test_objects_that_are_none_are_refused(sound: Path, tmp_path: Path, path: str, to: Any) -> None:
    with pytest.raises(InputError, match="is damaged") as caught:
        cartier.Home.load(signed(sound, tmp_path / "h", "objects.json", value(path, to)))
    assert "\n" not in str(caught.value)


def test_two_objects_of_one_id_are_refused(sound: Path, tmp_path: Path) -> None:
    folder = signed(sound, tmp_path / "h", "objects.json", lambda data: json.dumps(2 * json.loads(data)).encode())
    with pytest.raises(InputError, match="two objects have one id"):
        cartier.Home.load(folder)


@pytest.mark.parametrize(
    ("path", "to"),
    [
        ("settings", ["ab"]), ("camera", [1]), ("start_xy", 3), ("rooms", [1]), ("grid/resolution_m", 0),
        ("settings/doubts", 100000.0), ("settings/doubts", [0, 0]), ("settings/doubts", "ab"), ("settings/knows", 7),
        ("settings/knows", [["mug"]]), ("settings/scale_guessed", 1), ("settings/detector", None),
        ("settings/encoder", 5), ("settings/config", {"rooms": 3}), ("settings/recordings", [{"frames": 1}]),
        ("settings/recordings/0/frames", -1), ("settings/recordings/0/read_with", "up"),
        ("notes", "ab"), ("notes", [1]), ("name", 5), ("name", "x" * 100_000), ("detector", None), ("indexes", []),
        ("indexes", "object_depth"), ("indexes", ["object_depth", "object_depth"]), ("start_xy", [1e300, 0]),
        ("start_xy", [float("nan"), 0]), ("grid/origin_xy", [1e30, 0]), ("rooms/0/0", "one"), ("rooms/0/1", 5),
        ("rooms/0/1", "x" * 100_000), ("camera/0", 160.5),
    ],
)  # fmt: skip
def test_manifests_that_are_none_are_refused(sound: Path, tmp_path: Path, path: str, to: Any) -> None:
    with pytest.raises(InputError, match="is damaged"):
        cartier.Home.load(signed(sound, tmp_path / "h", "", value(path, to)))


@pytest.mark.parametrize(
    "change",
    [
        lambda a: {"rooms": a["rooms"][1:]}, lambda a: {"rooms": a["rooms"].astype(np.float32)},
        lambda a: {"rooms": np.full_like(a["rooms"], -1)}, lambda a: {"rooms": a["rooms"][0]},
        lambda a: {"height_m": np.full_like(a["height_m"], np.nan)},
        lambda a: {"height_m": a["height_m"].astype(str)},
        lambda a: {"floor_kinds": np.zeros((2, 2), np.uint8)},
        lambda a: {"floor_kinds": np.full_like(a["rooms"], 5, np.uint8)},
        lambda a: {"floor_kinds": np.zeros_like(a["rooms"], np.float32)},
    ],
)  # fmt: skip
def test_floor_plans_that_are_none_are_refused(sound: Path, tmp_path: Path, change: Callable[[Any], Any]) -> None:
    def changed(data: bytes) -> bytes:
        arrays = read_npz(data)
        return npz_bytes(**(arrays | change(arrays)))

    with pytest.raises(InputError, match="is damaged"):
        cartier.Home.load(signed(sound, tmp_path / "h", "occupancy.npz", changed))


def test_texts_are_printed_as_they_are(
    sound: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No command of a terminal, no markup of rich's, and no half of a character that UTF-8 cannot write."""
    bad = "\x1b[2J[/x]\ud800"
    folder = signed(sound, tmp_path / "a", "", value("notes", [bad]))
    folder = signed(folder, tmp_path / "b", "", value("settings/doubts", [bad]))
    folder = signed(folder, tmp_path / "c", "", value("rooms/0/1", bad))
    folder = signed(folder, tmp_path / "d", "objects.json", value("0/label", bad))
    monkeypatch.setattr("sys.argv", ["cartier", "show", str(folder), "--all"])
    with pytest.raises(SystemExit) as end:
        main()
    out = capsys.readouterr().out
    assert end.value.code in (None, 0)
    assert out.count("[2J[/x]") >= 3
    assert out.replace("\n", "").isprintable()
    home = cartier.Home.load(folder)
    json.dumps(home.to_dict(), ensure_ascii=False).encode()
    answer = cartier.ask(home, "Where is the trombone?")
    assert any("[2J[/x]" in note for note in answer.notes)
    assert all(note.isprintable() for note in answer.notes)


def test_settings_nested_without_end_are_refused(sound: Path, tmp_path: Path) -> None:
    nested: list[Any] = []
    for _ in range(700):
        nested = [nested]
    folder = tmp_path / "h"
    about, store = Store(sound).manifest(), Store(sound)
    blobs = {name: store.get(name, about) for name in about["blobs"]}
    write_signed(folder, about | {"settings": about["settings"] | {"unheard": nested}}, blobs)
    with pytest.raises(InputError, match="is damaged"):
        cartier.Home.load(folder)


@pytest.mark.parametrize(
    ("blob", "path", "to"),
    [
        ("growth/object_map.json", "labels", ["one"]), ("growth/object_map.json", "together", [[1e999, 1, 1]]),
        ("growth/object_map.json", "next_id", None), ("", "settings/recordings", 5),
    ],
)  # fmt: skip
def test_what_growing_needs_is_checked(sound: Path, tmp_path: Path, blob: str, path: str, to: Any) -> None:
    folder = signed(sound, tmp_path / "h", blob, value(path, to))
    with pytest.raises(InputError):
        cartier.Mapper(TrueBoxes(THINGS), onto=cartier.Home.load(folder))


def picture(format: str) -> bytes:
    """A sound picture of another format."""
    data = BytesIO()
    Image.new("RGB", (160, 120)).save(data, format)
    return data.getvalue()


@pytest.mark.parametrize(
    "damage",
    [lambda data: b"", lambda data: b"BM" + data, lambda data: data[: len(data) // 2], lambda data: b"\xff\xd8\xff"]
    + [lambda data, format=format: picture(format) for format in ("EPS", "PNG", "WEBP", "GIF", "TIFF")],
)
def test_a_photo_that_is_none_is_said(sound: Path, tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    """Everywhere, and no other decoder than JPEG's is asked: of an EPS, Pillow would start Ghostscript."""
    obj = cartier.Home.load(sound).objects[0]
    photo = f"photos/{obj.views[0].frame:06d}.jpg"
    home = cartier.Home.load(signed(sound, tmp_path / "h", photo, damage))
    place = cartier.Place(obj.label, obj.position, 1.0, obj.views[0].frame)
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        home.evidence(place)
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        draw_sheet(home, tmp_path / "sheet.png")
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        Operations(Homes([tmp_path / "h"]), plugins.make("reasoners", "embedded")).look_at(str(obj.id))
    with pytest.raises(InputError, match=f"photo of frame {place.frame}"):
        one_file(home)


def test_photos_are_jpegs_wherever_their_bytes_go(sound: Path, tmp_path: Path) -> None:
    """To a language model, or into a file for another program."""
    obj = cartier.Home.load(sound).objects[0]
    photo = f"photos/{obj.views[0].frame:06d}.jpg"
    home = cartier.Home.load(signed(sound, tmp_path / "h", photo, lambda data: picture("WEBP")))
    with pytest.raises(InputError, match="is no JPEG"):
        home.photo(obj.id)
    made = replace(home, photos={obj.views[0].frame: picture("WEBP")})  # a home that a program made
    with pytest.raises(InputError, match="is no JPEG"):
        made.evidence(cartier.Place(obj.label, obj.position, 1.0, obj.views[0].frame))


@pytest.mark.parametrize("size", [(1, 1), (2, 300), (300, 2)])
@pytest.mark.parametrize("box", [[20, 20, 90, 90], [-900, -900, -880, -880]])
def test_a_photo_that_does_not_reach_the_box_is_shown_as_it_is(
    sound: Path, tmp_path: Path, size: tuple[int, int], box: list[int]
) -> None:
    data, obj = BytesIO(), cartier.Home.load(sound).objects[0]
    Image.new("L", size).save(data, "JPEG")
    photo = f"photos/{obj.views[0].frame:06d}.jpg"
    folder = signed(sound, tmp_path / "a", photo, lambda _: data.getvalue())
    folder = signed(folder, tmp_path / "b", "objects.json", value("0/views/0/box_xyxy", box))
    jpeg = Operations(Homes([folder]), plugins.make("reasoners", "embedded")).look_at(str(obj.id))[1]
    with Image.open(BytesIO(jpeg)) as shown:
        assert min(shown.size) >= 1
    assert one_file(cartier.Home.load(folder))


def test_only_the_package_of_images_opens_images() -> None:
    """Pillow tries every decoder that it has unless it is told which."""
    source = Path(cartier.__file__).parent
    found = [file for file in source.rglob("*.py") if "Image.open(" in file.read_text("utf-8")]
    assert found == [source / "io" / "images.py"]
    assert found[0].read_text("utf-8").count("Image.open(source, formats=formats)") == 1
