"""ROS bags: ROS 1 .bag, ROS 2 .mcap or .db3 files and folders; images, CameraInfo, and /tf or odometry for the poses.

Topics are found by their types; ``colour``, ``depth``, ``info`` and ``odometry`` name them where that does not do. Each
image's pose is read from /tf and /tf_static at the image's own time stamp, interpolated. What lies outside of the
transforms' time is not extrapolated but left out and counted in the notes. The world is the frame ``map``, else
``odom``, else ``world``, else the root of the tree, and it stays exactly that frame, so that a goal is valid on the
robot: z = 0 is taken for the floor. Depth that is not registered to colour is reprojected. Distortion is taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.contracts import Detector, Recording
from cartier.errors import InputError, brief, frame_number
from cartier.io.bounded_file import Index
from cartier.mapping import gravity
from cartier.recordings.common.files import READERS, content_hash
from cartier.recordings.common.posed import check_floor
from cartier.recordings.common.poses import rigid
from cartier.types import Camera, Detections, Frame, TrueObject
from cartier_ros.bags.bag import METADATA, Bag, files_of
from cartier_ros.bags.detections import DETECTIONS, SAME_NS, read_detections, topic_detector
from cartier_ros.bags.frames import FrameImages, registration
from cartier_ros.bags.poses import camera_poses, left_out, transform_tree
from cartier_ros.bags.runs import Series, clock_notes, longest_run
from cartier_ros.bags.tf import Edge, extrinsic_matrix
from cartier_ros.bags.topics import Choice, Stream, choose

EXTRA = "ros"
DEFAULT_PERIOD_S = 0.1


def matches(path: Path) -> bool:
    """Whether a path is a bag file or a folder of them."""
    return bool(files_of(path))


def open(
    path: str | Path,
    colour: str | None = None,
    depth: str | None = None,
    info: str | None = None,
    frame: str | None = None,
    odometry: str | None = None,
    extrinsic: Sequence[float] | str | None = None,
    up: Sequence[float] | None = None,
    floor_m: float | None = None,
    detections: str | None = None,
) -> Recording:
    """Read a bag.

    ``colour``, ``depth``, ``info``: topics. ``frame``: the world frame. ``odometry``: a topic of type Odometry or
    PoseStamped to take the poses from instead of /tf; ``extrinsic``, x,y,z,qx,qy,qz,qw, is the camera's pose in the
    frame that it moves. ``up`` and ``floor_m`` level a world that is not level. ``detections``: a topic of detections
    that the bag holds; only images that have some are frames then, and the recording's ``detector`` gives them.
    """
    import rosbags  # noqa: F401  # a missing package is reported at once, with its extra

    bag = Bag(Path(path))
    choice = choose(bag, colour, depth, info)
    body = None if extrinsic is None else extrinsic_matrix(extrinsic)
    settings = f"rosbag 1 {colour} {depth} {info} {frame} {odometry} {extrinsic} up={up} floor_m={floor_m}"
    settings += "" if detections is None else f" {detections}"
    return RosBag(bag, choice, settings, frame, odometry, body, up, floor_m, detections)


class RosBag:
    """A bag's images with poses. The index, stamps and transforms are read when it is opened, images when asked for."""

    truth: Sequence[TrueObject] | None = None
    detector: Detector | None = None
    readers = READERS

    def __init__(
        self,
        bag: Bag,
        choice: Choice,
        settings: str,
        frame: str | None,
        odometry: str | None,
        body_from_camera: npt.NDArray[np.float64] | None,
        up: Sequence[float] | None,
        floor_m: float | None,
        detections: str | None,
    ) -> None:
        self.name = bag.path.resolve().name
        self.camera: Camera = choice.colour_lens.camera
        self._bag, self._choice, self._settings = bag, choice, settings
        self._reading = Lock()  # of the bag's bytes; images are decoded side by side
        self._fingerprint: str | None = None
        notes = [*choice.notes, *bag.notes]
        tree = transform_tree(bag)
        poses_of = camera_poses(bag, tree, choice.colour.frame, frame, odometry, body_from_camera)
        seen = self._seen(choice.colour, notes)
        measured = None if choice.depth is None else self._seen(choice.depth, notes)
        seen, measured = self._one_run(seen, measured, poses_of.moving, notes)
        rows, stamps_s = seen.rows, seen.times_s
        found = poses_of.at(stamps_s)
        keep = np.asarray(np.isfinite(found.matrices).all(axis=(1, 2)))
        partner = self._partners(stamps_s, measured, keep, notes)
        keep &= partner >= 0
        found_at = None if detections is None else self._detected(detections, stamps_s, keep, notes)
        keep &= True if found_at is None else found_at >= 0
        notes += [*poses_of.notes, *left_out(found, poses_of.what)]
        if not keep.any():
            raise InputError(f"{bag.path}: no image of {choice.colour.name} can be used: {'; '.join(notes)}")
        self._rows: Index = choice.colour.index[rows][keep]
        self._partner = partner[keep]
        self._times_s = stamps_s[keep]
        if detections is not None and found_at is not None:
            self._found_at = found_at[keep]
            self.detector = topic_detector(detections, partial(self._detections, self._topic(detections)))
        self._images = FrameImages(choice, registration(choice, tree, notes))
        poses = np.array([rigid(pose, str(bag.path)) for pose in found.matrices[keep]])
        if up is not None or floor_m is not None:
            levelling = gravity.level(poses, self.camera, None, up or (0, 0, 1), 0.0 if floor_m is None else floor_m)
            self.level_from_world = levelling.level_from_world  # so that the doctor sees the poses as they were given
            poses = levelling.level_from_world @ poses
            check_floor(poses, floor_m)
            notes += levelling.notes
        elif choice.depth is None:  # else it is measured
            notes.append(f"the floor is taken to be z = 0 of frame {poses_of.world!r}; override with --floor M")
        self._poses = poses
        self._poses.setflags(write=False)
        self.notes: Sequence[str] = notes

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Frame:
        i = frame_number(index, len(self), self.name)
        message, where = self._message(self._choice.colour, self._rows[i])
        return Frame(
            index=i,
            time_s=float(self._times_s[i]),
            rgb=self._images.rgb(message, where),
            depth_m=self._depth(i),
            world_from_camera=self._poses[i],
            camera=self.camera,
        )

    def fingerprint(self) -> str:
        if self._fingerprint is None:
            path = self._bag.path
            root = path if path.is_dir() else path.parent
            names = [file.name for file in self._bag.files]
            names += [METADATA] if path.is_dir() and (path / METADATA).is_file() else []
            self._fingerprint = content_hash(self._settings, root, names)
        return self._fingerprint

    def _message(self, stream: Stream, row: Index) -> tuple[Any, str]:
        where = f"{self._bag.path}: topic {stream.name} at {int(row[0]) / 1e9:.3f} s"
        with self._reading:
            return self._bag.decode(stream.name, self._bag.read(row)), where

    def _depth(self, i: int) -> npt.NDArray[np.float32] | None:
        stream = self._choice.depth
        if stream is None:
            return None
        return self._images.depth_m(*self._message(stream, stream.index[self._partner[i]]))

    def _topic(self, given: str) -> str:
        """The name of a topic of detections in the bag."""
        there = self._bag.topics(*DETECTIONS)
        name = next((name for name in there if name.lstrip("/") == given.lstrip("/")), None)
        if name is None:
            told = f"holds {self._bag.type_of(given)}" if self._bag.type_of(given) else "is not there"
            raise InputError(
                f"{self._bag.path}: topic {brief(given, 80)} {told}; topics of detections: {', '.join(there) or 'none'}"
            )
        return name

    def _detected(
        self, given: str, stamps_s: npt.NDArray[np.float64], usable: npt.NDArray[np.bool_], notes: list[str]
    ) -> Index:
        """Which message of detections has the stamp of each image, -1 for none."""
        name = self._topic(given)
        self._found = self._bag.index(name)
        times_s = np.array([self._bag.header(name, row).stamp_ns for row in self._found], np.int64) / 1e9
        if not len(times_s):
            raise InputError(f"{self._bag.path}: topic {name} has no messages")
        order = np.argsort(times_s, kind="stable")
        at = order[np.clip(np.searchsorted(times_s[order], stamps_s - SAME_NS / 1e9), 0, len(order) - 1)]
        same = np.abs(times_s[at] - stamps_s) <= SAME_NS / 1e9
        if (usable & ~same).any():
            lack = f"no message of {name} has their stamp"
            notes.append(f"{int((usable & ~same).sum())} images left out: {lack}")
        return np.asarray(np.where(same, at, -1), np.int64)

    def _detections(self, name: str, number: int) -> Detections:
        """What the bag's own detections say of a frame."""
        row = self._found[self._found_at[frame_number(number, len(self), self.name)]]
        where = f"{self._bag.path}: topic {name} at {int(row[0]) / 1e9:.3f} s"
        with self._reading:
            data = self._bag.read(row)
        kind, encoding = self._bag.type_of(name), self._bag.encoding(name)
        return read_detections(data, kind, encoding, self._choice, number, where)

    def _seen(self, stream: Stream, notes: list[str]) -> _Seen:
        """The messages of a stream that hold an image, with their own stamps, else the recorder's."""
        headers = [self._bag.header(stream.name, row) for row in stream.index]
        rows = np.flatnonzero([not header.empty_image for header in headers])
        if len(rows) < len(headers):
            notes.append(f"{len(headers) - len(rows)} messages of {stream.name} left out: their images are empty")
        stamps_ns = np.array([headers[row].stamp_ns for row in rows], dtype=np.int64)
        if not stamps_ns.any():
            notes.append(
                f"the images of {stream.name} carry no time stamps; the times at which they were recorded are used"
            )
            stamps_ns = stream.index[rows, 0]
        return _Seen(self._bag.order(stream.index[rows]), stamps_ns / 1e9, rows)

    def _one_run(
        self, seen: _Seen, measured: _Seen | None, moving: Sequence[Edge], notes: list[str]
    ) -> tuple[_Seen, _Seen | None]:
        """The images and depth of the longest run; the transforms are cut to it, too."""
        index, where = self._choice.colour.index[seen.rows], str(self._bag.path)
        others = [*([] if measured is None else [measured]), *(edge.series() for edge in moving)]
        kept, says = longest_run(seen, others, self._bag.pauses(index), where)
        notes += says
        if kept is not None:
            seen, parts = seen.part(kept[0]), iter(kept[1:])
            measured = None if measured is None else measured.part(next(parts))
            for edge in moving:
                edge.kept = next(parts)
        notes += clock_notes(seen, [edge.series() for edge in moving], self._bag.logged)
        return seen, measured

    def _partners(
        self,
        stamps_s: npt.NDArray[np.float64],
        measured: _Seen | None,
        posed: npt.NDArray[np.bool_],
        notes: list[str],
    ) -> Index:
        """Which depth image belongs to each colour image, -1 for none: the nearest, at most half a period away."""
        if measured is None:
            notes.append("there is no depth")
            return np.zeros(len(stamps_s), np.int64)
        order = np.argsort(measured.times_s, kind="stable")
        rows, times_s = measured.rows[order], measured.times_s[order]
        after = np.clip(np.searchsorted(times_s, stamps_s), 0, len(times_s) - 1)
        before = np.maximum(after - 1, 0)
        nearest = np.where(np.abs(times_s[before] - stamps_s) < np.abs(times_s[after] - stamps_s), before, after)
        steps = np.diff(np.sort(stamps_s))
        period_s = float(np.median(steps[steps > 0])) if (steps > 0).any() else DEFAULT_PERIOD_S
        away_s = np.abs(times_s[nearest] - stamps_s)
        lonely = away_s > period_s / 2
        if (lonely & posed).any():
            clocks = f" (the nearest is {np.median(away_s):.3g} s away: two clocks?)" if lonely.all() else ""
            lack = f"no depth within {period_s / 2 * 1000:.0f} ms of them{clocks}"
            notes.append(f"{int((lonely & posed).sum())} images left out: {lack}")
        return np.asarray(np.where(lonely, -1, rows[nearest]), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Seen(Series):
    """An image stream, and the rows of its index."""

    rows: Index

    def part(self, places: Index) -> _Seen:
        return _Seen(self.order[places], self.times_s[places], self.rows[places])
