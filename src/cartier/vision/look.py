"""Look before answering: after the list has answered, photographs are asked where the list cannot tell.

The rules: no question without a reason (how an object looks, which of several it is, its state, or a doubtful choice);
one call with at most three pictures; nothing about objects that appear too small; a refusal rather than a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from cartier.contracts import VisionModel, VisionModelDefaults, optional
from cartier.errors import NothingSent, ReasonerError
from cartier.io.images import decode_jpeg, decoded_size
from cartier.types import (
    CandidateView,
    Detections,
    Goal,
    Inventory,
    MapObject,
    OccupancyGrid,
    RobotModel,
    Selection,
    VisualAnswer,
    VisualQuestion,
    VisualReply,
    VisualTrace,
)
from cartier.understanding.cards import Deck
from cartier.vision import attributes, prompt
from cartier.vision.candidates import doubtful, meant
from cartier.vision.crops import MAX_TOKENS, picture
from cartier.vision.decision import MIN_VIEWS, Decision, decide
from cartier.vision.permission import Look
from cartier.vision.viewpoint import pose_to_see
from cartier.vision.views import MAX_PICTURES, MIN_APPARENT_PX, apparent_px, ranked, select, stored_views
from cartier.vision.wording import looked_notes, selection_of

PRIVATE = frozenset(["person", "man", "woman", "child", "face", "tv", "television", "laptop", "monitor", "screen"])
"""Labels of what is blurred."""
PRIVATE_SCORE = 0.1
"""The score from which a detection is blurred: a screen too many does no harm."""
_WORDS = {
    "clean": "Is this {label} clean or dirty?", "on": "Is this {label} switched on or off?",
    "open": "Is this {label} open or closed?", "full": "Is this {label} full or empty?",
    "colour": "What is the main colour of this {label}?", "text": "What is written on this {label}?",
    "look": "What does this {label} look like, in a few words?", "exists": "Is this really a {label}?",
}  # fmt: skip


@dataclass(frozen=True)
class Photographs:
    """The stored photographs of a home.

    Args:
        jpegs: JPEG bytes by frame number.
        detections: Gives all that the detector found in each frame, by frame number; frames may be missing.
    """

    jpegs: Mapping[int, bytes]
    detections: Callable[[], Mapping[int, Detections]]

    def sizes(self, objects: Sequence[MapObject]) -> dict[int, tuple[int, int]]:
        """(width, height) of the photographs of some objects, by frame."""
        frames = {view.frame for obj in objects for view in obj.all_views if view.frame in self.jpegs}
        return {frame: decoded_size(self.jpegs[frame], _where(frame)) for frame in frames}

    def rgb(self, frame: int) -> npt.NDArray[np.uint8]:
        """A photograph, (H, W, 3)."""
        return decode_jpeg(self.jpegs[frame], _where(frame))


@dataclass(frozen=True)
class Surroundings:
    """What a pose to look from is planned with: the floor plan, where the robot stands, and the robot."""

    grid: OccupancyGrid | None
    from_xy: tuple[float, float]
    robot: RobotModel


def look(
    allowed: Look,
    words: str,
    selection: Selection,
    inventory: Inventory,
    photographs: Photographs,
    around: Surroundings,
    deck: Deck,
) -> tuple[Selection, VisualTrace, tuple[str, ...]] | None:
    """What the photographs change in an answer; None if there is no reason to look.

    Returns:
        The answer, how it came about, and lines for the person: which photographs left, and to whom.
    """
    found = _question(words, selection, inventory, deck)
    if found is None:
        return None
    question, candidates, asked = found
    trace = ask_about(allowed, question, candidates, photographs, around, asked is not None and asked.form == "which")
    return selection_of(selection, trace, asked, inventory), trace, looked_notes(trace, allowed.model)


def ask_about(
    allowed: Look,
    question: VisualQuestion,
    candidates: Sequence[MapObject],
    photographs: Photographs,
    around: Surroundings,
    choose: bool = False,
    strict: bool = False,
) -> VisualTrace:
    """Ask a question about candidates, in one call at most. ``choose``: which of them fits is asked.

    Raises ReasonerError only if ``strict``; otherwise a model that cannot be reached could not tell.
    """
    sizes = photographs.sizes(candidates)
    largest = candidates[0] if len(candidates) == 1 else None
    if all(len(obj.views) < MIN_VIEWS for obj in candidates):
        return _trace(question, (), None, Decision("refused", "it was seen only once"), largest, sizes, around)
    if not choose and len(candidates) > MAX_PICTURES:
        return _trace(question, (), None, Decision("several", "too many are meant"), None, sizes, around)
    pictures, unlogged = _pictures(candidates, sizes, photographs, allowed.blur)
    if not pictures:
        why = "people and screens cannot be blurred: the detector's boxes of these frames are not stored"
        why = why if unlogged else f"it is below {MIN_APPARENT_PX:g} px in every photograph"
        return _trace(question, (), None, Decision("cannot_tell", why), largest or candidates[0], sizes, around)
    if (bar := barred(allowed, question, pictures)) is not None:
        return VisualTrace(question, pictures, None, "not_asked", why=bar)
    try:
        reply = allowed.model.look(question, pictures)
    except ReasonerError as error:
        if strict:
            raise
        reply = unanswered(allowed.model, pictures, error)
        return _trace(question, pictures, reply, Decision("cannot_tell", str(error)), None, sizes, around)
    if not reply.valid:
        return _trace(question, pictures, reply, Decision("cannot_tell", prompt.INVALID), None, sizes, around)
    pixels = [each.apparent_px for each in pictures]
    decision = decide(question, candidates, _checked(reply, question, pictures), pixels, choose)
    return _trace(question, pictures, reply, decision, largest, sizes, around)


def unanswered(model: VisionModel, pictures: Sequence[CandidateView], error: ReasonerError) -> VisualReply:
    """The reply of a model that gave none: it could not tell, and the photographs left, unless the error says not."""
    times_sent = 0 if isinstance(error, NothingSent) else 1
    return VisualReply(prompt.cannot_tell(pictures), model.name, model.endpoint, times_sent=times_sent)


def question_about(obj_label: str, attribute: str, wanted: str = "", **more: object) -> VisualQuestion:
    """The question about an attribute of an object with a label; ``more`` are further fields of it."""
    label = prompt.bare_words(obj_label, 60) or "object"
    choices = ("yes", "no") if attribute == "exists" else attributes.CLOSED.get(attribute, ())
    return VisualQuestion(_WORDS[attribute].format(label=label), attribute, choices, wanted, **more)  # type: ignore[arg-type]


def _question(
    words: str, selection: Selection, inventory: Inventory, deck: Deck
) -> tuple[VisualQuestion, list[MapObject], attributes.Asked | None] | None:
    """The question to photographs, its candidates, and what the words ask; None if the list is enough."""
    asked = attributes.read(words)
    candidates = meant(asked, inventory, deck) if asked is not None else []
    if asked is not None and candidates:
        reason: Literal["which", "look", "state"] = (
            "which" if asked.form == "which" else "look" if asked.attribute in ("colour", "text", "look") else "state"
        )
        numbers = tuple(obj.id for obj in candidates)
        question = question_about(
            candidates[0].label, asked.attribute, asked.value, reason=reason, objects=numbers
        )  # fmt: skip
        return question, candidates, asked
    obj = doubtful(selection, inventory)
    if obj is None:
        return None
    return question_about(obj.label, "exists", "yes", reason="doubt", objects=(obj.id,)), [obj], None


def _pictures(
    candidates: Sequence[MapObject],
    sizes: Mapping[int, tuple[int, int]],
    photographs: Photographs,
    blur: bool,
) -> tuple[tuple[CandidateView, ...], bool]:
    """The pictures to send, and whether any were left out because nothing is known to blur in them."""
    boxes: dict[int, list[tuple[float, ...]]] = {}
    out: set[int] = set()
    if blur:
        seen = photographs.detections()
        boxes = {frame: _private(seen[frame]) for frame in sizes if frame in seen}
        out = sizes.keys() - seen.keys()
    chosen = select(candidates, sizes, out)
    share = MAX_TOKENS // max(1, len(chosen))
    made = [picture(obj, view, photographs.rgb(view.frame), share, boxes.get(view.frame, ())) for obj, view in chosen]
    return tuple(made), bool(out) and not chosen


def _private(detections: Detections) -> list[tuple[float, ...]]:
    return [
        tuple(map(float, box))
        for box, label, score in zip(detections.boxes_xyxy, detections.labels, detections.scores, strict=True)
        if label in PRIVATE and score >= PRIVATE_SCORE
    ]


def barred(allowed: Look, question: VisualQuestion, pictures: Sequence[CandidateView]) -> str | None:
    """Why nothing may be sent, or None."""
    if optional(allowed.model, VisionModelDefaults, "sees") is False:
        return f"cartier check-model found that {allowed.model.name} does not see pictures"
    if allowed.when == "ask" and not allowed.consent(question, pictures):
        return "photographs may leave only when the owner agrees (--look ask)"
    return None


def _checked(reply: VisualReply, question: VisualQuestion, pictures: Sequence[CandidateView]) -> Sequence[VisualAnswer]:
    """The answers of a model of anyone's, if they are about these pictures and of the closed set; else none."""
    about = [(each.object_id, each.frame) for each in pictures]
    right = [(each.object_id, each.frame) for each in reply.answers] == about and all(
        each.answer is None or not question.choices or each.answer in question.choices for each in reply.answers
    )
    return reply.answers if right else prompt.cannot_tell(pictures)


def _trace(
    question: VisualQuestion,
    pictures: tuple[CandidateView, ...],
    reply: VisualReply | None,
    decision: Decision,
    unseen: MapObject | None,
    sizes: Mapping[int, tuple[int, int]],
    around: Surroundings,
) -> VisualTrace:
    """The trace; of what could not be told, with a pose from which it could."""
    pose: Goal | None = None
    if (
        decision.verdict == "cannot_tell"
        and unseen is not None
        and (views := ranked(stored_views(unseen, sizes), sizes))
    ):
        pixels = apparent_px(views[0], sizes[views[0].frame])
        pose = pose_to_see(unseen, pixels, around.grid, around.from_xy, around.robot, new_side=bool(pictures))
    return VisualTrace(
        question, pictures, reply, decision.verdict, decision.answer, decision.object_id, decision.certainty,
        decision.why, pose,
    )  # fmt: skip


def _where(frame: int) -> str:
    return f"the photo of frame {frame}"
