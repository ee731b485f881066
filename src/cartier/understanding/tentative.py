"""Tentative objects: detected too seldom, or only at their usual place. They are offered, and served after a "yes"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cartier.labels import plain, words
from cartier.spatial.describe import whereabouts
from cartier.spatial.query import Scene, called
from cartier.types import MapObject, Selection
from cartier.understanding.answers import one
from cartier.understanding.dialogue import FEW, NO, YES

MOST_REFUSING = 2  # words; "no, the sink" asks for something else
OFFER = "Shall I look there?"


def tentative_matches(scene: Scene) -> list[MapObject]:
    """What may be there, and is not listed by its name; the likeliest first."""
    listed = {name for obj in scene.objects for name in (obj.label, *obj.names)}
    return [obj for obj in scene.maybe if not called(obj, listed)]


def offer(obj: MapObject, scene: Scene, model: str) -> Selection:
    """A question instead of a goal."""
    where = whereabouts(scene, obj)
    question = f"I may have seen {one(obj.label)}{f' {where}' if where else ''}, but too seldom to be sure. {OFFER}"
    reason = f"seen in {obj.n_detected} of {obj.n_observable} frames that could show it"
    return Selection("clarify", reason=reason, question=question, text=question, model=model)


def maybe_there(obj: MapObject, model: str) -> Selection:
    """What was offered, to who wants it."""
    reason, say = "it may be there: seen too seldom to be sure", f"I look for the {obj.label}."
    return Selection("found", obj.label, reason=reason, object_id=obj.id, text=say, model=model)


def usual_place(near: Selection) -> Selection:
    """A question instead of a drive to the usual place of an object that was never detected."""
    question = f"{near.reason[:1].upper()}{near.reason[1:]}. {OFFER}"
    return replace(near, status="clarify", object=None, object_id=None, question=question, text=question)


def accepted(query: str, dialogue: Sequence[tuple[str, str]]) -> bool | None:
    """Whether the person accepts the offer of the turn before; None without an offer or a reply to it."""
    said = words(plain(query))
    if not dialogue or not dialogue[-1][1].endswith(OFFER) or not 0 < len(said) <= FEW:
        return None
    if NO.search(" ".join(said)):
        return None if len(said) > MOST_REFUSING else False
    return True if said[0] in YES else None
