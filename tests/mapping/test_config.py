"""Mapping configuration: files, bounds, what each part changes in a map, and what a home keeps of it."""

from __future__ import annotations

import sys
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier import cli
from cartier.errors import InputError
from cartier.home import Home
from cartier.mapping.config import DEFAULT_CONFIG, MappingConfig, read_config
from cartier.mapping.mapper import Mapper
from cartier.pipeline import map_home
from cartier.recordings.folder import save
from cartier.types import Detections, Frame
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk
from synthetic import walk as large_walk


def changed(**values: float) -> MappingConfig:
    """The defaults but for values named ``section__name``."""
    nested: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        section, name = key.split("__")
        nested.setdefault(section, {})[name] = value
    return MappingConfig.from_dict(nested)


def all_changed() -> MappingConfig:
    """Every number another one, within its bounds."""
    nested: dict[str, Any] = {}
    for part in fields(MappingConfig):
        section = getattr(DEFAULT_CONFIG, part.name)
        for each in fields(section):
            (low, high), value = each.metadata["bounds"], getattr(section, each.name)
            other = value + 1 if isinstance(value, int) else (value + (high if value < high else low)) / 2
            nested.setdefault(part.name, {})[each.name] = other
    return MappingConfig.from_dict(nested)


def test_every_number_survives_a_file(tmp_path: Path) -> None:
    config = all_changed()
    assert config.differences() == asdict(config), "each number differs from its default"
    lines = [
        line
        for section, values in asdict(config).items()
        for line in (f"[{section}]", *(f"{name} = {value!r}" for name, value in values.items()))
    ]
    (tmp_path / "all.toml").write_text("\n".join(lines))
    assert read_config(tmp_path / "all.toml") == config == MappingConfig.from_dict(config.differences())
    assert DEFAULT_CONFIG.differences() == {} and MappingConfig.from_dict({}) == DEFAULT_CONFIG


