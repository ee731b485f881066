"""Permission to look: which vision model may be sent a home's photographs, and when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from cartier.contracts import VisionModel
from cartier.types import CandidateView, VisualQuestion


@dataclass(frozen=True)
class Look:
    """The owner's choice of who may look at photographs, and when.

    Args:
        model: Who looks.
        when: "auto" (wherever the rules say so) or "ask" (the owner is asked each time).
        consent: For "ask": whether these pictures may go to the model now. By default they may not.
        blur: Whether people and screens are blurred first, by the boxes that the detector found.
    """

    model: VisionModel
    when: Literal["ask", "auto"] = "auto"
    consent: Callable[[VisualQuestion, Sequence[CandidateView]], bool] = lambda question, pictures: False
    blur: bool = False
