"""Images and the detections that come for them, later and perhaps not for each: paired by their stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from cartier.types.streams import Fault
from cartier_ros.bags.detections import SAME_NS
from cartier_ros.streams.messages import Message
from cartier_ros.streams.pairing import Paired

WAIT_S = 2.0  # for a detector on the robot
MOST_WAITING = 64  # images: two seconds at 30 Hz
MOST_MESSAGES = 256


class Detected(NamedTuple):
    """An image with its depth and pose, and the message with its detections."""

    paired: Paired
    message: Message


class DetectionPairer:
    """Holds images until the detections of their stamp have come; ``topic`` is that of the detections."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._images: deque[tuple[Paired, float]] = deque()
        self._messages: deque[tuple[int, Message]] = deque(maxlen=MOST_MESSAGES)

    def add(self, stamp_ns: int, message: Message) -> None:
        """Take in the detections of an image."""
        self._messages.append((stamp_ns, message))

    def clear(self) -> None:
        """The clock jumped: what is held is of before."""
        self._images.clear()
        self._messages.clear()

    def poll(self, new: Sequence[Paired | Fault], now_s: float) -> list[Detected | Fault]:
        """The images that are complete now, in order; those of which no detections came are left out."""
        done: list[Detected | Fault] = [each for each in new if isinstance(each, Fault)]
        self._images.extend((each, now_s) for each in new if not isinstance(each, Fault))
        newest = max((stamp_ns for stamp_ns, _ in self._messages), default=-1)
        while self._images:
            first, since_s = self._images[0]
            own = [message for stamp_ns, message in self._messages if abs(stamp_ns - first.stamp_ns) <= SAME_NS]
            passed = newest > first.stamp_ns + SAME_NS or len(self._images) > MOST_WAITING
            if not own and not passed and now_s - since_s < WAIT_S:
                break
            self._images.popleft()
            lack = f"no message of {self._topic} has the stamp of the image at {first.stamp_ns / 1e9:.3f} s"
            done.append(Detected(first, own[-1]) if own else Fault("no_detections", lack, 1))
        return done
