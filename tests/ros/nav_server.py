"""Robot under ROS 2, for an environment of build.py: serves NavigateToPose. usage: FORM SECONDS [SPEED]

FORM is drives, refuses, aborts, mute (gives no feedback), stuck (after a moment it gives no feedback and answers
nothing), deaf (does not let itself be cancelled), hesitates (takes two seconds to accept) or dies (after a moment).
As Nav2's bt_navigator does, it passes what comes on /goal_pose to its own action. Each event is printed with its time.
"""

import math
import os
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

STEP_S = 0.05


def say(*words: object) -> None:
    print(f"{time.time():.3f}", *words, flush=True)


class Robot(Node):
    """One that drives straight to its goals."""

    def __init__(self, form: str, speed: float) -> None:
        super().__init__("bt_navigator")
        self.form, self.speed, self.x, self.y, self.yaw = form, speed, 0.0, 0.0, 0.0
        self.current = None
        group = ReentrantCallbackGroup()
        self.server = ActionServer(
            self, NavigateToPose, "navigate_to_pose", execute_callback=self.execute, callback_group=group,
            goal_callback=self.decide, cancel_callback=self.cancel,
        )  # fmt: skip
        self.own = ActionClient(self, NavigateToPose, "navigate_to_pose", callback_group=group)
        self.create_subscription(PoseStamped, "goal_pose", self.goal_pose, 10, callback_group=group)
        self.tf = self.create_publisher(TFMessage, "/tf", 10)
        self.create_timer(STEP_S, self.tell, callback_group=group)

    def decide(self, request: NavigateToPose.Goal) -> GoalResponse:
        if self.form == "hesitates":
            say("hesitates")
            time.sleep(2)
        if self.form == "refuses":
            say("refused")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def cancel(self, goal: object) -> CancelResponse:
        if self.form == "stuck":
            time.sleep(60)
        say("asked to cancel")
        return CancelResponse.REJECT if self.form == "deaf" else CancelResponse.ACCEPT

    def goal_pose(self, pose: PoseStamped) -> None:
        goal = NavigateToPose.Goal()
        goal.pose = pose
        self.own.send_goal_async(goal)

    def execute(self, handle) -> NavigateToPose.Result:  # type: ignore[no-untyped-def]
        p, q = handle.request.pose.pose.position, handle.request.pose.pose.orientation
        yaw, begin_s, self.current = 2 * math.atan2(q.z, q.w), time.monotonic(), handle
        say("goal", handle.request.pose.header.frame_id, f"{p.x:.3f} {p.y:.3f} {yaw:.3f}")
        while True:
            if handle.is_cancel_requested:
                handle.canceled()
                say("cancelled")
                return NavigateToPose.Result()
            if self.current is not handle:  # a later goal replaces this one
                handle.abort()
                say("replaced")
                return NavigateToPose.Result()
            driven_s = time.monotonic() - begin_s
            if self.form == "dies" and driven_s > 0.5:
                say("dies")
                os._exit(1)
            if self.form == "aborts" and driven_s > 0.5:
                handle.abort()
                say("aborted")
                return NavigateToPose.Result(error_code=103, error_msg="no\nvalid path")
            left_m = math.dist((self.x, self.y), (p.x, p.y))
            if left_m < 1e-6:
                self.yaw = yaw
                handle.succeed()
                say("succeeded")
                return NavigateToPose.Result()
            step = min(1.0, self.speed * STEP_S / left_m)
            self.x, self.y = self.x + (p.x - self.x) * step, self.y + (p.y - self.y) * step
            if self.form != "mute" and not (self.form == "stuck" and driven_s > 0.5):
                feedback = NavigateToPose.Feedback()
                feedback.current_pose.pose.position.x, feedback.current_pose.pose.position.y = self.x, self.y
                feedback.distance_remaining = left_m
                handle.publish_feedback(feedback)
            time.sleep(STEP_S)

    def tell(self) -> None:
        place = TransformStamped()
        place.header.frame_id, place.child_frame_id = "map", "base_link"
        place.header.stamp = self.get_clock().now().to_msg()
        place.transform.translation.x, place.transform.translation.y = self.x, self.y
        place.transform.rotation.z, place.transform.rotation.w = math.sin(self.yaw / 2), math.cos(self.yaw / 2)
        self.tf.publish(TFMessage(transforms=[place]))


def main(form: str, seconds: float, speed: float = 0.5) -> None:
    rclpy.init()
    robot = Robot(form, speed)
    executor = MultiThreadedExecutor(8)
    executor.add_node(robot)
    threading.Thread(target=executor.spin, daemon=True).start()
    print("ready", flush=True)
    time.sleep(seconds)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:]))
