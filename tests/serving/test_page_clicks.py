"""Every object of two homes clicked on the floor plan: what is chosen is what was meant, and never a ghost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cartier
from cartier.home import Home
from cartier.serving.page import one_file
from flat import obj
from serving.browsing import chromium, click_every_object

GHOSTS = 60  # tentative objects in a home, as in that of a real kitchen
LEAST_RIGHT = 0.98


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium(webgl=False) as opened:
        yield opened


def crowded(name: str, base: Home) -> Home:
    """The objects of a home of the dollhouse with boxes as pixels give them, 3 cm awry, and ghosts between them."""
    rng = np.random.default_rng(7)
    things = cartier.make("worlds", "dollhouse").objects(name)
    sure = []
    for number, thing in enumerate(things):
        low, high = (np.array(end) + rng.normal(0, 0.03, 3) for end in (thing.box_min, thing.box_max))
        size = np.maximum(high - low, 0.04)
        middle = (low + high) / 2
        sure.append(obj(number, thing.label, tuple(middle.tolist()), tuple(size.tolist())))
    low, high = (np.array([end(t.position[axis] for t in sure) for axis in range(3)]) for end in (min, max))
    ghosts = [
        obj(1000 + k, "ghost", tuple(rng.uniform(low, high).tolist()), tuple(rng.uniform(0.05, 1, 3)), probability=0.3)
        for k in range(GHOSTS)
    ]
    return replace(base, objects=(*sure, *ghosts), grid=None, rooms=(), photos={})


@pytest.mark.parametrize(("tap", "name"), [(False, "studio"), (True, "kitchen_diner")], ids=["mouse", "finger"])
def test_a_click_chooses_what_was_meant(browser: Any, mapped: Path, tmp_path: Path, tap: bool, name: str) -> None:
    home = crowded(name, Home.load(mapped))
    file = tmp_path / f"{name}.html"
    file.write_bytes(one_file(home))
    size = {"width": 390, "height": 844} if tap else {"width": 1280, "height": 800}
    tab = browser.new_context(viewport=size, has_touch=tap, is_mobile=tap).new_page()
    tab.goto(file.as_uri())
    tab.wait_for_selector("html[data-ready]")
    assert tab.locator("#plan .tentative:visible").count() == 0, "ghosts are hidden until asked for"
    found = click_every_object(tab, home, tap, slice(0, None, 2))
    tab.check("#tentative")
    assert tab.locator("#plan .tentative:visible").count() == GHOSTS
    among = click_every_object(tab, home, tap, slice(1, None, 2))
    tab.context.close()
    assert not found.ghosts and not among.ghosts, "no ghost is above what is there"
    assert found.objects + among.objects > 50, "each object is clicked once"
    for each in (found, among):
        assert len(each.wrong) <= (1 - LEAST_RIGHT) * (each.objects + each.labels), each


def test_what_is_hidden_cannot_be_chosen_and_what_is_chosen_covers_nothing(
    browser: Any, mapped: Path, tmp_path: Path
) -> None:
    things = (
        obj(0, "table", (1, 1, 0.4), (2, 2, 0.8)), obj(1, "plate", (1, 1, 0.82), (0.3, 0.3, 0.04)),
        obj(2, "ghost", (1, 1, 1), (0.1, 0.1, 0.1), probability=0.3),
        obj(3, "ghost", (3, 1, 1), (1, 1, 1), probability=0.3),
        obj(4, "bowl", (1, 1, 0.86), (0.3, 0.3, 0.1)),
    )  # fmt: skip
    file = tmp_path / "home.html"
    file.write_bytes(one_file(replace(Home.load(mapped), objects=things, grid=None, rooms=(), photos={})))
    tab = browser.new_context(viewport={"width": 1000, "height": 700}).new_page()
    tab.goto(file.as_uri())
    tab.wait_for_selector("html[data-ready]")
    chosen = """([x, y]) => { const b = plan.svg.getBoundingClientRect();
      plan.svg.dispatchEvent(new MouseEvent("click", { bubbles: true,
        clientX: b.left + (x - plan.view.x) / plan.px, clientY: b.top + (-y - plan.view.y) / plan.px }));
      return chosen; }"""
    assert tab.evaluate(chosen, [3, 1]) is None, "a ghost is not shown"
    tab.check("#tentative")
    assert tab.evaluate(chosen, [3, 1]) == 3, "now it is"
    assert tab.evaluate(chosen, [0.3, 0.4]) == 0
    assert tab.evaluate(chosen, [1, 1]) == 4, "the bowl lies on the plate of its size, and the chosen table on neither"
    tab.uncheck("#tentative")
    tab.evaluate("choose(3)")
    assert tab.locator('#plan [data-id="3"]').is_visible(), "an answer may speak of it"
    tab.context.close()
