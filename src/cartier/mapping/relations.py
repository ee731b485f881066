"""Relations between mapped objects, from their boxes: pure functions, each result with metres and a probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartier.types import MapObject

NEAR_M = 0.12  # a bottom so near to a top stands on it


@dataclass(frozen=True)
class Relation:
    """``subject`` stands in a relation of a ``kind`` to ``object`` (ids); ``metres`` between what touches, or apart."""

    kind: str
    subject: int
    object: int
    metres: float
    probability: float


def supports(objects: Sequence[MapObject]) -> dict[int, Relation]:
    """What each thing stands on or in, by its id."""
    found: dict[int, Relation] = {}
    for thing in objects:
        low, high = np.array(thing.box_min), np.array(thing.box_max)
        for other in objects:
            o_low, o_high = np.array(other.box_min), np.array(other.box_max)
            shared = np.minimum(high, o_high)[:2] - np.maximum(low, o_low)[:2]
            share = float(np.prod(np.maximum(shared, 0)) / max(float(np.prod((high - low)[:2])), 1e-4))
            gap = float(abs(low[2] - o_high[2]))
            if (
                other.id != thing.id
                and share > 0.5
                and gap < NEAR_M
                and np.prod((o_high - o_low)[:2]) > np.prod((high - low)[:2])
            ):
                likely = share * (1 - gap / NEAR_M / 2)
                if thing.id not in found or found[thing.id].probability < likely:
                    found[thing.id] = Relation("on", thing.id, other.id, gap, min(likely, 1.0))
    return found
