"""Player of a ROS bag on real ROS 2 topics over DDS: images, CameraInfo, transforms and poses, byte for byte.

Messages of a ROS 1 bag are written anew as those of ROS 2. Stamps stay as they were recorded.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from cartier.errors import BackendError, InputError, brief
from cartier.sources.common.pacing import Pace, check_speed
from cartier_ros.bags.bag import COMPRESSED, IMAGE, TRANSFORMS, Bag
from cartier_ros.bags.images import INFO
from cartier_ros.streams.messages import Message, bag_messages
from cartier_ros.streams.ros_frames import KINDS

if TYPE_CHECKING:
    from cartier_ros.dds.topics import Writer

POLL_S = 0.1
SETTLED_S = 0.6  # after the first listener, others and their other topics are found
RECEIVED_S = 2.0
IMAGES, OTHERS = 30, 100  # messages that are kept for a listener that is slow
Progress = Callable[[int, int], None]


class TopicPlayer:
    """Publishes what a bag holds.

    Args:
        bag: The bag.
        domain: The DDS domain.
        speed: How many seconds of the bag pass in a second.

    Raises:
        InputError: The bag holds nothing that can be played.
        BackendError: DDS cannot use the network.
    """

    def __init__(self, bag: Bag, domain: int, speed: float) -> None:
        from cartier_ros.dds.topics import Writer, participant

        played = bag.topics(*KINDS)
        if not any(bag.type_of(name) in (IMAGE, COMPRESSED) for name in played):
            raise InputError(f"{bag.path} holds no images to play")
        self._bag, self._closed = bag, threading.Event()
        self._pace = Pace(check_speed(speed), self._closed)
        self._participant = participant(domain)
        self._writers: dict[str, Writer] = {}
        for name in played:
            kind = _kind(bag.type_of(name))
            latched = kind == INFO or name.endswith("tf_static")
            depth = IMAGES if kind in (IMAGE, COMPRESSED) else OTHERS
            self._writers[name] = Writer(self._participant, _topic(name), kind, depth, latched)
        self.left_out = [name for name in bag.all_topics() if name not in played]
        """Topics of the bag whose types are not played."""
        self.damaged: list[str] = []
        """What is wrong with messages that were not played."""
        self.count = sum(len(bag.index(name)) for name in played)

    def wait(self) -> int:
        """Wait until somebody listens to an image, then for others; returns how many, 0 if closed."""
        images = [writer for name, writer in self._writers.items() if self._bag.type_of(name) in (IMAGE, COMPRESSED)]
        settled_s, count = 0.0, 0
        while settled_s < SETTLED_S and not self._closed.wait(POLL_S):
            now = sum(writer.listeners() for writer in self._writers.values())
            heard = any(writer.listeners() for writer in images)
            settled_s, count = settled_s + POLL_S if heard and now == count else 0.0, now
        return 0 if self._closed.is_set() else max(writer.listeners() for writer in images)

    def play(self, progress: Progress | None = None) -> Counter[str]:
        """Publish all messages in the bag's own time; returns how many went out, by topic."""
        sent: Counter[str] = Counter()
        for log_ns, message in bag_messages(self._bag, KINDS):
            for _ in self._pace.until(log_ns / 1e9, "the bag has no message here"):
                pass
            if self._closed.is_set():
                break
            try:
                self._writers[message.topic].write(cdr_of(message))
            except (InputError, BackendError) as error:
                self.damaged.append(brief(error, 200))
                continue
            sent[message.topic] += 1
            if progress is not None:
                progress(sent.total(), self.count)
        if not self._closed.is_set():
            for writer in self._writers.values():
                writer.received(RECEIVED_S)
        return sent

    def close(self) -> None:
        """End it, from any thread."""
        self._closed.set()


def cdr_of(message: Message) -> bytes:
    """The CDR bytes of a message of a bag. Raises InputError for a damaged one of ROS 1."""
    from cartier_ros.dds.types import encoded, ros2_of

    if message.encoding == "cdr":
        return message.data
    if message.encoding != "ros1":
        raise InputError(f"{message.topic} is encoded as {brief(message.encoding, 40)!r}; cartier plays cdr and ros1")
    return encoded(ros2_of(message.decode(), _kind(message.kind)))


def _kind(kind: str) -> str:
    return TRANSFORMS[0] if kind in TRANSFORMS else kind


def _topic(name: str) -> str:
    """The name of a topic as ROS 2 has it: with a slash before it."""
    return f"/{name.lstrip('/')}"
