"""What a home grows on from: frozen with the home, packed when it is read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cartier.io.files import npz_bytes, read_npz
from cartier.mapping.mapper import Mapper
from cartier.mapping.state import FLOOR_KINDS
from cartier_dollhouse.floor_kinds import KNOWN
from synthetic import THINGS, RoomRecording, TrueBoxes, look, walk

HALF = 10  # frames


def grown(frames: int) -> Mapper:
    mapper, recording = Mapper(TrueBoxes(THINGS)), walk()
    for number in range(frames):
        mapper.add(recording[number])
    return mapper


def test_further_frames_change_nothing_of_a_home() -> None:
    recording, mapper = walk(), grown(HALF)
    home = mapper.home()
    for number in range(HALF, len(recording)):
        mapper.add(recording[number])
    mapper.home()
    alone = grown(HALF).home()
    assert {name: home.growth[name] == alone.growth[name] for name in alone.growth} == dict.fromkeys(home.growth, True)
    assert len(home.growth) == len(alone.growth) >= 5


def test_home_for_answers_is_the_home_without_the_search_for_drift() -> None:
    mapper = grown(HALF)
    quick, whole = mapper.home(drift=False), mapper.home()
    assert quick.to_dict() == whole.to_dict() and dict(quick.growth) == dict(whole.growth)


def test_a_grown_home_keeps_its_floor() -> None:
    """Also where the frames that are added show none of it."""
    home = grown(HALF).home()
    state = read_npz(home.growth[FLOOR_KINDS], where=FLOOR_KINDS)
    votes = np.zeros_like(state["votes"])
    votes[..., 0], votes[..., KNOWN] = 640, 10
    packed = npz_bytes(**{**state, "votes": votes})
    mapper = Mapper(TrueBoxes(THINGS), onto=replace(home, growth={**home.growth, FLOOR_KINDS: packed}))
    mapper.add(RoomRecording([look((1.0, 2.0, 1.5), (1.0, 4.0, 1.5))], THINGS)[0])
    grid = mapper.home().grid
    assert grid is not None and grid.floor_kinds is not None
    assert (grid.floor_kinds == 1).sum() > 100
