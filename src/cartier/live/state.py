"""State of a live session: what came in, what was left out and why, how late the map is; for people and programs."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.types.streams import Fault

KEPT_DELAYS = 1000


@dataclass(frozen=True)
class LiveState:
    """How a live session is doing.

    Args:
        phase: "waiting" (no frame came yet), "mapping", "ended" or "failed".
        frames_in: Frames that came with a pose.
        measured: Of these, the frames whose depth is in the floor plan.
        keyframes: Of these, the frames that show something new.
        looked: Of these, the frames in which objects were detected.
        dropped: How many frames were left out, by reason (``cartier.types.streams.REASONS``).
        thinned: Frames that were passed over, because depth is taken ten times a second.
        waiting: Keyframes that wait for the detector.
        postponed: Keyframes for which the detector had no time: they are looked at when the stream has ended.
        delay_s: From the arrival of the newest frame in the map until it could be answered for (s); None before that.
        delay_p50_s, delay_p95_s: The same over the last frames.
        as_of_s: How old the newest frame in the map is now (s); None before the first map.
        floor_seen: Which share of the floor was looked at, an estimate from 0 to 1.
        objects, confirmed: How many objects the map has.
        pose_updates: How many corrections of poses came.
        frame_epoch: How often the map was moved by them.
        resumed: Keyframes of an earlier run that was cut off.
        world_frame: The frame that is mapped, by its name on the robot.
        message: The latest thing that the source said; empty if all is well.
    """

    phase: str = "waiting"
    frames_in: int = 0
    measured: int = 0
    keyframes: int = 0
    looked: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    thinned: int = 0
    waiting: int = 0
    postponed: int = 0
    delay_s: float | None = None
    delay_p50_s: float | None = None
    delay_p95_s: float | None = None
    as_of_s: float | None = None
    floor_seen: float = 0.0
    objects: int = 0
    confirmed: int = 0
    pose_updates: int = 0
    frame_epoch: int = 0
    resumed: int = 0
    world_frame: str = "map"
    message: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values.

        Returns:
            All fields by name.
        """
        return asdict(self) | {"dropped": dict(self.dropped)}

    def line(self) -> str:
        """One line for a terminal.

        Returns:
            What came in, what was left out and why, and how late the map is.
        """
        lost = sum(self.dropped.values())
        why = f" ({', '.join(f'{reason} {count}' for reason, count in sorted(self.dropped.items()))})" if lost else ""
        parts = [f"{self.phase}: {self.frames_in} frames, {self.looked} looked at"]
        parts += [f"in the frame {self.world_frame!r}"] if self.world_frame != "map" else []
        parts += [f"{self.postponed} put off to the end"] if self.postponed else []
        parts += [f"{lost} left out{why}"] if lost else []
        parts += (
            [f"{self.confirmed} objects", f"{self.floor_seen:.0%} of the floor seen"]
            if self.as_of_s is not None
            else []
        )
        parts += [f"{self.delay_p50_s:.1f} s behind"] if self.delay_p50_s is not None else []
        parts += [self.message] if self.message else []
        return " · ".join(parts)


def planar(pose: npt.NDArray[np.float64]) -> list[float]:
    """x, y (m) and the heading of the camera (rad) of a pose (4, 4), world_from_camera."""
    return [round(float(v), 3) for v in (*pose[:2, 3], np.arctan2(pose[1, 2], pose[0, 2]))]


class Tally:
    """The counts of a session; any thread may add to them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._delays_s: deque[float] = deque(maxlen=KEPT_DELAYS)
        self._message, self._message_s = "", 0.0

    def add(self, what: str, count: int = 1) -> None:
        with self._lock:
            self._counts[what] += count

    def fault(self, fault: Fault) -> None:
        """Count what a fault left out, and remember what it says."""
        with self._lock:
            self._dropped[fault.reason] += fault.frames
            self._message, self._message_s = fault.text, time.monotonic()

    def answerable(self, delays_s: list[float]) -> None:
        """Frames are in a map that answers, so long after they arrived."""
        with self._lock:
            self._delays_s += delays_s

    def counts(self) -> dict[str, Any]:
        """The fields of a ``LiveState`` that are counted here."""
        with self._lock:
            delays = sorted(self._delays_s)
            late = self._delays_s[-1] if delays else None
            recent = self._message if time.monotonic() - self._message_s < 5 else ""
            return dict(self._counts) | {
                "dropped": {reason: count for reason, count in self._dropped.items() if count},
                "delay_s": late,
                "delay_p50_s": delays[len(delays) // 2] if delays else None,
                "delay_p95_s": delays[int(len(delays) * 0.95)] if delays else None,
                "message": recent,
            }
