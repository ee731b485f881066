"""A robot's ROS 2 topics over DDS, without ROS: images, CameraInfo, /tf and /tf_static, found by type and name.

Messages stay the bytes that they came as until it is known that they are needed. What every writer of a topic offers is
asked for: reliable and latched where all are, so that no publisher is left out.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from cartier.contracts import Detector, Source
from cartier.errors import BackendError, InputError, brief
from cartier.sources.common.pacing import QUIET_S
from cartier.types.streams import Event, Fault
from cartier_ros.bags.bag import COMPRESSED, IMAGE, TRANSFORMS
from cartier_ros.bags.detections import DETECTIONS
from cartier_ros.bags.images import INFO
from cartier_ros.bags.poses import ODOMETRY, POSE
from cartier_ros.dds.domain import domain_of, range_here
from cartier_ros.streams.gaps import Gaps
from cartier_ros.streams.messages import Message
from cartier_ros.streams.ros_frames import RosFrames, RosOptions

if TYPE_CHECKING:
    from cartier_ros.dds.topics import Offer, Publishers, Reader

EXTRA = "ros"
POLL_S, FIND_S = 0.004, 0.25  # how often messages are taken, and topics looked for
IMAGES, OTHERS = 30, 100  # messages that wait: a second of images at 30 Hz
TF, TRANSFORM = ("/tf", "/tf_static"), TRANSFORMS[0]
PICTURES, POSES = (IMAGE, COMPRESSED), (ODOMETRY, POSE)
NEEDED = (IMAGE, COMPRESSED, TRANSFORM, ODOMETRY, POSE)  # topics from which something must come


def make(
    domain: int | None = None,
    colour: str | None = None,
    depth: str | None = None,
    info: str | None = None,
    frame: str | None = None,
    odometry: str | None = None,
    extrinsic: Sequence[float] | str | None = None,
    detections: str | None = None,
) -> Source:
    """``domain`` is the robot's ROS_DOMAIN_ID, by default this shell's, else 0; the rest is as for ROS bags.

    Raises BackendError for an impossible domain.
    """
    import cyclonedds  # noqa: F401  # a missing package is reported at once, with its extra
    import rosbags  # noqa: F401

    from cartier_ros.dds.types import topic_type

    number = domain_of(domain, "source ros2")
    for kind in (IMAGE, COMPRESSED, INFO, TRANSFORM, ODOMETRY, POSE, *DETECTIONS):
        topic_type(kind)  # now, and not while the stream is listened to
    return Ros2Topics(number, RosOptions(colour, depth, info, frame, odometry, extrinsic, detections))


class Ros2Topics:
    """Obeys the Source contract."""

    waits = False
    recording = None

    def __init__(self, domain: int, options: RosOptions) -> None:
        self.name, self._domain, self._options = f"ros2 in domain {domain}", domain, options
        self._frames = RosFrames(self.name, options)
        self._closed = threading.Event()
        self._offers: dict[str, Offer] = {}
        self._readers: dict[str, Reader] = {}
        self._gaps = Gaps()
        self._publishers: Publishers | None = None
        self._said = ""  # why nothing came, when somebody was last there

    @property
    def notes(self) -> Sequence[str]:
        return [*self._frames.notes, *(self._misfits() if self._frames.choice is not None else [])]

    @property
    def detector(self) -> Detector | None:
        return self._frames.detector

    @property
    def world_frame(self) -> str:
        return self._frames.world_frame

    def __iter__(self) -> Iterator[Event]:
        """Raises BackendError if DDS cannot use the network."""
        from cartier_ros.dds.topics import Publishers, participant

        ours = participant(self._domain)
        publishers = self._publishers = Publishers(ours)
        told_s, found_s = time.monotonic(), float("-inf")
        try:
            while not self._closed.is_set():
                now_s = time.monotonic()
                if now_s - found_s >= FIND_S:
                    self._offers, found_s = publishers.offers(), now_s
                    self._listen(ours)
                events, heard = self._take(now_s)
                if not events and time.monotonic() - told_s >= QUIET_S:
                    events = [Fault("silent", self._why_silent())]
                told_s = time.monotonic() if events else told_s
                yield from itertools.takewhile(lambda _: not self._closed.is_set(), events)
                if not heard:
                    self._closed.wait(POLL_S)
        finally:
            self._readers, self._publishers = {}, None
            del publishers, ours

    def close(self) -> None:
        self._closed.set()

    def _take(self, now_s: float) -> tuple[list[Event], bool]:
        """The events that are due, and whether any message came."""
        heard, lost = False, 0
        for reader in self._readers.values():
            for data in reader.take():
                message, heard = Message(reader.offer.name, reader.offer.kind, data), True
                lost += self._missing(message)
                self._frames.feed(message, now_s)
        events = self._frames.poll(now_s)
        if lost:
            events.append(Fault("lost", f"images did not arrive, by their stamps: {_wider()}", lost))
        return events, heard

    def _missing(self, message: Message) -> int:
        choice = self._frames.choice
        if choice is None or message.topic != choice.colour.name:
            return 0
        try:
            return self._gaps.add(message.header().stamp_ns)
        except InputError:
            return 0  # it is told when the message is read

    def _listen(self, participant: Any) -> None:
        """Hear the topics that are wanted now, as their writers offer them now."""
        from cartier_ros.dds.topics import Reader

        wanted = {name: offer for name, offer in self._offers.items() if self._wanted(offer)}
        self._readers = {name: reader for name, reader in self._readers.items() if wanted.get(name) == reader.offer}
        for name, offer in wanted.items():
            if name not in self._readers:
                depth = IMAGES if offer.kind in (IMAGE, COMPRESSED) else OTHERS
                with contextlib.suppress(BackendError):  # somebody published it with another type before
                    self._readers[name] = Reader(participant, offer, depth)

    def _wanted(self, offer: Offer) -> bool:
        if offer.kind == TRANSFORM:
            return offer.name in TF or not any(name in self._offers for name in TF)
        if offer.kind in (ODOMETRY, POSE):
            return _is(offer.name, self._options.odometry)
        if offer.kind in DETECTIONS:
            return _is(offer.name, self._options.detections)
        if offer.kind not in (IMAGE, COMPRESSED, INFO):
            return False
        choice = self._frames.choice
        if choice is None:
            given = self._options
            names = (given.info,) if offer.kind == INFO else (given.colour, given.depth)
            return None in names or any(_is(offer.name, name) for name in names)
        return offer.name in (choice.colour.name, choice.depth and choice.depth.name)

    def _why_silent(self) -> str:
        where = f"in domain {self._domain}"
        publishers, offers = self._publishers, self._offers
        if publishers is None or (not offers and not publishers.programs()):
            if self._said:
                return brief(f"whoever published {where} is gone; before that: {self._said}", 400)
            return (
                f"nobody publishes {where}: is the robot on, is its ROS_DOMAIN_ID {self._domain}, and do the two "
                "machines share a network that lets multicast through? Zenoh is not DDS, and is not heard"
                f"{range_here()}"
            )
        self._said = "; ".join([*self._misfits()[:4], self._why_unheard(publishers)])
        return self._said

    def _misfits(self) -> list[str]:
        """The topics that are named by the options or by custom as what is lacking, and hold something else."""
        named, choice = self._options, self._frames.choice
        told = {named.colour: PICTURES, named.depth: PICTURES, named.info: (INFO,), named.odometry: POSES}
        found, lacking = list[str](), choice is None or choice.depth is None
        for name, kind, *_ in sorted(self._offers.values()):
            last, needed = name.rpartition("/")[2], next((told[given] for given in told if _is(name, given)), None)
            if needed is None and name in TF:
                needed = (TRANSFORM,)
            elif needed is None and lacking:
                needed = PICTURES if last.startswith("image") else (INFO,) if last == "camera_info" else None
            if needed is not None and kind not in needed:
                found.append(f"{brief(name, 80)} is {brief(kind, 60)}, and must be {' or '.join(needed)}")
        return found

    def _why_unheard(self, publishers: Publishers) -> str:
        """Why nothing comes though somebody is there."""
        where, offers = f"in domain {self._domain}", self._offers
        if not offers:
            foreign = publishers.foreign()
            what = (
                f"topics of types that are none of ROS 2: {', '.join(foreign)}" if foreign else "nothing that is heard"
            )
            return brief(
                f"{publishers.programs()} programs are {where}, and publish {what}; is the robot's driver on, and does "
                f"a firewall let UDP through in both directions?{range_here()}", 400,
            )  # fmt: skip
        images = sorted(offer.name for offer in offers.values() if offer.kind in (IMAGE, COMPRESSED))
        if not images:
            others = sorted(f"{offer.name} ({offer.kind})" for offer in offers.values() if _shows(offer.kind))
            there = f"; these are not read: {', '.join(others)}" if others else ": is the camera's driver on?"
            return brief(f"{len(offers)} topics are published {where}, but none of images{there}", 300)
        for name in (self._options.colour, self._options.depth, self._options.info, self._options.odometry):
            if name is not None and not any(_is(each, name) for each in offers):
                return (
                    f"nobody publishes {brief(name, 80)} {where}; the image topics are {brief(', '.join(images), 200)}"
                )
        if (unheard := self._unheard()) is not None:
            return unheard
        if not any(offer.kind == TRANSFORM for offer in offers.values()) and self._options.odometry is None:
            return f"no {TRANSFORM} comes on /tf {where}: is the robot's own driver on, or --odometry TOPIC the pose?"
        return self._no_detections() or brief(self._frames.why_silent(), 300)

    def _no_detections(self) -> str:
        """Why no detections can come; empty if they can, or are not wanted."""
        wanted = self._options.detections
        if wanted is None:
            return ""
        kinds = {offer.name: offer.kind for offer in self._offers.values()}
        kind = next((kinds[name] for name in kinds if _is(name, wanted)), None)
        if kind in DETECTIONS:
            return ""
        there = ", ".join(sorted(name for name in kinds if kinds[name] in DETECTIONS)) or "none"
        what = "nobody publishes it" if kind is None else f"it holds {brief(kind, 80)}"
        return f"no detections can come on {brief(wanted, 80)}: {what}; topics of detections: {brief(there, 200)}"

    def _unheard(self) -> str | None:
        """Which topic that is wanted brings nothing, though it is published, and why."""
        assert self._publishers is not None
        readers = [reader for reader in self._readers.values() if reader.offer.kind in NEEDED]
        pictures = any(reader.count for reader in readers if reader.offer.kind in (IMAGE, COMPRESSED))
        if self._frames.choice is None and pictures:  # another camera may be idle
            readers = [reader for reader in readers if reader.offer.kind not in (IMAGE, COMPRESSED)]
        dumb = [reader for reader in readers if not reader.count]
        for reader in dumb:
            name, kind = reader.offer.name, reader.offer.kind
            if not reader.writers():
                why = "; ".join(self._publishers.obstacles(name, kind)) or "its quality of service is none that we know"
                return brief(f"{name} is published, and does not match: {why}", 300)
        silent = [reader.offer.name for reader in dumb if reader.offer.kind != TRANSFORM]  # of /tf the frames tell more
        if not silent:
            return None
        name = silent[0]
        if any(reader.count for reader in self._readers.values()):
            lost = f"does it send? If so, its large messages are lost on the way: {_wider()}, or mend the network's MTU"
        else:
            lost = (
                "no data of anybody arrives. Is the driver paused, does a firewall drop UDP, or is the robot in a "
                "container or of another user, with shared memory (FASTDDS_BUILTIN_TRANSPORTS=UDPv4 on the robot)?"
            )
        return brief(f"{name} is published and matches, but nothing comes: {lost}", 400)


def _shows(kind: str) -> bool:
    """Whether a type that is not read holds pictures or depth, by its name."""
    return any(word in kind.lower() for word in ("image", "packet", "pointcloud", "video", "depth"))


def _is(name: str, given: str | None) -> bool:
    return given is not None and name.lstrip("/") == given.lstrip("/")


def _wider() -> str:
    """What helps against lost images."""
    from cartier_ros.dds.topics import SOCKET_BYTES, socket_limit

    limit = socket_limit()
    if limit is None:
        return "a cable or smaller images help"
    return f"sockets hold {limit} bytes at most here; 'sudo sysctl -w net.core.rmem_max={SOCKET_BYTES}' helps"
