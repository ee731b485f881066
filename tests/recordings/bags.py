"""Bags written by rosbags (ROS 2 and ROS 1) from any recording, for the tests of the bag reader."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from cartier import plugins
from cartier.contracts import Recording
from cartier.geometry import invert
from cartier.types import Camera

START_NS = 1_700_000_000_000_000_000
FRAME = "camera_color_optical_frame"
OPTICAL = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 1.2], [0, 0, 0, 1]])
"""base_from_camera: the camera on a robot, 1.2 m up, in its optical frame."""
MAP_FROM_ODOM = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])


class Messages:
    """Builds ROS messages of one distribution."""

    def __init__(self, ros1: bool = False) -> None:
        typesys = pytest.importorskip("rosbags.typesys", reason="the bag reader needs cartier[ros]")
        self.ros1 = ros1
        self.store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_JAZZY)
        if ros1:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(typesys.get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))

    def __call__(self, kind: str, *fields: Any, **named: Any) -> Any:
        return self.store.types[kind](*fields, **named)

    def bytes_of(self, message: Any) -> bytes:
        kind = message.__msgtype__
        return bytes(self.store.serialize_ros1(message, kind) if self.ros1 else self.store.serialize_cdr(message, kind))

    def header(self, ns: int, frame: str) -> Any:
        seq = {"seq": 0} if self.ros1 else {}
        stamp = self("builtin_interfaces/msg/Time", sec=int(ns // 10**9), nanosec=int(ns % 10**9))
        return self("std_msgs/msg/Header", **seq, stamp=stamp, frame_id=frame)

    def image(self, ns: int, frame: str, pixels: np.ndarray, encoding: str, padding: int = 0) -> Any:
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1 if pixels.size else 0)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        height, width = pixels.shape[:2]
        fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": rows.shape[1]}
        return self("sensor_msgs/msg/Image", self.header(ns, frame), **fields, data=rows.ravel())

    def compressed(self, ns: int, frame: str, data: bytes, form: str) -> Any:
        pixels = np.frombuffer(data, np.uint8)
        return self("sensor_msgs/msg/CompressedImage", self.header(ns, frame), format=form, data=pixels)

    def info(
        self,
        ns: int,
        frame: str,
        c: Camera,
        d: Sequence[float] = (),
        model: str = "plumb_bob",
        region: Sequence[int] = (0, 0, 0, 0),
        binning: Sequence[int] = (0, 0),
    ) -> Any:
        """``region`` is x, y, width, height."""
        k = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1])
        p = np.array([c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0])
        distortion, r = np.array(d, dtype=np.float64), np.eye(3).ravel()
        matrices = {"D": distortion, "K": k, "R": r, "P": p} if self.ros1 else {"d": distortion, "k": k, "r": r, "p": p}
        x, y, width, height = region
        roi = self("sensor_msgs/msg/RegionOfInterest", x, y, height, width, False)
        rest = {"height": c.height, "width": c.width, "distortion_model": model}
        rest |= {"binning_x": binning[0], "binning_y": binning[1]}
        return self("sensor_msgs/msg/CameraInfo", self.header(ns, frame), **rest, **matrices, roi=roi)

    def transforms(self, *items: tuple[int, str, str, np.ndarray]) -> Any:
        return self("tf2_msgs/msg/TFMessage", [self._transform(*item) for item in items])

    def odometry(self, ns: int, frame: str, child: str, pose: np.ndarray) -> Any:
        zero = self("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self("geometry_msgs/msg/Twist", zero, zero)
        return self(
            "nav_msgs/msg/Odometry",
            self.header(ns, frame),
            child,
            self("geometry_msgs/msg/PoseWithCovariance", self.pose(pose), np.zeros(36)),
            self("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
        )

    def pose(self, pose: np.ndarray) -> Any:
        point = self("geometry_msgs/msg/Point", *map(float, pose[:3, 3]))
        return self("geometry_msgs/msg/Pose", point, self._quaternion(pose))

    def _transform(self, ns: int, parent: str, child: str, pose: np.ndarray) -> Any:
        vector = self("geometry_msgs/msg/Vector3", *map(float, pose[:3, 3]))
        transform = self("geometry_msgs/msg/Transform", vector, self._quaternion(pose))
        return self("geometry_msgs/msg/TransformStamped", self.header(ns, parent), child, transform)

    def _quaternion(self, pose: np.ndarray) -> Any:
        return self("geometry_msgs/msg/Quaternion", *map(float, Rotation.from_matrix(pose[:3, :3]).as_quat()))


class BagFile:
    """Writes messages to ``home.bag`` inside a folder, or to a ROS 2 bag's folder."""

    def __init__(self, path: Path, kind: str = "mcap", compression: str = "") -> None:
        self.messages = Messages(ros1=kind == "ros1")
        self._topics: dict[str, Any] = {}
        if kind == "ros1":
            from rosbags.rosbag1 import Writer as Writer1

            path.mkdir()
            self._writer: Any = Writer1(path / "recording.bag")
            if compression:
                self._writer.set_compression(Writer1.CompressionFormat[compression.upper()])
        else:
            from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
            if compression:
                self._writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
        self._writer.open()

    def __enter__(self) -> BagFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def put(self, topic: str, log_ns: int, message: Any) -> None:
        if topic not in self._topics:
            kind = message.__msgtype__
            self._topics[topic] = self._writer.add_connection(topic, kind, typestore=self.messages.store)
        self._writer.write(self._topics[topic], int(log_ns), self.messages.bytes_of(message))


