"""What a home grows on from: frozen with the home, packed when it is read."""

from __future__ import annotations

from cartier.mapping.mapper import Mapper
from synthetic import THINGS, TrueBoxes, walk

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
