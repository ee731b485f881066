"""Verification of a map by its photographs: doubtful objects are asked about once, and how far to believe the answers.

An answer is evidence, weighed by how often the same model is right about objects of the same home that are beyond
doubt: asked about by their own names, where "yes" is right, and by the names of others, where "no" is.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from cartier.types import MapObject, VisualQuestion, VisualTrace
from cartier.vision.candidates import clear_label
from cartier.vision.decision import MIN_VIEWS
from cartier.vision.look import Photographs, Surroundings, ask_about, question_about
from cartier.vision.permission import Look
from cartier.vision.prompt import bare_words
from cartier.vision.views import MIN_APPARENT_PX, apparent_px, stored_views

LEAST_LIKELY = 0.1
"""The probability from which a tentative object is asked about: below, no answer would make it likely."""
BEYOND_DOUBT = 0.9
"""The probability from which a confirmed object with a clear label needs no check."""
SURE_LABEL = 0.9
"""The share of the evidence for its label from which an object may serve to calibrate."""
CONTESTED = 0.5
"""Of the evidence for its label, what another label must have for it to be unclear which of both the object is."""
MOST_NAMES = 3
"""Among which is chosen."""
NEITHER = "none of these"
CALIBRATED_ON = 6
"""Objects beyond doubt; each is asked about twice, by its own name and by another."""
Said = Literal["yes", "no", "cannot tell"]


@dataclass(frozen=True)
class Calibration:
    """What a vision model said of objects beyond doubt, by their own names (``named``) and by others (``misnamed``)."""

    named: Counter[str] = field(default_factory=Counter)
    misnamed: Counter[str] = field(default_factory=Counter)

    def factor(self, said: Said) -> float:
        """By how much an answer multiplies the odds that an object exists; 1 where nothing is known of the model.

        The likelihood ratio of the answer, with one answer of each kind added to what was counted (Laplace).
        """
        if said == "cannot tell":
            return 1.0
        return round(_share(self.named, said) / _share(self.misnamed, said), 4)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {"named": dict(self.named), "misnamed": dict(self.misnamed),
                "yes": self.factor("yes"), "no": self.factor("no")}  # fmt: skip


@dataclass(frozen=True)
class Checked:
    """What was said of a doubtful object.

    Args:
        obj: The object.
        said: Whether it is what the map calls it; of a contested one, whether it is one of its labels.
        factor: The factor by which that changes the odds of its existence.
        trace: What was asked.
        label: Of a contested one, the label that was chosen, whose evidence changes by the same factor; else empty.
    """

    obj: MapObject
    said: Said
    factor: float
    trace: VisualTrace
    label: str = ""

    def to_dict(self, after: float) -> dict[str, Any]:
        """Plain JSON values; ``after`` is how likely the object is now."""
        return {
            "id": self.obj.id, "label": self.obj.label, "said": self.said, "factor": self.factor, "chosen": self.label,
            "before": self.obj.probability, "after": after, "why": self.trace.why,
            "asked": self.trace.reply is not None, "frames": [picture.frame for picture in self.trace.pictures],
        }  # fmt: skip


def doubts(objects: Iterable[MapObject], out: Collection[int] = ()) -> list[MapObject]:
    """The objects that a look may decide about, the likeliest first: tentative, just confirmed, or of unclear label.

    Args:
        objects: Those of a map.
        out: The ids of those that were asked about already.
    """
    found = [obj for obj in objects if obj.id not in out and not obj.by_person and _in_doubt(obj)]
    return sorted(found, key=lambda obj: (-obj.probability, obj.id))


def check(
    allowed: Look,
    objects: Sequence[MapObject],
    doubtful: Sequence[MapObject],
    photographs: Photographs,
    around: Surroundings,
    step: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Calibration, list[Checked]]:
    """Ask about doubtful objects, one question each, and before that about some beyond doubt.

    ``step`` is told how many questions were asked, of how many. Raises ReasonerError if the model cannot be reached.
    """
    known = _beyond_doubt(objects, photographs)
    others = {obj.id: _other_label(obj, known) for obj in known}
    total, done = len(doubtful) + len(known) + sum(map(bool, others.values())), 0

    def said(obj: MapObject) -> tuple[Said, VisualTrace]:
        nonlocal done
        question = _question(obj)
        trace = ask_about(allowed, question, [obj], photographs, around, strict=True)
        done += 1
        step(done, total)
        return _said(trace), trace

    named = Counter[str](said(obj)[0] for obj in known)
    misnamed = Counter[str](said(replace(obj, label=others[obj.id]))[0] for obj in known if others[obj.id])
    calibration = Calibration(named, misnamed)
    checked = []
    for obj in doubtful:
        answer, trace = said(obj)
        factor = 1.0 if answer == "yes" and _beside_its_like(obj, objects) else calibration.factor(answer)
        chosen = trace.answer if trace.verdict == "told" and trace.answer in contested(obj) else None
        checked.append(Checked(obj, answer, factor, trace, chosen or ""))
    return calibration, checked


def contested(obj: MapObject) -> tuple[str, ...]:
    """The labels between which it is unclear what an object is, the likeliest first; none if its label is clear."""
    best = max((weight for label, weight in obj.labels if label == obj.label), default=0.0)
    rivals = [label for label, weight in obj.labels if label != obj.label and weight >= CONTESTED * best > 0]
    return (obj.label, *rivals)[:MOST_NAMES] if rivals and not obj.by_person else ()


def _question(obj: MapObject) -> VisualQuestion:
    """Whether an object is what the map calls it; of a contested one, which of its labels it is."""
    names = tuple(dict.fromkeys(bare_words(label, 60) or "object" for label in contested(obj)))
    if len(names) < 2 or names != contested(obj):  # a label with marks in it is asked about alone
        return question_about(obj.label, "exists", "yes", reason="doubt", objects=(obj.id,))
    words = f"What is this: {', '.join(names[:-1])} or {names[-1]}, or {NEITHER}?"
    return VisualQuestion(words, "exists", (*names, NEITHER), reason="doubt", objects=(obj.id,))


def _beside_its_like(obj: MapObject, objects: Iterable[MapObject]) -> bool:
    """Whether a likelier object of the same label stands so near that a photograph may show that one: listed twice."""
    size_m = max(high - low for low, high in zip(obj.box_min, obj.box_max, strict=True))
    return any(
        each.label == obj.label and each.id != obj.id and each.confirmed and each.probability >= obj.probability
        and math.dist(each.position, obj.position) < size_m
        for each in objects
    )  # fmt: skip


def _share(counted: Counter[str], said: Said) -> float:
    return (counted[said] + 1) / (counted.total() + 3)


def _said(trace: VisualTrace) -> Said:
    if trace.verdict != "told" or trace.answer is None:
        return "cannot tell"
    return "no" if trace.answer in ("no", NEITHER) else "yes"


def _in_doubt(obj: MapObject) -> bool:
    if not obj.confirmed:
        return obj.probability >= LEAST_LIKELY
    return obj.probability < BEYOND_DOUBT or not clear_label(obj) or bool(contested(obj))


def _beyond_doubt(objects: Sequence[MapObject], photographs: Photographs) -> list[MapObject]:
    """The likeliest objects that are large enough in a photograph, each of another label."""
    sure = [
        obj for obj in objects
        if obj.confirmed and obj.probability >= BEYOND_DOUBT and clear_label(obj, SURE_LABEL)
        and len(obj.views) >= MIN_VIEWS
    ]  # fmt: skip
    sizes, found = photographs.sizes(sure), dict[str, MapObject]()
    for obj in sorted(sure, key=lambda obj: (-obj.probability, obj.id)):
        pixels = [apparent_px(view, sizes[view.frame]) for view in stored_views(obj, sizes)]
        if max(pixels, default=0.0) >= MIN_APPARENT_PX:
            found.setdefault(obj.label, obj)
    return list(found.values())[:CALIBRATED_ON]


def _other_label(obj: MapObject, known: Sequence[MapObject]) -> str:
    """The label of another object that no detection gave to this one; empty if there is none."""
    own, at = {label for label, _ in obj.labels}, [each.id for each in known].index(obj.id)
    return next((each.label for each in (*known[at + 1 :], *known[:at]) if each.label not in own), "")
