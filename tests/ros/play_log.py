"""A robot of real ROS 2: publishes, with rclpy, the messages of a log in their own time, stamped as if it were now.

python play_log.py LOG [--reliable]

The log is made by benchmarks/live_check.py: a line of JSON with the topics and their types, then for each message the
topic's number, the time (ns) and the length, and its CDR bytes. It begins when somebody listens to an image.
"""

from __future__ import annotations

import importlib
import json
import struct
import sys
import time
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

HEAD = struct.Struct("<IqI")
STAMP = struct.Struct("<i")
SETTLED_S, PATIENCE_S, LEFT_S = 0.8, 20.0, 0.7


def publisher(node: Node, name: str, kind: str, reliable: bool) -> object:
    package, group, word = kind.split("/")
    sends_images = word in ("Image", "CompressedImage")
    qos = QoSProfile(
        depth=30,
        reliability=ReliabilityPolicy.BEST_EFFORT if sends_images and not reliable else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if name == "/tf_static" else DurabilityPolicy.VOLATILE,
    )
    return node.create_publisher(getattr(importlib.import_module(f"{package}.{group}"), word), name, qos)


def main() -> None:
    data = Path(sys.argv[1]).read_bytes()
    line, _, data = data.partition(b"\n")
    topics = json.loads(line)
    rclpy.init()
    node = Node("camera")
    publishers = [publisher(node, name, kind, "--reliable" in sys.argv) for name, kind in topics]
    images = [p for p, (_, kind) in zip(publishers, topics, strict=True) if kind.endswith("Image")]
    messages, at = [], 0
    while at < len(data):
        number, ns, length = HEAD.unpack_from(data, at)
        messages.append((ns, number, bytearray(data[at + HEAD.size : at + HEAD.size + length])))
        at += HEAD.size + length
    messages.sort(key=lambda each: each[0])
    until_s = time.monotonic() + PATIENCE_S
    while images and not all(p.get_subscription_count() for p in images) and time.monotonic() < until_s:
        time.sleep(0.05)
    time.sleep(SETTLED_S)
    first_ns = messages[0][0]
    time.sleep((first_ns / 1e9 - time.time()) % 1)  # stamps are moved by whole seconds
    begin_s, later_s = time.monotonic(), round(time.time() - first_ns / 1e9)
    for ns, number, message in messages:
        time.sleep(max(0.0, begin_s + (ns - first_ns) / 1e9 - time.monotonic()))
        where = 8 if topics[number][1].endswith("TFMessage") else 4  # of the seconds of the first header
        STAMP.pack_into(message, where, STAMP.unpack_from(message, where)[0] + later_s)
        publishers[number].publish(bytes(message))
    time.sleep(LEFT_S)


if __name__ == "__main__":
    main()
