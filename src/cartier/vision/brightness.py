"""Lamps and screens that were seen twice: on or off from pixels, where a photograph shows it bright and another dark.

One photograph tells nothing without a model: a dark picture on a screen that is on looks like a screen that is off, and
a white shade in the sun like a lit one. A change tells: of two photographs from one side, compared with what is around
it in each, the bright one shows it on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from cartier.labels import words
from cartier.types import MapObject, View
from cartier.vision.views import MIN_APPARENT_PX, apparent_px, stored_views

SCREENS, LAMPS = frozenset(["television", "tv", "monitor", "laptop", "screen"]), frozenset(["lamp", "light", "lantern"])
CHANGE_STOPS = 1.0
"""By which it must differ between two photographs: twice as bright against its surroundings."""
LIT_STOPS = -1.5
"""What is on is at least so bright against its surroundings; by eye."""
SAME_SIDE_RAD = math.radians(45)
"""A screen from behind is dark."""
LUMA = np.array([0.2126, 0.7152, 0.0722])
FLOOR = 0.01
"""Of the brightest, added to both sides of a ratio, so that noise in the dark is no change."""


@dataclass(frozen=True)
class SeenTwice:
    """What two photographs of a lamp or a screen show.

    Args:
        state: Whether it was on in the latest photograph.
        frame: That photograph.
        other: The one with which it was compared.
        stops: How much brighter the bright one is.
    """

    state: Literal["on", "off"]
    frame: int
    other: int
    stops: float


def shines(obj: MapObject) -> bool:
    """Whether an object is a lamp or a screen by its label."""
    return bool((SCREENS | LAMPS) & set(words(obj.label)))


def seen_twice(
    obj: MapObject, sizes: Mapping[int, tuple[int, int]], rgb: Callable[[int], npt.NDArray[np.uint8]]
) -> SeenTwice | None:
    """Whether a lamp or a screen was on when it was photographed last; None if its photographs do not tell.

    Args:
        obj: The object.
        sizes: (width, height) of the stored photographs by frame.
        rgb: Gives a photograph (H, W, 3).
    """
    if not shines(obj):
        return None
    large = [v for v in stored_views(obj, sizes) if apparent_px(v, sizes[v.frame]) >= MIN_APPARENT_PX]
    if len(large) < 2:
        return None
    last = max(large, key=lambda view: view.frame)
    beside = [v for v in large if v is not last and _turned(v, last) <= SAME_SIDE_RAD]
    now = glow(obj, last, rgb(last.frame))
    by = [(glow(obj, view, rgb(view.frame)) - now, view.frame) for view in beside]
    change, other = max(by, key=lambda each: abs(each[0]), default=(0.0, 0))
    if abs(change) < CHANGE_STOPS or now + max(change, 0.0) < LIT_STOPS:
        return None
    return SeenTwice("on" if change < 0 else "off", last.frame, other, round(abs(change), 2))


def glow(obj: MapObject, view: View, rgb: npt.NDArray[np.uint8]) -> float:
    """How bright an object is against what is around it, in stops: a screen's middle, a lamp's upper third."""
    height, width = rgb.shape[:2]
    x1, y1, x2, y2 = view.box_xyxy
    wide, high = x2 - x1, y2 - y1
    if LAMPS & set(words(obj.label)):
        inner = (x1 + wide / 4, y1, x2 - wide / 4, y1 + high / 3)
    else:
        inner = (x1 + wide / 4, y1 + high / 4, x2 - wide / 4, y2 - high / 4)
    outer = _whole((x1 - wide / 2, y1 - high / 2, x2 + wide / 2, y2 + high / 2), width, height)
    left, top, right, bottom = _whole(view.box_xyxy, width, height)
    light = np.square(rgb / 255.0) @ LUMA  # about linear
    around = np.ones(light.shape, bool)
    around[top:bottom, left:right] = False
    ring = light[outer[1] : outer[3], outer[0] : outer[2]][around[outer[1] : outer[3], outer[0] : outer[2]]]
    a, b, c, d = _whole(inner, width, height)
    if not ring.size or c <= a or d <= b:
        return 0.0
    return math.log2((float(light[b:d, a:c].mean()) + FLOOR) / (float(np.median(ring)) + FLOOR))


def _whole(box: Sequence[float], width: int, height: int) -> tuple[int, int, int, int]:
    """A box in whole pixels inside of an image."""
    x1, y1, x2, y2 = (round(value) for value in box)
    return max(0, x1), max(0, y1), min(width, x2), min(height, y2)


def _turned(one: View, other: View) -> float:
    return abs(math.remainder(one.yaw - other.yaw, math.tau))
