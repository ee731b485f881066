"""What is said of a path that is no recording, or may be two."""

from __future__ import annotations

from pathlib import Path

import pytest
from layouts import LAYOUTS

from cartier import plugins
from cartier.errors import InputError


def test_a_recording_nearby_is_named(tmp_path: Path) -> None:
    (tmp_path / "outer").mkdir()
    LAYOUTS["tum"](tmp_path / "outer" / "scan")
    for wrong in (tmp_path / "outer", tmp_path / "outer" / "scan" / "rgb"):
        with pytest.raises(InputError, match=r"is no recording .*: but .*outer/scan is one \(tum\): give that"):
            plugins.open_recording(wrong)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("scan.zip", r"it is a zip file: unpack it, and give the folder \(unzip .*scan\.zip -d .*/scan\)"),
        ("walk.MOV", "a video alone has no camera poses and no intrinsics: COLMAP or nerfstudio"),
        ("photos/IMG_1.JPG", r"it holds pictures such as IMG_1\.JPG, but no camera poses .*docs/phone\.md"),
        ("download/scan.zip", r"it holds scan\.zip: unpack that, and give its folder"),
        ("letters/a.txt", "the formats are arcore, .*'cartier list' says what each one looks like"),
    ],
)
def test_what_is_nearly_a_recording_is_said(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=says) as caught:
        plugins.open_recording(tmp_path / name.split("/")[0])
    assert "\n" not in str(caught.value)


def test_a_folder_of_two_formats_asks_which(tmp_path: Path) -> None:
    LAYOUTS["tum"](tmp_path / "a")
    LAYOUTS["arcore-without-depth"](tmp_path / "b")
    for path in (tmp_path / "b").iterdir():
        path.rename(tmp_path / "a" / path.name)
    with pytest.raises(InputError, match="may be one of arcore, tum: say which with --format"):
        plugins.open_recording(tmp_path / "a")
    assert len(plugins.open_recording(tmp_path / "a", format="tum")) == 4


def test_poses_in_a_layout_of_ones_own_are_seen_and_the_ways_are_said(tmp_path: Path) -> None:
    for name in ("0014_rgb.png", "0014_depth.png", "poses.json"):
        (tmp_path / name).write_bytes(b"{}")
    with pytest.raises(InputError, match=r"such as 0014_depth\.png, and poses\.json, in a layout of .*--format"):
        plugins.open_recording(tmp_path)
