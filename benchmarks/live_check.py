"""``cartier live --check``: seeded faults of robots that are named, and alarms on sound streams.

python benchmarks/live_check.py [--sound 30] [--over kilted] [--json check.json]
python benchmarks/live_check.py --write BAGS      # one sound bag and six broken ones, to try the check on

ROS messages are made from walks through homes of the dollhouse, a simulation; each fault is put into the messages as a
robot's driver would. They are played from bags, or, with ``--over``, sent by rclpy of that distribution, which
tests/ros/build.py builds, and heard over DDS. A fault is named if the check reports one of the ids that stand beside
it. Needs ``cartier[ros]`` and the tests' bag writer.
"""

from __future__ import annotations

import json
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS), *(str(TESTS / name) for name in ("recordings", "robots", "ros"))]

from bags import FRAME, MAP_FROM_ODOM, OPTICAL, START_NS, BagFile, Messages, compressed_depth, png  # noqa: E402
from build import FOLDER  # noqa: E402
from peers import LOOPBACK  # noqa: E402

from cartier import plugins  # noqa: E402
from cartier.contracts import Recording  # noqa: E402
from cartier.doctor import Fault  # noqa: E402
from cartier.doctor.stream_check import StreamReport, check_stream  # noqa: E402
from cartier.errors import InputError  # noqa: E402
from cartier.geometry import invert  # noqa: E402
from cartier.sources import open_source  # noqa: E402
from cartier.types import Camera  # noqa: E402

HOMES = ("studio", "family_flat", "kitchen_diner", "living_room", "old_couple")
FRAMES, STEP_NS = 50, 10**8
ODOMETRY = "/zed/odom"
LENS = "CameraInfo"  # what the evidence of a fault must name, where no frame comes without it
CAUSE = re.compile("CameraInfo|camera_info")
WATCH_S, LATER_S = 40.0, 1.0  # over DDS: at most, and after the robot has ended
COLOUR, DEPTH, INFO = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw", "/camera/color/camera_info"


@dataclass(frozen=True)
class Sent:
    """What is sent of frame ``i``."""

    rgb: Callable[[int, np.ndarray], np.ndarray] = lambda i, rgb: rgb
    depth: Callable[[int, Recording], np.ndarray | None] = lambda i, frames: frames[i].depth_m
    pose: Callable[[int, Sequence[np.ndarray]], np.ndarray | None] = lambda i, poses: poses[i]
    camera: Callable[[Camera], Camera | None] = lambda camera: camera
    stamp_ns: Callable[[int, int], int] = lambda i, ns: ns
    depth_late_ns: int = 3 * 10**6
    tf_late_ns: int = 0
    encoding: str = "rgb8"
    metres: bool = False
    static: np.ndarray | None = field(default_factory=lambda: OPTICAL)
    second_parent: bool = False
    doubled: bool = False
    kind: str = "mcap"
    late_ns: Callable[[int], int] = lambda i: 0
    compressed: bool = False
    odometry: bool = False
    has_map: bool = True
    reliable: bool = False


class Log:
    """What tests/ros/play_log.py sends, written as a bag is."""

    head = struct.Struct("<IqI")

    def __init__(self, path: Path) -> None:
        self.messages, self._path = Messages(), path
        self._topics: list[tuple[str, str]] = []
        self._data = bytearray()

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._path.write_bytes(json.dumps(self._topics).encode() + b"\n" + bytes(self._data))

    def put(self, topic: str, log_ns: int, message: Any) -> None:
        named = (topic, message.__msgtype__)
        if named not in self._topics:
            self._topics.append(named)
        data = self.messages.bytes_of(message)
        self._data += self.head.pack(self._topics.index(named), log_ns, len(data)) + data


def write(recording: Recording, sent: Sent, path: Path) -> None:
    """A robot's bag, 10 Hz, with map → odom → base_link → the camera."""
    with BagFile(path, sent.kind) as bag:
        tell(recording, sent, bag)


