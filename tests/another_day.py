"""Two rooms, walks around them, and a walk of another day in a pose frame of its own."""

from __future__ import annotations

import numpy as np

import cartier
from cartier.mapping.poses.motions import Reposed
from cartier.mapping.poses.registration import about_z
from synthetic import RoomRecording, TrueBoxes, box, look

ROOM_THINGS = (
    box(1, "chair", (3.6, 1.8, 0), (4.1, 2.3, 0.9)), box(2, "mug", (1.45, 3.45, 0.8), (1.55, 3.55, 0.9)),
    box(3, "table", (0.8, 3.2, 0), (2.2, 3.8, 0.8)), box(4, "shelf", (0.0, 0.5, 0), (0.3, 1.6, 1.8)),
    box(5, "bin", (4.5, 3.5, 0), (4.8, 3.8, 0.4)), box(6, "lamp", (4.4, 0.2, 0), (4.7, 0.5, 1.5)),
    box(7, "box", (2.0, 0.1, 0), (2.6, 0.5, 0.5)), box(8, "chair", (1.2, 2.5, 0), (1.6, 2.9, 0.9)),
)  # fmt: skip
OTHER_THINGS = (
    box(1, "table", (1.0, 1.0, 0), (2.6, 1.8, 0.8)), box(2, "mug", (2.0, 1.2, 0.8), (2.1, 1.3, 0.9)),
    box(3, "chair", (3.5, 3.0, 0), (4.0, 3.5, 0.9)), box(4, "shelf", (4.6, 0.5, 0), (5.0, 2.0, 1.8)),
    box(5, "bin", (0.2, 3.5, 0), (0.5, 3.8, 0.4)), box(6, "lamp", (0.2, 0.2, 0), (0.5, 0.5, 1.5)),
    box(7, "box", (3.0, 0.2, 0), (3.6, 0.6, 0.5)), box(8, "chair", (1.5, 2.2, 0), (1.9, 2.6, 0.9)),
)  # fmt: skip


def motion(turn_rad: float, x: float, y: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:2, 3] = about_z(turn_rad), (x, y)
    return matrix


def rounds(things: tuple[cartier.TrueObject, ...], phase: float, radius_m: float) -> RoomRecording:
    at = np.linspace(0, 2 * np.pi, 24, endpoint=False) + phase
    poses = [
        look((2.5 + radius_m * np.cos(a), 2 + radius_m * np.sin(a), 1.5), (2.5 - 3 * np.cos(a), 2 - 3 * np.sin(a), 0.6))
        for a in at
    ]
    return RoomRecording(poses, things, name=f"round {phase}")


def mapped(recording: cartier.Recording | Reposed, things: tuple[cartier.TrueObject, ...]) -> cartier.Home:
    return cartier.map_home(recording, TrueBoxes(things), every=1, mend_poses=False)


MOVED = motion(2.2, 4.0, -7.0)
ANOTHER_DAY = Reposed(rounds(ROOM_THINGS, 0.1, 0.9), lambda number, pose: MOVED @ pose)
