"""State of a map: what its frames left in it; started or thawed from a home, added to, and frozen into a home."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Detector, FrameIndex, SpatialIndex, optional
from cartier.errors import InputError
from cartier.home.corrected import apply
from cartier.home.data import origin_of
from cartier.home.detection_log import DetectionLog
from cartier.home.entity import CLOUD, DETECTIONS, Home
from cartier.io.files import npz_bytes, read_npz
from cartier.mapping.bearings import BearingGeometry
from cartier.mapping.cloud import CloudMapper
from cartier.mapping.config import MappingConfig
from cartier.mapping.extent import DepthGeometry
from cartier.mapping.indexing import filled_indexes
from cartier.mapping.object_ids import keep_ids
from cartier.mapping.object_map import MAP_ABOUT, MAP_ARRAYS, ObjectMap
from cartier.mapping.occupancy import OccupancyMapper
from cartier.mapping.photos import BestPhotos
from cartier.mapping.plausibility import weighed
from cartier.mapping.quality import Conditions
from cartier.mapping.rooms import find_rooms, rooms_of
from cartier.mapping.walls import walls_yaw
from cartier.spatial.doors import remembered
from cartier.types import Array, Camera, Detections, Frame, OccupancyGrid

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


class FloorKinds(Protocol):
    """Tells the kind of floor in each cell. An entry point ``cartier.floor_kinds`` makes it for a resolution (m)."""

    def add(self, frame: Frame) -> None:
        """Take in a keyframe with depth."""
        ...

    def kinds(self, grid: OccupancyGrid) -> npt.NDArray[np.uint8] | None:
        """(H, W) the number of each cell's kind in ``FLOOR_KINDS``, 0 for unknown; None if nothing is known."""
        ...

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """What is saved with a home."""
        ...

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Go on from what was saved. Raises InputError if it is damaged."""
        ...


class MapState:
    """Objects, floor plan, points, detections and all else that a map holds of its frames.

    Args:
        detector: What detects the objects.
        config: The numbers of the mapping.
        indexes: The spatial indices, empty or those of ``onto``.
        settings: What is saved with the home.
        onto: The home that is grown.
        required: Whether each index was asked for by name, and must not stay empty.
    """

    def __init__(
        self,
        detector: Detector,
        config: MappingConfig,
        indexes: dict[str, SpatialIndex],
        settings: dict[str, Any],
        onto: Home | None = None,
        required: bool = False,
    ) -> None:
        self.detector, self.config, self.indexes, self.settings = detector, config, indexes, settings
        self.notes: dict[str, None] = {}
        self.objects: ObjectMap | None = None  # the first frame decides: with or without depth
        self._onto, self._required = onto, required
        self._score_model = optional(detector, Detector, "score_model")
        self._floor, self._cloud = OccupancyMapper(config.occupancy), CloudMapper()
        self._floor_kinds, self._conditions = _floor_kinds(config), Conditions()
        self._seen, self._photos, self._log = set[int](), BestPhotos(), DetectionLog()
        self._start_xy: tuple[float, float] | None = None
        self._camera: Camera | None = None
        self._next_frame = self._blind = self._first_id = 0
        self._frame_indexes = [index for index in indexes.values() if isinstance(index, FrameIndex)]

    @classmethod
    def start(
        cls, detector: Detector, config: MappingConfig, indexes: dict[str, SpatialIndex], required: bool = False
    ) -> Self:
        """An empty map."""
        settings: dict[str, Any] = {
            "recordings": [], **_made_by(detector), "indexes": list(indexes), "encoder": None,
            "knows": list(optional(detector, Detector, "knows")), "doubts": [],
        }  # fmt: skip
        if changed := config.differences():
            settings["config"] = changed  # only what differs: homes mapped with the defaults keep their ids
        return cls(detector, config, indexes, settings, required=required)

    @classmethod
    def thaw(cls, home: Home, detector: Detector, config: MappingConfig, required: bool = False) -> Self:
        """The map that a home was frozen from, to grow it.

        Raises InputError if the home was mapped by another detector, or lacks what growing needs.
        """
        for what, mine in _made_by(detector).items():
            if home.settings.get(what) != mine:
                raise InputError(
                    f"{home.name} was mapped by {home.detector}, not by {detector.name}: add with the same detector"
                )
        state = cls(detector, config, deepcopy(dict(home.indexes)), deepcopy(dict(home.settings)), home, required)
        state._start_xy, state._camera, state._photos = home.start_xy, home.camera, BestPhotos(home.photos)
        state.notes = dict.fromkeys(home.notes)
        doors = () if home.route_map is None else home.route_map.doors
        state.settings |= remembered(doors, home.settings)  # a door that is shut by now is told by that
        try:
            state._restore(home)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            lacking = error.args[0] if isinstance(error, KeyError) else "sound record of its recordings"
            raise InputError(f"{home.name} keeps no {lacking} to go on from: map it again") from error
        return state

    def _restore(self, home: Home) -> None:
        self.objects = self._object_map(home.grid is not None)
        rows = [(row["recording"], row["sha256"], int(row["frames"])) for row in self.settings["recordings"]]
        self._next_frame = sum(frames for _, _, frames in rows)
        self.objects.restore(home.growth)
        self._first_id = self.objects.next_id
        self.objects.kept = frozenset(number for t in home.objects if t.by_person for number in (t.id, *t.aliases))
        self._seen = set(read_npz(home.growth[FRAMES], where=FRAMES)["keys"].tolist())
        self._log.restore(home.growth[DETECTIONS])
        if COUNTS in home.growth:
            self._floor.restore(read_npz(home.growth[COUNTS], where=COUNTS))
        if FLOOR_KINDS in home.growth:
            self._floor_kinds.restore(read_npz(home.growth[FLOOR_KINDS], where=FLOOR_KINDS))
        if CLOUD in home.growth:
            self._cloud.restore(home.growth[CLOUD])

    def _object_map(self, with_depth: bool) -> ObjectMap:
        return ObjectMap(self._score_model, self.config, DepthGeometry if with_depth else BearingGeometry)

    def add_depth(self, frame: Frame, key: int) -> bool:
        """Add the depth of a frame, which ``key`` tells from all others, to the floor plan and the points.

        Returns whether its detections may be added: not for a frame that is already in the map, or that lacks depth
        while the map has it.
        """
        if key in self._seen:
            return False
        self._seen.add(key)
        self._start_xy = self._start_xy or (float(frame.world_from_camera[0, 3]), float(frame.world_from_camera[1, 3]))
        self._camera = self._camera or frame.camera
        if self.objects is None:
            self.objects = self._object_map(frame.depth_m is not None)
        if frame.depth_m is not None:
            self._floor.add(frame)
            self._cloud.add(frame)
        self._conditions.add(frame)
        if frame.depth_m is None and self.objects.geometry.with_depth:
            self._blind += 1
            return False
        return True

    def add_detections(self, frame: Frame, detections: Detections) -> npt.NDArray[np.int64]:
        """Add the N detections of a frame for which ``add_depth`` returned True; returns (N,) object ids, or -1."""
        assert self.objects is not None
        if self._next_frame:
            frame = replace(frame, index=frame.index + self._next_frame)
            detections = replace(detections, frame=frame.index)
        ids = self.objects.add(frame, detections, self._next_frame)
        self._log.add(detections, ids)
        if frame.depth_m is not None:
            self._floor_kinds.add(frame)
        if self._frame_indexes:
            counting = detections.keep(detections.scores >= self._score_model.threshold)
            for index in self._frame_indexes:
                index.add(frame, counting)
        self._photos.keep(frame, self.objects.best_frames())
        return ids

    def end_recording(self, row: dict[str, Any], notes: Mapping[str, None]) -> None:
        """All frames of a recording were added: the next ones are of another."""
        self.settings["recordings"].append(row)
        self.notes |= notes
        self._next_frame += row["frames"]

    def succeed(self, old: MapState, with_depth: bool = False) -> None:
        """Go on where the map is from which these frames were replayed; objects get the ids that they have there.

        Args:
            old: That map.
            with_depth: Whether it took in the depth of more frames in the same poses, which is then taken over.
        """
        self.settings, self.notes = deepcopy(old.settings), dict(old.notes)
        self._next_frame, self._blind = old._next_frame, old._blind
        if with_depth:
            self._floor, self._cloud = old._floor, old._cloud
            self._conditions, self._seen = old._conditions, old._seen
        if old.objects is not None and self.objects is not None:
            keep_ids((old.objects, old._log), (self.objects, self._log), old._first_id)

    def follow(self, apart: MapState, moved: list[float]) -> None:
        """Go on where a map is that had these frames apart, before they were ``moved`` (turn, shift) onto this one."""
        self.settings["recordings"] += [row | {"moved": moved} for row in apart.settings["recordings"]]
        self.notes |= apart.notes
        self._next_frame += apart._next_frame
        self._blind = apart._blind

    def freeze(self, drift: bool = True) -> Home:
        """The map so far, as a home that further frames do not change; ``drift``: whether drifting poses are searched.

        Raises InputError if no frame was added, nothing was detected, or an index that is required stays empty.
        """
        if self._start_xy is None or self._camera is None or self.objects is None:
            raise InputError("nothing was mapped yet: the recording holds no frames")
        grid = self._floor.grid()
        grid = None if grid is None else replace(grid, floor_kinds=self._floor_kinds.kinds(grid))
        yaw = None if grid is None else walls_yaw(grid)
        self.objects.fit(yaw)  # what is fitted here need not be fitted again for the next home
        merged = deepcopy(self.objects)
        merged.consolidate(yaw)
        objects = merged.objects(yaw)
        if not objects:
            hint = "is the threshold too high, or are these not the things that it knows?"
            told = "; ".join(optional(self.detector, Detector, "notes")) or hint
            raise InputError(f"{self.detector.name} found nothing in the {len(self._seen)} frames: {told}")
        if merged.geometry.with_depth:
            objects = weighed(objects, grid, self._camera, self.config.existence.confirmed_probability)
        rooms = find_rooms(grid, objects, self.config.rooms) if grid is not None else ()
        within = rooms_of(objects, grid, rooms)
        objects = tuple(replace(obj, room=room) for obj, room in zip(objects, within, strict=True))
        with_depth = self.objects.geometry.with_depth
        name = " + ".join(row["recording"] for row in self.settings["recordings"][:1]) or "live"
        known = None
        if self._onto is not None:
            name = self._onto.mapped_name
            if self._onto.corrected is not None:  # what people said holds in the grown home, too
                known = apply(self._onto.corrected.log, objects, rooms, grid, name, origin_of(self.settings))
                name, objects, rooms = known.name, known.objects, known.rooms
        indexes, about_indexes, encoder = filled_indexes(self.indexes, objects, self._required, with_depth)
        settings = self.settings | ({} if encoder is None else {"encoder": encoder})
        notes = dict.fromkeys([*self._home_notes(grid is not None, drift), *about_indexes])
        return Home(
            name, self.detector.name, self._camera, objects, indexes, grid, self._start_xy, settings, rooms,
            self._photos.of(objects), tuple(notes),
            self._growth(merged), corrected=known,
        )  # fmt: skip

    def _home_notes(self, with_grid: bool, drift: bool) -> Iterator[str]:
        """What a user of the home should know about how it was made."""
        yield from self.settings.get("doubts", ())
        yield from self.notes
        yield from self._conditions.notes(drift)
        yield from optional(self.detector, Detector, "notes")
        if not self._score_model.measured:
            yield f"{self.detector.name} was never measured: how likely its objects are there is a sober guess"
        if not with_grid:
            yield "the recording has no depth: no occupancy grid, and so no goals; objects lie where bearings meet"
        if self._blind:
            yield f"{self._blind} frames without depth add nothing to a map that has depth"

    def _growth(self, objects: ObjectMap) -> Packed:
        """What ``thaw`` reads; all but ``objects`` is copied and may go on."""
        keys, counts = np.array(sorted(self._seen), np.int64), self._floor.counts()
        cloud, state = deepcopy(self._cloud), cache(objects.state)
        parts: dict[str, Callable[[], bytes]] = {
            MAP_ARRAYS: lambda: state()[MAP_ARRAYS],
            MAP_ABOUT: lambda: state()[MAP_ABOUT],
            FRAMES: lambda: npz_bytes(keys=keys),
            DETECTIONS: deepcopy(self._log).state,
        }
        if counts is not None:
            parts |= {COUNTS: _packs(counts), FLOOR_KINDS: _packs(self._floor_kinds.state())}
        if not cloud.empty:
            parts[CLOUD] = cloud.state
        return Packed(parts)


def _floor_kinds(config: MappingConfig) -> FloorKinds:
    made: FloorKinds = plugins.neighbour("floor_kinds", "texture")(config.occupancy.resolution_m)
    return made


def _packs(arrays: Mapping[str, Array]) -> Callable[[], bytes]:
    now = {name: array.copy() for name, array in arrays.items()}
    return lambda: npz_bytes(**now)


def _made_by(detector: Detector) -> dict[str, Any]:
    return {"detector": detector.name, "detector_sha256": optional(detector, Detector, "sha256")}