BAD = {
    "[association]\nthreshhold = 0.7": "unknown key association.threshhold: did you mean association.threshold?",
    "[asociation]\nthreshold = 0.7": "unknown key asociation: did you mean association?",
    "threshold = 0.7": "unknown key threshold: did you mean",
    "association = 0.7": "association must be a table of numbers, got 0.7",
    '[association]\nthreshold = "high"': "association.threshold must be a number from 0 to 1.35, got high",
    "[association]\nthreshold = true": "association.threshold must be a number",
    "[association]\nthreshold = nan": "association.threshold must be a number",
    "[association]\nthreshold = 2": "association.threshold must be a number from 0 to 1.35, got 2",
    "[merging]\ninterval_frames = 2.5": "merging.interval_frames must be a whole number from 1 to 10000, got 2.5",
    "[association\nthreshold = 0.7": "not valid TOML",
    "\x00\xff": "not valid TOML",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files_are_one_line(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    words = ["cartier", "map", str(tmp_path / "no_recording"), "-o", str(tmp_path / "home"), "--config", str(file)]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    error = capsys.readouterr().err
    assert ended.value.code == 1 and error.count("\n") == 1 and "Traceback" not in error
    assert BAD[text] in error and str(file) in error, "the file is read before the recording, which is missing"


def test_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.toml is missing"):
        read_config(tmp_path / "none.toml")


class Misses(TrueBoxes):
    """Finds nothing in each third frame."""

    def detect(self, frame: Frame) -> Detections:
        found = super().detect(frame)
        return found.keep(np.zeros(0, int)) if frame.index % 3 == 2 else found


@pytest.fixture(scope="module")
def usual() -> Home:
    return map_home(walk(), Misses(THINGS), mend_poses=False)


CHANGES: dict[str, dict[str, float]] = {
    "a match needs more than can be": {"association__threshold": 1.35},
    "labels count nothing": {"association__label_weight": 0.0, "association__threshold": 0.9},
    "less in view is observable": {"existence__min_in_view_share": 0.1},
    "extents grow at once": {"extent__grow_rate": 1.0},
    "one view that has a point is enough": {"extent__min_agreement": 0.0},
    "rare objects are pruned": {"merging__prune_max_detected": 4, "merging__prune_min_observable": 5},
    "coarse cells": {"occupancy__resolution_m": 0.1},
    "short depth": {"occupancy__range_m": 1.5},
    "larger keyframe steps": {"keyframes__distance_m": 5.0, "keyframes__angle_deg": 90.0},
    "nothing is a wall": {"rooms__min_wall_height_m": 5.0},
}


def fingerprint(home: Home) -> tuple[object, ...]:
    assert home.grid is not None
    looked = home.settings["recordings"][0]["looked"]
    rooms = [(room.name, room.cells.tobytes()) for room in home.rooms]
    return home.objects, home.growth["object_map.npz"], home.grid.cells.tobytes(), home.grid.resolution_m, rooms, looked


@pytest.mark.parametrize("case", CHANGES)
def test_changed_number_changes_the_map(case: str, usual: Home) -> None:
    recording = walk()
    if "keyframe" in case:  # frames close together, of which keyframes are picked
        recording = RoomRecording([pose for pose in recording.poses[:4] for _ in range(3)], THINGS)
        for k, pose in enumerate(recording.poses):
            recording.poses[k] = pose.copy()
            recording.poses[k][0, 3] += 0.05 * (k % 3)
        usual = map_home(recording, Misses(THINGS), mend_poses=False)
    if "pruned" in case:  # by a camera that sees enough for some to be rare
        recording = large_walk()
        usual = map_home(recording, Misses(THINGS), mend_poses=False)
    config = changed(**CHANGES[case])
    home = map_home(recording, Misses(THINGS), config=config, mend_poses=False)
    assert fingerprint(home) != fingerprint(usual)
    assert home.settings["config"] == config.differences() and home.id != usual.id


def test_defaults_leave_no_trace(usual: Home) -> None:
    again = map_home(walk(), Misses(THINGS), config=MappingConfig(), mend_poses=False)
    assert "config" not in usual.settings and again.id == usual.id and fingerprint(again) == fingerprint(usual)


def test_home_grows_with_its_configuration(tmp_path: Path) -> None:
    config = changed(occupancy__resolution_m=0.1)
    map_home(walk(), TrueBoxes(THINGS), config=config).save(tmp_path)
    home = Home.load(tmp_path)
    assert Mapper(TrueBoxes(THINGS), onto=home).config == config
    more = RoomRecording(walk().poses[::-3], THINGS)
    grown = map_home(more, TrueBoxes(THINGS), onto=home, config=config)
    assert (
        grown.grid is not None and grown.grid.resolution_m == 0.1 and grown.settings["config"] == config.differences()
    )
    with pytest.raises(InputError, match=r"was mapped with occupancy.resolution_m = 0.1, not 0.05"):
        map_home(more, TrueBoxes(THINGS), onto=home, config=MappingConfig())
    with pytest.raises(InputError, match="no sound configuration"):
        Mapper(TrueBoxes(THINGS), onto=replace(home, settings={**home.settings, "config": {"rooms": 3}}))


def test_command_line_takes_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save(walk(), tmp_path / "room")
    (tmp_path / "my.toml").write_text("[occupancy]\nresolution_m = 0.1\n")
    detector = str(Path(__file__).parents[1] / "slow_detector.py")
    words = ["cartier", "map", tmp_path / "room", "-o", tmp_path / "home", "--detector", detector]
    monkeypatch.setattr(sys, "argv", [str(word) for word in [*words, "--config", tmp_path / "my.toml"]])
    with pytest.raises(SystemExit):
        cli.main()
    home = Home.load(tmp_path / "home")
    assert home.grid is not None and home.grid.resolution_m == 0.1, capsys.readouterr().err
    assert np.isclose(home.settings["config"]["occupancy"]["resolution_m"], 0.1)
