"""View selection: which stored photographs show the candidates largest and from different sides."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from cartier.geometry import shorter_side
from cartier.types import MapObject, View

MIN_APPARENT_PX = 64.0
"""The shorter side of an object's box from which a picture may be asked about: false claims follow how few pixels an
object has. Below, the answer is "cannot tell"."""
MAX_PICTURES = 3
"""In one call, of all candidates together."""
SAME_SIDE_RAD = math.radians(30)
"""Views of one object from directions that differ by less show the same side."""


def apparent_px(view: View, size: tuple[int, int]) -> float:
    """The shorter side (px) of a view's box, as far as it lies inside of an image of a size (width, height)."""
    return shorter_side(view.box_xyxy, size)


def stored_views(obj: MapObject, sizes: Mapping[int, tuple[int, int]]) -> list[View]:
    """The views of an object whose photographs are stored; ``sizes`` has their (width, height) by frame."""
    return [view for view in obj.all_views if view.frame in sizes]


def ranked(views: Sequence[View], sizes: Mapping[int, tuple[int, int]]) -> list[View]:
    """Views in the order in which they are taken: the largest, then the largest from another side, and so on."""
    left = sorted(views, key=lambda v: (-apparent_px(v, sizes[v.frame]), v.frame))
    chosen: list[View] = []
    while left:
        best = next((v for v in left if not _seen_from(v, chosen)), left[0])
        chosen.append(best)
        left.remove(best)
    return chosen


def select(
    objects: Sequence[MapObject], sizes: Mapping[int, tuple[int, int]], out: Collection[int] = ()
) -> list[tuple[MapObject, View]]:
    """The views to ask about, at most ``MAX_PICTURES``: first one of each candidate, then further ones in turn.

    Views below ``MIN_APPARENT_PX`` and frames in ``out`` are left out. Candidates keep their order; the views of one
    stand in the order in which they were taken.
    """
    large = [
        [v for v in ranked(stored_views(obj, sizes), sizes)
         if v.frame not in out and apparent_px(v, sizes[v.frame]) >= MIN_APPARENT_PX]
        for obj in objects[:MAX_PICTURES]
    ]  # fmt: skip
    turns = [(k, n) for n in range(MAX_PICTURES) for k in range(len(large)) if n < len(large[k])][:MAX_PICTURES]
    picked = [(k, large[k][n]) for k, n in turns]
    return [(objects[k], view) for k, view in sorted(picked, key=lambda pair: (pair[0], pair[1].frame))]


def _seen_from(view: View, others: Sequence[View]) -> bool:
    """Whether one of the others shows the same side."""
    return any(abs(math.remainder(view.yaw - other.yaw, math.tau)) < SAME_SIDE_RAD for other in others)
