"""What every recording format owes its reader, over every layout that the tests can write."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from layouts import LAYOUTS, room

from cartier import plugins
from cartier.errors import InputError
from cartier.geometry import backproject, box_distance, transform
from cartier.recordings import folder
from cartier.testing import check_recording
from cartier.types import TrueObject
from synthetic import ROOM

COLOURS = (
    "rgb/*",
    "*.color.*",
    "color/*",
    "results/frame*",
    "images/*",
    "rgbd/*.jpg",
    "keyframes/images/*",
    "frame_*.jpg",
    "*_rgb/*",
)


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Writes a layout the first time that it is asked for; nobody may change it."""

    @cache
    def write(name: str) -> Path:
        path = tmp_path_factory.mktemp("written") / "home"
        LAYOUTS[name](path)
        return path

    return write


def copied(whole: Path, tmp_path: Path) -> Path:
    (shutil.copytree if whole.is_dir() else shutil.copy)(whole, tmp_path / "home")
    return tmp_path / "home"


@pytest.fixture(params=LAYOUTS)
def layout(request: pytest.FixtureRequest, written: Callable[[str], Path], tmp_path: Path) -> Path:
    """A copy of a layout, to be changed at will."""
    return copied(written(request.param), tmp_path)


LIKE_ANOTHER = ("-without-depth", "-simulator", "-png", "-zstd", "-bz2")  # the same kinds of files, or fewer of them


@pytest.fixture(
    params=[pytest.param(n, marks=pytest.mark.slow) if n.endswith(LIKE_ANOTHER) else pytest.param(n) for n in LAYOUTS]
)
def files(request: pytest.FixtureRequest, written: Callable[[str], Path], tmp_path: Path) -> Path:
    """The same, for what is done to one file after the other: by default once for each set of kinds of files."""
    return copied(written(request.param), tmp_path)


def test_every_format_is_under_the_laws() -> None:
    """But for a spool, which is one file that this program wrote: tests/io/test_spool.py holds it to its laws."""
    assert {b.name for b in plugins.backends("recordings")} - {"spool"} == {name.split("-")[0] for name in LAYOUTS}


def test_the_readers_take_a_file_of_the_right_name_for_nothing_else(tmp_path: Path) -> None:
    """Whatever the suffix, asking each format about a file or an empty folder neither raises nor says yes."""
    names = [
        "a.db",
        "a.db3",
        "a.bag",
        "a.mcap",
        "a.r3d",
        "cameras.txt",
        "transforms.json",
        "keyframes",
        "frame_00000.json",
    ]
    for name in names:
        (tmp_path / name).write_bytes(b"")
    for path in (tmp_path / "empty", *(tmp_path / name for name in names)):
        (tmp_path / "empty").mkdir(exist_ok=True)
        said = [b.name for b in plugins.backends("recordings") if plugins._load("recordings", b.name).matches(path)]
        assert said in ([], ["rosbag"], ["record3d"])


def test_exactly_one_format_recognises_it(layout: Path) -> None:
    formats = [b.name for b in plugins.backends("recordings")]
    recognised = [f for f in formats if plugins._load("recordings", f).matches(layout)]
    assert len(recognised) == 1


def test_it_obeys_the_laws_of_every_recording(layout: Path) -> None:
    check_recording(lambda: plugins.open_recording(layout))
    assert len(plugins.open_recording(layout)) == len(room())


def test_what_is_seen_lies_where_the_room_is(layout: Path) -> None:
    """The whole chain of axes, units, intrinsics and worlds at once: back-projected points lie on the room's
    surfaces."""
    for frame in plugins.open_recording(layout):
        assert np.abs(frame.rgb.astype(int) - room()[frame.index].rgb).mean() < 8
        if frame.depth_m is None:
            assert abs(frame.world_from_camera[2, 3] - 1.5) < 0.02
            continue
        points = transform(
            frame.world_from_camera, backproject(frame.depth_m, frame.camera, 3).reshape(-1, 3).astype(float)
        )
        low, high = np.array(ROOM[0]), np.array(ROOM[1])
        walls_m = np.minimum(np.abs(points - low), np.abs(points - high)).min(axis=1)
        boxes_m = [surface_distance(points, obj) for obj in room().objects]
        off_m = np.minimum.reduce([walls_m, *boxes_m])
        assert np.median(off_m) < 0.02 and (off_m < 0.05).mean() > 0.97


def surface_distance(points: np.ndarray, obj: TrueObject) -> np.ndarray:
    """How far points are from the surface of a box, from within or without."""
    low, high = np.array(obj.box_min), np.array(obj.box_max)
    outside = box_distance(points, low, high)
    return np.where(outside > 0, outside, np.minimum(points - low, high - points).min(axis=1))


