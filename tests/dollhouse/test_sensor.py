"""The sensor's faults: same seed, same bytes; each fault of its size; each can be switched off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from cartier.errors import InputError
from cartier_dollhouse.render import View
from cartier_dollhouse.sensor import SENSORS, Sensor, sensor_of

OFF = {"depth_quantum": 0.0, "holes": False, "flying": 0.0, "image_noise": 0.0, "exposure": 0.0}


def view(depth: float = 3.0) -> View:
    """A wall with a nearer box before it, a strip of floor seen at a grazing angle, and a dark patch."""
    image = np.full((120, 160), depth, np.float32)
    image[40:80, 60:100] = depth / 2
    image[100:] = 1.0 / np.linspace(1 / depth, 0.02, 20, dtype=np.float32)[:, None]
    hard = np.zeros(image.shape, np.bool_)
    hard[5:25, 5:55] = True
    return View(np.full((120, 160, 3), 120, np.uint8), image, np.ones(image.shape, np.int32), hard)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    first, again, other = Sensor(3).corrupt(view(), 7), Sensor(3).corrupt(view(), 7), Sensor(4).corrupt(view(), 7)
    assert first.rgb.tobytes() == again.rgb.tobytes() and first.depth_m.tobytes() == again.depth_m.tobytes()
    assert first.rgb.tobytes() != other.rgb.tobytes()
    assert first.rgb.tobytes() != Sensor(3).corrupt(view(), 8).rgb.tobytes()


def test_all_switched_off_changes_nothing_in_range() -> None:
    given = view()
    made = Sensor(range_m=(0.0, 900.0), **OFF).corrupt(given, 0)
    np.testing.assert_array_equal(made.depth_m, given.depth_m)
    np.testing.assert_array_equal(made.rgb, given.rgb)


def test_the_view_itself_stays_as_it_was() -> None:
    given = view()
    Sensor().corrupt(given, 0)
    np.testing.assert_array_equal(given.depth_m, view().depth_m)
    np.testing.assert_array_equal(given.rgb, view().rgb)


def test_depth_steps_grow_with_depth_squared() -> None:
    errors = []
    for depth in (1.5, 3.0):
        made = Sensor(**OFF | {"depth_quantum": 0.003}).corrupt(view(depth), 0).depth_m[:30]
        errors.append(float(np.abs(made - depth).mean()))
        steps = np.diff(np.unique(made))
        assert steps == pytest.approx(0.003 * depth**2, rel=0.1)
    assert errors[1] / errors[0] == pytest.approx(4, rel=0.4)


def test_holes_where_sensors_fail() -> None:
    given = view()
    made = Sensor(**OFF | {"holes": True}).corrupt(given, 0)
    missing = np.isnan(made.depth_m)
    assert missing[given.hard].mean() > 0.5  # glass, mirrors, screens, black
    assert missing[102:112].mean() > 0.5  # grazing
    assert missing[30:38, 5:55].mean() == 0  # a wall, seen straight on
    far = Sensor(range_m=(0.5, 2.0), **OFF).corrupt(given, 0)
    assert np.isnan(far.depth_m[given.depth_m > 2]).all()


def test_flying_pixels_hang_between_front_and_back() -> None:
    given = view()
    made = Sensor(**OFF | {"flying": 1.0}).corrupt(given, 0).depth_m
    changed = (made != given.depth_m) & (np.arange(120) < 95)[:, None]
    row, col = np.nonzero(changed)
    assert len(row) > 50 and ((made[changed] > 1.5) & (made[changed] < 3.0)).all()
    assert (np.minimum(np.abs(row - 39.5), np.abs(row - 79.5)) < 1).max() and col.min() >= 59 and col.max() <= 100


def test_image_noise_and_exposure() -> None:
    noisy = [Sensor(**OFF | {"image_noise": 4.0}).corrupt(view(), i).rgb for i in range(3)]
    assert np.std(noisy) == pytest.approx(4, rel=0.1)
    bright = [float(Sensor(**OFF | {"exposure": 0.1}).corrupt(view(), i).rgb.mean()) for i in range(40)]
    assert np.std(bright) / 120 == pytest.approx(0.1, rel=0.4)


def test_poses_drift_smoothly_and_stay_rigid() -> None:
    true = [np.eye(4) for _ in range(101)]
    ends = []
    for seed in range(40):
        poses = Sensor(seed, drift_m=0.05, drift_rad=0.02).drift(true)
        np.testing.assert_allclose(poses[0], np.eye(4))
        places = np.array([pose[:3, 3] for pose in poses])
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.03
        np.testing.assert_allclose(poses[-1][:3, :3] @ poses[-1][:3, :3].T, np.eye(3), atol=1e-9)
        ends.append((places[-1, 0], math.atan2(poses[-1][1, 0], poses[-1][0, 0])))
    assert np.std(ends, axis=0) == pytest.approx((0.05, 0.02), rel=0.5)
    _same(Sensor(1).drift(true), Sensor(1).drift(true))
    _same(Sensor(1, drift_m=0, drift_rad=0).drift(true), true)


def _same(first: list[npt.NDArray[np.float64]], second: list[npt.NDArray[np.float64]]) -> None:
    np.testing.assert_array_equal(np.array(first), np.array(second))


@pytest.mark.parametrize("wrong", [{"flying": 2.0}, {"image_noise": -1.0}, {"range_m": (3.0, 1.0)}, {"seed": -1}])
def test_impossible_sizes_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="sensor"):
        Sensor(**wrong)  # type: ignore[arg-type]


def test_coarse_depth_shows_one_reading_in_all_pixels_of_a_cell() -> None:
    given = view()
    made = Sensor(depth_width=40, range_m=(0.0, 900.0), **OFF).corrupt(given, 0).depth_m
    cells = made.reshape(30, 4, 40, 4)
    assert made.shape == given.depth_m.shape and (cells == cells[:, :1, :, :1]).all()
    np.testing.assert_array_equal(cells[:, 0, :, 0], given.depth_m[2::4, 2::4])
    assert not np.array_equal(made, given.depth_m)


def test_depth_noise_is_a_share_of_depth() -> None:
    spreads = [
        float(np.nanstd(Sensor(depth_noise=0.02, range_m=(0.0, 900.0), **OFF).corrupt(view(far), 0).depth_m[:30] / far))
        for far in (1.5, 3.0)
    ]
    assert spreads == pytest.approx([0.02, 0.02], rel=0.5) and spreads[0] == pytest.approx(spreads[1], rel=1e-3)


def test_a_phone_sees_coarser_and_less_far_than_a_picture() -> None:
    given = view(4.0)
    made = replace(SENSORS["phone"], seed=1, depth_width=80).corrupt(given, 0)
    assert np.isfinite(made.depth_m[:100]).mean() > 0.7 and np.nanmax(made.depth_m) <= 5.0
    assert np.nanmax(Sensor(1).corrupt(given, 0).depth_m) > 5.0


def test_sensors_by_name() -> None:
    assert sensor_of("exact", 3) is None and sensor_of("phone", 3) == replace(SENSORS["phone"], seed=3)
    with pytest.raises(InputError, match="no sensor 'radar': exact, depth-camera, phone"):
        sensor_of("radar", 0)
