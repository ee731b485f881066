"""What every world owes its user, over every world that needs nothing foreign."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import BackendError, CartierError

WORLDS = [b.name for b in plugins.backends("worlds") if b.extra is None]
OPTIONS = {"dollhouse": {"width": 96, "height": 72}}


@pytest.fixture(params=WORLDS, scope="module")
def world(request: pytest.FixtureRequest) -> Any:
    return plugins.make("worlds", request.param, **OPTIONS[request.param])


@pytest.fixture(scope="module")
def home(world: Any) -> str:
    return str(world.homes()[-1])


@pytest.fixture(scope="module")
def recording(world: Any, home: str) -> Iterator[Any]:
    yield world.explore(home, max_frames=14)


def test_there_is_one() -> None:
    assert WORLDS


def test_homes_are_named_once_and_listing_is_quick(world: Any) -> None:
    homes = world.homes()
    assert len(homes) == len(set(homes)) > 0
    assert all(isinstance(name, str) and name for name in homes)


def test_exploring_makes_a_recording(world: Any, recording: Any) -> None:
    assert isinstance(recording, Recording)
    assert world.name in recording.name
    assert len(recording) == 14
    assert recording.notes
    assert all("\n" not in note for note in recording.notes)
    assert any("simulat" in note for note in recording.notes)
    for i in (0, 13):
        frame = recording[i]
        assert frame.index == i
        assert frame.camera == recording.camera
        assert frame.depth_m is not None
        assert frame.depth_m.dtype == np.float32
        assert frame.instances is not None
    for index in (-1, 14):
        with pytest.raises(IndexError):
            recording[index]


def test_frames_are_the_same_each_time(world: Any, home: str, recording: Any) -> None:
    again = world.explore(home, max_frames=14)
    assert again.fingerprint() == recording.fingerprint()
    for i in (5, 2, 5):
        a, b = recording[i], again[i]
        assert a.time_s == b.time_s
        assert np.array_equal(a.rgb, b.rgb)
        assert np.array_equal(a.depth_m, b.depth_m, equal_nan=True)
        assert np.array_equal(a.instances, b.instances)
    with pytest.raises(ValueError, match="read-only"):
        recording[0].world_from_camera[0, 3] = 9


def test_objects_are_the_recordings_truth_and_name_the_instances(world: Any, home: str, recording: Any) -> None:
    objects = world.objects(home)
    assert [vars(o) for o in objects] == [vars(o) for o in recording.truth]
    ids = {o.id for o in objects}
    assert len(ids) == len(objects)
    assert 0 not in ids
    for o in objects:
        assert all(low <= high for low, high in zip(o.box_min, o.box_max, strict=True))
    assert set(np.unique(recording[3].instances).tolist()) <= ids | {0}


def test_the_robot_only_ever_stands_where_it_is_free(world: Any, home: str, recording: Any) -> None:
    assert all(world.free(home, recording[i].world_from_camera[:2, 3]) for i in range(0, 14, 4))
    assert not world.free(home, (1e4, 1e4))


def test_what_is_unknown_is_said_in_one_line(world: Any, home: str) -> None:
    for call in (world.explore, world.objects, lambda name: world.free(name, (0, 0))):
        with pytest.raises(CartierError) as fault:
            call("no such home")
        assert "\n" not in str(fault.value)
    with pytest.raises(BackendError, match="has no option 'colour'; it has seed"):
        world.explore(home, colour="red")


@pytest.mark.parametrize("option", [{"width": 0}, {"height": 10**6}, {"fov": 179.0}, {"radius_m": 0.0}])
def test_the_dollhouse_refuses_impossible_options(option: dict[str, float]) -> None:
    with pytest.raises(BackendError, match=next(iter(option))):
        plugins.make("worlds", "dollhouse", **option)
    with pytest.raises(BackendError, match="max_frames"):
        plugins.make("worlds", "dollhouse").explore("studio", max_frames=0)


def test_dollhouse_homes_can_be_generated_steered_and_disturbed(monkeypatch: pytest.MonkeyPatch) -> None:
    world = plugins.make("worlds", "dollhouse", **OPTIONS["dollhouse"])
    recording = world.explore("7", max_frames=3, sensor=True, seed=5)
    assert len(recording) == 3
    assert any("ended early, after 3 frames" in note for note in recording.notes)
    monkeypatch.setattr("cartier.worlds.dollhouse.teleop.terminal_keys", lambda: (key for key in "adq"))
    monkeypatch.setattr("cartier.worlds.dollhouse.teleop.print_view", lambda rgb, line: None)
    steered = world.explore("7", drive=True)
    assert len(steered) == 3
    assert any("steered" in note for note in steered.notes)
