"""Frames out of ROS messages as they come: topics chosen by type and name, then colour, depth and pose paired."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartier.errors import InputError, brief
from cartier.recordings.common.poses import matrices, rigid
from cartier.types import Frame
from cartier.types.streams import Event, Fault, Stamped
from cartier_ros.bags.bag import COMPRESSED, IMAGE, TRANSFORMS, frame_name
from cartier_ros.bags.detections import DETECTIONS, TopicDetector, read_detections, topic_detector
from cartier_ros.bags.frames import FrameImages, registration
from cartier_ros.bags.graphs import GRAPHS, ns_of, read_graph
from cartier_ros.bags.images import INFO
from cartier_ros.bags.poses import ODOMETRY, POSE
from cartier_ros.bags.tf import extrinsic_matrix
from cartier_ros.bags.topics import Choice, Messages, choose
from cartier_ros.streams.corrections import Corrections
from cartier_ros.streams.detected import Detected, DetectionPairer
from cartier_ros.streams.messages import FirstMessages, Message
from cartier_ros.streams.pairing import Paired, Pairer
from cartier_ros.streams.transforms import Circle, Lookup, Matrix, TransformBuffer

KINDS = frozenset((IMAGE, COMPRESSED, INFO, *TRANSFORMS, ODOMETRY, POSE, *GRAPHS, *DETECTIONS))
"""The types of messages that are listened to."""
CHOOSING_S = 1.0  # from the first image on, so that every topic has shown itself
WORLD_S = 2.0  # how long a frame "map" may take to appear above "odom", once it is known how the camera moves
MOST_HELD = 128  # messages that wait until the topics are chosen
MOST_WORLDS = 8  # that are told of
BODY = "cartier_body"  # what moves, where a topic of poses does not name it


@dataclass(frozen=True)
class RosOptions:
    """Which topics and frames to take, where those that fit by type and name are not the right ones.

    ``colour depth info`` are topics; ``frame`` is the world; ``odometry`` a topic of poses to take instead of /tf, and
    ``extrinsic``, x,y,z,qx,qy,qz,qw, the camera's pose on what it moves. ``detections`` is the topic of a detector on
    the robot: frames bring what it found, and others are left out.
    """

    colour: str | None = None
    depth: str | None = None
    info: str | None = None
    frame: str | None = None
    odometry: str | None = None
    extrinsic: Sequence[float] | str | None = None
    detections: str | None = None


class RosFrames:
    """Takes messages, gives frames. Times are those of arrival, by a clock that never jumps (s).

    ``known`` are the messages that there will be, as far as that is known; else the first second of images decides
    which topics are taken. Raises InputError if nothing among what is known fits.
    """

    def __init__(self, name: str, options: RosOptions, known: Messages | None = None) -> None:
        self.name, self.options = name, options
        self.notes: list[str] = []
        self.transforms = TransformBuffer()
        self.choice: Choice | None = None
        self.first = FirstMessages(name)
        self._held: list[Message] = []
        self._first_image_s: float | None = None
        self._moving_s: float | None = None  # since when it is known how the camera moves
        self._images: FrameImages | None = None
        self._world: str | None = options.frame
        self._guessed = False  # whether the world is what there was in time
        self._body_of_odometry: str | None = None
        self._camera = ""  # its frame, where an extrinsic says where it is
        self._other_worlds: set[str] = set()  # in which poses were corrected, and which are not mapped
        self._events: list[Event] = []
        self._count = 0
        self._lack = ""
        self._pairer = Pairer(self._pose, True, self._forget)
        self._detected = None if options.detections is None else DetectionPairer(options.detections)
        self._corrections = Corrections()
        self._above: tuple[int, Matrix] | None = None  # the transform above odometry, and since when (ns)
        self._body = None if options.extrinsic is None else extrinsic_matrix(options.extrinsic)
        if known is not None:
            self._take(choose(known, options.colour, options.depth, options.info))

    def feed(self, message: Message, now_s: float) -> None:
        """Take in a message that has arrived."""
        if message.kind not in KINDS:
            return
        try:
            if message.kind in TRANSFORMS:
                self._transforms(message, now_s)
            elif message.kind in (ODOMETRY, POSE):
                self._odometry(message, now_s)
            elif message.kind in GRAPHS:
                self._graph(message)
            elif message.kind in DETECTIONS:
                self._detections(message)
            elif self.choice is None:
                self._look(message, now_s)
            else:
                self._image(message, now_s)
        except InputError as error:
            self._leave_out(error, message)
        except Exception as error:  # whatever a stranger sends, it ends no session
            self._leave_out(f"a message of {message.topic}: {type(error).__name__}: {brief(error, 200)}", message)

    def _leave_out(self, why: object, message: Message) -> None:
        reason = "circle" if isinstance(why, Circle) else "unreadable"
        self._events.append(Fault(reason, brief(why, 300), int(self._is_colour(message))))

    def poll(self, now_s: float) -> list[Event]:
        """The events that are due now."""
        self._choose(now_s)
        events, self._events = self._events, []
        if self.choice is not None and self._found_world(now_s):
            events += self._moved_into_map()
            before = self._pairer.between
            paired = self._pairer.poll(now_s)
            for each in paired if self._detected is None else self._detected.poll(paired, now_s):
                if isinstance(each, Fault):
                    events.append(each)
                    continue
                image, found = each if isinstance(each, Detected) else (each, None)
                events += [*self._jumped(image.stamp_ns), self._frame(image, found)]
            if not before and self._pairer.between:
                self.notes.append(
                    "depth comes at a lower rate: colour images between two of its images are passed over"
                )
        return events

    @property
    def detector(self) -> TopicDetector | None:
        """Stands for the detector on the robot, if its detections are taken."""
        return None if self.options.detections is None else topic_detector(self.options.detections)

    @property
    def world_frame(self) -> str:
        """The frame that is mapped, ``map`` until that is decided."""
        return self._world or "map"

    @world_frame.setter
    def world_frame(self, name: str) -> None:
        """Say beforehand what is mapped."""
        self._world = name
        self._tell_world()

    def why_silent(self) -> str:
        """Why there are no frames."""
        if self._lack:
            return self._lack
        if self._first_image_s is None:
            return "no images arrive: is the camera's driver running, and are these its topics?"
        if self.choice is None:
            return "images arrive: which topics belong together is seen in a second"
        if self._world is None:
            return (
                f"no transforms lead to the camera's frame {self.choice.colour.frame!r}: is its driver's /tf_static on?"
            )
        also = "" if self.options.detections is None else f", or none has detections of {self.options.detections}"
        return f"images arrive, but none has depth and a pose{also}"

    def _is_colour(self, message: Message) -> bool:
        return self.choice is not None and message.topic == self.choice.colour.name

    def _look(self, message: Message, now_s: float) -> None:
        """Hold a message until it is known which topics are taken."""
        self.first.add(message)
        if message.kind != INFO:
            self._first_image_s = now_s if self._first_image_s is None else self._first_image_s
        self._held.append(message)
        del self._held[:-MOST_HELD]

    def _choose(self, now_s: float) -> None:
        if self.choice is not None or self._first_image_s is None or now_s - self._first_image_s < CHOOSING_S:
            return
        self._first_image_s = now_s  # if there is no choice yet, there may be one in a second
        try:
            self._take(choose(self.first, self.options.colour, self.options.depth, self.options.info))
        except InputError as error:
            self._lack = str(error)
            return
        held, self._held = self._held, []
        for message in held:
            self.feed(message, now_s)

    def _take(self, choice: Choice) -> None:
        """Take these topics from now on."""
        self._lack, self.choice = "", choice
        self._pairer = Pairer(self._pose, choice.depth is not None, self._forget)
        self.notes = list(choice.notes)

    def _image(self, message: Message, now_s: float) -> None:
        assert self.choice is not None
        depth = self.choice.depth
        takes = {self.choice.colour.name: self._pairer.colour} | ({depth.name: self._pairer.depth} if depth else {})
        if message.topic not in takes:
            return
        header = message.header()
        self._first_image_s = now_s if self._first_image_s is None else self._first_image_s
        if header.empty_image:
            raise InputError(f"an image of {message.topic} is empty")
        takes[message.topic](header.stamp_ns, message, now_s)

    def _transforms(self, message: Message, now_s: float) -> None:
        static = message.topic.endswith("tf_static")
        if self._pairer.quiet(now_s) and not static:
            return
        for item in message.decode().transforms:
            parent, child = (frame_name(str(n), self.name) for n in (item.header.frame_id, item.child_frame_id))
            t, q = item.transform.translation, item.transform.rotation
            pose = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
            if child == self._body_of_odometry or (self._body is not None and child == self._camera):
                continue
            try:
                self._add(parent, child, item.header.stamp, pose, static, now_s)
                if parent == self._world and not static:
                    self._jump(child, pose, ns_of(item.header.stamp))
            except InputError as error:  # the others of the message may be sound
                self._leave_out(error, message)

    def _jump(self, child: str, pose: Sequence[float], stamp_ns: int) -> None:
        """Remember the latest transform of odometry in the world; it counts once a frame of its time is sent."""
        if self.choice is None or self._above is not None:
            return
        chain = self.transforms.chain(self.choice.colour.frame)
        if child in chain and self.transforms.fixed(child, chain[0]) is None:  # else it is the robot itself
            self._above = stamp_ns, matrices(np.array([pose]))[0]

    def _jumped(self, stamp_ns: int) -> list[Event]:
        """The corrections that are due before a frame of this time."""
        if self._above is None or stamp_ns < self._above[0]:
            return []
        update, self._above = self._corrections.by_jump(self._above[1]), None
        return [] if update is None else [update]

    def _graph(self, message: Message) -> None:
        """Take in the optimised poses of a SLAM, if they are of the world that is mapped."""
        if self.choice is None or self._world is None:
            return
        told = read_graph(message.data, message.kind, message.encoding, f"a message of {message.topic}")
        if told.world != self._world:
            if told.world not in self._other_worlds and len(self._other_worlds) < MOST_WORLDS:
                self._other_worlds.add(told.world)
                told_where = f"{message.topic} corrects poses in {told.world!r}, and {self._world!r} is mapped"
                self._events.append(Fault("frame", f"{brief(told_where, 200)}: it is ignored; see --frame"))
            return
        camera = self.choice.colour.frame
        fixed = {name: self.transforms.fixed(name, camera) for name in self.transforms.chain(camera)}
        bodies = {name: matrix for name, matrix in fixed.items() if matrix is not None}
        update = self._corrections.by_graph(told, message.topic, bodies)
        self._events += [] if update is None else [update]

    def _detections(self, message: Message) -> None:
        wanted = self.options.detections
        if self._detected is not None and wanted is not None and message.topic.lstrip("/") == wanted.lstrip("/"):
            self._detected.add(message.header().stamp_ns, message)

    def _forget(self) -> None:
        """The clock jumped."""
        if self._detected is not None:
            self._detected.clear()
        self.transforms.forget_moving()
        self._corrections, self._above = Corrections(), None

    def _odometry(self, message: Message, now_s: float) -> None:
        wanted = self.options.odometry
        if wanted is None or message.topic.lstrip("/") != wanted.lstrip("/") or self._pairer.quiet(now_s):
            return
        told = message.decode()
        pose = told.pose.pose if message.kind == ODOMETRY else told.pose
        world = frame_name(str(told.header.frame_id), self.name)
        body = frame_name(str(getattr(told, "child_frame_id", "")), self.name) or BODY
        if self._body is not None:
            body = BODY  # the extrinsic says where the camera is on what moves, even if that is named like the camera
        p, q = pose.position, pose.orientation
        if self._body_of_odometry is None:
            self._world = self.options.frame or world
            self._body_of_odometry = body  # what /tf says of it is not asked for
            self.transforms.drop(body)
        self._add(world, body, told.header.stamp, (p.x, p.y, p.z, q.x, q.y, q.z, q.w), False, now_s)
        if self._body is not None and self.choice is not None:
            self._fix(body, self.choice.colour.frame, self._body)

    def _fix(self, body: str, camera: str, body_from_camera: Matrix) -> None:
        """Say where the camera sits."""
        from scipy.spatial.transform import Rotation

        if self._camera != camera:  # what /tf says of it is not asked for
            self._camera = camera
            self.transforms.drop(camera)
        quaternion = Rotation.from_matrix(body_from_camera[:3, :3]).as_quat()
        self.transforms.add(body, camera, 0.0, (*body_from_camera[:3, 3], *quaternion), True)

    def _add(self, parent: str, child: str, stamp: Any, pose: Sequence[float], static: bool, now_s: float) -> None:
        if not self.transforms.add(parent, child, stamp.sec + stamp.nanosec * 1e-9, pose, static):
            self._pairer.clock_jumped(now_s, f"the transform of {child!r} went back in time")

    def _found_world(self, now_s: float) -> bool:
        """Whether it is decided in which frame to map."""
        if self._world is not None:
            return True
        assert self.choice is not None
        camera = self.choice.colour.frame
        if self.options.odometry is not None or not self.transforms.moves(camera):
            return False
        self._moving_s = now_s if self._moving_s is None else self._moving_s
        world = self.transforms.world(camera)
        if world != "map" and now_s - self._moving_s < WORLD_S:
            return False
        self._world, self._guessed = world, world != "map"
        self._tell_world()
        return True

    def _tell_world(self) -> None:
        assert self.choice is not None
        self.notes.append(f"poses from /tf: {self._world!r} to {self.choice.colour.frame!r}")
        if self._world != "map" and self.options.frame is None:
            self.notes.append(f"there is no frame 'map' above the camera: the world is {self._world!r}; see --frame")

    def _moved_into_map(self) -> list[Event]:
        """Where 'map' appears late, what was sent is moved into it, and it is mapped from now on."""
        if not self._guessed or self._world is None:
            return []
        map_from_world = self.transforms.newest("map", self._world)
        if map_from_world is None:
            return []
        late = f"'map' appeared above {self._world!r}, which was mapped until now: the map is moved into it"
        self._world, self._guessed = "map", False
        self._tell_world()
        update = self._corrections.moved(map_from_world)
        return [Fault("frame", brief(late, 200)), *([] if update is None else [update])]

    def _pose(self, stamp_ns: int) -> Lookup:
        assert self.choice is not None and self._world is not None
        return self.transforms.lookup(self._world, self.choice.colour.frame, stamp_ns / 1e9)

    def _frame(self, paired: Paired, found: Message | None) -> Event:
        assert self.choice is not None
        if self._images is None:  # the transforms are known by now
            self._images = FrameImages(self.choice, registration(self.choice, self.transforms, self.notes))
        where = f"{self.name}: the image at {paired.stamp_ns / 1e9:.3f} s"
        try:
            frame = Frame(
                index=self._count,
                time_s=paired.stamp_ns / 1e9,
                rgb=self._images.rgb(paired.colour.decode(), where),
                depth_m=None if paired.depth is None else self._images.depth_m(paired.depth.decode(), where),
                world_from_camera=rigid(paired.world_from_camera, where),
                camera=self._images.camera,
            )
            detections = None if found is None else read_detections(
                found.data, found.kind, found.encoding, self.choice, frame.index, f"a message of {found.topic}"
            )  # fmt: skip
        except InputError as error:
            return Fault("unreadable", brief(error, 300), 1)
        self._count += 1
        self._corrections.sent(paired.stamp_ns, frame.world_from_camera)
        odometry = self.transforms.lookup("odom", self.choice.colour.frame, paired.stamp_ns / 1e9).matrix
        seen_from = None if odometry is None else np.asarray(odometry)
        return Stamped(frame, paired.stamp_ns, seen_from, detections=detections)
