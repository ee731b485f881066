"""Furniture by name: what stands on the floor, and what has a flat top.

Detectors' boxes of furniture are often cut by what stands before it, and hold what lies on it. Its name says that it
reaches down to the floor, and that its box ends at the plane of its top.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cartier.labels import display_name

STANDING, FLAT_TOPPED = 1, 2
"""Bits of a shape."""
STAND_ON_THE_FLOOR = frozenset([
    "arm chair", "armchair", "bathtub", "bed", "bench", "bookcase", "bookshelf", "cart", "chair", "coffee table",
    "couch", "desk", "dining table", "dishwasher", "dog bed", "dresser", "floor lamp", "footstool", "fridge",
    "garbage can", "laundry hamper", "nightstand", "office chair", "ottoman", "refrigerator", "rocking chair",
    "shelving unit", "side table", "sofa", "stool", "stove", "toilet", "trash can", "tv stand", "vacuum cleaner",
    "wardrobe", "washing machine",
])  # fmt: skip
HAVE_A_FLAT_TOP = frozenset([
    "bench", "cabinet", "coffee table", "counter top", "countertop", "desk", "dining table", "dresser", "nightstand",
    "side table", "tv stand",
])  # fmt: skip
"""Both from what households hold, by hand; none of it was fitted to a recording."""


def shapes(labels: Sequence[str]) -> npt.NDArray[np.int8]:
    """The shape (n,) of what is called so: sums of ``STANDING`` and ``FLAT_TOPPED``, 0 for neither."""
    names = [display_name(label) for label in labels]
    return np.array(
        [(name in STAND_ON_THE_FLOOR) * STANDING + (name in HAVE_A_FLAT_TOP) * FLAT_TOPPED for name in names], np.int8
    )
