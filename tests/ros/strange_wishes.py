"""Stranger who tries the action's corners: cancels, preempts, asks for what cannot be. Prints a line for each.

usage: X,Y X,Y, two poses in the map that the robot can reach and that lie more than a metre apart.
"""

import math
import sys
import time

import rclpy
from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from three_poses import Commander

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def spin(node, until, timeout_s=20.0):
    end_s = time.monotonic() + timeout_s
    while not until() and time.monotonic() < end_s:
        rclpy.spin_once(node, timeout_sec=0.1)
    return bool(until())


rclpy.init()
me = Commander()
one, two = (tuple(map(float, words.split(","))) for words in sys.argv[1:3])
states, frames, poses = {}, {}, []
me.create_subscription(
    GoalStatusArray, "navigate_to_pose/_action/status",
    lambda told: states.update({bytes(s.goal_info.goal_id.uuid): s.status for s in told.status_list}), LATCHED,
)  # fmt: skip
for topic, qos in (("tf", 100), ("tf_static", LATCHED)):
    me.create_subscription(
        TFMessage, topic,
        lambda told: frames.update({t.child_frame_id: t.header.frame_id for t in told.transforms}), qos,
    )  # fmt: skip
me.create_subscription(PoseWithCovarianceStamped, "amcl_pose", poses.append, LATCHED)
me.create_publisher(PoseWithCovarianceStamped, "initialpose", 10).publish(PoseWithCovarianceStamped())
me.wait_until_active()
spin(me, lambda: len(frames) >= 4 and poses)
print(
    "frames", *(f"{child}<{parent}" for child, parent in sorted(frames.items())), poses[0].header.frame_id, flush=True
)

first = me.go(*one, 0.0)
spin(me, lambda: me.told)
second = me.go(*two, 0.0)
print("preempted", me.wait(first, 20).status, flush=True)
spin(me, lambda: states.get(bytes(second.goal_id.uuid)) == 2 and me.told)
print("driving", states[bytes(second.goal_id.uuid)], me.told[-1].current_pose.header.frame_id, flush=True)
future = second.cancel_goal_async()
rclpy.spin_until_future_complete(me, future, timeout_sec=20)
print("cancelled", len(future.result().goals_canceling), me.wait(second, 20).status, flush=True)

third, all_of_them = me.go(*one, 0.0), me.create_client(CancelGoal, "navigate_to_pose/_action/cancel_goal")
spin(me, lambda: me.told)
future = all_of_them.call_async(CancelGoal.Request())
rclpy.spin_until_future_complete(me, future, timeout_sec=20)
print("all cancelled", len(future.result().goals_canceling), me.wait(third, 20).status, flush=True)
future = all_of_them.call_async(CancelGoal.Request())
rclpy.spin_until_future_complete(me, future, timeout_sec=20)
print("none left", future.result().return_code, len(future.result().goals_canceling), flush=True)

for name, x, y, frame in (
    ("outside", 500.0, 0.0, "map"),
    ("no frame", *one, "moon"),
    ("no number", math.nan, 0.0, "map"),
    ("from here", 0.0, 0.0, "base_link"),
):
    ended = me.wait(me.go(x, y, 0.0, frame), 20)
    print(name, ended.status, ended.result.error_code, "not a number" in ended.result.error_msg, flush=True)

goal = PoseStamped()
goal.header.frame_id, (goal.pose.position.x, goal.pose.position.y), goal.pose.orientation.w = "map", one, 1.0
publisher, known = me.create_publisher(PoseStamped, "goal_pose", 10), set(states)
spin(me, publisher.get_subscription_count)
for _ in range(20):  # who is known to listen may not know yet who speaks
    publisher.publish(goal)
    if spin(me, lambda: set(states) - known, 1.0):
        break
print("by topic", spin(me, lambda: any(states[goal] == 4 for goal in set(states) - known), 60), flush=True)
rclpy.shutdown()
