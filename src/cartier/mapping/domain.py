"""Domain of a detector: whether it was made for the pictures of a recording, photographs or those of a simulator."""

from __future__ import annotations

from cartier.contracts import Detector, Recording, optional

DOLLHOUSE = "dollhouse"  # the simulator for whose pictures cartier has a detector


def is_from_world(recording: Recording, world: str) -> bool:
    """Whether a recording is a simulator's, as it says itself."""
    return recording.truth is not None and recording.name.startswith(f"{world} ")


def domain_warning(detector: Detector, recording: Recording) -> str | None:
    """The line that says that a detector was not made for such a recording, None if it was or if that is not known."""
    world = optional(detector, Detector, "world")
    if world == "" and is_from_world(recording, DOLLHOUSE):
        return (
            f"WRONG DETECTOR: {detector.name} knows photographs, and {recording.name} is rendered: the {DOLLHOUSE} has "
            "a detector of its own, which fits; map again without --detector"
        )
    if not world or is_from_world(recording, world):
        return None
    return (
        f"WRONG DETECTOR: {detector.name} knows only rendered pictures of the {world}, and {recording.name} is none of "
        "it: trust nothing that it lists; map again without --detector"
    )
