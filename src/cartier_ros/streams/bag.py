"""A recording in any format, played as a stream: bag:PATH@SPEED, in its own time, faster, or as fast as it goes (max).

Of a ROS bag the messages are played, and its images are paired with depth and transforms as those of a live robot are.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import Detector, Recording, Source
from cartier.errors import CartierError, InputError
from cartier.sources.common.pacing import QUIET_S, Pace, check_speed
from cartier.sources.common.player import RecordingPlayer
from cartier.types.streams import Event, Fault
from cartier_ros import rosbag
from cartier_ros.bags.bag import Bag
from cartier_ros.bags.poses import transform_tree
from cartier_ros.streams.detected import WAIT_S
from cartier_ros.streams.messages import bag_messages
from cartier_ros.streams.ros_frames import KINDS, WORLD_S, RosFrames, RosOptions


def make(model: str, speed: float = 1.0, format: str | None = None, **options: Any) -> Source:
    """``model`` is the path of the recording, ``options`` are those of its reader.

    Raises InputError for a path that is no recording, or an impossible speed.
    """
    speed, path = check_speed(float(speed)), Path(model)
    if not path.exists():
        raise InputError(f"{path} does not exist")
    known = set(RosOptions.__dataclass_fields__)
    if format in (None, "rosbag") and rosbag.matches(path) and set(options) <= known:
        import rosbags  # noqa: F401  # a missing package is reported at once, with its extra

        return BagPlayer(path, speed, format, options)
    return RecordingPlayer(plugins.open_recording(path, format, **options), speed)


class BagPlayer:
    """Obeys the Source contract: the messages of a ROS bag, by the times at which they were recorded."""

    def __init__(self, path: Path, speed: float, format: str | None, options: dict[str, Any]) -> None:
        self._bag, self._format, self._options = Bag(path), format, options
        self.name, self.waits = self._bag.path.resolve().name, not speed
        self._frames = RosFrames(self.name, RosOptions(**options), self._bag)
        self._find_world()
        self._closed = threading.Event()
        self._pace = Pace(speed, self._closed)
        self._recording: Recording | None = None

    @property
    def notes(self) -> Sequence[str]:
        return (*self._bag.notes, *self._frames.notes)

    @property
    def world_frame(self) -> str:
        return self._frames.world_frame

    @property
    def detector(self) -> Detector | None:
        return self._frames.detector

    @property
    def recording(self) -> Recording | None:
        """The bag as its reader gives it; None if that cannot read it."""
        if self._recording is None:
            try:
                self._recording = plugins.open_recording(self._bag.path, self._format, **self._options)
            except CartierError:
                return None
        return self._recording

    def _find_world(self) -> None:
        """Map in the frame that the bag's reader maps in: what comes late in the bag is known beforehand."""
        options, choice = self._frames.options, self._frames.choice
        if options.frame is not None or options.odometry is not None or choice is None:
            return
        with contextlib.suppress(InputError):  # what is wrong with its transforms is told when they come
            tree = transform_tree(self._bag)
            if tree.moving(choice.colour.frame) and (world := tree.world(choice.colour.frame)):
                self._frames.world_frame = world

    def __iter__(self) -> Iterator[Event]:
        now_s, told_s = 0.0, time.monotonic()
        for log_ns, message in bag_messages(self._bag, KINDS):
            now_s = log_ns / 1e9
            yield from self._pace.until(now_s, f"{self.name} has no message here")
            if self._closed.is_set():
                return
            self._frames.feed(message, now_s)
            events = self._frames.poll(now_s)
            if not events and time.monotonic() - told_s >= QUIET_S:
                events = [Fault("silent", self._frames.why_silent())]
            told_s = time.monotonic() if events else told_s
            yield from self._until_closed(events)
        ended = False
        while not (ended or self._closed.is_set()):  # what still waits is decided: nothing more will come
            now_s += max(WORLD_S, WAIT_S)
            events = self._frames.poll(now_s)
            ended = not events
            yield from self._until_closed(events)

    def close(self) -> None:
        self._closed.set()

    def _until_closed(self, events: Sequence[Event]) -> Iterator[Event]:
        return itertools.takewhile(lambda _: not self._closed.is_set(), events)
