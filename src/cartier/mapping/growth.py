"""State from which a home grows on: frozen when a home is made, packed when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from functools import cache

import numpy as np

from cartier.home.detection_log import DetectionLog
from cartier.home.entity import CLOUD, DETECTIONS
from cartier.io.files import npz_bytes
from cartier.mapping.cloud import CloudMapper
from cartier.mapping.floor_kinds import FloorKindMapper
from cartier.mapping.object_map import MAP_ABOUT, MAP_ARRAYS, ObjectMap
from cartier.mapping.occupancy import OccupancyMapper
from cartier.types import Array

COUNTS, FRAMES, FLOOR_KINDS = "occupancy_counts.npz", "frames.npz", "floor_kinds.npz"


class Packed(Mapping[str, bytes]):
    """Named blobs, each of which is made when it is first read.

    Args:
        parts: What makes each blob.
    """

    def __init__(self, parts: Mapping[str, Callable[[], bytes]]) -> None:
        self._parts, self._packed = parts, dict[str, bytes]()

    def __getitem__(self, name: str) -> bytes:
        if name not in self._packed:
            self._packed[name] = self._parts[name]()
        return self._packed[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


def growth(
    objects: ObjectMap,
    seen: Iterable[int],
    log: DetectionLog,
    floor: OccupancyMapper,
    kinds: FloorKindMapper,
    cloud: CloudMapper,
) -> Packed:
    """The state of a map with the keys of the frames that it has; all but ``objects`` is copied and may go on."""
    keys, counts, cloud, state = np.array(sorted(seen), np.int64), floor.counts(), deepcopy(cloud), cache(objects.state)
    parts: dict[str, Callable[[], bytes]] = {
        MAP_ARRAYS: lambda: state()[MAP_ARRAYS],
        MAP_ABOUT: lambda: state()[MAP_ABOUT],
        FRAMES: lambda: npz_bytes(keys=keys),
        DETECTIONS: deepcopy(log).state,
    }
    if counts is not None:
        parts |= {COUNTS: _packs(counts), FLOOR_KINDS: _packs(kinds.state())}
    if not cloud.empty:
        parts[CLOUD] = cloud.state
    return Packed(parts)


def _packs(arrays: Mapping[str, Array]) -> Callable[[], bytes]:
    now = {name: array.copy() for name, array in arrays.items()}
    return lambda: npz_bytes(**now)
