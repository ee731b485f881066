from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cartier.errors import InputError, check_pose
from cartier.geometry import backproject
from cartier.io.files import read_json
from cartier.labels import display_name
from cartier.types import Camera, Detections, Frame, OccupancyGrid, Place, Selection
from synthetic import CAMERA, walk


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rgb": np.zeros((3, 3, 3), np.uint8)}, r"rgb must be \(120, 160, 3\) uint8, got \(3, 3, 3\)"),
        ({"depth_m": np.zeros((60, 80), np.float32)}, r"depth_m must be \(120, 160\), got \(60, 80\)"),
        ({"world_from_camera": np.full((4, 4), np.nan)}, "frame 0: the pose holds NaN"),
        ({"world_from_camera": np.diag([1.0, 1, -1, 1])}, "mirrors"),
        ({"world_from_camera": np.diag([2.0, 2, 2, 1])}, "not orthonormal"),
        ({"world_from_camera": np.eye(3)}, r"must be 4x4, got \(3, 3\)"),
        ({"time_s": float("nan")}, "time_s must be finite"),
    ],
)
def test_a_frame_says_what_is_wrong_with_it(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(walk()[0], **change)


def test_a_pose_with_a_projective_row_is_refused() -> None:
    pose = np.eye(4)
    pose[3, 0] = 0.1
    with pytest.raises(InputError, match="last row"):
        check_pose(pose)
    pose = np.eye(4)
    pose[1, 3] = -1e30
    with pytest.raises(InputError, match=r"the pose is 1e\+30 m from the origin, which is no home"):
        check_pose(pose)


@pytest.mark.parametrize(
    ("boxes", "scores", "labels", "message"),
    [
        ([[0, 0, 1, 1]], [1, 1], ["a"], "1 boxes, 2 scores, 1 labels"),
        ([[5, 0, 1, 1]], [1], ["a"], "x2 < x1"),
        ([[0, 0, np.nan, 1]], [1], ["a"], "NaN"),
        ([[0, 0, 1e308, 1]], [1], ["a"], "infinite"),
    ],
)
def test_detections_are_checked(boxes: list[list[float]], scores: list[float], labels: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Detections(3, np.array(boxes), np.array(scores), tuple(labels))


def test_detections_keep_by_mask_and_by_number() -> None:
    seen = Detections(0, np.arange(12).reshape(3, 4), np.array([0.1, 0.2, 0.3]), ("a", "b", "c"))
    assert seen.keep(np.array([True, False, True])).labels == ("a", "c")
    assert seen.keep(np.array([2, 0])).labels == ("c", "a")


def test_cropped_pixels_show_the_same_points() -> None:
    rng = np.random.default_rng(0)
    camera, depth = Camera(64, 48, 60.0, 61.0, 31.5, 23.5), rng.uniform(1, 3, (48, 64)).astype(np.float32)
    frame = Frame(7, 1.5, rng.integers(0, 255, (48, 64, 3), np.uint8), depth, np.eye(4), camera)
    part = frame.cropped((10, 5, 40, 30))
    assert (part.index, part.time_s, part.camera.width, part.camera.height) == (7, 1.5, 30, 25)
    whole_points, points = (backproject(f.depth_m, f.camera) for f in (frame, part))
    np.testing.assert_allclose(points, whole_points[5:30, 10:40], atol=1e-6)
    np.testing.assert_array_equal(part.rgb, frame.rgb[5:30, 10:40])
    for wrong in ((10, 5, 10, 30), (-1, 0, 5, 5), (0, 0, 65, 48)):
        with pytest.raises(InputError, match=r"frame 7: a part must lie in the 64x48 px"):
            frame.cropped(wrong)


def test_selections_name_an_object_exactly_when_they_found_one() -> None:
    with pytest.raises(InputError, match="must name an object"):
        Selection("found")
    with pytest.raises(InputError, match="must not name an object"):
        Selection("not_found", "cup")


def test_cameras_places_and_grids_are_checked() -> None:
    with pytest.raises(InputError, match="focal lengths must be positive"):
        Camera(640, 480, 0, 500, 320, 240)
    with pytest.raises(InputError, match="size must be"):
        Camera(0, 480, 500, 500, 320, 240)
    with pytest.raises(InputError, match=r"size must be 1 to 32768 px, got 1000+…x480$"):
        Camera(10**4000, 480, 500, 500, 320, 240)
    with pytest.raises(InputError, match="67 megapixels at most"):
        Camera(30_000, 30_000, 30_000, 30_000, 0, 0)
    for far in (1e-30, 6.3, 641_000.0, 1e30):
        with pytest.raises(InputError, match="are no lens's for images of 640x480 px: they are in pixels"):
            Camera(640, 480, 500, far, 320, 240)
        assert Camera(640, 480, 6.5, 639_000, 320, 240)
    with pytest.raises(InputError, match="principal point"):
        Camera(640, 480, 500, 500, -1e30, 240)
    with pytest.raises(InputError, match="3 finite numbers"):
        Place("cup", (1, 2, float("inf")), 1.0, 0)
    for position in ((1, 2, 10**400), (1, 2, "x"), 7, None, [[1, 2, 3]], "123" * 9):
        with pytest.raises(InputError, match=r"place of 'cup': position must be 3 finite numbers, got .{1,100}$"):
            Place("cup", position, 1.0, 0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="rows, cols"):
        OccupancyGrid(np.zeros((0, 3), np.int8), 0.05, (0, 0), np.zeros((0, 3), np.float16))
    assert CAMERA.scaled(320, 240).fx == 2 * CAMERA.fx


@pytest.mark.parametrize("text", ["", "{", "[1,]", '{"a": ' + "9" * 5000 + "}", "[" * 100_000, "\udcff"])
def test_rubbish_json_is_one_line(text: str, tmp_path: Path) -> None:
    file = tmp_path / "x.json"
    file.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError) as caught:
        read_json(file)
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(InputError, match="is a folder"):
        read_json(tmp_path)


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("CoffeeMachine", "coffee machine"),
        ("coffee_machine", "coffee machine"),
        ("TVStand", "tv stand"),
        ("  wine\tglass\n", "wine glass"),
        ("bat_(animal)", "bat (animal)"),
        ("Café", "café"),
    ],
)
def test_display_names(label: str, name: str) -> None:
    assert display_name(label) == name
    assert display_name(name) == name


def test_nanoseconds_are_no_seconds() -> None:
    camera = Camera(2, 2, 1.0, 1.0, 0.5, 0.5)
    with pytest.raises(InputError, match="nanoseconds"):
        Frame(0, 6.8e14, np.zeros((2, 2, 3), np.uint8), None, np.eye(4), camera)
