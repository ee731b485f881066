"""Simulated robot that explores a home of the dollhouse: dollhouse:HOME@SPEED, with the true poses.

It is a simulation: what it sends is rendered while it drives.
"""

from __future__ import annotations

from cartier import plugins
from cartier.contracts import Source
from cartier.sources.common.pacing import check_speed
from cartier.sources.common.player import RecordingPlayer


def make(
    model: str,
    speed: float = 1.0,
    seed: int = 0,
    sensor: str = "exact",
    max_frames: int = 800,
    width: int = 640,
    height: int = 480,
) -> Source:
    """``model`` is a home of the dollhouse. The other options are the world's and those of ``explore``.

    Raises InputError for an unknown home or an impossible speed.
    """
    speed = check_speed(float(speed))
    world = plugins.make("worlds", "dollhouse", width=int(width), height=int(height))
    return RecordingPlayer(world.explore(model, seed=int(seed), sensor=sensor, max_frames=int(max_frames)), speed)
