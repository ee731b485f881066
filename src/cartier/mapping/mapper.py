"""Incremental mapping: frames and detections in, objects and a floor plan kept, a home out at any time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cartier.contracts import Detector, Encoder, Recording, RecordingDefaults, optional
from cartier.errors import InputError
from cartier.home.entity import Home
from cartier.mapping.config import MappingConfig, config_for
from cartier.mapping.detection_cache import Detect
from cartier.mapping.domain import domain_warning
from cartier.mapping.indexing import make_indexes
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.poses.alignment import Alignment
from cartier.mapping.poses.motions import moved
from cartier.mapping.poses.pose_graph import Mended
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.mapping.recording_row import recording_row
from cartier.mapping.replay import KeptFrame, frame_key, replay
from cartier.mapping.state import MapState
from cartier.types import Detections, Frame

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
        self.detector, self.config = detector, config_for(config, onto)
        self._onto, self._asked = onto, (indexes, encoder)
        self.begin(onto)

    def begin(self, onto: Home | None) -> None:
        """Begin without the frames so far.

        Args:
            onto: The home to grow. With None, a mapper that has a home maps apart from it, for a comparison, without
                the indices that were asked for.

        Raises:
            InputError: ``onto`` was mapped by another detector, or lacks what growing needs.
        """
        indexes, encoder = self._asked
        if onto is not None:
            self.state = MapState.thaw(onto, self.detector, self.config, indexes is not None)
            return
        asked = None if self._onto is not None else indexes
        empty = make_indexes(asked or DEFAULT_INDEXES, encoder)
        self.state = MapState.start(self.detector, self.config, empty, asked is not None)

    def contains(self, recording: Recording) -> bool:
        """Whether the recording is already in the map.

        Args:
            recording: The recording.

        Returns:
            Whether a recording of the same content was mapped.

        Raises:
            InputError: It is not in the map and cannot be added, because a scale is a guess.
        """
        held = recording.fingerprint() in (row["sha256"] for row in self.state.settings["recordings"])
        guessed = self.state.settings.get("scale_guessed") or optional(recording, RecordingDefaults, "scale_guessed")
        if guessed and not held and self.state.settings["recordings"]:
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
        return self.state.add_depth(frame, frame_key(frame) if key is None else key)

    def integrate_detections(self, frame: Frame, detections: Detections) -> npt.NDArray[np.int64]:
        """Add the detections of a frame for which ``integrate_depth`` returned True.

        Args:
            frame: The frame.
            detections: Its N detections.

        Returns:
            (N,) the object id of each detection, -1 for none.
        """
        return self.state.add_detections(frame, detections)

    def run(
        self,
        recording: Recording,
        detect: Detect,
        every: int | None,
        progress: Callable[[int, int], None] | None = None,
        watch: Callable[[Frame], None] | None = None,
    ) -> int:
        """Add a whole recording: every frame's depth, and the detections of its keyframes.

        Args:
            recording: The recording.
            detect: Gives the detections of several frames.
            every: As for ``map_home``.
            progress: Called after each frame with the number of frames done and of all frames.
            watch: Is shown every frame, to find drift.

        Returns:
            In how many frames objects were detected.
        """
        keyframes, processed, waiting = Keyframes(every, self.config.keyframes), 0, list[Frame]()
        batch = batch_size(self.detector, recording.camera)
        for done, frame in enumerate(prefetch(recording, batch), 1):
            if watch is not None:
                watch(frame)
            waiting += keyframes.push(frame) if self.integrate_depth(frame) else []
            waiting += keyframes.flush() if done == len(recording) else []
            if len(waiting) >= batch or done == len(recording):
                for keyframe, detections in zip(waiting, detect(waiting), strict=True):
                    self.integrate_detections(keyframe, detections)
                processed, waiting = processed + len(waiting), []
            if progress is not None:
                progress(done, len(recording))
        return processed

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
        fresh = Mapper(self.detector, self._asked[0], encoder=self._asked[1], onto=self._onto, config=self.config)
        replay(fresh.state, now, progress).succeed(self.state)
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
        lines = [mended and mended.note(), aligned and aligned.note(recording.name), *recording.notes]
        row = recording_row(recording, looked, mended, aligned)
        self.state.end_recording(row, dict.fromkeys(line for line in lines if line))
        settings = self.state.settings
        doubts = settings.setdefault("doubts", [])
        if optional(recording, RecordingDefaults, "scale_guessed"):
            settings["scale_guessed"] = True  # only where it is so: homes of others keep their ids
        scale = SCALE_GUESSED if settings.get("scale_guessed") else None
        doubts += [line for line in (domain_warning(self.detector, recording), scale) if line and line not in doubts]

    def home(self, drift: bool = True) -> Home:
        """The map so far, as a home that further frames do not change.

        Args:
            drift: Whether to search for drifting poses, which takes most of the time; not for answers meanwhile.

        Returns:
            The home.

        Raises:
            InputError: No frame was added, nothing was detected, or an index that was asked for is empty.
        """
        return self.state.freeze(drift)
