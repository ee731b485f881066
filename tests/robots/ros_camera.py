# mypy: disable-error-code="type-arg, valid-type"
# cyclonedds states its sequences and arrays in a way that mypy cannot read.
"""Robot with a camera on a DDS domain, of message types written down by hand. usage: DOMAIN FORM IMAGES [HZ]

FORM is raw, compressed, or a fault: gaps (five images are never sent), no_tf, no_images. Images are best effort, as
most drivers send them; CameraInfo and /tf_static are sent once and kept for those who come later.
"""

import io
import struct
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from PIL import Image as Picture
from ros_listener import Header, Quaternion, Time

WIDTH, HEIGHT, FOCAL, START_S = 64, 48, 60.0, 1_700_000_000
FRAME = "camera_optical"


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header
    format: str
    data: sequence[uint8]


@dataclass
class Region(IdlStruct, typename="sensor_msgs::msg::dds_::RegionOfInterest_"):
    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


@dataclass
class CameraInfo(IdlStruct, typename="sensor_msgs::msg::dds_::CameraInfo_"):
    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: sequence[float64]
    k: array[float64, 9]
    r: array[float64, 9]
    p: array[float64, 12]
    binning_x: uint32
    binning_y: uint32
    roi: Region


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


def rgb() -> np.ndarray:
    """(H, W, 3) what the camera sees."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([x * 4, y * 5, np.full_like(x, 77)], axis=2).astype(np.uint8)


def depth_mm() -> np.ndarray:
    """(H, W) uint16."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return (1000 + 10 * x + y).astype(np.uint16)


def png(pixels: np.ndarray) -> bytes:
    out = io.BytesIO()
    Picture.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def moved(k: int, parent: str, child: str, x: float, y: float, z: float, q: tuple[float, ...]) -> Any:
    transform = Transform(Vector3(x, y, z), Quaternion(*q))
    return TransformStamped(at(k, parent), child, transform)


def at(k: int, frame: str) -> Header:
    """The header of the k-th image: they are a tenth of a second apart."""
    return Header(Time(START_S + k // 10, k % 10 * 10**8), frame)


class Robot:
    """The topics, and what is sent on them."""

    def __init__(self, domain: int, form: str) -> None:
        self.participant, self.form = DomainParticipant(domain), form
        packed = form == "compressed"
        kind: Any = CompressedImage if packed else Image
        self.colour = self.writer("camera/color/image_raw" + "/compressed" * packed, kind, False, False)
        self.depth = self.writer("camera/depth/image_raw" + "/compressedDepth" * packed, kind, False, False)
        self.info = self.writer("camera/color/camera_info", CameraInfo, True, True)
        self.tf = self.writer("tf", TFMessage, True, False)
        self.tf_static = self.writer("tf_static", TFMessage, True, True)
        unit, optical = (0.0, 0.0, 0.0, 1.0), (-0.5, 0.5, -0.5, 0.5)
        k = [FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1]
        p = [FOCAL, 0, WIDTH / 2, 0, 0, FOCAL, HEIGHT / 2, 0, 0, 0, 1, 0]
        eye = [float(v) for v in np.eye(3).ravel()]
        sizes = (HEIGHT, WIDTH, "plumb_bob", [0.0] * 5)
        self.info.write(
            CameraInfo(
                at(0, FRAME), *sizes, list(map(float, k)), eye, list(map(float, p)), 0, 0, Region(0, 0, 0, 0, False)
            )
        )
        fixed = [moved(0, "map", "odom", 1.0, 2.0, 0.0, unit), moved(0, "base", FRAME, 0.1, 0.0, 1.2, optical)]
        self.tf_static.write(TFMessage(fixed))

    def writer(self, name: str, kind: Any, reliable: bool, latched: bool) -> Any:
        qos = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(10),
        )
        return DataWriter(self.participant, Topic(self.participant, f"rt/{name}", kind), qos=qos)

    def send(self, k: int) -> None:
        if self.form != "no_tf":
            self.tf.write(TFMessage([moved(k, "odom", "base", 0.1 * k, 0.0, 0.0, (0.0, 0.0, 0.0, 1.0))]))
        if self.form == "no_images" or (self.form == "gaps" and 60 <= k < 65):
            return
        header = at(k, FRAME)
        if self.form == "compressed":
            self.colour.write(CompressedImage(header, "rgb8; png compressed", list(png(rgb()))))
            packed = struct.pack("<i2f", 0, 0, 0) + png(depth_mm())
            self.depth.write(CompressedImage(header, "16UC1; compressedDepth png", list(packed)))
            return
        self.colour.write(Image(header, HEIGHT, WIDTH, "rgb8", 0, WIDTH * 3, list(rgb().tobytes())))
        self.depth.write(Image(header, HEIGHT, WIDTH, "16UC1", 0, WIDTH * 2, list(depth_mm().tobytes())))


def main(domain: int, form: str, images: int, hz: float = 20.0) -> None:
    robot = Robot(domain, form)
    print("ready", flush=True)
    for k in range(images):
        robot.send(k)
        time.sleep(1 / hz)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], int(sys.argv[3]), *map(float, sys.argv[4:]))
