"""Drive of cartier to a goal two metres away, as ``cartier ask --go ros2`` does it; each line has its time.

usage: drive.py [laws] [SILENT_S]; with laws, the laws of robots over the robot that is there.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "robots"))

from peers import answer, goal_at

from cartier import plugins
from cartier.errors import CartierError
from cartier.robots import send
from cartier.testing import check_robot
from cartier.types import DriveProgress

GOAL = goal_at(1.6, 1.2, 0.5)


def say(*words: object) -> None:
    print(f"{time.time():.3f}", *words, flush=True)


def watch(progress: DriveProgress) -> None:
    say(progress.status, progress.text)


def main(*words: str) -> int:
    make = lambda: plugins.make("robots", "ros2")  # noqa: E731
    say("made", "rclpy" if make()._with_rclpy else "dds")
    if "laws" in words:
        check_robot(make, GOAL)
        say("exit the laws hold")
        return 0
    if words:
        from cartier_ros.robots import rclpy_action

        rclpy_action.SILENT_S = float(words[0])
    try:
        sent = send(make(), answer("found", GOAL), watch)
    except CartierError as error:
        say("exit", error)
        return 1
    say("exit", sent.text)
    return sent.exit_code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
