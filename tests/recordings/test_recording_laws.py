"""What every recording format owes its reader, over every layout that the tests can write."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from layouts import LAYOUTS, room

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import InputError


@pytest.fixture(params=LAYOUTS)
def layout(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    LAYOUTS[request.param](tmp_path / "home")
    return tmp_path / "home"


def test_every_format_is_under_the_laws() -> None:
    assert {b.name for b in plugins.backends("recordings")} == {name.split("-")[0] for name in LAYOUTS}


def test_exactly_one_format_recognises_it(layout: Path) -> None:
    formats = [b.name for b in plugins.backends("recordings")]
    recognised = [f for f in formats if plugins._load("recordings", f).matches(layout)]
    assert len(recognised) == 1


def test_frames_are_typed_and_counted(layout: Path) -> None:
    recording = plugins.open_recording(layout)
    assert isinstance(recording, Recording)
    assert recording.name
    assert all(isinstance(note, str) and "\n" not in note for note in recording.notes)
    frames = list(recording)
    assert len(frames) == len(recording) == len(room())
    for i, frame in enumerate(frames):
        shape = (recording.camera.height, recording.camera.width)
        assert frame.index == i
        assert np.isfinite(frame.time_s)
        assert frame.camera == recording.camera
        assert frame.rgb.dtype == np.uint8
        assert frame.rgb.shape == (*shape, 3)
        if frame.depth_m is not None:
            assert frame.depth_m.dtype == np.float32
            assert np.isnan(frame.depth_m).any() or frame.depth_m.min() > 0
        if frame.instances is not None:
            assert frame.instances.dtype == np.int32


@pytest.mark.parametrize("index", [-1, 4, 10**9])
def test_there_is_no_frame_outside(layout: Path, index: int) -> None:
    with pytest.raises(IndexError, match="frames 0 to 3"):
        plugins.open_recording(layout)[index]


def test_reading_is_deterministic(layout: Path) -> None:
    one, two = plugins.open_recording(layout), plugins.open_recording(layout)
    assert one.fingerprint() == two.fingerprint()
    for i in (3, 0, 3):
        a, b = one[i], two[i]
        assert (a.time_s, a.world_from_camera.tolist()) == (b.time_s, b.world_from_camera.tolist())
        assert np.array_equal(a.rgb, b.rgb)
        if a.depth_m is not None and b.depth_m is not None:
            assert np.array_equal(a.depth_m, b.depth_m, equal_nan=True)


def test_the_fingerprint_covers_every_kind_of_file_and_no_place(layout: Path, tmp_path: Path) -> None:
    before = plugins.open_recording(layout).fingerprint()
    assert len(before) == 64
    moved = tmp_path / "elsewhere" / "home"
    shutil.copytree(layout, moved)
    assert plugins.open_recording(moved).fingerprint() == before
    last_of_kind = {(p.parent, *p.suffixes[-2:]): p for p in sorted(layout.rglob("*")) if p.is_file()}
    for path in last_of_kind.values():
        content = path.read_bytes()
        recording = plugins.open_recording(layout)
        path.write_bytes(content + b" ")
        assert recording.fingerprint() != before, path.name
        path.write_bytes(content)
    assert plugins.open_recording(layout).fingerprint() == before


def test_opening_decodes_no_colour_and_a_damaged_image_costs_one_frame(layout: Path) -> None:
    for path in [*layout.glob("rgb/*"), *layout.glob("*.color.*")]:
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    recording = plugins.open_recording(layout)
    for i in range(len(recording)):
        with pytest.raises(InputError, match="damaged or truncated"):
            recording[i]


def test_frames_cannot_change_the_poses(layout: Path) -> None:
    recording = plugins.open_recording(layout)
    before = recording[0].world_from_camera.copy()
    with pytest.raises(ValueError, match="read-only"):
        recording[0].world_from_camera[0, 3] = 9
    assert np.array_equal(recording[0].world_from_camera, before)
