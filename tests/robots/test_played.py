"""Robot of the dollhouse on ROS 2 topics, in this process: seen by the source ros2, driven by the robot ros2."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from peers import HOME, LOOPBACK, any_domain, goal_at

from cartier import plugins
from cartier.errors import CartierError
from cartier.sources import open_source
from cartier.testing import check_robot
from cartier.types.streams import Stamped
from cartier_dollhouse.recording import lit_renderer, pinhole
from cartier_dollhouse.scene import load_home

for needed in ("cyclonedds", "rosbags"):
    pytest.importorskip(needed, reason="needs cartier[ros]")

if TYPE_CHECKING:
    from cartier_ros.robots.played import PlayedRobot

SMALL = pinhole(160, 120)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return any_domain()


@pytest.fixture
def robot(domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[PlayedRobot]:
    from cartier_ros.robots import played

    monkeypatch.setattr(played, "pinhole", lambda: SMALL)
    (tmp_path / "tiny.yaml").write_text(HOME)
    robot = played.PlayedRobot(load_home(str(tmp_path / "tiny.yaml")), domain)
    thread = threading.Thread(target=robot.run)
    thread.start()
    yield robot
    robot.close()
    thread.join(10)
    assert not thread.is_alive()


def test_what_it_shows_is_where_it_stands(robot: PlayedRobot, domain: int) -> None:
    source, frames = open_source("ros2", domain=domain), list[Stamped]()
    patience = threading.Timer(20, source.close)
    patience.start()
    for event in source:
        if isinstance(event, Stamped):
            frames.append(event)
        if len(frames) == 3:
            source.close()
    patience.cancel()
    assert source.world_frame == "map"
    frame = frames[-1].frame
    view = lit_renderer(robot.scene, SMALL).render(frame.world_from_camera)
    assert frame.depth_m is not None
    seen = np.isfinite(frame.depth_m) & (frame.depth_m > 0)
    assert seen.mean() > 0.9 and np.abs(frame.depth_m - view.depth_m)[seen].max() < 0.002
    assert np.array_equal(frame.rgb, view.rgb)


def test_it_obeys_as_a_robot(robot: PlayedRobot, domain: int) -> None:
    goal = goal_at(1.4, 2.0, 1.0)
    check_robot(lambda: plugins.make("robots", "ros2", domain=domain, timeout_s=4), goal)  # type: ignore[arg-type, return-value]
    assert math.dist(robot.pose[:2], (1.4, 2.0)) < 1.1


def test_who_arrives_is_there(robot: PlayedRobot, domain: int) -> None:
    driver, goal = plugins.make("robots", "ros2", domain=domain, timeout_s=4), goal_at(1.3, 1.3, 0.5)
    told = list(driver.drive(goal))  # type: ignore[attr-defined]
    assert told[-1].status == "arrived", told[-1]
    assert math.dist(robot.pose[:2], (1.3, 1.3)) < 0.25
    x, y, _ = driver.pose()  # type: ignore[attr-defined]
    assert math.dist(robot.pose[:2], (x, y)) < 0.1


def test_play_refuses_what_is_no_robot(domain: int) -> None:
    from typer.testing import CliRunner

    from cartier.cli import app

    for words, why in (
        (["dollhouse:nowhere"], "nowhere"),
        (["dollhouse:studio", "--speed", "2"], "--speed is for bags"),
        (["walk.mcap", "--explore"], "not for bags"),
    ):
        result = CliRunner().invoke(app, ["play", *words])
        assert result.exit_code, words
        assert why in (str(result.exception) + result.output) or isinstance(result.exception, CartierError)
