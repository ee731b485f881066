"""Client of Nav2's NavigateToPose action, with the ROS 2 that is sourced in this shell."""

from __future__ import annotations

from typing import Any

import rclpy
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from cartier.errors import BackendError
from cartier.robots._pose import FRAME, in_words, quaternion_zw
from cartier.types import Goal


def send_action(goal: Goal, action: str, domain: int, timeout_s: float) -> str:
    """Send the goal and wait until it is accepted. Raises BackendError on timeout or refusal."""
    context = Context()  # a context of its own, beside that of a program that uses ROS
    rclpy.init(args=[], context=context, domain_id=domain)
    try:
        node = rclpy.create_node("cartier", context=context)
        client = ActionClient(node, NavigateToPose, action)
        if not client.wait_for_server(timeout_sec=timeout_s):
            raise BackendError(
                f"no robot serves the action /{action} in domain {domain} (waited {timeout_s:g} s): is Nav2 up and "
                f"active, and is its ROS_DOMAIN_ID {domain}?"
            )
        future = client.send_goal_async(_message(goal))
        executor = SingleThreadedExecutor(context=context)
        rclpy.spin_until_future_complete(node, future, executor=executor, timeout_sec=timeout_s)
        if not future.done():
            raise BackendError(f"/{action} in domain {domain} did not answer within {timeout_s:g} s")
        if not future.result().accepted:
            refused = f"/{action} in domain {domain} refused the goal: {in_words(goal)}"
            raise BackendError(f"{refused}; the robot's log says why")
    finally:
        rclpy.shutdown(context=context)
    return f"accepted by /{action} in domain {domain}: {in_words(goal)}"


def _message(goal: Goal) -> Any:
    message = NavigateToPose.Goal()
    message.pose.header.frame_id = FRAME  # the stamp stays zero: the latest transform, on a real or a simulated clock
    message.pose.pose.position.x, message.pose.pose.position.y = goal.x, goal.y
    orientation = message.pose.pose.orientation
    orientation.z, orientation.w = quaternion_zw(goal.yaw)
    return message
