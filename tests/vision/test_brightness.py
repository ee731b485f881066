"""Lamps and screens that were seen twice: a change of brightness tells, and nothing else does."""

from __future__ import annotations

from pathlib import Path

import pytest

import cartier
from cartier.reasoners import embedded
from cartier.vision.brightness import SeenTwice, seen_twice
from cartier_bench.look_items import items, scene_of, walk
from cartier_dollhouse.states import with_states
from vision.staged_photos import BOX, mug, painted_home, photo, photographs

DARK, BRIGHT, DIM = (25, 25, 28), (200, 210, 215), (90, 90, 90)
RGB = tuple[int, int, int]


def shown(*colours: RGB, label: str = "television", headings: tuple[float, ...] = (0, 0, 0)) -> SeenTwice | None:
    """What photographs 1, 2 … of an object say, painted in these colours and taken in these headings (degrees)."""
    obj = mug(1, [(k, BOX, headings[k - 1]) for k in range(1, len(colours) + 1)], label=label)
    kept = photographs({k: photo((BOX, colour)) for k, colour in enumerate(colours, start=1)})
    return seen_twice(obj, kept.sizes([obj]), kept.rgb)


@pytest.mark.parametrize("label", ["television", "floor lamp", "computer monitor", "laptop"])
def test_the_latest_of_two_unlike_photographs_tells(label: str) -> None:
    on, off = shown(DARK, BRIGHT, label=label), shown(BRIGHT, DARK, label=label)
    assert on is not None and (on.state, on.frame, on.other) == ("on", 2, 1)
    assert off is not None and (off.state, off.frame, off.other) == ("off", 2, 1) and off.stops > 3


@pytest.mark.parametrize(
    ("colours", "more"),
    [
        ((BRIGHT,), {}), ((DARK,), {}), ((BRIGHT, BRIGHT), {}), ((DARK, DARK), {}),
        ((BRIGHT, DARK), {"label": "fridge"}),  # which may well look dark
        ((BRIGHT, DARK), {"headings": (0, 180)}),  # its back
        (((6, 6, 6), (30, 30, 30)), {}),  # a reflection on a dark screen
        ((BRIGHT, (160, 165, 170)), {}),  # less than twice as bright
    ],
)  # fmt: skip
def test_anything_else_tells_nothing(colours: tuple[RGB, ...], more: dict) -> None:
    assert shown(*colours, **more) is None


def test_a_darker_photograph_is_no_darker_screen() -> None:
    """The light of the room went out: what is around the screen says so."""
    lit = photo(((0.0, 0.0, 640.0, 480.0), (200, 200, 200)), (BOX, (150, 150, 150)))
    unlit = photo(((0.0, 0.0, 640.0, 480.0), (60, 60, 60)), (BOX, (45, 45, 45)))
    obj = mug(1, [(1, BOX, 0), (2, BOX, 0)], label="television")
    kept = photographs({1: lit, 2: unlit})
    assert seen_twice(obj, kept.sizes([obj]), kept.rgb) is None


def test_small_ones_tell_nothing() -> None:
    small = (300.0, 200.0, 360.0, 260.0)
    obj = mug(1, [(1, small, 0), (2, small, 0)], label="television")
    kept = photographs({1: photo((small, BRIGHT)), 2: photo((small, DARK))})
    assert seen_twice(obj, kept.sizes([obj]), kept.rgb) is None


def test_a_home_answers_and_says_by_which_photographs(tmp_path: Path) -> None:
    screen, fridge = (
        mug(k, [(k, BOX, 0), (k + 10, BOX, 0)], label=name) for k, name in ((1, "television"), (2, "fridge"))
    )
    jpegs = {1: photo((BOX, DARK)), 11: photo((BOX, BRIGHT)), 2: photo((BOX, DARK)), 12: photo((BOX, BRIGHT))}
    home = painted_home([screen, fridge], jpegs, tmp_path / "home")
    for words, value, begins in (
        ("is the television on?", "on", "Yes: the television"), ("is the tv switched off?", "on", "No: the television"),
        ("is the fridge on?", None, "I cannot tell by looking without a vision model"),
        ("is the television clean?", None, "I cannot tell by looking without a vision model"),
    ):  # fmt: skip
        said = cartier.ask(home, words, embedded.make()).selection
        assert said.fact is not None and said.fact.value == value and said.text.startswith(begins), said
    text = cartier.ask(home, "is the television on?", embedded.make()).selection.text
    assert text.endswith("when I saw it last: it was bright in the photograph of frame 11 and dark in that of frame 1.")


@pytest.mark.parametrize(("before", "after"), [("on", "off"), ("off", "on")])
def test_two_recordings_of_a_room_tell_its_screen(before: str, after: str) -> None:
    asked = [each for each in items() if each.room == "aster"]
    scene = scene_of("aster", asked)
    (screen,) = (thing.id for thing in scene.things if thing.type == "Television")
    home = None
    for state in (before, after):
        recording = walk(with_states(scene, {screen: state}), asked[:1])  # type: ignore[dict-item]
        detector = cartier.make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
        home = cartier.map_home(recording, detector, ["object_depth"], every=1, onto=home)
        said = cartier.ask(home, "is the television on?", embedded.make()).selection
        assert said.fact is not None and said.fact.value == (None if state == before else after)
