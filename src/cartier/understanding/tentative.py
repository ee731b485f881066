"""Tentative objects: detected too seldom to be confirmed, or only at their usual place.

Who asks for an object by name mostly has one, so the request is evidence that it exists. With it, a tentative object
may be as likely as a confirmed one: then it is served, with how sure that is; else it is offered, and served after a
"yes".
"""

from __future__ import annotations

from dataclasses import replace

from cartier.spatial.describe import whereabouts
from cartier.spatial.query import Scene, called
from cartier.types import MapObject, Selection
from cartier.understanding.answers import one

OFFER = "Shall I look there?"
REQUEST_LIKELIHOOD_RATIO = (
    9.0  # of a request given that its object is there, to one for what is not (tools/request_evidence.py)
)
CONFIRMED_PROBABILITY = 0.7  # as in the configuration of the mapping


def tentative_matches(scene: Scene) -> list[MapObject]:
    """What may be there, and is not listed by its name; the likeliest first."""
    listed = {name for obj in scene.objects for name in (obj.label, *obj.names)}
    return [obj for obj in scene.maybe if not called(obj, listed)]


def probability_if_asked(obj: MapObject) -> float:
    """How likely an object exists once somebody asks for it."""
    odds = REQUEST_LIKELIHOOD_RATIO * obj.probability / max(1 - obj.probability, 1e-9)
    return odds / (1 + odds)


def offer(obj: MapObject, scene: Scene, model: str) -> Selection:
    """The object if it is likely enough now that it was asked for, or a question instead."""
    likely = probability_if_asked(obj)
    seen = f"seen in {obj.n_detected} of {obj.n_observable} frames that could show it"
    named = _named(obj, scene)
    if likely >= CONFIRMED_PROBABILITY:
        reason, say = f"it may be there: {seen}, {likely:.0%} sure", f"I think I saw {named}; I'll look there."
        shares = ((obj.label, round(likely, 3)),)
        return Selection("found", obj.label, reason=reason, object_id=obj.id, text=say, candidates=shares, model=model)
    question = f"I may have seen {named}, but too seldom to be sure. {OFFER}"
    return Selection("clarify", reason=seen, question=question, text=question, model=model, tentative=obj.id)


def unsure(answer: Selection, obj: MapObject, scene: Scene) -> Selection:
    """An answer that knows of no such object, with the one that may be there."""
    where = whereabouts(scene, obj)
    say = f"I may have seen {_named(obj, scene)}; I am not sure."
    if answer.fact is not None and answer.fact.kind != "where":
        say = f"{answer.text} I may have seen one{f' {where}' if where else ''}; I am not sure."
    return replace(answer, text=say, reason=say, tentative=obj.id)


def _named(obj: MapObject, scene: Scene) -> str:
    where = whereabouts(scene, obj)
    return f"{one(obj.label)}{f' {where}' if where else ''}"


def maybe_there(obj: MapObject, model: str) -> Selection:
    """What was offered, to who wants it."""
    reason, say = "it may be there: seen too seldom to be sure", f"I look for the {obj.label}."
    return Selection("found", obj.label, reason=reason, object_id=obj.id, text=say, model=model)


def usual_place(near: Selection) -> Selection:
    """A question instead of a drive to the usual place of an object that was never detected."""
    question = f"{near.reason[:1].upper()}{near.reason[1:]}. {OFFER}"
    return replace(near, status="clarify", object=None, object_id=None, question=question, text=question)
