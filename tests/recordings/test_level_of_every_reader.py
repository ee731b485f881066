"""Any turn and shift of the world gives the same home: what a map gets of a recording is level, whoever reads it."""

from __future__ import annotations

from pathlib import Path

import layouts
import numpy as np
import pytest
from layouts import LAYOUTS

from cartier import plugins
from cartier.mapping.samples import sample
from cartier.mapping.upright import upright
from lying import lying, world
from synthetic import TrueBoxes

WORLDS = {
    "low": ((0, 0, 0), (0.3, -2.0, -0.93)),
    "leaning": ((0.4, 0.3, 0), (1.0, 2.0, 3.0)),
    "on its side": ((0, np.pi / 2, 0.5), (-1.0, 0.0, 0.4)),
    "upside down": ((np.pi, 0, 0), (0.0, 0.0, 2.0)),
}
WITH_DEPTH = [name for name in LAYOUTS if "without-depth" not in name and not name.startswith("colmap")]
KEPT = ("-png", "-zstd", "-bz2", "-ros1", "-sqlite3", "-video", "-simulator")
FRAMES = 8


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n.endswith(KEPT) else n for n in WITH_DEPTH]
)
def test_a_world_that_lies_otherwise_is_levelled(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    poses = {}
    for lies, (rotation, shift) in {"sound": ((0, 0, 0), (0, 0, 0)), **WORLDS}.items():
        there = lying(world(rotation, shift), frames=FRAMES)
        monkeypatch.setattr(layouts, "room", lambda there=there: there)
        monkeypatch.setattr(layouts, "seen", lambda there=there: there)
        LAYOUTS[name](tmp_path / lies)
        recording = upright(plugins.open_recording(tmp_path / lies), TrueBoxes(()))
        assert recording.levelled.turns == 0
        poses[lies] = sample(recording, numbers=list(range(FRAMES))).poses
    for lies in WORLDS:
        sound, level = poses["sound"], poses[lies]
        assert np.abs(level[:, 2, :3] - sound[:, 2, :3]).max() < 0.02, lies
        assert np.abs(level[:, 2, 3] - sound[:, 2, 3]).max() < 0.05, lies
