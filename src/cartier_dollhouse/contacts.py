"""True contacts of furnishings: rays against the home's triangles find what each one stands on or in."""

from __future__ import annotations

import numpy as np

from cartier.errors import BackendError
from cartier.types import Array
from cartier_dollhouse.model import Scene, triangles
from cartier_dollhouse.trace import Tracer, tracer

TOUCH_M = 0.03  # its holder is at most so far below a furnishing, and at most so far above its lowest point
COVERED, WALLED = 0.5, 0.85  # inside is what its holder covers, or surrounds, to such a share
RAYS = 15  # along each side of an outline
UP, DOWN = np.array([0, 0, 1], np.float32), np.array([0, 0, -1], np.float32)


class Contacts:
    """What each furnishing of a scene stands on or in: ``holder`` has (id, "on" or "in") by id; ``covered`` are (id, id
    of what is above more than half of it)."""

    def __init__(self, scene: Scene) -> None:
        self._mesh = triangles(scene)
        self._boxes = {t.id: np.array([t.box_min, t.box_max], np.float32) for t in scene.truth()}
        self._own = {i: self._tracer([i]) for i in self._boxes}
        self._structure = self._tracer([0])
        self.holder: dict[int, tuple[int, str]] = {}
        self.covered: set[tuple[int, int]] = set()
        for i in self._boxes:
            self._look_at(i)
        for i in self._boxes:
            self._break_cycle(i)

    def mapped_holder(self, thing: int, mapped: set[int]) -> tuple[int, str] | None:
        """What holds a furnishing; if that is not in the map, what holds that."""
        found = self.holder.get(thing)
        while found and found[0] not in mapped:
            found = self.holder.get(found[0])
        return found

    def _look_at(self, i: int) -> None:
        low, high = self._boxes[i]
        share = (np.arange(RAYS, dtype=np.float32) + 0.5) / RAYS
        xy = np.stack(np.meshgrid(*(low[:2] + share[:, None] * (high - low)[:2]).T), -1).reshape(-1, 2)
        near = self._near(i)
        others = self._tracer(near) if near else None
        bottom = low[2] - 1 + self._far(self._own[i], _at(xy, low[2] - 1), UP)
        stands = bottom < max(low[2], float(np.nanmin(bottom))) + TOUCH_M
        feet = _at(xy[stands], bottom[stands] + 0.02)
        below, far = self._met(others, feet, DOWN)
        holder = _most(below[far < 0.02 + TOUCH_M])
        if holder:
            roof = _at(feet[:, :2], max(high[2] - 0.005, low[2] + 0.015))
            turn = np.arange(24) / 24 * 2 * np.pi
            level = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1).astype(np.float32)
            middle = np.tile([*(low + high)[:2] / 2, low[2] + min(0.03, (high[2] - low[2]) / 2)], (24, 1))
            covers, walls = (
                np.isfinite(self._far(self._own[holder], *rays)).mean() for rays in ((roof, UP), (middle, level))
            )
            self.holder[i] = holder, "in" if covers >= COVERED or walls >= WALLED else "on"
        top = high[2] + 1 - self._far(self._own[i], _at(xy, high[2] + 1), DOWN)
        above, _ = self._met(others, _at(xy, top + 0.005)[np.isfinite(top)], UP)
        cover = _most(above)
        if cover and (above == cover).mean() >= COVERED and cover != holder and self.holder.get(cover, (0,))[0] != i:
            self.covered.add((i, cover))

    def _break_cycle(self, i: int) -> None:
        """Of furnishings that hold each other in a ring, as a cabinet and a bowl in it seem to, the smallest holds
        none."""
        ring = [i]
        while (found := self.holder.get(ring[-1])) and found[0] not in ring:
            ring.append(found[0])
        if found:
            ring = ring[ring.index(found[0]) :]
            smallest = min(ring, key=lambda j: float(np.prod(self._boxes[j][1] - self._boxes[j][0])))
            del self.holder[next(j for j in ring if self.holder[j][0] == smallest)]

    def _near(self, i: int) -> list[int]:
        """What may touch or cover a furnishing."""
        low, high = self._boxes[i]
        return [
            j for j, (a, b) in self._boxes.items() if j != i and (a[:2] <= high[:2]).all() and (b[:2] >= low[:2]).all()
        ]

    def _tracer(self, ids: list[int]) -> Tracer:
        """Of the triangles of some furnishings; 0 is the structure."""
        made = tracer(self._mesh, np.flatnonzero(np.isin(self._mesh.instance, ids)))
        if made is None:
            raise BackendError("what stands on what is found by tracing rays: this machine has no embreex")
        return made

    def _far(self, by: Tracer, starts: Array, ways: Array) -> Array:
        """How far rays reach, NaN where they meet nothing."""
        triangle, _, _, far = by.hits(starts.astype(np.float32), np.broadcast_to(ways, starts.shape))
        return np.where(triangle >= 0, far, np.nan)

    def _met(self, others: Tracer | None, starts: Array, ways: Array) -> tuple[Array, Array]:
        """Whose triangles rays meet first (0: the structure or nothing), and how far off."""
        whose, far = np.zeros(len(starts), int), np.full(len(starts), np.inf)
        for by in (self._structure, *([others] if others else [])):
            triangle, _, _, reached = by.hits(starts.astype(np.float32), np.broadcast_to(ways, starts.shape))
            first = (triangle >= 0) & (reached < far)
            whose = np.where(first, self._mesh.instance[triangle], whose)
            far = np.where(first, reached, far)
        return whose, far


def _at(xy: Array, z: Array | float) -> Array:
    return np.column_stack([xy, np.broadcast_to(z, len(xy))])


def _most(ids: Array) -> int:
    """The id that is there most often, 0 without any."""
    return int(np.bincount(ids).argmax()) if len(ids) else 0