def test_it_converts_to_our_own_format(layout: Path, tmp_path: Path) -> None:
    """What ``cartier convert`` does."""
    source = plugins.open_recording(layout)
    folder.save(source, tmp_path / "ours")
    ours = plugins.open_recording(tmp_path / "ours", format="folder")
    assert (ours.camera, list(ours.notes), len(ours)) == (source.camera, list(source.notes), len(source))
    for a, b in zip(source, ours, strict=True):
        assert a.time_s == b.time_s
        assert np.abs(a.world_from_camera - b.world_from_camera).max() < 1e-12
        assert (a.depth_m is None) == (b.depth_m is None)
        if a.depth_m is not None and b.depth_m is not None:
            assert np.array_equal(np.isnan(a.depth_m), np.isnan(b.depth_m))
            assert np.nanmax(np.abs(a.depth_m - b.depth_m)) < 0.00051


def test_there_is_no_frame_outside(layout: Path) -> None:
    recording = plugins.open_recording(layout)
    for index in (-1, 4, 10**9):
        with pytest.raises(IndexError, match="frames 0 to 3"):
            recording[index]


def test_the_fingerprint_covers_every_kind_of_file_and_no_place(files: Path, tmp_path: Path) -> None:
    before = plugins.open_recording(files).fingerprint()
    assert len(before) == 64
    moved = tmp_path / "elsewhere" / "home"
    shutil.copytree(files, moved)
    assert plugins.open_recording(moved).fingerprint() == before
    for path in one_of_each(files):
        content = path.read_bytes()
        recording = plugins.open_recording(files)
        path.write_bytes(content + b" ")
        assert recording.fingerprint() != before, path.name
        path.write_bytes(content)
    assert plugins.open_recording(files).fingerprint() == before


def one_of_each(layout: Path) -> list[Path]:
    """One file of each kind."""
    return list({(p.parent, *p.suffixes[-2:]): p for p in sorted(layout.rglob("*")) if p.is_file()}.values())


def test_a_pipe_or_a_folder_in_place_of_a_file_is_as_good_as_none(files: Path, tmp_path: Path) -> None:
    """Nothing hangs: who reads a pipe that nobody writes to waits for ever."""
    before = plugins.open_recording(files).fingerprint()
    for path in one_of_each(files):
        path.rename(tmp_path / "kept")
        for other in (os.mkfifo, os.mkdir):
            other(path)
            try:
                recording = plugins.open_recording(files)  # some formats leave out frames that lack an image
                assert len(list(recording)) and recording.fingerprint() != before
            except InputError as error:
                assert "\n" not in str(error)
            path.rmdir() if path.is_dir() else path.unlink()
        (tmp_path / "kept").rename(path)
    assert plugins.open_recording(files).fingerprint() == before


def test_links_are_read_and_those_out_of_the_folder_are_noted(files: Path, tmp_path: Path) -> None:
    """Whoever shares a map shares what the links lead to, and has to know."""
    before, noted = plugins.open_recording(files).fingerprint(), "out of the recording's folder, such as "
    for path in one_of_each(files):
        name = path.relative_to(files).as_posix()
        for target in (tmp_path / path.name, files / f".{path.name}"):
            path.rename(target)
            path.symlink_to(target)
            recording = plugins.open_recording(files)
            assert recording.fingerprint() == before
            notes = [note for note in recording.notes if noted in note]
            out = f"1 file is a link that leads {noted}{name}"
            assert notes == ([] if target.parent == files else [out])
            path.unlink()
            target.rename(path)
    for folder_of in {path.parent for path in one_of_each(files)} - {files}:
        folder_of.rename(tmp_path / folder_of.name)
        folder_of.symlink_to(tmp_path / folder_of.name)
        recording = plugins.open_recording(files)
        assert recording.fingerprint() == before
        assert sum(noted in note for note in recording.notes) == 1
        folder_of.unlink()
        (tmp_path / folder_of.name).rename(folder_of)
    files.rename(tmp_path / "moved")
    files.symlink_to(tmp_path / "moved")  # the person's own link to the whole of it is no link in it
    recording = plugins.open_recording(files)
    assert recording.fingerprint() == before and not any(noted in note for note in recording.notes)


def test_a_link_to_a_device_or_to_nothing_is_as_good_as_no_file(files: Path, tmp_path: Path) -> None:
    before = plugins.open_recording(files).fingerprint()
    for path in one_of_each(files):
        path.rename(tmp_path / "kept")
        for target in ("/dev/zero", tmp_path / "gone", path.name):
            path.symlink_to(target)
            try:
                recording = plugins.open_recording(files)  # some formats leave out frames that lack an image
                assert len(list(recording)) and recording.fingerprint() != before
            except InputError as error:
                assert "\n" not in str(error)
            path.unlink()
        (tmp_path / "kept").rename(path)


def test_opening_decodes_no_colour_and_a_damaged_image_costs_one_frame(layout: Path) -> None:
    colours = [path for pattern in COLOURS for path in layout.glob(pattern)]
    if not colours:
        pytest.skip("its images are inside of another file")
    for path in colours:
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
