"""What every world owes its user, over every world that needs nothing foreign."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.contracts import Recording, World
from cartier.errors import BackendError, CartierError
from cartier.testing import check_world

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
    yield world.explore(home, max_frames=6)


def test_there_is_one() -> None:
    assert WORLDS


def test_it_obeys_the_laws_of_every_world(world: Any, home: str) -> None:
    check_world(lambda: Short(world), home)


class Short:
    """A world in which every walk ends early."""

    def __init__(self, world: World) -> None:
        self.name, self.homes, self.objects, self.free = world.name, world.homes, world.objects, world.free
        self.world = world

    def explore(self, home: str, **options: Any) -> Recording:
        return self.world.explore(home, max_frames=6, **options)


def test_exploring_makes_a_recording(world: Any, recording: Any) -> None:
    assert isinstance(recording, Recording)
    assert world.name in recording.name
    assert len(recording) == 6
    assert recording.notes
    assert all("\n" not in note for note in recording.notes)
    assert any("simulat" in note for note in recording.notes)
    for i in (0, 5):
        frame = recording[i]
        assert frame.index == i
        assert frame.camera == recording.camera
        assert frame.depth_m is not None
        assert frame.depth_m.dtype == np.float32
        assert frame.instances is not None
    for index in (-1, 6):
        with pytest.raises(IndexError):
            recording[index]


def test_what_is_unknown_is_said_in_one_line(world: Any, home: str) -> None:
    with pytest.raises(CartierError):
        world.free("no such home", (0, 0))
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
    recording = world.explore("7", max_frames=3, sensor="phone", seed=5)
    assert len(recording) == 3
    assert any("ended early, after 3 frames" in note for note in recording.notes)
    monkeypatch.setattr("cartier_dollhouse.teleop.terminal_keys", lambda: (key for key in "adq"))
    monkeypatch.setattr("cartier_dollhouse.teleop.print_view", lambda rgb, line: None)
    steered = world.explore("7", drive=True)
    assert len(steered) == 3
    assert any("steered" in note for note in steered.notes)
