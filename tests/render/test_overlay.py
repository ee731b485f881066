"""The overlay of boxes on frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from cartier.errors import InputError
from cartier.pipeline import map_home
from cartier.render.overlay import COLOURS, draw_overlay, placed_names
from synthetic import THINGS, RoomRecording, TrueBoxes, walk


def test_overlay_draws_boxes_of_confirmed_objects(tmp_path: Path) -> None:
    recording = walk()
    home = map_home(recording, TrueBoxes(THINGS))
    draw_overlay(home, recording, tmp_path / "boxes.png")
    picture = np.asarray(Image.open(tmp_path / "boxes.png").convert("RGB")).reshape(-1, 3)
    drawn = {colour for colour in COLOURS if (picture == colour).all(1).sum() > 50}
    assert drawn >= {COLOURS[obj.id % len(COLOURS)] for obj in home.objects if obj.confirmed}


def test_overlay_needs_the_mapped_recording_and_a_picture_format(tmp_path: Path) -> None:
    recording = walk()
    home = map_home(recording, TrueBoxes(THINGS))
    with pytest.raises(InputError, match=r"was not mapped from|its files or its reader changed"):
        draw_overlay(home, walk(with_depth=False), tmp_path / "boxes.png")
    with pytest.raises(InputError, match="no image format"):
        draw_overlay(home, recording, tmp_path / "boxes.xyz")
    assert not list(tmp_path.iterdir())


def test_names_lie_in_the_picture_and_not_on_each_other() -> None:
    home = map_home(walk(), TrueBoxes(THINGS))
    draw = ImageDraw.Draw(Image.new("RGB", (640, 480)))
    corners = np.random.default_rng(0).uniform((-200, -50), (800, 200), (30, 2))
    named = [(home.objects[k % len(home.objects)], corner) for k, corner in enumerate(corners)]
    boxes = np.array([box for *_, box in placed_names(draw, named)])
    assert (boxes[:, :2] >= 0).all() and (boxes[:, 2] < 640).all()
    apart = (boxes[:, None, :2] > boxes[None, :, 2:]).any(-1)
    assert (apart | apart.T | np.eye(len(boxes), dtype=bool)).all()


@pytest.mark.parametrize(("frames", "shown", "size"), [(1, 1, (640, 480)), (4, 3, (1920, 480)), (10, 5, (1280, 960))])
def test_rows_of_frames_are_full(tmp_path: Path, frames: int, shown: int, size: tuple[int, int]) -> None:
    recording = RoomRecording(walk().poses[:frames], THINGS)
    home = map_home(recording, TrueBoxes(THINGS))
    log = home.detections()
    assert log is not None and sum(len(of.objects) > 0 for of in log.looked().values()) == shown
    confirmed = tuple(replace(obj, confirmed=True) for obj in home.objects)
    draw_overlay(replace(home, objects=confirmed), recording, tmp_path / "b.png")
    with Image.open(tmp_path / "b.png") as picture:
        assert picture.size == size
