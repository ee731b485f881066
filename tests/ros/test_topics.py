"""Topics of ROS 2 both ways: cameras under rclpy are heard exactly, and rclpy hears what cartier publishes."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ros_camera
from peers import LOOPBACK
from rospeers import Ros

from cartier import plugins
from cartier.pipeline import map_home
from cartier.sources import open_source
from cartier.testing import check_source
from cartier.types.streams import Stamped
from synthetic import THINGS, TrueBoxes, walk

pytestmark = pytest.mark.slow
HEARD = {"raw": "raw", "16UC1": "raw", "tf": "raw", "tf_static": "raw", "compressed": "compressed",
         "compressedDepth": "compressed", "32FC1": "32FC1", "CameraInfo": "region", "Odometry": "odometry"}  # fmt: skip
FORMS = {form: [cell for cell, of in HEARD.items() if of == form] for form in dict.fromkeys(HEARD.values())}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("camera") / "pictures.npz"
    rgb, depth_mm = ros_camera.rgb(), ros_camera.depth_mm()
    png = {
        f"{name}_png": np.frombuffer(ros_camera.png(pixels), np.uint8)
        for name, pixels in (("rgb", rgb), ("depth", depth_mm))
    }
    np.savez(file, rgb=rgb, depth_mm=depth_mm, focal=ros_camera.FOCAL, **png)
    return file


def frames(domain: int, count: int = 6, **options: Any) -> list[Stamped]:
    source = open_source("ros2", domain=domain, **options)
    patience = threading.Timer(30, source.close)
    patience.start()
    try:
        return check_source(lambda: source, most=count, ends=False)
    finally:
        patience.cancel()


@pytest.mark.parametrize("cells", FORMS.values(), ids=lambda cells: "+".join(cells))
def test_a_camera_is_heard(ros: Ros, cells: list[str], pictures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    told, (x, y) = ({"odometry": "/odom"}, (0.0, 0.0)) if cells == ["Odometry"] else ({}, (1.0, 2.0))  # of odom in map
    with ros.peer("camera.py", pictures, HEARD[cells[0]], 60):
        heard = frames(ros.domain, **told)
    assert len(heard) >= 6
    height, width = ros_camera.depth_mm().shape
    for each in heard:
        k = round((each.stamp_ns / 1e9 - ros_camera.START_S) * 10)
        frame = each.frame
        np.testing.assert_array_equal(frame.rgb, ros_camera.rgb())
        assert frame.depth_m is not None
        np.testing.assert_allclose(frame.depth_m, ros_camera.depth_mm() / 1000, atol=1e-6)
        k_matrix = [ros_camera.FOCAL, ros_camera.FOCAL, width / 2, height / 2]
        camera = frame.camera
        np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], k_matrix, atol=0.51)
        forward_right_down = [[0, 0, 1, x + 0.1 + 0.1 * k], [-1, 0, 0, y], [0, -1, 0, 1.2], [0, 0, 0, 1]]
        np.testing.assert_allclose(frame.world_from_camera, forward_right_down, atol=1e-9)


@pytest.mark.parametrize("cells", [["detections"]], ids=lambda cells: "+".join(cells))
def test_a_detector_is_heard(ros: Ros, cells: list[str], pictures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    with ros.peer("camera.py", pictures, cells[0], 60):
        heard = frames(ros.domain, detections="yolo/detections")
    assert len(heard) >= 6
    for each in heard:
        x, found = 20 + round(each.stamp_ns / 1e8) % 10, each.detections
        assert found is not None and (found.labels, found.scores.tolist()) == (("cup",), [0.75])
        np.testing.assert_allclose(found.boxes_xyxy, [[x - 5, 11, x + 5, 19]], atol=1e-6)


@pytest.mark.parametrize("cells", [["objects out", "ask"]], ids=lambda cells: "+".join(cells))
def test_a_home_is_heard_and_asked(ros: Ros, cells: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from cartier.serving.homes import Homes
    from cartier.serving.operations import Operations
    from cartier_ros.served_topics import HomeTopics

    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    home = map_home(walk(), TrueBoxes(THINGS))
    home.save(tmp_path / "room")
    served = Homes([tmp_path / "room"])
    topics = HomeTopics(Operations(served, plugins.make("reasoners", "embedded")), ros.domain, lambda: "map")
    told = dict[str, Any]()
    try:
        with ros.peer("listener.py", "bring me to the table", 60) as listener:
            while len(told) < 3:
                name, _, value = listener.line(30).partition(" ")
                told[name] = json.loads(value)
    finally:
        topics.close()
    known = sorted(
        [str(obj.id), obj.label, round(obj.box_max[2] - obj.box_min[2], 6)] for obj in home.objects if obj.confirmed
    )
    assert told["objects"]["frame"] == "map"
    assert sorted([key, label, round(height, 6)] for key, label, height in told["objects"]["rows"]) == known
    assert told["markers"] == 1 + 2 * len(known)
    assert told["answer"]["object"] == "table"
