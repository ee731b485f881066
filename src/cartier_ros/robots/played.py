"""Robot of the dollhouse as a ROS 2 robot with Nav2: camera, odometry, transforms, map and NavigateToPose over DDS.

It is a simulation: what its camera shows is rendered where it truly is; what it says of that is what it believes.
"""

from __future__ import annotations

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from cartier.errors import InputError
from cartier.robots.common.pose import FRAME, Pose
from cartier.types import FREE, OCCUPIED, OccupancyGrid
from cartier_dollhouse.base import Base, compose
from cartier_dollhouse.explore import explore
from cartier_dollhouse.model import Scene
from cartier_dollhouse.navigator import Drive, Ending, route
from cartier_dollhouse.recording import EYE_M, lit_renderer, look, pinhole
from cartier_ros.dds.large import LargeWriter
from cartier_ros.dds.services import Request, Services
from cartier_ros.dds.topics import Offer, Reader, Writer, participant
from cartier_ros.dds.types import decode, encoded, header, message, pose_of
from cartier_ros.robots.navigate_to_pose import GoalState, NavGoal, NavigateToPose

STEP_S = 0.05  # of driving and transforms
FRAME_S, SLOWEST_FRAME_S = 0.1, 0.8  # between two images
SLOWER, QUICKER = 1.5, 0.97  # of that time, after an image that came late and after each; twice looks like a lost image
SPREAD, LONGEST_S = 0.8, 0.2  # of that time, and at most, an image is on its way: readers are slow, and hold little
SLOWEST_S = 0.2  # after a longer pause it does not make up for the time
DOWN = math.radians(20)  # the pitch of its camera
ODOM, BASE, CAMERA, OPTICAL = "odom", "base_link", "camera_link", "camera_color_optical_frame"
POSE_STAMPED, POSE_NEWS_M = "geometry_msgs/msg/PoseStamped", 0.2
TF, IMAGE, INFO = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
COLOUR_TOPIC, DEPTH_TOPIC = "/camera/color", "/camera/aligned_depth_to_color"
NODES = ("amcl", "bt_navigator", "controller_server", "map_server", "planner_server")
ACTIVE = 3  # of lifecycle_msgs/msg/State
CODES = {
    Ending.OUTSIDE: 204,
    Ending.OCCUPIED: 206,
    Ending.NO_PATH: 208,
    Ending.STUCK: 105,
}  # of Nav2's planner, controller
NO_TREE, NO_TRANSFORM, NOWHERE = 9001, 9002, 204


