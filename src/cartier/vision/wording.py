"""Wording of what photographs showed: the answer for the person and for programs."""

from __future__ import annotations

from dataclasses import replace

from cartier.contracts import VisionModel
from cartier.labels import object_ref
from cartier.spatial.describe import tell_apart, whereabouts
from cartier.spatial.query import Scene
from cartier.types import Fact, Inventory, MapObject, Selection, VisualTrace
from cartier.vision.attributes import Asked

LOOKS = {"clean": "looks", "colour": "looks", "look": "looks"}
"""The verb of each attribute, where it is not "is"."""


def selection_of(before: Selection, trace: VisualTrace, asked: Asked | None, inventory: Inventory) -> Selection:
    """The answer after a look; the list's own where nothing was found out that changes it."""
    if trace.verdict == "not_asked":
        return before
    if asked is None:
        return _doubt_settled(before, trace, inventory)
    named = {obj.id: obj for obj in inventory.objects}
    scene, model = Scene(inventory), trace.reply.model if trace.reply is not None else before.model
    candidates = [named[number] for number in trace.question.objects if number in named]
    goes = before.status in ("found", "likely_near") and asked.form == "which"
    if trace.verdict == "several":
        return _which(candidates, scene, trace, model)
    about = named.get(trace.object_id) if trace.object_id is not None else None
    if trace.verdict != "told":
        if goes or (before.fact is not None and before.fact.value is not None):
            return before  # what the list tells, its colour, stays
        text = f"I cannot tell by looking{_of(candidates, scene)}: {trace.why}."
        return Selection("answered", reason=trace.why, text=text, model=model)
    if about is None:
        text = f"I see none that {LOOKS.get(asked.attribute, 'is')} {asked.value}."
        if goes:
            return Selection("not_found", reason=text, model=model)
        return Selection("answered", reason=trace.why, text=text, fact=Fact("list", []), model=model)
    if goes:
        return replace(
            before, status="found", object=about.label, object_id=about.id, model=model,
            reason=f"a photograph shows that it is {asked.value}",
        )  # fmt: skip
    text, fact = _told(about, trace.answer or "", asked, scene), Fact("tell", trace.answer, (about.id,))
    return Selection(
        "answered", about.label, reason=trace.why, object_id=about.id, text=text, fact=fact, model=model,
        candidates=((about.label, round(trace.certainty, 3)),),
    )  # fmt: skip


def looked_notes(trace: VisualTrace, model: VisionModel) -> tuple[str, ...]:
    """Which photographs left and to whom, or which would; and where to look from."""
    photos = ", ".join(f"frame {each.frame} ({object_ref(each.label, each.object_id)})" for each in trace.pictures)
    notes = []
    if trace.reply is not None and not trace.reply.times_sent:
        notes.append(f"no photograph was sent to {trace.reply.model}")
    elif trace.reply is not None and trace.reply.endpoint:
        times = "once" if trace.reply.times_sent == 1 else f"{trace.reply.times_sent} times"
        notes.append(f"photographs were sent to {trace.reply.model} at {trace.reply.endpoint}, {times}: {photos}")
    elif trace.reply is not None:
        notes.append(f"{trace.reply.model} looked at photographs, which did not leave this machine: {photos}")
    elif trace.pictures:
        notes.append(f"nothing was sent: {trace.why}; a look would send {photos} to {model.endpoint or model.name}")
    if trace.verdict in ("cannot_tell", "refused") and trace.reply is not None:
        notes.append(f"the look did not help: {trace.why}")
    if trace.view_from is not None:
        pose = trace.view_from
        notes.append(f"it could be seen from x {pose.x:.2f} y {pose.y:.2f} m, yaw {pose.yaw:.2f} rad")
    return tuple(notes)


def _doubt_settled(before: Selection, trace: VisualTrace, inventory: Inventory) -> Selection:
    """The list's choice, confirmed or turned down by the photograph of the doubtful object."""
    if trace.verdict != "told":
        return before
    obj = next(obj for obj in inventory.objects if obj.id == trace.question.objects[0])
    model = trace.reply.model if trace.reply is not None else before.model
    if trace.answer == "no":
        reason = f"what was taken for the {obj.label} does not look like one"
        return Selection("not_found", reason=reason, model=model)
    if before.status == "found":
        return before
    reason = f"a photograph shows the {obj.label}"
    return Selection("found", obj.label, reason=reason, object_id=obj.id, model=model)


def _told(obj: MapObject, answer: str, asked: Asked, scene: Scene) -> str:
    where = whereabouts(scene, obj)
    named = f"the {obj.label}{f' {where}' if where else ''}"
    if asked.attribute == "text":
        return f"On {named} I read “{answer}”."
    verb = LOOKS.get(asked.attribute, "is")
    if asked.form == "which" or not asked.value:
        return f"{named[:1].upper()}{named[1:]} {verb} {answer}."
    return f"{'Yes' if answer == asked.value else 'No'}, {named} {verb} {answer}."


def _which(candidates: list[MapObject], scene: Scene, trace: VisualTrace, model: str) -> Selection:
    """A question that tells the candidates apart."""
    told = [words for words in tell_apart(scene, candidates[:4]) if words]
    question = f"Which {candidates[0].label} do you mean{': ' + ' or '.join(told) if len(told) > 1 else ''}?"
    return Selection("clarify", reason=trace.why, question=question, text=question, model=model)


def _of(candidates: list[MapObject], scene: Scene) -> str:
    if len(candidates) != 1:
        return ""
    where = whereabouts(scene, candidates[0])
    return f" at the {candidates[0].label}{f' {where}' if where else ''}"