def tell(recording: Recording, sent: Sent, bag: BagFile | Log) -> None:
    poses = [recording[i].world_from_camera for i in range(len(recording))]
    camera = sent.camera(recording.camera)
    m = bag.messages
    if sent.static is not None:
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, sent.static)))
    for i in range(len(recording)):
        log_ns, view = START_NS + i * STEP_NS, recording[i]
        ns = sent.stamp_ns(i, log_ns)
        if camera is not None:
            bag.put(INFO, log_ns, m.info(ns, FRAME, camera))
        rgb = np.ascontiguousarray(sent.rgb(i, view.rgb))
        for again in range(1 + sent.doubled):
            name, image = COLOUR, m.image(ns, FRAME, rgb, sent.encoding) if not sent.compressed else None
            if sent.compressed:
                name, image = f"{COLOUR}/compressed", m.compressed(ns, FRAME, png(rgb), "rgb8; png compressed bgr8")
            bag.put(name, log_ns + 10**6 + again + sent.late_ns(i), image)
        depth_m = sent.depth(i, recording)
        if depth_m is not None:
            name, image = _depth(m, sent, ns + sent.depth_late_ns, depth_m)
            bag.put(name, log_ns + 4 * 10**6 + sent.depth_late_ns, image)
        pose = sent.pose(i, poses)
        if pose is None:
            continue
        tf_ns, odom_from_base = ns + sent.tf_late_ns, invert(MAP_FROM_ODOM) @ pose @ invert(OPTICAL)
        if sent.odometry:
            bag.put(ODOMETRY, log_ns, m.odometry(tf_ns, "map", FRAME, pose))
            continue
        bag.put("/tf", log_ns, m.transforms((tf_ns, "odom", "base_link", odom_from_base)))
        if sent.has_map:
            bag.put("/tf", log_ns, m.transforms((tf_ns, "map", "odom", MAP_FROM_ODOM)))
        if sent.second_parent:
            bag.put("/tf", log_ns, m.transforms((tf_ns, "base_footprint", "base_link", np.eye(4))))


def _depth(m: Messages, sent: Sent, ns: int, depth_m: np.ndarray) -> tuple[str, Any]:
    pixels = np.nan_to_num(depth_m).astype(np.float32)
    if sent.compressed:
        data = compressed_depth(depth_m, "16UC1")
        return f"{DEPTH}/compressedDepth", m.compressed(ns, FRAME, data, "16UC1; compressedDepth png")
    if not sent.metres:
        pixels = np.rint(pixels * 1000).clip(0, 65535).astype(np.uint16)
    return DEPTH, m.image(ns, FRAME, pixels, "32FC1" if sent.metres else "16UC1")


def scaled(pose: np.ndarray, by: float) -> np.ndarray:
    out = pose.copy()
    out[:3, 3] *= by
    return out


def depth_at(i: int, frames: Recording) -> np.ndarray:
    depth_m = frames[i].depth_m
    assert depth_m is not None
    return depth_m


def zoomed(depth_m: np.ndarray) -> np.ndarray:
    """Depth of a wider lens, beside the colour."""
    rows, columns = (np.arange(n) for n in depth_m.shape)
    at = [np.clip(((x - n / 2) / 0.8 + n / 2 + off).astype(int), 0, n - 1)
          for x, n, off in ((rows, len(rows), 0), (columns, len(columns), 12))]  # fmt: skip
    return np.asarray(depth_m[np.ix_(*at)])


def cut_off(depth_m: np.ndarray) -> np.ndarray:
    """Depth that gives no reading from 2.5 m on, and says 10 m there."""
    return np.where(depth_m < 2.5, depth_m, np.float32(10.0))


def blurred(rgb: np.ndarray) -> np.ndarray:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(rgb, (4, 4, 0)))