def write_images(bag: BagFile, recording: Recording, frame: str = FRAME) -> None:
    """rgb8 and 16UC1 images with a CameraInfo, 0.1 s apart; depth is stamped 3 ms later."""
    m = bag.messages
    for i in range(len(recording)):
        ns, view = START_NS + i * 10**8, recording[i]
        bag.put("/camera/color/camera_info", ns, m.info(ns, frame, recording.camera))
        bag.put("/camera/color/image_raw", ns + 10**6, m.image(ns, frame, view.rgb, "rgb8"))
        if view.depth_m is not None:
            depth = np.where(np.isnan(view.depth_m), 0, np.rint(view.depth_m * 1000)).astype(np.uint16)
            topic = "/camera/aligned_depth_to_color/image_raw"
            bag.put(topic, ns + 4 * 10**6, m.image(ns + 3 * 10**6, frame, depth, "16UC1"))


def write_transforms(bag: BagFile, poses: Sequence[np.ndarray], frame: str = FRAME) -> None:
    """map → odom → base_link → the camera, such that the camera is at each pose at its image's stamp."""
    m = bag.messages
    bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", frame, OPTICAL)))
    for i, pose in enumerate(poses):
        ns = START_NS + i * 10**8
        odom_from_base = invert(MAP_FROM_ODOM) @ pose @ invert(OPTICAL)
        bag.put("/tf", ns, m.transforms((ns, "odom", "base_link", odom_from_base)))
        bag.put("/tf", ns, m.transforms((ns, "map", "odom", MAP_FROM_ODOM)))


def write_bag(recording: Recording, path: Path, kind: str = "mcap", compression: str = "") -> None:
    """A robot's bag of a recording."""
    with BagFile(path, kind, compression) as bag:
        write_images(bag, recording)
        write_transforms(bag, [recording[i].world_from_camera for i in range(len(recording))])


def png(pixels: np.ndarray) -> bytes:
    out = BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def compressed_depth(depth_m: np.ndarray, encoding: str) -> bytes:
    """What compressed_depth_image_transport writes: a head of 12 bytes and a PNG, of inverse depth for 32FC1."""
    known = np.nan_to_num(depth_m)
    if encoding == "16UC1":
        return struct.pack("<i2f", 0, 0, 0) + png(np.rint(known * 1000).astype(np.uint16))
    quantum_zero, maximum_m = 100.0, 10.0  # the plug-in's depth_quantization and depth_max by default
    a = quantum_zero * (quantum_zero + 1)
    b = 1 - a / maximum_m
    with np.errstate(divide="ignore"):
        inverse = np.where(known > 0, np.rint(a / known + b), 0).astype(np.uint16)
    return struct.pack("<i2f", 0, a, b) + png(inverse)


def opened(path: Path, **options: Any) -> Recording:
    return plugins.open_recording(path, format="rosbag", **options)


def same(found: Recording, source: Recording, rgb: float = 0) -> None:
    """Equal poses, colours (mean difference) and depth (to half a millimetre)."""
    assert len(found) == len(source)
    assert found.camera == source.camera
    for i in range(len(source)):
        a, b = found[i], source[i]
        assert np.abs(a.world_from_camera - b.world_from_camera).max() < 1e-6
        assert np.abs(a.rgb.astype(int) - b.rgb).mean() <= rgb
        if b.depth_m is not None:
            assert a.depth_m is not None
            assert np.abs(a.depth_m - b.depth_m).max() < 0.00051
