"""Colour naming: what stands in a home's light gets the name of its material, whatever the light's own colour."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from cartier.mapping.colours import named_shares
from cartier.mapping.observation import colour_shares, white_balance
from cartier.types import Array
from cartier_dollhouse.recording import look, pinhole
from cartier_dollhouse.render import Renderer, View
from cartier_dollhouse.scene import load_scene

HOME = """\
name: lit
start: [0.5, 0.5]
rooms:
  - {name: room, kind: living room, box: [0, 0, 4, 3], floor: "planks:oak", walls: "paint:cream"}
windows:
  - {room: room, side: north, at: 2.0, width: 1.2}
front_door: {room: room, side: south, at: 1.5}
things:
  - type: CounterTop
    at: [3.0, 1.5]
    face: west
    size: [1.6, 0.6, 0.8]
    colour: whitewood
    things:
      - {type: Tomato, at: [-0.6, 0.0], size: [0.2, 0.2, 0.17]}
      - {type: Bowl, at: [-0.1, 0.0], colour: "ceramic:white"}
      - {type: Book, at: [0.4, 0.0], colour: petrol}
  - {type: FloorLamp, at: [3.6, 2.7]}
  - {type: Chair, at: [2.0, 2.5], colour: oak}
"""


@cache
def seen() -> tuple[dict[str, int], View]:
    """The ids of what stands in a home, and a picture of it."""
    scene = load_scene(HOME)
    view = Renderer(scene, pinhole(320, 240, 80.0)).render(look((0.8, 1.4), 0.15, math.radians(15)))
    return {obj.label: obj.id for obj in scene.truth()}, view


def shares(rgb: npt.NDArray[np.uint8], mask: npt.NDArray[np.bool_]) -> Array:
    return colour_shares(rgb, np.arange(mask.size)[None], mask.reshape(1, -1))[0]


@pytest.mark.parametrize(
    ("label", "colour"),
    [("Tomato", "red"), ("FloorLamp", "white"), ("Bowl", "white"), ("CounterTop", "white"), ("Book", "blue"),
     ("Chair", "brown")],
)  # fmt: skip
@pytest.mark.parametrize("tint", [(1, 1, 1), (1.04, 1, 0.92), (0.96, 1, 1.04)])
def test_what_stands_in_a_home_has_the_colour_of_its_material(
    label: str, colour: str, tint: tuple[float, float, float]
) -> None:
    ids, view = seen()
    rgb = np.clip(view.rgb * np.array(tint), 0, 255).astype(np.uint8)
    mask = view.instances == ids[label]
    assert mask.sum() > 50
    assert named_shares(shares(rgb, mask))[0][0] == colour


@pytest.mark.parametrize("tint", [(1, 0.93, 0.8), (0.85, 0.93, 1), (0.92, 1, 0.92)])
@pytest.mark.parametrize(("level", "colour"), [(235, "white"), (215, "white"), (128, "grey"), (80, "grey")])
def test_neutral_swatches_stay_neutral_in_tinted_light(
    tint: tuple[float, float, float], level: int, colour: str
) -> None:
    rgb = np.full((120, 160, 3), 220.0)
    rgb[20:100, 20:100] = level
    rgb[:, 120:] = (150, 60, 50)  # what is coloured by itself says little about the light
    rgb = rgb * tint
    mask = np.zeros(rgb.shape[:2], bool)
    mask[20:100, 20:100] = True
    assert named_shares(shares(rgb.astype(np.uint8), mask))[0] == (colour, 1.0)


def test_a_frame_without_anything_pale_is_taken_as_it_is() -> None:
    rgb = np.full((120, 160, 3), (150, 60, 50), np.uint8)
    assert white_balance(rgb).tolist() == [1, 1, 1]
    assert white_balance(np.full((120, 160, 3), 255, np.uint8)).tolist() == [1, 1, 1]  # burnt out
    rgb[:20, :20] = (160, 180, 200)  # a pale thing that is too small to tell of the light
    assert white_balance(rgb).tolist() == [1, 1, 1]


def test_what_is_burnt_out_hides_no_tint() -> None:
    rgb = np.full((120, 160, 3), (220, 200, 180), np.uint8)
    tinted = white_balance(rgb)
    rgb[:60] = 255
    assert np.allclose(white_balance(rgb), tinted) and tinted[2] > 1.03


def test_a_wall_that_is_coloured_is_not_bleached() -> None:
    """No gain is beyond a tenth: the light of a home is not bluer or redder than that after a camera's own balance."""
    gains = white_balance(np.full((120, 160, 3), (230, 200, 165), np.uint8))
    assert 1 / 1.1 - 1e-9 <= gains.min() < 0.95 and 1.05 < gains.max() <= 1.1


@pytest.mark.parametrize(
    ("rgb", "colour"),
    [((180, 25, 25), "red"), ((130, 20, 25), "red"), ((245, 245, 240), "white"), ((120, 120, 120), "grey"),
     ((190, 188, 175), "white"), ((200, 183, 158), "white"), ((195, 149, 99), "brown"), ((183, 135, 82), "brown"),
     ((25, 25, 25), "black"), ((230, 190, 40), "yellow"), ((220, 110, 35), "orange"), ((110, 75, 45), "brown"),
     ((178, 131, 46), "yellow"),
     ((60, 130, 60), "green"), ((50, 90, 160), "blue"), ((110, 60, 130), "purple"), ((225, 140, 160), "pink")],
)  # fmt: skip
def test_typical_colours(rgb: tuple[int, int, int], colour: str) -> None:
    assert named_shares(shares(np.full((1, 1, 3), rgb, np.uint8), np.ones((1, 1), bool))) == ((colour, 1.0),)
