"""Stream events: stamped frames, pose updates and faults, as a live source yields them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cartier.errors import check_pose, need
from cartier.types.frames import Detections, Frame

REASONS: Mapping[str, str] = {
    "silent": "nothing arrives",
    "no_depth": "no depth image within 20 ms of the colour image",
    "no_pose": "no transform covers the image within half a second",
    "no_detections": "no detections have the image's stamp",
    "too_early": "taken before the first transform that is known",
    "pose_gap": "the transforms have a gap there",
    "pose_jump": "the transforms jump there faster than a robot moves",
    "circle": "transforms run in a circle: that which closes it is left out",
    "frame": "poses are told in another frame than the one that is mapped",
    "two_parents": "a frame has two parents: two programs publish it",
    "double": "an image with the same stamp came before",
    "late": "a later image came before it",
    "clock": "the clock jumped: what was taken around the jump is left out",
    "unreadable": "an image or a message cannot be read",
    "lost": "the transport lost messages",
    "busy": "this computer is slower than the stream",
    "ended": "the stream ended before it was whole",
}
"""Why a stream says something, or why frames are left out."""


@dataclass(frozen=True, eq=False)
class Stamped:
    """A frame of a stream.

    Args:
        frame: The frame, with its pose in the world that is mapped. Its ``index`` counts the frames of the stream.
        stamp_ns: When it was taken, by the stream's clock (ns).
        odom_from_camera: (4, 4) the pose by odometry alone, which is smooth but drifts; None if it is not known.
        detections: What a detector on the robot found in it; None if the source brings none.
        received_s: When all of it had arrived, by ``time.monotonic`` (s).
    """

    frame: Frame
    stamp_ns: int
    odom_from_camera: npt.NDArray[np.float64] | None = None
    received_s: float = field(default_factory=time.monotonic)
    detections: Detections | None = None

    def __post_init__(self) -> None:
        if self.odom_from_camera is not None:
            pose = check_pose(self.odom_from_camera, f"the odometry of frame {self.frame.index}")
            object.__setattr__(self, "odom_from_camera", pose)


@dataclass(frozen=True, eq=False)
class PoseUpdate:
    """Corrected poses of frames that were sent before, as a robot's SLAM knows them after a loop closure.

    Args:
        poses: (4, 4) world_from_camera by the stamp of the frame (ns). It is of all frames from the first to the last
            of these; between two that are named, their corrections are blended.
        origin: Who corrects: a topic, for a person to see.
        received_s: When it arrived, by ``time.monotonic`` (s).
    """

    poses: Mapping[int, npt.NDArray[np.float64]]
    origin: str
    received_s: float = field(default_factory=time.monotonic)

    def __post_init__(self) -> None:
        checked = {int(ns): check_pose(pose, f"the corrected pose at {ns} ns") for ns, pose in self.poses.items()}
        object.__setattr__(self, "poses", checked)


@dataclass(frozen=True)
class Fault:
    """Something that a stream has to say of itself.

    Args:
        reason: One of ``REASONS``.
        text: What is wrong and how to mend it, in one line.
        frames: How many frames were left out because of it.
    """

    reason: str
    text: str
    frames: int = 0

    def __post_init__(self) -> None:
        need(self.reason in REASONS, f"a fault's reason is one of {', '.join(REASONS)}, not {self.reason!r}")
        need(bool(self.text.strip()) and "\n" not in self.text, f"a fault says one line, got {self.text!r}")
        need(self.frames >= 0, f"a fault leaves out 0 frames or more, got {self.frames}")


Event = Stamped | PoseUpdate | Fault
"""What a source yields."""
