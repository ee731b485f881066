"""Growing map of a live session: one mapper, its keyframes and its spool; each step takes the lock by itself."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from cartier.contracts import Detector, Encoder, Recording, SourceDefaults, optional
from cartier.errors import InputError
from cartier.home import Home
from cartier.live.level import Level
from cartier.live.recorded import Recorded
from cartier.live.sent_poses import SentPoses
from cartier.live.walked import Walked
from cartier.mapping.config import MappingConfig, config_for
from cartier.mapping.detection_cache import detecting
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.mapper import Mapper
from cartier.mapping.poses.alignment import Alignment, align
from cartier.mapping.poses.motions import Matrix, moved
from cartier.mapping.replay import KeptFrame, frame_key, replay
from cartier.mapping.state import MapState
from cartier.types import Detections, Frame
from cartier.types.streams import PoseUpdate, Stamped

Progress = Callable[[int, int], None]


class GrowingMap:
    """Frames in, snapshots out.

    Args:
        source: Whose frames they are.
        detector: Detects the objects.
        spool: The file in which the keyframes are kept, or None for one that is removed in the end.
        onto: The home to grow.
        mapping: Further arguments of ``Mapper``.
        every: As for ``map_home``.
        align: Whether the source has a world of its own: frames are mapped apart until objects and walls agree where
            it lies in that of ``onto``.
    """

    def __init__(
        self,
        source: Level,
        detector: Detector,
        spool: Path | None,
        onto: Home | None,
        every: int | None,
        indexes: Sequence[str] | None,
        encoder: str | Encoder,
        config: MappingConfig | None,
        align: bool = False,
    ) -> None:
        self._source, self._detector, self._onto = source, detector, onto
        self._to_align = onto if align else None
        self._alignment: Alignment | None = None
        self._refusal = ""
        self._begun = None if align else onto
        config = config_for(config, onto)
        self._new_mapper = partial(Mapper, detector, indexes, encoder=encoder, config=config)
        self._mapper = self._new_mapper(onto=self._begun)
        self._detect = detecting(detector)
        self._keyframes = Keyframes(every, self._mapper.config.keyframes)
        self._lock = threading.Lock()
        self._walked, self._looked = Walked(source), 0
        self._by_frame: dict[int, Stamped] = {}
        self._name = source.name if spool is None else spool.stem
        self._sent, self._origins = SentPoses(), set[str]()
        self._recorded = Recorded(spool, self._about(), self._sent)
        self._kept: list[KeptFrame] = []
        self._postponed: list[tuple[int, int]] = []  # stamp (ns) and frame_key
        self._resumed = 0
        self.version = 0
        """Rises with each keyframe that is in the map, and when its poses are corrected."""
        self.epoch = 0
        """How often the map was moved by corrected poses."""

    def resume(self, progress: Progress | None = None) -> int:
        """Map the keyframes of a session that was cut off, with the detections of then; returns how many."""
        count = self._recorded.cut_off_count
        for number, kept in enumerate(self._recorded.cut_off()):
            self._walked.add(kept.frame, kept.stamp_ns)
            found = kept.detections
            if found is None and optional(self._source, SourceDefaults, "detector") is not None:
                continue  # a kill came between it and the detections that it brought
            if found is None:  # the detector had not come to it yet
                (found,) = self._detect([kept.frame])
                self._recorded.seen(kept.stamp_ns, found)
            if self._mapper.integrate_depth(kept.frame):
                self._mapper.integrate_detections(kept.frame, found)
                self._keep(kept.stamp_ns, kept.frame, number)
            if progress is not None:
                progress(number + 1, count)
        if count:
            told = optional(self._source, SourceDefaults, "notes")  # by which a simulation is known
            self._walked.notes = [*told, f"{count} keyframes of a session that was cut off"]
            self._mapper.finish(self._walked, count)
            self._walked, self.version = Walked(self._source), count
        self._resumed = count
        return count

    def heard(self, stamped: Stamped) -> None:
        """A frame has arrived, and may be taken in later: corrections that come from now on may be of it."""
        self._sent.add(stamped.stamp_ns, stamped.frame.world_from_camera)

    def measure(self, stamped: Stamped) -> list[Stamped]:
        """Take in the depth of a frame; returns the keyframes that are decided by it."""
        with self._lock:
            self._walked.add(stamped.frame, stamped.stamp_ns)
            placed = self._now(stamped)
            new = self._mapper.integrate_depth(placed.frame)
        return self._decided(stamped, self._keyframes.push(placed.frame)) if new else []

    def flush(self) -> list[Stamped]:
        """The keyframe that still waits for a sharper one."""
        return self._decided(None, self._keyframes.flush())

    def record(self, stamped: Stamped) -> None:
        """Write a keyframe to the disk, so that no kill loses it."""
        self._recorded.add(stamped)
        if stamped.detections is not None:
            self._recorded.seen(stamped.stamp_ns, stamped.detections)

    def look(self, stamped: Stamped) -> int:
        """Detect the objects of a keyframe and take them in; returns how many."""
        brought = stamped.detections
        (detections,) = self._detect([stamped.frame]) if brought is None else (brought,)
        with self._lock:
            stamped = self._now(stamped)
            self._mapper.integrate_depth(stamped.frame)  # nothing, unless the poses were corrected meanwhile
            self._mapper.integrate_detections(stamped.frame, detections)
            self._looked += 1
            self.version += 1
            if brought is None:
                self._recorded.seen(stamped.stamp_ns, detections)
            self._keep(stamped.stamp_ns, stamped.frame, stamped.frame.index)
        return len(detections)

    def postpone(self, stamped: Stamped) -> None:
        """Leave a keyframe that is on the disk for the end."""
        self._postponed.append((stamped.stamp_ns, frame_key(stamped.frame)))

    def catch_up(self, progress: Progress | None = None) -> int:
        """Detect the objects of the keyframes that were postponed, then map all again in the order of their stamps;
        returns how many there were."""
        count = len(self._postponed)
        if not count:
            return 0
        step, total = progress or (lambda done, of: None), 2 * count + len(self._kept)
        for number, (stamp_ns, key) in enumerate(self._postponed, 1):
            kept_frame = self._recorded.read(stamp_ns)
            frame = kept_frame.frame
            if kept_frame.detections is None:
                (detections,) = self._detect([frame])
                self._recorded.seen(stamp_ns, detections)
            now = self._now(Stamped(frame, stamp_ns)).frame
            self._keep(stamp_ns, now, now.index, key)
            step(number, total)
        self._postponed = []
        self._kept.sort(key=lambda each: each.stamp_ns)
        go_on = partial(MapState.succeed, with_depth=True)  # also of the frames between keyframes
        self._map_again(None, go_on, lambda done, of: step(count + done, total))
        self._looked += count
        return count

    def correct_poses(self, update: PoseUpdate) -> bool:
        """Take in corrected poses; returns whether a keyframe moved, so that ``repose`` is due."""
        with self._lock:
            if not self._sent.correct(update.poses):
                return False
            self._recorded.correct(update.origin)
            poses = self._to_correct()
            if poses:
                self._origins.add(update.origin)
            return bool(poses)

    def repose(self) -> bool:
        """Map the keyframes again with their corrected poses, while frames are still taken in; returns whether it was.

        A correction that comes meanwhile is due again.
        """
        with self._lock:
            poses = self._to_correct()
        if not poses:
            return False
        self._map_again(lambda each: poses.get(each.stamp_ns, each.world_from_camera), MapState.succeed)
        return True

    def align(self) -> bool:
        """Try to find where the source's world lies in that of the home; returns whether the map is in it now.

        The keyframes so far are mapped again, onto the home.
        """
        with self._lock:
            if self._to_align is None or self._alignment is not None:
                return False
            apart = replace(self._mapper.home(drift=False), name=self._source.name)
        try:
            found = align(self._to_align, apart)
        except InputError as error:
            self._refusal = str(error)
            return False

        def go_on(fresh: MapState, old: MapState) -> None:
            fresh.follow(old, found.row())
            self._alignment = found

        self._begun = self._to_align
        self._map_again(lambda each: found.pose(0, each.world_from_camera), go_on)
        return True

    def _map_again(
        self,
        pose_of: Callable[[KeptFrame], Matrix] | None,
        go_on: Callable[[MapState, MapState], None],
        progress: Progress | None = None,
    ) -> None:
        """Replay the keyframes while frames are still taken in, and then take the new map.

        Args:
            pose_of: The pose (4, 4) of each keyframe from now on; None if none moves.
            go_on: Makes the new map go on where the old one is then.
            progress: Called after each frame with the number of frames done and of all frames.
        """

        def placed(kept: Sequence[KeptFrame]) -> list[KeptFrame]:
            return [each if pose_of is None else replace(each, world_from_camera=pose_of(each)) for each in kept]

        with self._lock:
            count, now = len(self._kept), placed(self._kept)
        fresh = replay(self._new_mapper(onto=self._begun).state, now, progress)
        with self._lock:
            late = placed(self._kept[count:])
            go_on(replay(fresh, late), self._mapper.state)
            self._mapper.state, self._kept = fresh, now + late
            self.epoch += pose_of is not None
            self.version += 1

    @property
    def apart(self) -> bool:
        """Whether the map is still to be aligned."""
        return self._to_align is not None and self._alignment is None

    def snapshot(self) -> tuple[Home, int]:
        """The map so far, and its frame epoch. Raises InputError if there is none yet."""
        with self._lock:
            home, epoch = self._mapper.home(drift=False), self.epoch
            row = {"recording": self._walked.name, "sha256": self._walked.fingerprint(), "frames": len(self._walked)}
            looked = self._looked
        if self.apart:
            home = replace(home, notes=(*home.notes, "places are in the robot's own frame: it is not aligned yet"))
        if not row["frames"]:
            return home, epoch
        rows = [*home.settings["recordings"], row | {"looked": looked, "live": True}]
        name = self._name if self._onto is None else home.name
        return replace(home, name=name, settings={**home.settings, "recordings": rows}), epoch

    def finish(self, left_out: Mapping[str, int], thinned: int) -> tuple[Home, int]:
        """End the session; returns the whole home and its frame epoch.

        The home is that of ``cartier map`` if no frame was left out and no pose was corrected.
        """
        recording: Recording | None = optional(self._source, SourceDefaults, "recording")
        with suppress(InputError):  # nothing was detected
            self.align()
        if self.apart:
            why = self._refusal or "nothing was detected, so nothing can be aligned"
            raise InputError(f"{why}: cartier map {self._recorded.path} -o OTHER")
        with self._lock:
            if len(self._walked):
                whole = recording is not None and len(recording) == len(self._walked)
                whole = whole and not self.epoch
                notes = [*optional(self._source, SourceDefaults, "notes")]
                notes += [f"{count} frames left out: {reason}" for reason, count in sorted(left_out.items())]
                notes += [f"{thinned} frames passed over: depth is taken ten times a second"] if thinned else []
                notes += [f"poses were corrected by {origin}" for origin in sorted(self._origins)]
                self._walked.notes, self._walked.levelled = notes, self._source.levelled
                made_of = recording if whole and recording is not None else self._walked
                self._mapper.finish(made_of, self._looked, aligned=self._alignment)
            return self._mapper.home(), self.epoch

    def end_spool(self, home_id: str) -> None:
        """The home is saved."""
        self._recorded.ended(home_id)

    def close(self) -> None:
        self._recorded.close()

    def placed(self, stamped: Stamped) -> Matrix:
        """The pose of a frame in the world of the map by what is known now, (4, 4) world_from_camera."""
        return self._now(stamped).frame.world_from_camera

    def _keep(self, stamp_ns: int, frame: Frame, index: int, key: int | None = None) -> None:
        """Remember a keyframe that is in the map."""
        number = index + self._resumed

        def read() -> tuple[Frame, Detections]:
            kept = self._recorded.read(stamp_ns, number)
            assert kept.detections is not None
            return kept.frame, kept.detections

        key = frame_key(frame) if key is None else key
        self._kept.append(KeptFrame(stamp_ns, frame.world_from_camera, key, read))

    def _now(self, stamped: Stamped) -> Stamped:
        """A frame with the pose that it has in the world of the map by what is known now."""
        told = self._sent.now(stamped)
        if self._alignment is None:
            return told
        return replace(told, frame=replace(told.frame, world_from_camera=self._placed(told.frame.world_from_camera)))

    def _placed(self, pose: Matrix) -> Matrix:
        """A pose of the source's world in that of the map."""
        return pose if self._alignment is None else self._alignment.pose(0, pose)

    def _to_correct(self) -> dict[int, Matrix]:
        """The corrected poses of the keyframes in the map, if one of them moved."""
        poses = {each.stamp_ns: self._placed(self._sent.current(each.stamp_ns)) for each in self._kept}
        return poses if any(moved(each.world_from_camera, poses[each.stamp_ns]) for each in self._kept) else {}

    def _decided(self, stamped: Stamped | None, frames: list[Frame]) -> list[Stamped]:
        """The stamped frames of keyframes; of others only that is kept which may still become one."""
        if stamped is not None:
            self._by_frame[stamped.frame.index] = stamped
        chosen = [self._by_frame[frame.index] for frame in frames]
        waiting = self._keyframes.waiting
        kept = {} if waiting is None else {waiting.index: self._by_frame[waiting.index]}
        self._by_frame = kept
        return chosen

    def _about(self) -> dict[str, Any]:
        """What the spool says of the session."""
        return {
            "name": self._source.name, "detector": self._detector.name,
            "detector_sha256": optional(self._detector, Detector, "sha256"),
            "onto": None if self._onto is None else self._onto.id,
            "notes": list(optional(self._source, SourceDefaults, "notes")),
        }  # fmt: skip
