"""The options of the commands that open recordings."""

from __future__ import annotations

import inspect
from dataclasses import fields
from pathlib import Path

import pytest
from layouts import LAYOUTS, room, write_sevenscenes
from typer.testing import CliRunner

from cartier import pipeline, plugins
from cartier.cli import app
from cartier.cli.reader_options import Reader, as_mapped, remembered
from cartier.errors import InputError
from cartier.home import Home
from cartier.types import Detections, Frame
from synthetic import THINGS, TrueBoxes

COMMANDS = ("map", "doctor", "convert")


def test_whatever_a_reader_takes_every_command_offers() -> None:
    taken = {"format"}
    for backend in plugins.backends("recordings"):
        taken |= set(inspect.signature(plugins._load("recordings", backend.name).open).parameters) - {"path"}
    own = {field.name for field in fields(Reader)}
    assert taken == own
    for command in COMMANDS:
        shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output
        assert all(f"--{name.removesuffix('_m')} " in shown for name in own)


def test_the_options_reach_the_reader(tmp_path: Path) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    told = ["--up", "0,0,1", "--floor", "-0.5", "--format", "sevenscenes"]
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "a"), "-o", str(tmp_path / "b"), *told])
    assert done.exit_code == 0
    ours = plugins.open_recording(tmp_path / "b")
    assert abs(ours[0].world_from_camera[2, 3] - room()[0].world_from_camera[2, 3] - 0.5) < 1e-9


@pytest.mark.parametrize("command", COMMANDS)
def test_an_option_of_another_format_is_one_line(tmp_path: Path, command: str) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    args = {"map": ["--detector", "embedded", "-o", "h"], "convert": ["-o", "h"], "doctor": []}[command]
    done = CliRunner().invoke(app, [command, str(tmp_path / "a"), "--odometry", "/odom", *args])
    assert "'sevenscenes' has no option 'odometry'; it has up, floor_m" in str(done.exception)
    done = CliRunner().invoke(app, [command, str(tmp_path / "a"), "--up", "0,0", *args])
    assert isinstance(done.exception, InputError) and "--up needs 3 finite numbers" in str(done.exception)


class Told(TrueBoxes):
    """The true boxes of what a format without instances kept of the room."""

    def detect(self, frame: Frame) -> Detections:
        return super().detect(room()[frame.index])


def test_a_home_remembers_what_its_recording_was_read_with(tmp_path: Path) -> None:
    write_sevenscenes(room(), tmp_path / "a")
    home = tmp_path / "home"
    source = plugins.open_recording(tmp_path / "a", format="sevenscenes", up=[0, 0, 1], floor_m=-0.5)
    pipeline.map_home(source, Told(THINGS)).save(home)
    mapped = Home.load(home)
    assert mapped.settings["recordings"][0]["read_with"] == {"format": "sevenscenes", "up": [0, 0, 1], "floor_m": -0.5}
    again = as_mapped(mapped, tmp_path / "a")
    assert again.fingerprint() == source.fingerprint() != plugins.open_recording(tmp_path / "a").fingerprint()


def test_what_a_reader_of_ones_own_read_needs_its_format_again(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text("from cartier_bench.datasets.sevenscenes import open\n")
    write_sevenscenes(room(), tmp_path / "a")
    pipeline.map_home(plugins.open_recording(tmp_path / "a", format=str(mine)), Told(THINGS)).save(tmp_path / "home")
    mapped = Home.load(tmp_path / "home")
    assert mapped.settings["recordings"][0]["read_with"] == {"format": str(mine)}
    assert as_mapped(mapped, tmp_path / "a", str(mine)).read_with == {"format": str(mine)}
    assert as_mapped(mapped, tmp_path / "a").read_with == {}, "the home's word for a file of code is not enough"


def test_a_strangers_home_gives_a_reader_nothing_but_plain_options(tmp_path: Path) -> None:
    evil = tmp_path / "evil.py"
    evil.write_text("raise SystemExit('it ran')")
    assert remembered({"format": str(evil), "root": "/", "confidence": "x", "up": "abc", "camera": [[1]]}) == {}
    assert remembered({"floor_m": 1, "camera": [1.5, 2], "up": [0, 0, 1], "confidence": 0, "format": "tum"}) == {
        "floor_m": 1, "camera": [1.5, 2], "up": [0, 0, 1], "confidence": 0, "format": "tum",
    }  # fmt: skip
    assert remembered(None) == remembered([1]) == {}


@pytest.mark.parametrize(("name", "highest"), [("stray", 2), ("scannerapp", 2), ("polycam", 255), ("arcore", 255)])
def test_a_confidence_that_the_format_does_not_have_is_refused(tmp_path: Path, name: str, highest: int) -> None:
    LAYOUTS[name](tmp_path / "a")
    for wrong in (-1, highest + 1):
        with pytest.raises(InputError, match=f"--confidence {wrong}: .* has confidences of 0 to {highest}$"):
            plugins.open_recording(tmp_path / "a", confidence=wrong)
    assert len(plugins.open_recording(tmp_path / "a", confidence=highest)) == 4


@pytest.mark.parametrize("name", ["stray", "sevenscenes", "rosbag-mcap"])
def test_a_floor_above_every_camera_is_refused(tmp_path: Path, name: str) -> None:
    if name == "rosbag-mcap":
        pytest.importorskip("rosbags")
    LAYOUTS[name](tmp_path / "a")
    highest_m = max(pose[2, 3] for pose in room().poses)
    up = {} if name == "stray" else {"up": (0, 0, 1)}
    with pytest.raises(InputError, match=f"--floor 99 lies above every camera: the highest is at {highest_m:.2f} m"):
        plugins.open_recording(tmp_path / "a", floor_m=99, **up)
    assert len(plugins.open_recording(tmp_path / "a", floor_m=highest_m - 0.01, **up)) == 4
