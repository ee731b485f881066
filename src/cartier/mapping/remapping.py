"""Mapping of kept frames again: with corrected poses, or onto a home in whose frame they were not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import TYPE_CHECKING

from cartier.home import Home
from cartier.mapping.alignment import Alignment
from cartier.mapping.prefetch import read_ahead
from cartier.mapping.repose import KeptFrame, keep_ids
from cartier.types import Detections, Frame

if TYPE_CHECKING:
    from cartier.mapping.mapper import Mapper

REREADERS = 2  # threads that read kept frames again: a live session has more to do


def again(
    mapper: Mapper,
    kept: Sequence[KeptFrame],
    progress: Callable[[int, int], None] | None = None,
    onto: Home | None = None,
) -> Mapper:
    """A new mapper of the same settings, with these frames; by default onto the home that the old one grows."""
    (indexes, encoder), onto = mapper._asked, mapper._onto if onto is None else onto
    fresh = type(mapper)(mapper.detector, indexes, encoder=encoder, onto=onto, config=mapper.config)
    reads = read_ahead((each.read for each in kept), REREADERS)
    for done, (each, (frame, detections)) in enumerate(zip(kept, reads, strict=True), 1):
        _add(fresh, each, frame, detections)
        if progress is not None:
            progress(done, len(kept))
    return fresh


def add_kept(mapper: Mapper, kept: KeptFrame) -> None:
    """Map a frame that is read again, with the pose that it has now."""
    _add(mapper, kept, *kept.read())


def _add(mapper: Mapper, kept: KeptFrame, frame: Frame, detections: Detections) -> None:
    frame = replace(frame, world_from_camera=kept.world_from_camera)
    if mapper.integrate_depth(frame, kept.key):
        mapper.integrate_detections(frame, detections)


def succeed(mapper: Mapper, old: Mapper) -> None:
    """Go on where another mapper of the same detections is; objects get the ids that they have there."""
    mapper._settings, mapper._notes = deepcopy(old._settings), dict(old._notes)
    mapper._next_frame, mapper._blind = old._next_frame, old._blind
    if old._objects is not None and mapper._objects is not None:
        keep_ids((old._objects, old._log), (mapper._objects, mapper._log), old._first_id)


def keep_depth(mapper: Mapper, old: Mapper) -> None:
    """Take on the floor plan and the points of a mapper that took in the depth of more frames in the same poses."""
    mapper._floor, mapper._cloud, mapper._conditions, mapper._seen = old._floor, old._cloud, old._conditions, old._seen


def follow(mapper: Mapper, apart: Mapper, aligned: Alignment) -> None:
    """Go on where a mapper is that mapped these frames apart, before they were moved onto the home of this one."""
    mapper._settings["recordings"] += [row | {"moved": aligned.row()} for row in apart._settings["recordings"]]
    mapper._notes |= apart._notes
    mapper._next_frame += apart._next_frame
    mapper._blind = apart._blind
