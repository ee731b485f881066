"""The overlay of boxes on frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cartier.errors import InputError
from cartier.pipeline import map_home
from cartier.render.overlay import COLOURS, draw_overlay
from synthetic import THINGS, TrueBoxes, walk


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
