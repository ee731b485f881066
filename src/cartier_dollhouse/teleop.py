"""Teleoperation: a person steers the robot with the keyboard and sees the camera's picture in the terminal."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable, Generator, Iterable
from contextlib import closing

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.types import Camera
from cartier_dollhouse.explore import DOWN, RADIUS_M, STEP_M, advance, standing_plan
from cartier_dollhouse.model import Scene
from cartier_dollhouse.recording import EYE_M, Poses, look
from cartier_dollhouse.render import Renderer

TURN, TILT = math.radians(15), math.radians(7.5)
KEYS = {
    "w": (1, 0, 0), "s": (-1, 0, 0), "a": (0, 1, 0), "d": (0, -1, 0), "r": (0, 0, -1), "f": (0, 0, 1),
    "\x1b[A": (1, 0, 0), "\x1b[B": (-1, 0, 0), "\x1b[D": (0, 1, 0), "\x1b[C": (0, -1, 0),
}  # fmt: skip
"""(ahead, left, down) of each key; the last four are the arrows."""
FINISH = ("q", "\x1b", "\x03", "\x04")
HELP = "W/S or up/down: drive   A/D or left/right: turn   R/F: look up/down   Q: finish"
VIEW_PX = (320, 240)

Show = Callable[[npt.NDArray[np.uint8], str], None]


def steer(
    scene: Scene,
    camera: Camera,
    radius_m: float = RADIUS_M,
    eye_m: float = EYE_M,
    keys: Iterable[str] | None = None,
    show: Show | None = None,
) -> Poses:
    """Camera poses (N, 4, 4) of a walk that a person steers from ``scene.start_xy``: one per key that changes the view.

    ``keys`` come from the terminal if not given, and end with Q or when there are no more; ``show`` gets each view (H,
    W, 3) with a line of text. A step that would collide is refused. Raises InputError where there is no terminal.
    """
    if keys is None:
        with closing(terminal_keys()) as typed:
            return steer(scene, camera, radius_m, eye_m, typed, show)
    plan = standing_plan(scene, scene.start_xy, radius_m)
    show = print_view if show is None else show
    renderer = Renderer(scene, camera.scaled(*VIEW_PX))
    xy, yaw, down = np.array(scene.start_xy, dtype=np.float64), 0.0, DOWN
    poses = [look(xy, yaw, down, eye_m)]
    show(renderer.render(poses[-1]).rgb, HELP)
    for key in keys:
        if key.lower() in FINISH:
            break
        ahead, left, lower = KEYS.get(key if len(key) > 1 else key.lower(), (0, 0, 0))
        step = xy + ahead * STEP_M * np.array([math.cos(yaw), math.sin(yaw)])
        there, free = advance(plan, xy, step)
        xy = there if free else xy
        yaw, down = yaw + left * TURN, min(max(down + lower * TILT, -TURN), 4 * TURN)
        pose = look(xy, yaw, down, eye_m)
        if not np.array_equal(pose, poses[-1]):
            poses.append(pose)
        note = f"x {xy[0]:.2f}  y {xy[1]:.2f}  {len(poses)} frames" if free else "bump! something is in the way"
        show(renderer.render(pose).rgb, f"{note}   |   {HELP}")
    return np.array(poses)


def terminal_keys() -> Generator[str, None, None]:
    """Key strokes of the terminal as they come, arrows as their escape sequences; the terminal is restored at the end.

    Raises InputError, at once, where there is no terminal.
    """
    if not sys.stdin.isatty():
        raise InputError("steering needs a keyboard: run it in a terminal, or leave out --drive to explore by itself")
    if sys.platform == "win32":
        raise InputError("steering needs a Unix terminal: leave out --drive to explore by itself")
    return _strokes(sys.stdin.fileno())


def _strokes(terminal: int) -> Generator[str, None, None]:
    import termios
    import tty

    before = termios.tcgetattr(terminal)
    try:
        tty.setraw(terminal)
        while typed := os.read(terminal, 1024).decode("utf-8", "ignore"):
            yield from re.findall(r"\x1b\[[A-D]|.", typed, re.DOTALL)  # a key held down comes several times at once
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def half_blocks(rgb: npt.NDArray[np.uint8], columns: int, rows: int) -> str:
    """An image as coloured half-block characters, two pixels each, as large as fits into a terminal of that size."""
    from PIL import Image

    height, width = rgb.shape[:2]
    scale = min(columns / width, 2 * rows / height)
    size = (max(1, int(width * scale)), 2 * max(1, int(height * scale / 2)))
    small = np.asarray(Image.fromarray(rgb).resize(size, Image.Resampling.BOX))
    lines = []
    for upper, lower in zip(small[::2].tolist(), small[1::2].tolist(), strict=True):
        pairs = zip(upper, lower, strict=True)
        cells = (f"\x1b[38;2;{a};{b};{c};48;2;{d};{e};{f}m▀" for (a, b, c), (d, e, f) in pairs)
        lines.append("".join(cells) + "\x1b[0m")
    return "\r\n".join(lines)


def print_view(rgb: npt.NDArray[np.uint8], line: str) -> None:
    """Clear the terminal's screen and draw a view with a line of text below."""
    columns, rows = os.get_terminal_size()
    sys.stdout.write(f"\x1b[H\x1b[J{half_blocks(rgb, columns, rows - 2)}\r\n{line[:columns]}\r\n")
    sys.stdout.flush()