TURNED = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
UPSIDE = np.diag([-1.0, -1, 1, 1])
SHORT = np.array([[1.0, 0, 0, 0.7], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
JUMP = np.array([[1.0, 0, 0, 3], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
FAULTS: dict[str, tuple[Sent, tuple[str, ...]]] = {
    "no transforms": (Sent(pose=lambda i, poses: None), ("silent", "no_pose", "too_early")),
    "no /tf_static: the camera is nowhere": (Sent(static=None), ("silent", "no_pose")),
    "identity for the optical frame": (
        Sent(static=np.block([[np.eye(3), OPTICAL[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]])),
        ("not_level", "rotated_images", "contradictory", "opengl_axes", "inverted_poses"),
    ),
    "camera mounted upside down, its frame not": (
        Sent(static=OPTICAL @ UPSIDE), ("opengl_axes", "rotated_images"),
    ),
    "no depth topic": (Sent(depth=lambda i, frames: None), ("no_depth", "silent")),
    "depth empty": (Sent(depth=lambda i, frames: depth_at(i, frames) * 0), ("no_depth",)),
    "millimetres sent as 32FC1": (
        Sent(depth=lambda i, frames: depth_at(i, frames) * 1000, metres=True), ("depth_unit", "depth_scale"),
    ),
    "depth ten times too small": (
        Sent(depth=lambda i, frames: depth_at(i, frames) / 10), ("depth_scale", "pose_scale", "depth_unit"),
    ),
    "depth 50 ms late": (Sent(depth_late_ns=50_000_000), ("no_depth",)),
    "depth of half a second before": (
        Sent(depth=lambda i, frames: depth_at(max(i - 5, 0), frames)),
        ("time_offset", "contradictory", "depth_not_registered"),
    ),
    "depth not registered": (Sent(depth=lambda i, frames: zoomed(depth_at(i, frames))), ("depth_not_registered",)),
    "CameraInfo of twice the size": (
        Sent(camera=lambda c: replace(c, fx=c.fx * 2, fy=c.fy * 2, cx=c.cx * 2, cy=c.cy * 2)),
        ("refused", "intrinsics_resolution", "lens", f"silent: {LENS}"),
    ),
    "focal length of another camera": (
        Sent(camera=lambda c: replace(c, fx=c.fx * 1.5, fy=c.fy * 1.5)),
        ("intrinsics_resolution", "lens", "contradictory", "depth_scale", "pose_scale"),
    ),
    "CameraInfo without calibration": (
        Sent(camera=lambda c: replace(c, cx=0.1, cy=0.1)),
        ("refused", "lens", "intrinsics_resolution", f"silent: {LENS}"),
    ),
    "no CameraInfo": (Sent(camera=lambda c: None), ("refused", f"silent: {LENS}")),
    "two parents of base_link": (Sent(second_parent=True), ("two_parents",)),
    "transforms stop": (Sent(pose=lambda i, poses: poses[i] if i < FRAMES // 2 else None), ("no_pose",)),
    "transforms twice a second": (Sent(pose=lambda i, poses: poses[i] if i % 5 == 0 else None), ("pose_gap",)),
    "transforms by a clock 0.3 s ahead": (
        Sent(tf_late_ns=300_000_000), ("time_offset", "contradictory", "no_pose", "too_early"),
    ),
    "the clock goes back": (Sent(stamp_ns=lambda i, ns: ns - (i > 25) * 5 * 10**9), ("clock",)),
    "stamps are never set": (Sent(stamp_ns=lambda i, ns: 10**9), ("double", "clock", "rate")),
    "each image twice": (Sent(doubled=True), ("double",)),
    "inverted poses": (
        Sent(pose=lambda i, poses: invert(poses[i])), ("inverted_poses", "not_level", "contradictory", "pose_jump"),
    ),
    "poses in centimetres": (
        Sent(pose=lambda i, poses: scaled(poses[i], 100)), ("pose_scale", "pose_jump", "contradictory"),
    ),
    "the world lies on its side": (Sent(pose=lambda i, poses: TURNED @ poses[i]), ("not_level",)),
    "odometry that never moves": (Sent(pose=lambda i, poses: poses[0]), ("still_pose",)),
    "localisation jumps": (Sent(pose=lambda i, poses: JUMP @ poses[i] if i > 25 else poses[i]), ("pose_jump",)),
    "an encoding that nobody reads": (Sent(encoding="yuv999"), ("refused", "unreadable")),
    "blurred images": (Sent(rgb=lambda i, rgb: blurred(rgb)), ("blur",)),
    "the lens cap is on": (Sent(rgb=lambda i, rgb: rgb // 50), ("black",)),
    "the picture is frozen": (Sent(rgb=lambda i, rgb: FIRST.setdefault(rgb.shape, rgb)), ("frozen",)),
    "red and blue swapped": (Sent(encoding="bgr8"), ("colours_swapped",)),
    "colour upside down, depth not": (Sent(rgb=lambda i, rgb: rgb[::-1, ::-1]), ("turned_pictures",)),
    "an infrared camera as colour": (
        Sent(rgb=lambda i, rgb: np.repeat(rgb[..., 1:2], 3, axis=2)), ("grey",),
    ),
    "no reading sent as 10 m": (Sent(depth=lambda i, frames: cut_off(depth_at(i, frames))), ("no_reading_far",)),
    "odometry jumps by 0.7 m": (
        Sent(pose=lambda i, poses: SHORT @ poses[i] if i > 25 else poses[i]), ("pose_jump",),
    ),
}  # fmt: skip
FIRST: dict[tuple[int, ...], np.ndarray] = {}


SOUND = {  # over DDS: as robots of strangers send
    "plain": Sent(),
    "32FC1": Sent(metres=True),
    "reliable images": Sent(reliable=True),
    "compressed and compressedDepth": Sent(compressed=True),
    "depth at half of colour's rate": Sent(depth=lambda i, frames: depth_at(i, frames) if i % 2 == 0 else None),
    "an image out of order": Sent(late_ns=lambda i: 130_000_000 * (i == 20)),
    "odometry of the camera's frame": Sent(odometry=True, static=None),
    "a robot that stands still": Sent(
        rgb=lambda i, rgb: STILL.setdefault("rgb", rgb), depth=lambda i, frames: depth_at(0, frames),
        pose=lambda i, poses: poses[0],
    ),
    "bgr8, as it says": Sent(rgb=lambda i, rgb: rgb[..., ::-1], encoding="bgr8"),
    "odom alone": Sent(has_map=False),
    "depth 15 ms late": Sent(depth_late_ns=15_000_000),
    "compressed, 10 ms late": Sent(compressed=True, depth_late_ns=10_000_000),
}  # fmt: skip
STILL: dict[str, np.ndarray] = {}


EXAMPLES = {
    "sound": "",
    "optical_frame": "identity for the optical frame",
    "unit": "millimetres sent as 32FC1",
    "clocks": "transforms by a clock 0.3 s ahead",
    "lens": "CameraInfo of twice the size",
    "registration": "depth not registered",
    "two_parents": "two parents of base_link",
}


def checked(recording: Recording, sent: Sent, folder: Path) -> StreamReport:
    write(recording, sent, folder)
    try:
        return check_stream(open_source(f"bag:{folder}@max"), 60)
    except InputError as error:  # the source itself says in one line what is wrong
        return StreamReport(folder.name, 0.0, 0, (), (Fault("refused", str(error), ""),))


def heard(recording: Recording, sent: Sent, folder: Path, distribution: str) -> StreamReport:
    """The same from a robot of real ROS 2 in a process of its own."""
    with Log(folder) as log:
        tell(recording, sent, log)
    domain = random.randrange(1, 200)
    lines = (FOLDER / distribution / "env").read_text(encoding="utf-8").splitlines()
    told = dict(line.split("=", 1) for line in lines if "=" in line) | {"ROS_DOMAIN_ID": str(domain)}
    command = ["python", str(TESTS / "ros" / "play_log.py"), str(folder), *(["--reliable"] if sent.reliable else [])]
    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    source = open_source("ros2", domain=domain, **({"odometry": ODOMETRY} if sent.odometry else {}))
    robot = subprocess.Popen(command, env=os.environ | told, executable=FOLDER / distribution / "bin" / "python")

    def end() -> None:
        robot.wait()
        threading.Timer(LATER_S, source.close).start()

    threading.Thread(target=end, daemon=True).start()
    try:
        return check_stream(source, WATCH_S)
    except InputError as error:
        return StreamReport(folder.name, 0.0, 0, (), (Fault("refused", str(error), ""),))
    finally:
        robot.kill()
        robot.wait()


def walk(home: str, seed: int) -> Recording:
    """A robot's walk with 10 frames a second, such that frames overlap as they do on a robot."""
    world = plugins.make("worlds", "dollhouse", width=320, height=240)
    recording: Recording = world.explore(home, seed=seed, max_frames=FRAMES)
    return recording


def sound_streams(count: int, over_dds: bool) -> dict[str, tuple[str, Sent]]:
    """The home and what is sent of it, by name."""
    if over_dds:
        return {name: (HOMES[number % len(HOMES)], sent) for number, (name, sent) in enumerate(SOUND.items())}
    return {
        f"{HOMES[number % len(HOMES)]}, seed {number}": (
            HOMES[number % len(HOMES)],
            Sent(kind=("mcap", "sqlite3", "ros1")[number % 3], metres=bool(number % 2), depth_late_ns=number * 500_000),
        )
        for number in range(count)
    }


def main() -> None:
    options = Parser(__doc__)
    options.add_argument("--sound", type=int, default=30, help="how many sound streams")
    options.add_argument("--over", metavar="DISTRIBUTION", help="hear rclpy of jazzy or kilted, and of both by turns")
    options.add_argument("--only", help="faults and sound streams with this in their names")
    options.add_argument("--json", type=Path, help="write the results here")
    options.add_argument("--write", type=Path, metavar="FOLDER", help="write seven bags there, and end")
    given = options.parse_args()
    if given.write:
        for name, fault in EXAMPLES.items():
            write(walk(HOMES[0], 0), FAULTS[fault][0] if fault else Sent(), given.write / name)
        return
    result: dict[str, Any] = {"over": given.over or "bags", "faults": {}, "alarms": {}}
    walks = {home: walk(home, 0) for home in HOMES[:2]}
    over = given.over.split(",") if given.over else []
    faults = {name: fault for name, fault in FAULTS.items() if not given.only or given.only in name}
    sound = sound_streams(0 if given.only and not over else given.sound, bool(over))
    sound = {name: each for name, each in sound.items() if not given.only or given.only in name}
    with tempfile.TemporaryDirectory() as temporary:

        def examined(recording: Recording, sent: Sent, number: int, kind: str) -> StreamReport:
            FIRST.clear()
            STILL.clear()
            path = Path(temporary) / f"{kind}{number}"
            return heard(recording, sent, path, over[number % len(over)]) if over else checked(recording, sent, path)

        for number, (name, (sent, ids)) in enumerate(faults.items()):
            report = examined(walks[HOMES[number % 2]], sent, number, "fault")
            told = [fault.fault for fault in report.faults]
            told += [f"{fault.fault}: {LENS}" for fault in report.faults if CAUSE.search(fault.evidence)]
            nobody = any("nobody publishes in" in fault.evidence for fault in report.faults)
            named = bool(set(told) & set(ids)) and not nobody
            result["faults"][name] = {"told": told, "named": named, "frames": report.frames}
            why = "" if named else f" {[fault.evidence for fault in report.faults]}"
            heading = "named " if named else "MISSED"
            print(f"{heading}  {name}: {', '.join(told) or 'nothing'} ({report.frames} frames){why}", flush=True)
        for number, (name, (home, sent)) in enumerate(sound.items()):
            report = examined(walk(home, seed=number), sent, number, "sound")
            if not report.ok or not report.frames:
                result["alarms"][name] = [f"{f.fault}: {f.evidence}" for f in report.faults]
            print(f"{'sound ' if report.ok else 'ALARM '}  {name}: {report.frames} frames "
                  f"{[f'{f.fault}: {f.evidence}' for f in report.faults] or ''}", flush=True)  # fmt: skip
    named = sum(each["named"] for each in result["faults"].values())
    print(
        f"over {result['over']}: {named} of {len(faults)} seeded faults named; alarms on {len(result['alarms'])} of "
        f"{len(sound)} sound"
    )
    if given.json:
        given.json.write_text(json.dumps(result, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run_script(main)
