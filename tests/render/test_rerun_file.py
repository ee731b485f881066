"""A home as a Rerun file: what stands on its time line, where, and when; written whole or not at all."""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.home import Home
from cartier.pipeline import map_home
from cartier.recordings.folder import save
from cartier.types import UNKNOWN, Detections, Frame
from synthetic import THINGS, TrueBoxes, walk

rr = pytest.importorskip("rerun", reason="a Rerun file needs cartier[viz]")
FRAMES = len(walk())
UNSEEN = (176, 176, 172)


@pytest.fixture(scope="module")
def home() -> Home:
    return map_home(walk(), TrueBoxes(THINGS))


@pytest.fixture
def logged(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[tuple[int | None, Any]]]:
    """What is logged by entity, with its frame, while it is written as ever."""
    calls: dict[str, list[tuple[int | None, Any]]] = defaultdict(list)

    class Listening(rr.RecordingStream):  # type: ignore[misc, name-defined]
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


def arrays(one: Any) -> np.ndarray:
    return np.array(one.as_arrow_array().to_pylist())


def test_a_home_alone_shows_its_evidence(home: Home, tmp_path: Path, logged: dict[str, Any]) -> None:
    from cartier.render.rerun_file import write_rrd

    write_rrd(home, tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    frames = {view.frame for obj in home.objects for view in obj.views}
    assert {frame for frame, _ in of("LineStrips3D", logged["home/sight"])} == frames
    assert {frame for frame, _ in of("EncodedImage", logged["camera/image"])} == home.photos.keys()  # of sides, too
    assert [frame for frame, _ in of("Mesh3D", logged["home/floor_plan"])] == [0] and of(
        "TextDocument", logged["about"]
    )
    assert "camera" not in logged and "home/path" not in logged
    seen = home.cloud()
    assert seen is not None
    ((_, points),) = of("Points3D", logged["home/points"])
    assert np.allclose(arrays(points.positions), seen.xyz_m, atol=1e-4) and len(points.colors) == len(seen.rgb)


def test_photos_without_a_pose_are_kept_out_of_the_3d_view(home: Home) -> None:
    from cartier.render.rerun_file import blueprint

    def space(posed: bool) -> Any:
        return blueprint(posed).root_container.contents[0]

    assert "- /camera/**" in space(False).contents and "- /camera/**" not in space(True).contents


def test_every_box_of_every_frame_that_was_looked_at_is_there(tmp_path: Path, logged: dict[str, Any]) -> None:
    from cartier.render.rerun_file import write_rrd

    class Blinking(TrueBoxes):
        """Detects nothing in one frame, and a false positive in another."""

        def detect(self, frame: Frame) -> Detections:
            found = super().detect(frame)
            if frame.index == 6:
                return found.keep(np.zeros(len(found), bool))
            if frame.index == 9:
                return Detections(9, np.array([[0, 0, 2, 2]]), np.array([0.1]), ("ghost",))
            return found

    detector = Blinking(THINGS)
    detector.score_model = replace(TrueBoxes.score_model, spawn_threshold=0.2)
    home = map_home(walk(), detector, every=3)
    write_rrd(home, tmp_path / "a.rrd")
    asked = {number: detector.detect(walk()[number]) for number in range(0, FRAMES, 3)}
    shown = dict(of("Boxes2D", logged["camera/image/boxes"]))
    assert shown.keys() == {number for number, found in asked.items() if len(found)} and 6 not in shown
    for number, boxes in shown.items():
        assert sorted(arrays(boxes.half_sizes).tolist()) == sorted(
            ((box[2:] - box[:2]) / 2).tolist() for box in asked[number].boxes_xyxy
        )
        if number != 9:
            labels = boxes.labels.as_arrow_array().to_pylist()
            for label, _, owner in (re.fullmatch(r"(.+) (\d\.\d\d), object (\d+)", text).groups() for text in labels):
                assert next(obj for obj in home.objects if obj.id == int(owner)).label == label
    assert shown[9].labels.as_arrow_array().to_pylist() == ["ghost 0.10, no object"]
    texts = {frame: arrays(one.text)[0] for frame, one in of("TextDocument", logged["processed"])}
    processed = {frame: text.startswith("processed") for frame, text in texts.items()}
    assert processed == {n: n % 3 == 0 for n in range(FRAMES) if n % 3 < 2}, "what is said holds until the next is"
    assert texts[6] == "processed frame 6: 0 boxes, 0 of objects of this home"
    cleared = {frame for frame, _ in of("Clear", logged["camera/image/boxes"])}
    assert cleared == {n for n in processed if n not in shown}


def test_objects_appear_with_their_first_box_and_rooms_are_areas(home: Home, tmp_path: Path, logged: Any) -> None:
    from cartier.render.rerun_file import write_rrd

    write_rrd(home, tmp_path / "a.rrd")
    first: dict[str, int] = {}
    for number in reversed(range(FRAMES)):
        first |= dict.fromkeys(TrueBoxes(THINGS).detect(walk()[number]).labels, number)
    for obj in home.objects:
        ((frame, one),) = logged[f"home/objects/{'confirmed' if obj.confirmed else 'tentative'}/{obj.id}"]
        assert frame == first[obj.label] and np.abs(arrays(one.centers)[0] - obj.position).max() < 1e-3
    ((_, plan),) = logged["home/floor_plan"]
    assert home.grid is not None and home.rooms
    known = np.argwhere(home.grid.cells != UNKNOWN)
    (top, left), (bottom, right) = known.min(axis=0), known.max(axis=0) + 1
    picture = arrays(plan.albedo_texture_buffer)[0].reshape(bottom - top, right - left, 3)
    colourful = np.ptp(picture.astype(int), axis=2) > 20
    inside = np.zeros(home.grid.cells.shape, bool)
    for room in home.rooms:
        inside[tuple(room.cells.T)] = True
    assert (colourful == inside[top:bottom, left:right]).all() and colourful.sum() == inside.sum()
    corners = arrays(plan.vertex_positions)[[0, 2], :2]
    side = home.grid.resolution_m
    wanted = home.grid.origin_xy + side * np.array([(left, top), (right, bottom)])
    assert np.abs(corners - wanted).max() < 1e-4


def test_with_its_recording_every_frame_is_there(home: Home, tmp_path: Path, logged: dict[str, Any]) -> None:
    from cartier.render.rerun_file import write_rrd

    seen: list[tuple[int, int]] = []
    write_rrd(home, tmp_path / "a.rrd", walk(), lambda done, total: seen.append((done, total)))
    for entity, kind in (("camera", "Transform3D"), ("camera/image", "EncodedImage"), ("camera/depth", "DepthImage")):
        assert [frame for frame, _ in of(kind, logged[entity])] == list(range(FRAMES))
    assert seen[-1] == (FRAMES, FRAMES)
    places = np.array([pose[:3, 3] for pose in walk().poses])
    for frame, path in of("LineStrips3D", logged["home/path"]):
        assert np.abs(np.array(arrays(path.strips)[0]) - places[: frame + 1]).max() < 1e-5
    plans = of("Mesh3D", logged["home/floor_plan"])
    known = [(arrays(one.albedo_texture_buffer)[0].reshape(-1, 3) != UNSEEN).any(axis=1).sum() for _, one in plans]
    assert [frame for frame, _ in plans] == list(range(FRAMES)) and known[0] < 0.8 * known[-1]
    batch_size = defaultdict(list, logged)
    logged.clear()
    write_rrd(home, tmp_path / "a.rrd")
    alone, last = (of("Mesh3D", calls["home/floor_plan"])[-1][1] for calls in (logged, batch_size))
    assert (arrays(alone.albedo_texture_buffer) == arrays(last.albedo_texture_buffer)).all()


def test_another_recording_and_a_folder_that_is_not_there_are_one_line(home: Home, tmp_path: Path) -> None:
    from cartier.render.rerun_file import write_rrd

    save(walk(with_depth=False), tmp_path / "other")
    from cartier.recordings import folder

    with pytest.raises(InputError, match="was mapped from synthetic room, but its files or its reader changed"):
        write_rrd(home, tmp_path / "a.rrd", folder.open(tmp_path / "other"))
    elsewhere = replace(walk(with_depth=False), name="elsewhere")
    with pytest.raises(InputError, match="was not mapped from elsewhere, but from synthetic room: give that"):
        write_rrd(home, tmp_path / "a.rrd", elsewhere)
    (tmp_path / "plain").write_bytes(b"")
    with pytest.raises(InputError, match=r"a\.rrd cannot be written"):
        write_rrd(home, tmp_path / "plain" / "a.rrd")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "plain"]
