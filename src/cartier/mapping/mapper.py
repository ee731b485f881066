"""Incremental mapping: frames and detections in, objects and a floor plan kept, a home out at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Detector, Encoder, FrameIndex, Recording, RecordingDefaults, optional
from cartier.errors import InputError
from cartier.home.corrected import apply
from cartier.home.data import origin_of
from cartier.home.detection_log import DetectionLog
from cartier.home.entity import CLOUD, DETECTIONS, Home
from cartier.io.files import read_npz
from cartier.mapping.alignment import Alignment
from cartier.mapping.bearings import BearingGeometry
from cartier.mapping.cloud import CloudMapper
from cartier.mapping.config import MappingConfig, config_for
from cartier.mapping.domain import domain_warning
from cartier.mapping.extent import DepthGeometry
from cartier.mapping.floor_kinds import FloorKindMapper
from cartier.mapping.growth import COUNTS, FLOOR_KINDS, FRAMES, growth
from cartier.mapping.indexing import filled_indexes, make_indexes
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.occupancy import OccupancyMapper
from cartier.mapping.photos import BestPhotos
from cartier.mapping.plausibility import weighed
from cartier.mapping.pose_graph import Mended
from cartier.mapping.quality import Conditions
from cartier.mapping.recording_row import recording_row
from cartier.mapping.remapping import again, succeed
from cartier.mapping.repose import KeptFrame, frame_key, moved
from cartier.mapping.rooms import find_rooms, rooms_of
from cartier.mapping.walls import walls_yaw
from cartier.spatial.doors import remembered
from cartier.types import Camera, Detections, Frame

DEFAULT_INDEXES = ("object_depth", "object_viewpoint")
SCALE_GUESSED = "the scale of this home is a guess: its metres and centimetres are right only relative to each other"


class Mapper:
    """Grows the map of one home frame by frame; of the frames, only photos of the objects' best views are kept.

    Args:
        detector: Detects the objects.
        indexes: The names of the spatial indices to build; by default those that need no encoder and that the frames
            allow.
        encoder: NAME, NAME:MODEL or an Encoder, for indices that need one.
        onto: A home to grow, mapped by the same detector; its indices, settings and configuration stay.
        config: The numbers of the mapping; by default those of ``onto``, else ``MappingConfig()``.

    Raises:
        InputError: ``onto`` was mapped by another detector, or lacks what growing needs.
        BackendError: An index or encoder is unknown.

    Example:
        >>> import cartier
        >>> walk = cartier.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=12)
        >>> mapper = cartier.Mapper(cartier.make("detectors", "ground_truth", truth=walk.truth, source="dollhouse"))
        >>> for number in range(len(walk)):
        ...     ids = mapper.add(walk[number])  # the ids of the objects that its detections belong to
        >>> mapper.finish(walk)
        >>> mapper.home().settings["recordings"][0]["frames"]
        12
    """

    def __init__(
        self,
        detector: Detector,
        indexes: Sequence[str] | None = None,
        *,
        encoder: str | Encoder = "embedded",
        onto: Home | None = None,
        config: MappingConfig | None = None,
    ) -> None:
        self.detector, self._onto, self._explicit = detector, onto, indexes is not None
        self._asked = indexes, encoder
        made_by = {"detector": detector.name, "detector_sha256": optional(detector, Detector, "sha256")}
        self._score_model = optional(detector, Detector, "score_model")
        self._objects: ObjectMap | None = None  # the first frame decides: with or without depth
        self.config = config_for(config, onto)
        self._floor, self._cloud = OccupancyMapper(self.config.occupancy), CloudMapper()
        self._floor_kinds = FloorKindMapper(self.config.occupancy.resolution_m)
        self._conditions = Conditions()
        self._seen, self._photos, self._log = set[int](), BestPhotos(), DetectionLog()
        self._start_xy: tuple[float, float] | None = None
        self._camera: Camera | None = None
        self._next_frame = self._blind = self._first_id = 0
        self._notes: dict[str, None] = {}
        if onto is None:
            self._indexes = make_indexes(indexes or DEFAULT_INDEXES, encoder)
            self._settings: dict[str, Any] = {
                "recordings": [], **made_by, "indexes": list(self._indexes), "encoder": None,
                "knows": list(optional(detector, Detector, "knows")), "doubts": [],
            }  # fmt: skip
            if changed := self.config.differences():
                self._settings["config"] = changed  # only what differs: homes mapped with the defaults keep their ids
        else:
            self._go_on(onto, made_by)
        self._frame_indexes = [index for index in self._indexes.values() if isinstance(index, FrameIndex)]

    def _object_map(self, with_depth: bool) -> ObjectMap:
        return ObjectMap(self._score_model, self.config, DepthGeometry if with_depth else BearingGeometry)

    def _go_on(self, home: Home, made_by: Mapping[str, str]) -> None:
        for what, mine in made_by.items():
            if home.settings.get(what) != mine:
                raise InputError(
                    f"{home.name} was mapped by {home.detector}, not by {self.detector.name}: "
                    "add with the same detector"
                )
        self._settings, self._indexes = deepcopy(dict(home.settings)), deepcopy(dict(home.indexes))
        self._start_xy, self._camera, self._photos = home.start_xy, home.camera, BestPhotos(home.photos)
        self._notes = dict.fromkeys(home.notes)
        self._settings |= remembered(
            () if home.route_map is None else home.route_map.doors, home.settings
        )  # a door that is shut by now is told by that
        try:
            self._objects = self._object_map(home.grid is not None)
            rows = [(row["recording"], row["sha256"], int(row["frames"])) for row in self._settings["recordings"]]
            self._next_frame = sum(frames for _, _, frames in rows)
            self._objects.restore(home.growth)
            self._first_id = self._objects.next_id
            self._objects.kept = frozenset(number for t in home.objects if t.by_person for number in (t.id, *t.aliases))
            self._seen = set(read_npz(home.growth[FRAMES], where=FRAMES)["keys"].tolist())
            self._log.restore(home.growth[DETECTIONS])
            if COUNTS in home.growth:
                self._floor.restore(read_npz(home.growth[COUNTS], where=COUNTS))
            if FLOOR_KINDS in home.growth:
                self._floor_kinds.restore(read_npz(home.growth[FLOOR_KINDS], where=FLOOR_KINDS))
            if CLOUD in home.growth:
                self._cloud.restore(home.growth[CLOUD])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            told = error.args[0] if isinstance(error, KeyError) else "sound record of its recordings"
            raise InputError(f"{home.name} keeps no {told} to go on from: map it again") from error

    def contains(self, recording: Recording) -> bool:
        """Whether the recording is already in the map.

        Args:
            recording: The recording.

        Returns:
            Whether a recording of the same content was mapped.

        Raises:
            InputError: It is not in the map and cannot be added, because a scale is a guess.
        """
        held = recording.fingerprint() in (row["sha256"] for row in self._settings["recordings"])
        guessed = self._settings.get("scale_guessed") or optional(recording, RecordingDefaults, "scale_guessed")
        if guessed and not held and self._settings["recordings"]:
            raise InputError(
                f"{recording.name} cannot be added: where a scale is a guess, two recordings do not fit together; let "
                "one reconstruction have the pictures of both"
            )
        return held

    def add(self, frame: Frame, detections: Detections | None = None) -> npt.NDArray[np.int64]:
        """Map one frame. A frame that is already in the map changes nothing.

        Args:
            frame: The frame.
            detections: Its detections; by default the detector is run.

        Returns:
            (N,) the object id of each detection, -1 for none.

        Raises:
            CartierError: What the detector raises.
        """
        detections = self.detector.detect(frame) if detections is None else detections
        new = self.integrate_depth(frame)
        return self.integrate_detections(frame, detections) if new else np.full(len(detections), -1)

    def integrate_depth(self, frame: Frame, key: int | None = None) -> bool:
        """Add the depth of a frame to the floor plan and the point cloud.

        Args:
            frame: The frame.
            key: What tells it from all others; by default its time and its pixels.

        Returns:
            Whether its detections may be added: False for a frame that is already in the map, or that lacks depth while
            the map has it.
        """
        key, pose = frame_key(frame) if key is None else key, frame.world_from_camera
        if key in self._seen:
            return False
        self._seen.add(key)
        self._start_xy = self._start_xy or (float(pose[0, 3]), float(pose[1, 3]))
        self._camera = self._camera or frame.camera
        if self._objects is None:
            self._objects = self._object_map(frame.depth_m is not None)
        if frame.depth_m is not None:
            self._floor.add(frame)
            self._cloud.add(frame)
        self._conditions.add(frame)
        if frame.depth_m is None and self._objects.geometry.with_depth:
            self._blind += 1
            return False
        return True

    def integrate_detections(self, frame: Frame, detections: Detections) -> npt.NDArray[np.int64]:
        """Add the detections of a frame for which ``integrate_depth`` returned True.

        Args:
            frame: The frame.
            detections: Its N detections.

        Returns:
            (N,) the object id of each detection, -1 for none.
        """
        assert self._objects is not None
        if self._next_frame:
            frame = replace(frame, index=frame.index + self._next_frame)
            detections = replace(detections, frame=frame.index)
        ids = self._objects.add(frame, detections, self._next_frame)
        self._log.add(detections, ids)
        if frame.depth_m is not None:
            self._floor_kinds.add(frame)
        if self._frame_indexes:
            counting = detections.keep(detections.scores >= self._score_model.threshold)
            for index in self._frame_indexes:
                index.add(frame, counting)
        self._photos.keep(frame, self._objects.best_frames())
        return ids

    def repose(
        self,
        poses: Mapping[int, npt.NDArray[np.float64]],
        kept: Sequence[KeptFrame],
        progress: Callable[[int, int], None] | None = None,
    ) -> Mapper:
        """Map the same frames with corrected poses. This mapper stays as it is.

        Args:
            poses: (4, 4) corrected world_from_camera by the frames' stamps (ns).
            kept: The frames whose detections are in the map, in the order in which they were added to this mapper.
            progress: Called after each frame with the number of frames done and of all frames.

        Returns:
            A mapper that goes on where this one is, whose objects have the ids that they have here; this one itself if
            no frame moved by 2 cm or half a degree.

        Raises:
            InputError: A frame cannot be read.
        """
        now = [replace(k, world_from_camera=poses.get(k.stamp_ns, k.world_from_camera)) for k in kept]
        if not any(moved(k.world_from_camera, new.world_from_camera) for k, new in zip(kept, now, strict=True)):
            return self
        fresh = again(self, now, progress)
        succeed(fresh, self)
        return fresh

    def finish(
        self,
        recording: Recording,
        looked: int | None = None,
        mended: Mended | None = None,
        aligned: Alignment | None = None,
    ) -> None:
        """End a recording: all of its frames were added, and the next ones are of another recording.

        Args:
            recording: The recording.
            looked: In how many of its frames objects were detected; by default in all.
            mended: How the poses that it tells were corrected, if they were.
            aligned: How they were moved into the world of this map then, if they were.
        """
        self._settings["recordings"].append(recording_row(recording, looked, mended, aligned))
        told = [mended and mended.note(), aligned and aligned.note(recording.name)]
        self._notes |= dict.fromkeys(note for note in told if note)
        doubts = self._settings.setdefault("doubts", [])
        if optional(recording, RecordingDefaults, "scale_guessed"):
            self._settings["scale_guessed"] = True  # only where it is so: homes of others keep their ids
        scale = SCALE_GUESSED if self._settings.get("scale_guessed") else None
        doubts += [line for line in (domain_warning(self.detector, recording), scale) if line and line not in doubts]
        self._next_frame += len(recording)
        self._notes |= dict.fromkeys(recording.notes)

    def home(self, drift: bool = True) -> Home:
        """The map so far, as a home that further frames do not change.

        Args:
            drift: Whether to search for drifting poses, which takes most of the time; not for answers meanwhile.

        Returns:
            The home.

        Raises:
            InputError: No frame was added, nothing was detected, or an index that was asked for is empty.
        """
        if self._start_xy is None or self._camera is None or self._objects is None:
            raise InputError("nothing was mapped yet: the recording holds no frames")
        grid = self._floor.grid()
        grid = None if grid is None else replace(grid, floor_kinds=self._floor_kinds.kinds(grid))
        yaw = None if grid is None else walls_yaw(grid)
        self._objects.fit(yaw)  # what is fitted here need not be fitted again for the next home
        merged = deepcopy(self._objects)
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
        with_depth = self._objects.geometry.with_depth
        name = " + ".join(row["recording"] for row in self._settings["recordings"][:1]) or "live"
        known = None
        if self._onto is not None:
            name = self._onto.mapped_name
            if self._onto.corrected is not None:  # what people said holds in the grown home, too
                known = apply(self._onto.corrected.log, objects, rooms, grid, name, origin_of(self._settings))
                name, objects, rooms = known.name, known.objects, known.rooms
        indexes, about_indexes, encoder = filled_indexes(self._indexes, objects, self._explicit, with_depth)
        settings = self._settings | ({} if encoder is None else {"encoder": encoder})
        notes = dict.fromkeys([*self._home_notes(grid is not None, drift), *about_indexes])
        return Home(
            name, self.detector.name, self._camera, objects, indexes, grid, self._start_xy, settings, rooms,
            self._photos.of(objects), tuple(notes),
            growth(merged, self._seen, self._log, self._floor, self._floor_kinds, self._cloud), corrected=known,
        )  # fmt: skip

    def _home_notes(self, with_grid: bool, drift: bool) -> Iterator[str]:
        """What a user of the home should know about how it was made."""
        yield from self._settings.get("doubts", ())
        yield from self._notes
        yield from self._conditions.notes(drift)
        yield from optional(self.detector, Detector, "notes")
        if not self._score_model.measured:
            yield f"{self.detector.name} was never measured: how likely its objects are there is a sober guess"
        if not with_grid:
            yield "the recording has no depth: no occupancy grid, and so no goals; objects lie where bearings meet"
        if self._blind:
            yield f"{self._blind} frames without depth add nothing to a map that has depth"
