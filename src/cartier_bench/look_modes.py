"""Ways in which the suite look has a question answered: by the list, by pictures, or by guessing."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cartier.contracts import VisionModel, VisionModelDefaults, optional
from cartier.errors import ReasonerError
from cartier.home import Home
from cartier.home.looking import photographs_of
from cartier.io.images import decode_jpeg
from cartier.pipeline import ask
from cartier.reasoners import embedded
from cartier.types import Answer, CandidateView, VisualQuestion, VisualReply
from cartier.vision.crops import JPEG_QUALITY, MAX_TOKENS, whole
from cartier.vision.decision import MIN_MARGIN
from cartier.vision.permission import Look
from cartier.vision.views import MAX_PICTURES
from cartier_bench.look_items import CANNOT_TELL, PLACES_X, LookItem

MODES = ("list only", "blind", "frames only", "list + look", "mirrored")
"""``blind``: the pictures are grey. ``frames only``: whole photographs, no list and no box. ``mirrored``: as list +
look, with each picture mirrored."""
WHOLE = "The images are whole photographs, each twice, without a crop and without a box. "


@dataclass(frozen=True)
class Given:
    """An answer: one of the item's choices or "cannot tell"; the pictures that it rests on, and how it came about.

    ``asked`` says whether the vision model was asked, ``unanswered`` that it had no reply: such a row is not counted.
    """

    answer: str
    pictures: tuple[CandidateView, ...] = ()
    asked: int = 0
    unanswered: bool = False
    why: str = ""
    text: str = ""
    whole: Answer | None = None


class Changed:
    """A vision model that sees each picture changed; it counts what it is asked, and what it has no reply to."""

    def __init__(self, model: VisionModel, change: Callable[[bytes], bytes] = lambda jpeg: jpeg) -> None:
        self.name, self.endpoint, self.sees = model.name, model.endpoint, optional(model, VisionModelDefaults, "sees")
        self._model, self._change, self.asked, self.failed = model, change, 0, False

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        self.asked += 1
        changed = [
            replace(each, crop_jpeg=self._change(each.crop_jpeg), context_jpeg=self._change(each.context_jpeg))
            for each in pictures
        ]
        try:
            return self._model.look(question, changed)
        except ReasonerError:
            self.failed = True
            raise


def grey(jpeg: bytes) -> bytes:
    """A picture of the same size in which nothing can be seen."""
    return _jpeg(np.full_like(decode_jpeg(jpeg, "a picture"), 128))


def mirrored(jpeg: bytes) -> bytes:
    """The picture with left and right swapped."""
    return _jpeg(decode_jpeg(jpeg, "a picture")[:, ::-1])


def answer(home: Home, item: LookItem, mode: str, model: VisionModel | None) -> Given:
    """The answer to a question in one of the ``MODES``; all but "list only" need a model."""
    if mode == "list only":
        return _given(home, ask(home, item.words, embedded.make()), item, None)
    assert model is not None
    if mode == "frames only":
        return _of_frames(home, item, Changed(model))
    seen = Changed(model, {"blind": grey, "mirrored": mirrored}.get(mode, lambda jpeg: jpeg))
    return _given(home, ask(home, item.words, embedded.make(), look=Look(seen)), item, seen)


def _given(home: Home, told: Answer, item: LookItem, seen: Changed | None) -> Given:
    trace, chosen = told.look, told.selection
    value: object = chosen.fact.value if chosen.fact is not None else None
    if item.kind == "which":
        x = next((obj.position[0] for obj in home.objects if obj.id == chosen.object_id), None)
        value = None if x is None else ("left" if x < _middle(item) else "right")
    elif isinstance(value, bool):
        value = "yes" if value else "no"
    given = value if isinstance(value, str) and value in item.choices else CANNOT_TELL
    pictures = () if trace is None or trace.reply is None else trace.pictures
    asked, failed = (0, False) if seen is None else (seen.asked, seen.failed)
    return Given(given, pictures, asked, failed, trace.why if trace is not None else "", chosen.text, told)


def _middle(item: LookItem) -> float:
    """Where the place is along the room (m)."""
    return PLACES_X[int(item.id.rpartition("-")[2]) - 1]


def _of_frames(home: Home, item: LookItem, seen: Changed) -> Given:
    """Whole photographs of the place, the latest that tells counts."""
    photographs = photographs_of(home)
    frames = _frames_of(home, item)
    pictures = tuple(whole(frame, photographs.rgb(frame), MAX_TOKENS // max(1, len(frames))) for frame in frames)
    if not pictures:
        return Given(CANNOT_TELL, why="no photograph was kept")
    question = VisualQuestion(f"{WHOLE}{item.plain}", item.attribute, item.choices)
    try:
        reply = seen.look(question, pictures)
    except ReasonerError as error:
        return Given(CANNOT_TELL, pictures, seen.asked, True, str(error))
    told = [each for each in reply.answers if each.answer in item.choices and 2 * each.certainty - 1 >= MIN_MARGIN]
    given = max(told, key=lambda each: each.frame).answer if told else None
    return Given(given or CANNOT_TELL, pictures, seen.asked, False, reply.reply[:300], item.plain)


def _frames_of(home: Home, item: LookItem) -> list[int]:
    """The kept photographs that were taken at an item's place, at most three, spread over the arc."""
    from cartier_bench.look_items import ARC_DEG

    first = (int(item.id.rpartition("-")[2]) - 1) * len(ARC_DEG)
    kept = [frame for frame in range(first, first + len(ARC_DEG)) if frame in home.photos]
    step = max(1, len(kept) // MAX_PICTURES)
    return kept[::step][:MAX_PICTURES]


def _jpeg(rgb: np.ndarray) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(rgb).save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return buffer.getvalue()
