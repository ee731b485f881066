"""Sends nothing: prints the pose, and the ros2 command line that would send it to Nav2.

The goal of ``/navigate_to_pose`` is the same in Humble, Iron, Jazzy and Kilted.
"""

from __future__ import annotations

from cartier.robots._pose import in_words, send_goal_command
from cartier.types import Goal


def make() -> Print:
    return Print()


class Print:
    """Obeys the Robot contract."""

    name = "print"

    def go_to(self, goal: Goal) -> str:
        return f"{goal.place.label}: {in_words(goal)}: {send_goal_command(goal)}"