class PlayedRobot:
    """A robot in a home of the dollhouse, on a domain.

    Args:
        scene: The home.
        domain: The DDS domain.
        seed: Of its odometry's errors and of its exploration.
        explores: Whether it explores the home by itself until it is sent somewhere.

    Raises:
        InputError: It does not fit at the home's start.
        BackendError: DDS cannot use the network.
    """

    def __init__(self, scene: Scene, domain: int, seed: int = 0, explores: bool = False) -> None:
        self.scene, self._base, self._lock = scene, Base(scene, seed=seed), threading.Lock()
        self._camera, self._closed = pinhole(), threading.Event()
        self._drive: Drive | None = None
        if explores:
            self._drive = Drive(self._base, _waypoints(explore(scene, self._camera, seed=seed).track))
        self._goal: NavGoal | None = None
        self._participant = ours = participant(domain)
        self._services = Services(domain)
        self._navigation = NavigateToPose(ours, self._services)
        self._posed = Reader(ours, Offer("/goal_pose", POSE_STAMPED, True, False), 10)
        self._tf, self._odom = Writer(ours, "/tf", TF, 100), Writer(ours, "/odom", "nav_msgs/msg/Odometry")
        self._amcl = Writer(ours, "/amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", 1, latched=True)
        self._amcl_at: Pose | None = None
        self._kept = [Writer(ours, "/tf_static", TF, 1, latched=True)]
        self._kept[0].write(encoded(message(TF, transforms=_mounting())))
        self._kept.append(Writer(ours, "/map", "nav_msgs/msg/OccupancyGrid", 1, latched=True))
        self._kept[1].write(encoded(_map(self._base.plan.grid())))
        theirs = self._services.participant
        self._images = [
            (LargeWriter(theirs, f"{topic}/image_raw", IMAGE), Writer(ours, f"{topic}/camera_info", INFO))
            for topic in (COLOUR_TOPIC, DEPTH_TOPIC)
        ]
        for node in NODES:
            self._services.serve(f"/{node}/get_state", "lifecycle_msgs/srv/GetState", _active)
        self.frames = 0
        """Images that were published."""

    def run(self) -> None:
        """Drive, see and answer until closed."""
        eyes = threading.Thread(target=self._see, name="camera")
        eyes.start()
        last_s = next_s = time.monotonic()
        try:
            while not self._closed.wait(max(0.0, next_s - time.monotonic())):
                now_s = time.monotonic()
                next_s = max(next_s + STEP_S, now_s)
                self._take_goals()
                with self._lock:
                    ended = self._step(min(now_s - last_s, SLOWEST_S))
                last_s = now_s
                self._tell()
                self._report(ended)
        finally:
            self._closed.set()
            eyes.join()
            self._services.close()

    def close(self) -> None:
        """End it, from any thread."""
        self._closed.set()

    @property
    def pose(self) -> Pose:
        """Where the robot truly is."""
        return self._base.true

    def _step(self, step_s: float) -> Ending | None:
        if self._drive is not None:
            return self._drive.step(step_s)
        self._base.step(0.0, 0.0, step_s)
        return None

    def _take_goals(self) -> None:
        for data in self._posed.take():
            try:
                self._navigation.send(decode(data, POSE_STAMPED))
            except InputError:
                continue
        new = self._navigation.taken()
        if new is not None:
            self._start(new)
        if self._goal is not None and self._goal.status == GoalState.CANCELING:
            self._end(GoalState.CANCELED)

    def _start(self, goal: NavGoal) -> None:
        """Begin the drive to a goal; one that Nav2 could not begin is aborted, and the drive before it goes on."""
        if goal.status == GoalState.CANCELING:
            self._navigation.end(goal, GoalState.CANCELED)
            return
        pose, finite = self._in_map(goal), all(map(math.isfinite, goal.pose))
        if goal.behavior_tree or pose is None or not finite:
            wrong = (NO_TREE, f"Error loading: {goal.behavior_tree}. Navigation canceled.")
            if pose is None:
                wrong = NO_TRANSFORM, f"no transform leads from {goal.frame!r} to the global frame {FRAME!r}"
            elif not finite:
                wrong = NOWHERE, "the goal's x, y or orientation is not a number"
            self._navigation.end(goal, GoalState.ABORTED, *wrong)
            return
        if self._goal is not None:
            self._end(GoalState.ABORTED)
        way = route(self._base, pose)
        self._goal, self._drive = goal, None if isinstance(way, Ending) else Drive(self._base, way, pose)
        if isinstance(way, Ending):
            self._end(GoalState.ABORTED, CODES[way], way.value)

    def _in_map(self, goal: NavGoal) -> Pose | None:
        """Where a goal lies in the map; None if its frame is not known."""
        frames = {FRAME: (0.0, 0.0, 0.0), ODOM: self._base.map_from_odom, BASE: self._base.believed}
        frame = frames.get(goal.frame)
        return None if frame is None else compose(frame, goal.pose)

    def _report(self, ended: Ending | None) -> None:
        if self._drive is None or (self._goal is None and ended is None):
            return
        if self._goal is None:
            self._drive = None
        elif ended is Ending.ARRIVED:
            self._end(GoalState.SUCCEEDED)
        elif ended is not None:
            self._end(GoalState.ABORTED, CODES[ended], ended.value)
        else:
            left_m, speed_m_s = self._drive.left_m, abs(self._base.speed_m_s)
            left_s = left_m / speed_m_s if speed_m_s > 0.01 and left_m > 0.1 else 0.0
            self._navigation.feedback(self._goal, self._base.believed, left_m, left_s, self._drive.recoveries)

    def _end(self, status: GoalState, code: int = 0, text: str = "") -> None:
        goal, self._goal, self._drive = self._goal, None, None
        if goal is not None:
            self._navigation.end(goal, status, code, text)

    def _tell(self) -> None:
        """Publish where the robot is, by its odometry and by its map."""
        now_ns, base = time.time_ns(), self._base
        links = [_link(FRAME, ODOM, base.map_from_odom, now_ns), _link(ODOM, BASE, base.odom, now_ns)]
        self._tf.write(encoded(message(TF, transforms=links)))
        placed = message("geometry_msgs/msg/PoseWithCovariance", pose=pose_of((*base.odom[:2], 0), base.odom[2]),
                         covariance=np.diag([1e-3] * 6).ravel())  # fmt: skip
        speed = message(
            "geometry_msgs/msg/Twist", linear=_vector(base.speed_m_s, 0, 0), angular=_vector(0, 0, base.turn_rad_s)
        )
        moving = message("geometry_msgs/msg/TwistWithCovariance", twist=speed, covariance=np.diag([1e-3] * 6).ravel())
        head = header(ODOM, now_ns)
        self._odom.write(
            encoded(message("nav_msgs/msg/Odometry", header=head, child_frame_id=BASE, pose=placed, twist=moving))
        )
        if self._amcl_at is None or math.dist(self._amcl_at[:2], base.believed[:2]) > POSE_NEWS_M:
            self._amcl_at = x, y, yaw = base.believed
            placed = message(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=pose_of((x, y, 0), yaw),
                covariance=np.diag([0.01] * 6).ravel(),
            )
            kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
            self._amcl.write(encoded(message(kind, header=header(FRAME, now_ns), pose=placed)))

    def _see(self) -> None:
        renderer, next_s, every_s = lit_renderer(self.scene, self._camera), time.monotonic(), FRAME_S
        sender = ThreadPoolExecutor(1)
        sent = sender.submit(time.sleep, 0)
        while not self._closed.wait(max(0.0, next_s - time.monotonic())):
            every_s = max(FRAME_S, QUICKER * every_s)
            if time.monotonic() > next_s + every_s:  # a camera that is too quick for the computer is set slower
                next_s, every_s = time.monotonic(), min(SLOWER * every_s, SLOWEST_FRAME_S)
            next_s += every_s
            with self._lock:
                (x, y, yaw), now_ns = self._base.true, time.time_ns()
            view = renderer.render(look((x, y), yaw, DOWN))
            sent.result()
            sent = sender.submit(self._show, view.rgb, view.depth_m, now_ns, min(SPREAD * every_s, LONGEST_S))
        sender.shutdown()

    def _show(self, rgb: np.ndarray[Any, Any], depth_m: np.ndarray[Any, Any], now_ns: int, within_s: float) -> None:
        depth_mm = np.nan_to_num(depth_m * 1000, nan=0.0, posinf=0.0).clip(0, 65535).round().astype("<u2")
        head = header(OPTICAL, now_ns)
        info = encoded(self._info(head))
        for (images, infos), pixels, form in zip(self._images, (rgb, depth_mm), ("rgb8", "16UC1"), strict=True):
            infos.write(info)
            images.write(encoded(_image(head, pixels, form)), (rgb.nbytes + depth_mm.nbytes) / within_s)
        self.frames += 1

    def _info(self, head: Any) -> Any:
        c = self._camera
        k = np.array([c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1.0])
        p = np.array([c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1.0, 0])
        roi = message("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        return message(
            INFO, header=head, height=c.height, width=c.width, distortion_model="plumb_bob", d=np.zeros(5), k=k,
            r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0, roi=roi,
        )  # fmt: skip


