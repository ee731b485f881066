"""The options of the commands that open recordings."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest
from layouts import LAYOUTS, room, write_sevenscenes
from typer.testing import CliRunner

from cartier import plugins
from cartier.cli import app
from cartier.cli._reader import OPTIONS
from cartier.errors import InputError

COMMANDS = ("map", "doctor", "convert")


def test_whatever_a_reader_takes_every_command_offers() -> None:
    taken = {"format"}
    for backend in plugins.backends("recordings"):
        taken |= set(inspect.signature(plugins._load("recordings", backend.name).open).parameters) - {"path"}
    assert taken == set(OPTIONS)
    for command in COMMANDS:
        shown = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output
        assert all(f"{option} " in shown for option, _, _ in OPTIONS.values())


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
