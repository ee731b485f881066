"""Recordings on object storage: mapped as from a folder, read frame by frame; what cannot be read is one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import cartier
from cartier.blob_stores import open_store
from cartier.errors import InputError
from cartier_fleet.jobs import find_tasks
from fleet.tiny import content_of, make_recordings, work

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")


@pytest.fixture
def recordings_there(s3: str, tmp_path: Path) -> str:
    """Tiny recordings on S3."""
    make_recordings(tmp_path / "walks", 2)
    place = f"{s3}/walks-{tmp_path.name}"
    for name, data in content_of(tmp_path / "walks").items():
        open_store(place).put(name, data)
    return place


def test_recordings_on_object_storage_are_mapped_as_from_a_folder(recordings_there: str, tmp_path: Path) -> None:
    """The same homes, bit for bit; running it again reads no frame; a changed recording is mapped again."""
    there, here = find_tasks(recordings_there), find_tasks(tmp_path / "walks")
    assert [task.name for task in there] == [task.name for task in here] == ["flat-1", "nested/flat-0"]
    stores = [open_store(str(tmp_path / name)) for name in ("there", "here")]
    assert [work(store, tasks) for store, tasks in zip(stores, (there, here), strict=True)] == [["mapped"] * 2] * 2
    homes = [content_of(tmp_path / name / "homes") for name in ("there", "here")]
    assert homes[0] == homes[1] and homes[0]
    assert work(stores[0], there) == ["finished"] * 2
    changed = open_store(recordings_there)
    held = changed.get("flat-1/rgb/000001.jpg")
    assert held is not None
    changed.put("flat-1/rgb/000000.jpg", held.data)
    assert work(stores[0], there, "two") == ["mapped", "finished"]


def test_map_reads_a_recording_on_object_storage(recordings_there: str, tmp_path: Path) -> None:
    place, output = f"{recordings_there}/flat-1", tmp_path / "home"
    command = [sys.executable, "-m", "cartier", "map", place, "-o", str(output), "--all"]
    subprocess.run([*command, "--detector", "ground_truth"], check=True, capture_output=True)
    recording = cartier.open_recording(tmp_path / "walks" / "flat-1")
    assert cartier.Home.load(output).settings["recordings"][0]["sha256"] == recording.fingerprint()
    assert cartier.open_recording(place).fingerprint() == recording.fingerprint(), "without a frame read before"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("recording.json", "recording.json is missing: on object storage, cartier reads recordings in its own format"),
        ("rgb/000001.jpg", "000001.jpg is missing"),
        ("depth/000003.png", "000003.png is missing"),
    ],
)
def test_what_is_no_recording_there_is_one_line(recordings_there: str, change: str, line: str) -> None:
    open_store(recordings_there).delete(f"flat-1/{change}")
    with pytest.raises(InputError, match=line):
        cartier.open_recording(f"{recordings_there}/flat-1")
    with pytest.raises(InputError, match="not rosbag"):
        cartier.open_recording(f"{recordings_there}/flat-1", "rosbag")
    with pytest.raises(InputError, match="holds no recording in cartier's own format"):
        find_tasks(f"{recordings_there}/flat-1/rgb")
