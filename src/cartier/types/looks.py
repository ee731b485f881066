"""Looks: questions about photographs, the pictures that go with them, and what a vision model answers."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cartier.errors import need
from cartier.types.places import Goal

CANNOT_TELL = "cannot tell"
"""What a vision model answers where a photograph does not show it; no other answer may be called so."""


@dataclass(frozen=True)
class VisualQuestion:
    """A question about photographs (visual question answering).

    Args:
        words: What to find out about the object in the drawn box, as a sentence: "Is this mug clean or dirty?".
        attribute: What is asked for: "colour", "clean", "on", "open", "full", "text", "look" (all else that an object
            looks like), "which" (whether this is the object that was meant) or "exists" (whether it is what the map
            calls it).
        choices: The closed set of answers; empty for an open answer, which is short text and never obeyed.
        wanted: The choice that the person hopes for or presumes: "clean" in "is the mug clean?"; empty for none.
        reason: Why photographs are asked about: "look", "which", "state" or "doubt".
        objects: The ids of the candidate objects, best first.
    """

    words: str
    attribute: str
    choices: tuple[str, ...]
    wanted: str = ""
    reason: Literal["look", "which", "state", "doubt"] = "look"
    objects: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        need(CANNOT_TELL not in self.choices, f"{CANNOT_TELL!r} is always possible and no choice")
        need(not self.wanted or self.wanted in self.choices, f"{self.wanted!r} is not one of {self.choices}")


@dataclass(frozen=True)
class CandidateView:
    """A picture of a candidate that goes with a question: a crop, and its context with the box drawn.

    Args:
        object_id: The id of the object.
        label: Its label.
        frame: The number of the frame whose photograph this is.
        box_xyxy: Its box in the photograph (px).
        apparent_px: The shorter side of that box, inside the photograph.
        crop_jpeg: The box with a small margin, enlarged, as JPEG.
        context_jpeg: The photograph around it with the box drawn, as JPEG.
        tokens: How many image tokens both take, by the counting rule of ``cartier.vision.crops``.
        blurred: How many people and screens were blurred.
    """

    object_id: int
    label: str
    frame: int
    box_xyxy: tuple[float, ...]
    apparent_px: float
    crop_jpeg: bytes = field(repr=False)
    context_jpeg: bytes = field(repr=False)
    tokens: int
    blurred: int = 0

    def to_dict(self) -> dict[str, Any]:
        """The picture as plain JSON values, with digests instead of the images.

        Returns:
            What ``cartier ask --json`` prints of a photograph that was looked at.
        """
        sent = {"crop_sha256": self.crop_jpeg, "context_sha256": self.context_jpeg}
        return {
            "object_id": self.object_id, "label": self.label, "frame": self.frame, "box_xyxy": list(self.box_xyxy),
            "apparent_px": round(self.apparent_px, 1), "image_tokens": self.tokens, "blurred": self.blurred,
            **{name: hashlib.sha256(jpeg).hexdigest() for name, jpeg in sent.items()},
        }  # fmt: skip


@dataclass(frozen=True)
class VisualAnswer:
    """What a vision model says about one picture.

    Args:
        object_id, frame: Which candidate, and in which frame.
        answer: One of the question's choices, or short text for an open question; None for "cannot tell".
        certainty: How certain it is, 0 to 1; 0 where it cannot tell.
    """

    object_id: int
    frame: int
    answer: str | None
    certainty: float

    def __post_init__(self) -> None:
        need(0 <= self.certainty <= 1, f"a certainty lies between 0 and 1, got {self.certainty}")


@dataclass(frozen=True)
class VisualReply:
    """The answer of a vision model to a question.

    Args:
        answers: One for each picture, in their order.
        model: Which model it was.
        endpoint: Where the pictures went: a URL without credentials, and a proxy on the way; empty if they did not
            leave this process.
        prompt, reply: What it was sent (without the images) and what it returned.
        tokens: How many tokens it took, as the server counts them; 0 if unknown.
        valid: False if the reply was not of the form that it was asked for, so that it answers nothing.
        times_sent: How often the pictures were sent; 0 if the server did not even take a made one.
    """

    answers: tuple[VisualAnswer, ...]
    model: str
    endpoint: str = ""
    prompt: str = ""
    reply: str = ""
    tokens: int = 0
    valid: bool = True
    times_sent: int = 1


@dataclass(frozen=True)
class VisualTrace:
    """How photographs were looked at for an answer, or why not.

    Args:
        question: What was to be found out.
        pictures: The pictures that went with it.
        reply: What the vision model answered; None if none was asked.
        verdict: What follows: "told", "cannot_tell", "refused" (too little certainty or too few views), "several" (two
            candidates fit) or "not_asked" (nothing was sent; ``why`` says why).
        answer: The answer of the latest verified observation, or None.
        object_id: The candidate that it is about, or None.
        certainty: How certain that is.
        why: The verdict's reason, in one sentence.
        view_from: A reachable pose from which the object would appear large enough, or None.
    """

    question: VisualQuestion
    pictures: tuple[CandidateView, ...]
    reply: VisualReply | None
    verdict: Literal["told", "cannot_tell", "refused", "several", "not_asked"]
    answer: str | None = None
    object_id: int | None = None
    certainty: float = 0.0
    why: str = ""
    view_from: Goal | None = None

    def to_dict(self) -> dict[str, Any]:
        """The trace as plain JSON values.

        Returns:
            What ``cartier ask --json`` prints as ``look``.
        """
        asked, reply = asdict(self.question), self.reply
        times_sent = 0 if reply is None else reply.times_sent
        return {
            "question": {**asked, "choices": list(asked["choices"]), "objects": list(asked["objects"])},
            "photos": [picture.to_dict() for picture in self.pictures], "sent": times_sent > 0,
            "times_sent": times_sent,
            "to": None if reply is None else {"model": reply.model, "endpoint": reply.endpoint or None},
            "answers": [] if reply is None else [asdict(answer) for answer in reply.answers],
            "reply": "" if reply is None else reply.reply, "verdict": self.verdict, "answer": self.answer,
            "object_id": self.object_id, "certainty": round(self.certainty, 3), "why": self.why,
            "view_from": None if self.view_from is None else self.view_from.to_dict(),
        }  # fmt: skip
