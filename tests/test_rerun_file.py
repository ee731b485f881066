"""A home as a Rerun file: what stands on its time line, where, and when; written whole or not at all."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.home import Home
from cartier.pipeline import map_home
from cartier.recordings.folder import save
from synthetic import THINGS, TrueBoxes, walk

rr = pytest.importorskip("rerun", reason="a Rerun file needs cartier[viz]")
FRAMES = len(walk())


@pytest.fixture(scope="module")
def home() -> Home:
    return map_home(walk(), TrueBoxes(THINGS))


@pytest.fixture
def logged(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[tuple[int | None, Any]]]:
    """What is logged by entity, with its frame, while it is written as ever."""
    calls: dict[str, list[tuple[int | None, Any]]] = defaultdict(list)

    class Listening(rr.RecordingStream):  # type: ignore[misc]
        frame: int | None = None

        def set_time(self, timeline: str, *, sequence: int) -> None:
            assert timeline == "frame"
            self.frame = sequence
            super().set_time(timeline, sequence=sequence)

        def log(self, entity: str, *what: Any, static: bool = False) -> None:
            calls[entity] += [(None if static else self.frame, one) for one in what]
            super().log(entity, *what, static=static)

    monkeypatch.setattr("rerun.RecordingStream", Listening)
    return calls


def of(kind: str, entries: list[tuple[int | None, Any]]) -> list[tuple[int | None, Any]]:
    return [(frame, one) for frame, one in entries if type(one).__name__ == kind]


def test_a_home_alone_shows_its_evidence(home: Home, tmp_path: Path, logged: dict[str, Any]) -> None:
    from cartier.rerun_file import write_rrd

    write_rrd(home, tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    boxes = of("Boxes3D", logged["home/objects/confirmed"])
    sure = [thing for thing in home.objects if thing.confirmed]
    (((frame, one),), middles) = boxes, np.array([thing.position for thing in sure])
    assert frame is None and np.abs(np.array(one.centers.as_arrow_array().to_pylist()) - middles).max() < 1e-3
    frames = {view.frame for thing in home.objects for view in thing.views}
    assert {frame for frame, _ in of("Boxes2D", logged["camera/image/boxes"])} == frames
    assert {frame for frame, _ in of("EncodedImage", logged["camera/image"])} == frames & home.photos.keys()
    assert {frame for frame, _ in of("Clear", logged["camera/image/boxes"])} == {frame + 1 for frame in frames}
    assert of("Mesh3D", logged["home/floor_plan"]) and of("TextDocument", logged["about"])
    assert "camera" not in logged and "home/path" not in logged


def test_with_its_recording_every_frame_is_there(home: Home, tmp_path: Path, logged: dict[str, Any]) -> None:
    from cartier.rerun_file import write_rrd

    seen: list[tuple[int, int]] = []
    write_rrd(home, tmp_path / "a.rrd", walk(), lambda done, total: seen.append((done, total)))
    for entity, kind in (("camera", "Transform3D"), ("camera/image", "EncodedImage"), ("camera/depth", "DepthImage")):
        assert [frame for frame, _ in of(kind, logged[entity])] == list(range(FRAMES))
    assert seen[-1] == (FRAMES, FRAMES)
    ((_, path),) = of("LineStrips3D", logged["home/path"])
    strip = np.array(path.strips.as_arrow_array().to_pylist()[0])
    assert np.abs(strip - np.array([pose[:3, 3] for pose in walk().poses])).max() < 1e-5


def test_another_recording_and_a_folder_that_is_not_there_are_one_line(home: Home, tmp_path: Path) -> None:
    from cartier.rerun_file import write_rrd

    save(walk(with_depth=False), tmp_path / "other")
    from cartier.recordings import folder

    with pytest.raises(InputError, match="was not mapped from synthetic room as it is read now, but from"):
        write_rrd(home, tmp_path / "a.rrd", folder.open(tmp_path / "other"))
    with pytest.raises(InputError, match=r"a\.rrd cannot be written \(No such file or directory\)"):
        write_rrd(home, tmp_path / "nowhere" / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]
