"""A stream whose frames are level and upright, however the world of its poses lies.

That is measured by the first frames, and again whenever twice as many have come. Where the floor comes into view only
later, the poses of the frames before are corrected as a SLAM corrects them. How the first images are turned stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cartier.contracts import Detector, Recording, Source, SourceDefaults, optional
from cartier.mapping.gravity import FRAMES, SAMPLES_ACROSS
from cartier.mapping.poses.motions import Matrix
from cartier.mapping.samples import thinned, thinned_depth
from cartier.mapping.upright import Levelled, measured, upright
from cartier.types import Array, Camera
from cartier.types.streams import Event, PoseUpdate, Stamped

FIRST, LAST = 5, 2000  # frames by which it is measured first, and at most
LEAST_M, LEAST_RAD = 0.05, 0.03  # what is corrected later
ORIGIN = "the floor, which came into view"


class Level:
    """Obeys the Source contract; a recording that is played is level as ``map_home`` makes it."""

    def __init__(self, source: Source, detector: Detector, onto: Sequence[Mapping[str, Any]]) -> None:
        self._source, self._detector = source, detector
        self._levelled: Levelled | None = None
        self._fixed = any(row.get("level") for row in onto)
        self.recording: Recording | None = optional(source, SourceDefaults, "recording")
        if self.recording is not None:
            whole = upright(self.recording, detector, onto)
            self.recording, self._levelled, self._fixed = whole, whole.levelled, True
        elif self._fixed:
            self._levelled = Levelled.of_row(next(row for row in onto if row.get("level")))
        self._told: dict[int, Matrix] = {}
        self._seen: dict[int, Array | None] = {}
        self._small: Camera | None = None
        self._every = 1

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    @property
    def levelled(self) -> Levelled | None:
        """How it is corrected, once that is measured."""
        return self._levelled

    @property
    def notes(self) -> Sequence[str]:
        """What the source says, and what is corrected."""
        return (*optional(self._source, SourceDefaults, "notes"), *(self._levelled.notes if self._levelled else ()))

    def close(self) -> None:
        self._source.close()

    def __iter__(self) -> Iterator[Event]:
        held = list[Stamped]()
        for event in self._source:
            if isinstance(event, Stamped):
                self._see(event)
                held.append(event)
                if self._levelled is not None or len(held) == FIRST:
                    yield from self._level(held)
                continue
            yield from self._level(held)
            yield self._corrected(event) if isinstance(event, PoseUpdate) else event
        yield from self._level(held)
        yield from self._again()

    def _level(self, held: list[Stamped]) -> Iterator[Event]:
        """What was held until it was known how it lies."""
        if held and self._levelled is None:
            self._levelled = self._measured()
        for event in held:
            yield self._of(event)
        held.clear()
        if len(self._told) in (FIRST << doubled for doubled in range(1, 9)):
            yield from self._again()

    def _see(self, event: Stamped) -> None:
        """Keep what level and floor are measured by."""
        if self._fixed or len(self._told) >= LAST:
            return
        frame, stride = event.frame, max(1, event.frame.camera.width // SAMPLES_ACROSS)
        self._small = thinned(frame.camera, stride)
        self._told[event.stamp_ns] = frame.world_from_camera
        if len(self._told) % self._every == 0:
            self._seen[event.stamp_ns] = None if frame.depth_m is None else thinned_depth(frame, stride)
        if len(self._seen) > 2 * FRAMES:
            self._seen, self._every = dict(list(self._seen.items())[::2]), 2 * self._every

    def _measured(self) -> Levelled:
        assert self._small is not None
        depths = list(self._seen.values())
        found = measured(np.array([self._told[ns] for ns in self._seen]), self._small, depths.__getitem__)
        return replace(found, turns=0) if optional(self._detector, Detector, "as_recorded") else found

    def _again(self) -> Iterator[PoseUpdate]:
        """The poses so far, if the frames that came since say that the world lies otherwise."""
        if self._fixed or self._levelled is None or len(self._told) == LAST:
            return
        before = self._levelled.level_from_world
        now = replace(self._measured(), turns=self._levelled.turns)
        turn = now.level_from_world[:3, :3] @ before[:3, :3].T
        leans = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) > LEAST_RAD
        if leans or abs(now.level_from_world[2, 3] - before[2, 3]) > LEAST_M:
            self._levelled = now
            yield PoseUpdate({ns: now.pose(pose) for ns, pose in self._told.items()}, ORIGIN)

    def _of(self, event: Stamped) -> Stamped:
        assert self._levelled is not None
        if not self._levelled.changes():
            return event
        odom, images = event.odom_from_camera, Levelled(turns=self._levelled.turns)
        odom = None if odom is None else images.pose(odom)
        return replace(event, frame=self._levelled.frame(event.frame), odom_from_camera=odom)

    def _corrected(self, event: PoseUpdate) -> PoseUpdate:
        self._told |= {ns: pose for ns, pose in event.poses.items() if ns in self._told}
        if self._levelled is None:
            return event
        return replace(event, poses={ns: self._levelled.pose(pose) for ns, pose in event.poses.items()})
