"""Strange program: written against Nav2's documentation alone, it sends a robot to poses. usage: X,Y,YAW ..."""

import math
import sys

import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.node import Node


class Commander(Node):
    def __init__(self):
        super().__init__("commander")
        self.state = self.create_client(GetState, "bt_navigator/get_state")
        self.navigator = ActionClient(self, NavigateToPose, "navigate_to_pose")
        self.told = []

    def wait_until_active(self):
        while not self.state.wait_for_service(timeout_sec=1.0):
            self.get_logger().info("bt_navigator is not up yet")
        label = ""
        while label != "active":
            future = self.state.call_async(GetState.Request())
            rclpy.spin_until_future_complete(self, future)
            label = future.result().current_state.label
        while not self.navigator.wait_for_server(timeout_sec=1.0):
            self.get_logger().info("navigate_to_pose is not up yet")

    def go(self, x, y, yaw, frame="map"):
        goal = NavigateToPose.Goal()
        goal.pose.header.frame_id = frame
        goal.pose.header.stamp = self.get_clock().now().to_msg()
        goal.pose.pose.position.x, goal.pose.pose.position.y = x, y
        goal.pose.pose.orientation.z, goal.pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        self.told = []
        sent = self.navigator.send_goal_async(goal, feedback_callback=lambda told: self.told.append(told.feedback))
        rclpy.spin_until_future_complete(self, sent)
        return sent.result()

    def wait(self, handle, timeout_sec=None):
        result = handle.get_result_async()
        rclpy.spin_until_future_complete(self, result, timeout_sec=timeout_sec)
        return result.result()


if __name__ == "__main__":
    rclpy.init()
    commander = Commander()
    commander.wait_until_active()
    for words in sys.argv[1:]:
        x, y, yaw = map(float, words.split(","))
        handle = commander.go(x, y, yaw)
        if not handle.accepted:
            sys.exit(f"{words} was rejected")
        ended = commander.wait(handle)
        p = commander.told[-1].current_pose.pose.position if commander.told else None
        off_m = math.dist((p.x, p.y), (x, y)) if p else -1.0
        succeeded = ended.status == GoalStatus.STATUS_SUCCEEDED
        print(words, "reached" if succeeded else f"failed {ended.status} {ended.result.error_code}", f"{off_m:.2f}",
              len(commander.told), flush=True)  # fmt: skip
    rclpy.shutdown()
