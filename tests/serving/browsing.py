"""The page in Chromium for several test files, and clicks on every object of a home as a person would click."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import pytest

from cartier.home import Home
from cartier.types import MapObject

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@contextmanager
def chromium(webgl: bool = True) -> Iterator[Any]:
    """A browser that draws WebGL by software, or not at all: drawing takes most of a click's time."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as running:
        drawing = (
            ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
            if webgl
            else ["--disable-gpu", "--disable-3d-apis"]
        )
        opened = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", *drawing])
        yield opened
        opened.close()


STILL = """async () => {
  choose(null);
  for (let before = "", now; ; before = now) {
    const b = plan.svg.getBoundingClientRect();
    now = [b.left, b.top, b.width, plan.view.w].join();
    if (now === before) return [b.left, b.top];
    await new Promise((next) => requestAnimationFrame(() => requestAnimationFrame(next)));
  }
}"""
"""Chooses nothing, waits until the plan stands still, and gives its upper left corner in the window's pixels."""


class Clicks(NamedTuple):
    """Of the confirmed objects of a home: how many were clicked, and what went wrong."""

    objects: int
    labels: int
    wrong: list[str]
    ghosts: list[str]


def click_every_object(tab: Any, home: Home, tap: bool = False, part: slice = slice(None)) -> Clicks:
    """Click the confirmed objects, where neither a smaller one nor another's name lies over, and their names.

    Of both lists a ``part``. ``ghosts`` are tentative objects hit instead.
    """
    sure = [obj for obj in home.objects if obj.confirmed]
    wrong, ghosts = list[str](), list[str]()
    of = {obj.id: obj for obj in home.objects}

    def click(meant: MapObject, x: float, y: float, what: str = "") -> None:
        """At (x, y) in the plan's own pixels: on a busy machine the page may still move while it is laid out."""
        left, top = tab.evaluate(STILL)
        (tab.touchscreen.tap if tap else tab.mouse.click)(left + x, top + y)
        found: int | None = tab.evaluate("chosen")
        if found != meant.id:
            wrong.append(f"{what}{meant.label} {meant.id}: {found}")
        if meant.confirmed and found is not None and not of[found].confirmed:
            ghosts.append(f"{of[found].label} {found}")

    tab.evaluate(STILL)
    px, left, top = tab.evaluate("[plan.px, -plan.view.x / plan.px, -plan.view.y / plan.px]")
    named = tab.evaluate("plan.labels.placed.filter((p) => p.id !== null).map((p) => [p.id, ...p.box])")
    for obj in sure[part]:
        names = [[(b[0] - left) * px, (top - b[3]) * px, (b[2] - left) * px, (top - b[1]) * px]
                 for number, *b in named if number != obj.id]  # fmt: skip
        x, y = free_point(obj, sure, names, px)
        click(obj, left + x / px, top - y / px)
    for number, *b in named[part]:
        click(of[number], (b[0] + b[2]) / 2, (b[1] + b[3]) / 2, "the name of ")
    return Clicks(len(sure[part]), len(named[part]), wrong, ghosts)


def free_point(
    obj: MapObject, others: Sequence[MapObject], names: Sequence[Sequence[float]], px: float
) -> tuple[float, float]:
    """The point of an object's outline farthest from its edge and from what lies over it; its middle if that is all."""
    from scipy.ndimage import distance_transform_edt

    (x1, y1), (x2, y2) = obj.box_min[:2], obj.box_max[:2]
    step = min(px, (x2 - x1) / 5, (y2 - y1) / 5)
    xs, ys = (np.arange(low + step / 2, high, step) for low, high in ((x1, x2), (y1, y2)))
    free = np.ones((len(ys), len(xs)), bool)
    area = (x2 - x1) * (y2 - y1)
    over = [(*other.box_min[:2], *other.box_max[:2]) for other in others if other.id != obj.id]
    for a1, b1, a2, b2 in [*(b for b in over if (b[2] - b[0]) * (b[3] - b[1]) < area), *names]:
        free &= ~(((xs >= a1) & (xs <= a2))[None] & ((ys >= b1) & (ys <= b2))[:, None])
    if not free.any():
        return (x1 + x2) / 2, (y1 + y2) / 2
    far = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(far.argmax()), far.shape)
    return float(xs[column]), float(ys[row])
