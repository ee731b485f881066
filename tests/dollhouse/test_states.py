"""States of furnishings: what is on, full, dirty or shut differs from what is not, and nothing else is changed."""

from __future__ import annotations

import numpy as np
import pytest

from cartier.errors import InputError
from cartier_dollhouse.model import Shape
from cartier_dollhouse.shapes import build
from cartier_dollhouse.states import in_state


def materials(shape: Shape) -> list[str]:
    return [part.material for part in shape.parts]


def test_screens_and_lamps_are_switched() -> None:
    off, on = build("Television", variant=0), build("Television", variant=1)
    assert materials(in_state("Television", off, "on")) == materials(on)
    assert materials(in_state("Television", on, "off")) == materials(off)
    assert "light" not in materials(in_state("FloorLamp", build("FloorLamp"), "off"))


@pytest.mark.parametrize("type", ["Box", "GarbageCan", "Bathtub"])
def test_full_reaches_up_and_stays_inside(type: str) -> None:
    empty = build(type)
    full = in_state(type, empty, "full")
    added = np.concatenate([part.vertices for part in full.parts[len(empty.parts) :]])
    assert full.parts[: len(empty.parts)] == empty.parts
    assert 0.6 * empty.size[2] < added[:, 2].max() <= 1.05 * empty.size[2]  # a heap may stand out a little
    np.testing.assert_allclose(full.size[:2], empty.size[:2], atol=1e-6)


@pytest.mark.parametrize("type", ["Plate", "Pillow", "Box"])
def test_spots_lie_on_what_is_dirty(type: str) -> None:
    clean = build(type)
    dirty = in_state(type, clean, "dirty")
    spots = dirty.parts[len(clean.parts) :]
    assert len(spots) == 14 and {part.material for part in spots} == {"food:saddlebrown", "soil"}
    everything = np.concatenate([part.vertices for part in clean.parts])
    middles = np.array([part.vertices[0] for part in spots])
    assert (middles >= everything.min(0) - 0.01).all() and (middles <= everything.max(0) + 0.01).all()
    again = in_state(type, clean, "dirty").parts[len(clean.parts) :]
    assert all((a.vertices == b.vertices).all() for a, b in zip(spots, again, strict=True))


def test_a_shut_box_has_a_lid_and_no_flaps() -> None:
    opened = build("Box")
    shut = in_state("Box", opened, "closed")
    assert shut.size[2] < opened.size[2] and not shut.surfaces
    lid = shut.parts[5].vertices
    assert np.ptp(lid[:, 2]) < 0.01 and np.ptp(lid[:, 0]) > 0.5 * opened.size[0]


@pytest.mark.parametrize(("type", "state"), [("Box", "on"), ("Plate", "full")])
def test_a_state_that_it_cannot_have_is_refused(type: str, state: str) -> None:
    with pytest.raises(InputError, match=f"a {type} has no"):
        in_state(type, build(type), state)  # type: ignore[arg-type]
