"""Decision from a vision model's answers: the latest verified observation of each candidate, and when to refuse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from cartier.types import MapObject, VisualAnswer, VisualQuestion
from cartier.vision.views import MIN_APPARENT_PX

MIN_MARGIN = 0.15
"""By which an answer must be likelier than what contradicts it."""
MIN_VIEWS = 2
"""In which an object must have been seen before an answer about it counts."""
UNKNOWN = 0.5
"""How likely a candidate fits about which the model cannot tell."""
Verdict = Literal["told", "cannot_tell", "refused", "several"]


@dataclass(frozen=True)
class Decision:
    """What follows from a reply: the fields of ``VisualTrace`` that it settles."""

    verdict: Verdict
    why: str
    answer: str | None = None
    object_id: int | None = None
    certainty: float = 0.0


def latest(answers: Sequence[VisualAnswer], sizes_px: Sequence[float]) -> dict[int, VisualAnswer]:
    """The latest verified observation of each candidate: frames count up, and "cannot tell" verifies nothing.

    ``sizes_px`` are the apparent sizes in the pictures; an answer about one below ``MIN_APPARENT_PX`` does not count.
    """
    told = [
        answer for answer, pixels in zip(answers, sizes_px, strict=True)
        if answer.answer is not None and pixels >= MIN_APPARENT_PX
    ]  # fmt: skip
    return {answer.object_id: answer for answer in sorted(told, key=lambda answer: answer.frame)}


def decide(
    question: VisualQuestion,
    candidates: Sequence[MapObject],
    answers: Sequence[VisualAnswer],
    sizes_px: Sequence[float],
    choose: bool,
) -> Decision:
    """What the answers (one a picture) say. ``choose``: which candidate fits is asked, not how they are."""
    told = {number: answer for number, answer in latest(answers, sizes_px).items() if _margin(answer) >= MIN_MARGIN}
    unsure = latest(answers, sizes_px)
    if not told:
        return _nothing_told(unsure)
    named = {obj.id: obj for obj in candidates}
    decision = _chosen(question, candidates, told) if choose else _agreed(told)
    about = named.get(decision.object_id) if decision.object_id is not None else None
    if decision.verdict == "told" and about is not None and len(about.views) < MIN_VIEWS:
        return Decision("refused", f"the {about.label} was seen only once, which is too little to say")
    return decision


def _nothing_told(unsure: dict[int, VisualAnswer]) -> Decision:
    if unsure:
        return Decision("refused", "the vision model is not certain enough")
    return Decision("cannot_tell", "no photograph shows it")


def _agreed(told: dict[int, VisualAnswer]) -> Decision:
    """One answer about all candidates, or that they differ."""
    answers = {answer.answer for answer in told.values()}
    if len(answers) > 1:
        return Decision("several", "the objects that are meant differ")
    best = max(told.values(), key=lambda answer: answer.certainty)
    return Decision("told", "the latest photograph that shows it", best.answer, best.object_id, best.certainty)


def _chosen(question: VisualQuestion, candidates: Sequence[MapObject], told: dict[int, VisualAnswer]) -> Decision:
    """The one candidate that fits, if it fits clearly better than the next."""
    fits = [answer for answer in told.values() if answer.answer == question.wanted]
    if len(fits) > 1:
        return Decision("several", f"{len(fits)} of them fit")
    if not fits:
        every = len(told) == len(candidates)
        return Decision("told" if every else "cannot_tell", f"none of the {len(told)} that could be seen fits")
    others = [obj.id for obj in candidates if obj.id != fits[0].object_id]
    next_best = max((_fit(told.get(number)) for number in others), default=0.0)
    if fits[0].certainty - next_best < MIN_MARGIN:
        return Decision("refused", "another one may fit as well")
    return Decision("told", "the only one that fits", fits[0].answer, fits[0].object_id, fits[0].certainty)


def _fit(answer: VisualAnswer | None) -> float:
    """How likely a candidate with another answer, or with none, is the wanted one."""
    return UNKNOWN if answer is None else 1 - answer.certainty


def _margin(answer: VisualAnswer) -> float:
    """How much likelier an answer is than all that contradicts it."""
    return answer.certainty - (1 - answer.certainty)