def _waypoints(track: np.ndarray[Any, Any]) -> list[Pose]:
    """A walk as poses to drive to; the heading counts only where it turns on the spot."""
    stays = [*(np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1) < 0.02), True]
    return [(x, y, yaw if still else math.nan) for (x, y, yaw), still in zip(track.tolist(), stays, strict=True)]


def _active(request: Request) -> None:
    state = message("lifecycle_msgs/msg/State", id=ACTIVE, label="active")
    request.reply(message("lifecycle_msgs/srv/GetState_Response", current_state=state))


def _vector(x: float, y: float, z: float) -> Any:
    return message("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def _link(parent: str, child: str, pose: Pose, stamp_ns: int) -> Any:
    x, y, yaw = pose
    turn = pose_of((0, 0, 0), yaw).orientation
    return _transform(parent, child, (x, y, 0.0), turn, stamp_ns)


def _transform(parent: str, child: str, xyz: tuple[float, float, float], turn: Any, stamp_ns: int) -> Any:
    placed = message("geometry_msgs/msg/Transform", translation=_vector(*xyz), rotation=turn)
    return message(
        "geometry_msgs/msg/TransformStamped", header=header(parent, stamp_ns), child_frame_id=child, transform=placed
    )


def _mounting() -> list[Any]:
    """Where the camera sits on the base: looking ahead and down, and its optical frame."""
    now_ns, kind = time.time_ns(), "geometry_msgs/msg/Quaternion"
    pitch = message(kind, x=0.0, y=math.sin(DOWN / 2), z=0.0, w=math.cos(DOWN / 2))
    optical = message(kind, x=-0.5, y=0.5, z=-0.5, w=0.5)
    return [
        _transform(BASE, CAMERA, (0.0, 0.0, EYE_M), pitch, now_ns),
        _transform(CAMERA, OPTICAL, (0.0, 0.0, 0.0), optical, now_ns),
    ]


def _image(head: Any, pixels: np.ndarray[Any, Any], form: str) -> Any:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    return message(IMAGE, header=head, height=height, width=width, encoding=form, is_bigendian=0,
                   step=data.size // height, data=data)  # fmt: skip


def _map(grid: OccupancyGrid) -> Any:
    cells = np.full(grid.cells.shape, -1, np.int8)
    cells[grid.cells == FREE], cells[grid.cells == OCCUPIED] = 0, 100
    now, (rows, cols) = header(FRAME, time.time_ns()), grid.cells.shape[:2]
    about = message(
        "nav_msgs/msg/MapMetaData", map_load_time=now.stamp, resolution=grid.resolution_m, width=cols, height=rows,
        origin=pose_of((*grid.origin_xy, 0.0), 0.0),
    )  # fmt: skip
    return message("nav_msgs/msg/OccupancyGrid", header=now, info=about, data=cells.ravel())
