"""Domain of a detector: whether it was made for the pictures of a recording, photographs or those of a simulator."""

from __future__ import annotations

import numpy as np

from cartier.contracts import Detector, Recording, optional
from cartier.types import Array

DOLLHOUSE = "dollhouse"  # the simulator for whose pictures cartier has a detector
LOOKED = 9  # frames, spread over the recording
SAMPLES = 76_800  # pixels of a frame that are compared; with far fewer, any picture has a colour for each
FEW_COLOURS = 0.045
"""Different colours per sample, in steps of 4, below which pictures are rendered: sensors have noise, shaders none.
Medians of recordings: 0.084 to 0.144 of four real rooms and 0.115 of 64 photographs; 0.009 of AI2-THOR, 0.012 to 0.024
of homes of the dollhouse."""


def is_from_world(recording: Recording, world: str) -> bool:
    """Whether a recording is a simulator's, as it says itself by its truth or, a spool, by its notes."""
    told = recording.truth is not None or any(note.startswith(f"a simulation: the {world}") for note in recording.notes)
    return told and recording.name.startswith(f"{world} ")


def looks_rendered(recording: Recording) -> bool:
    """Whether the pictures of a recording lack the noise that every camera has; False for pictures too small to say."""
    camera = recording.camera
    if not len(recording) or camera.width * camera.height < SAMPLES:
        return False
    looked = np.unique(np.linspace(0, len(recording) - 1, LOOKED).round().astype(int)).tolist()
    return float(np.median([colour_share(recording[number].rgb) for number in looked])) < FEW_COLOURS


def colour_share(rgb: Array) -> float:
    """How many different colours, in steps of 4, an image (H, W, 3) has for each of its samples."""
    step = max(1, round((rgb.shape[0] * rgb.shape[1] / SAMPLES) ** 0.5))
    levels = rgb[::step, ::step].astype(np.int32) // 4
    codes = (levels[..., 0] * 64 + levels[..., 1]) * 64 + levels[..., 2]
    return len(np.unique(codes)) / codes.size


def domain_warning(detector: Detector, recording: Recording) -> str | None:
    """The line that says that a detector was not made for such a recording, None if it was or if that is not known."""
    world = optional(detector, Detector, "world")
    if world == "" and is_from_world(recording, DOLLHOUSE):
        return (
            f"WRONG DETECTOR: {detector.name} knows photographs, and {recording.name} is rendered: the {DOLLHOUSE} has "
            "a detector of its own, which fits; map again without --detector"
        )
    if world == "" and looks_rendered(recording):
        return (
            f"WRONG DETECTOR: {detector.name} knows photographs, and the pictures of {recording.name} look rendered: "
            "they have next to no noise and few colours; trust little that it lists; those of the {DOLLHOUSE} have a "
            "detector of their own: --detector embedded"
        )
    if not world or is_from_world(recording, world) or (recording.truth is None and looks_rendered(recording)):
        return None  # pictures that look rendered, and do not say of which world, may be of this one
    return (
        f"WRONG DETECTOR: {detector.name} knows only rendered pictures of the {world}, and {recording.name} is none of "
        "it: trust nothing that it lists; map again without --detector"
    )
