"""Values of objects, rooms, goals and answers, as the operations give them: plain JSON, rounded.

An object has one place wherever it is told: the middle of its box, not the surface that an index aims at.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import brief
from cartier.home import Home
from cartier.llm.lookup import names_of
from cartier.types import Answer, Array, Goal, MapObject, Place, Room, Selection
from cartier.types.route_rules import RouteRule

CANDIDATES, MEANT = 3, 12
CROP_PX, MARGIN = 512, 0.35  # of a cropped photo: its longer side, and the margin in box sizes


def answer_values(home: Home, answer: Answer) -> dict[str, Any]:
    chosen, place, goal = answer.selection, answer.place, answer.goal
    number = chosen.object_id if place is None else place.object_id
    one = None if number is None else next((t for t in home.objects if t.id == number), None)
    result: dict[str, Any] = {"status": chosen.status, "object": chosen.object}
    result |= {"id": one.id} if one is not None else {}
    result |= {"alarm": chosen.alarm} if chosen.alarm else {}
    words = {getattr(chosen, key): key for key in ("reason", "text", "question")}  # the same text once
    result |= {key: text for text, key in reversed(words.items()) if text}
    if ids := meant(home, chosen):
        result["ids"] = ids
    if chosen.tentative is not None:
        result["tentative"] = chosen.tentative
    result |= {"rules": [rule.text for rule in chosen.rules]} if chosen.rules else {}
    result |= {"lifts": [rule.text for rule in chosen.lifts]} if chosen.lifts else {}
    if candidates := [[name, round(score, 2)] for name, score in chosen.candidates[:CANDIDATES] if score >= 0.01]:
        result["candidates"] = candidates
    if one is not None:
        result |= {"name": one.names[0]} if one.names else {}
        result |= {"room": room_name(home, one), **certainty(one), **xyz(one.position)}
    elif place is not None:
        result |= xyz(place.middle)
    result["goal"] = None if goal is None else pose(goal)
    notes = [note for note in answer.notes if "embedded reasoner answers" not in note]
    result |= {"notes": notes} if notes else {}
    result |= {"as_of": asdict(answer.as_of)} if answer.as_of is not None else {}
    return result | ({"next": [answer_values(home, further) for further in answer.next]} if answer.next else {})


def meant(home: Home, chosen: Selection) -> list[int]:
    """The objects that an answer is about, or that a question names, for a person to point at one."""
    if chosen.tentative is not None:
        return []  # the confirmed ones in its words only say where it is
    if chosen.status != "clarify":
        return list(chosen.fact.objects[:MEANT]) if chosen.fact else []
    named = {name for name, _ in names_of(tuple(home.names)).mentions(chosen.question or "")}
    return [t.id for t in home.objects if t.confirmed and named & {t.label, *t.names}][:MEANT]


def pose(goal: Goal) -> dict[str, Any]:
    """A goal pose with the corners of its path, and how it follows route rules, where any hold."""
    route = goal.route
    told = {} if route is None else {"route": {
        "rules": [rule.text for rule in route.rules], "breaks": [rule.text for rule in route.breaks],
        "shortest_m": round(route.shortest_m, 2), "directions": list(route.directions),
        "alternatives": [each.words for each in route.alternatives], "shortest_path": _corners(route.shortest),
    }}  # fmt: skip
    return {
        "x": round(goal.x, 3), "y": round(goal.y, 3), "yaw": round(goal.yaw, 3), "length_m": round(goal.length_m, 2),
        "sees_it": goal.line_of_sight, "path": _corners(goal.path),
    } | told  # fmt: skip


def rule_row(rule: RouteRule, now: datetime) -> dict[str, Any]:
    """A route rule of a home; it may not hold at this hour, or have expired."""
    holds = "now" if rule.holds(now) else "expired" if rule.expired(now) else "later"
    return {"id": rule.id, "rule": rule.text, "words": rule.in_words(), "said": rule.said, "made": rule.made,
            "holds": holds}  # fmt: skip


def _corners(path: Array) -> list[list[float]]:
    """A path (K, 2) without the points on its straight parts."""
    if len(path) > 2:
        steps = np.diff(path, axis=0)
        turns = np.abs(steps[1:] - steps[:-1]).max(1) > 1e-6
        path = path[np.concatenate([[True], turns, [True]])]
    return [[round(float(x), 3), round(float(y), 3)] for x, y in path]


def place_of(one: MapObject | Room, home: Home) -> Place:
    """The place of an object or a room, to plan a goal for: the one that ``ask`` drives to, else an object's box."""
    room = one.id if isinstance(one, Room) else None
    name = one.name if isinstance(one, Room) else one.label
    place = home.locate(Selection("found", name, object_id=one.id if room is None else None, room=room))
    if place is not None and (room is not None or place.object_id == one.id):
        return place
    assert isinstance(one, MapObject)  # a home without a floor plan has no rooms
    view = one.views[0] if one.views else None
    place = Place(
        one.label, one.position, one.probability, view.frame if view else -1, view.box_xyxy if view else None,
        one.box_min, one.box_max, object_id=one.id,
    )  # fmt: skip
    return home.in_its_room(place)


def room_row(home: Home, room: Room) -> dict[str, Any]:
    assert home.grid is not None
    count = sum(t.room == room.id and t.confirmed for t in home.objects)
    area = round(len(room.cells) * home.grid.resolution_m**2, 1)
    return {"room": f"room:{room.id}", "name": room.name, "kind": room.kind, "area_m2": area, "objects": count}


def evidence(obj: MapObject) -> str:
    frame = f", frame {obj.views[0].frame}" if obj.views else ""
    said = "a person said so; " if obj.by_person else ""
    return f"{said}seen {obj.n_detected} of {obj.n_observable}{frame}"


def called(home: Home, number: int | None) -> str:
    obj = next(t for t in home.objects if t.id == number)
    return f"{obj.names[0] if obj.names else obj.label} {obj.id}"


def room_name(home: Home, obj: MapObject) -> str | None:
    return next((room.name for room in home.rooms if room.id == obj.room), None)


def certainty(obj: MapObject) -> dict[str, Any]:
    return {"certainty": round(obj.probability, 2), "evidence": evidence(obj)}


def xyz(position: Sequence[float]) -> dict[str, float]:
    return {axis: round(v, 2) for axis, v in zip("xyz", position, strict=True)}


def crop(
    photo: npt.NDArray[np.uint8], box_xyxy: Sequence[float], side_px: int = CROP_PX, quality: int = 85
) -> tuple[bytes, list[int]]:
    """The part of a photo (H, W, 3) around a box, as JPEG, and the box in its pixels; never less than one pixel."""
    from PIL import Image

    (x1, y1, x2, y2), (height, width) = box_xyxy, photo.shape[:2]
    margin = MARGIN * max(x2 - x1, y2 - y1, 40.0)
    left, top = (min(max(0, math.floor(v - margin)), side - 1) for v, side in ((x1, width), (y1, height)))
    right = max(left + 1, min(width, math.ceil(x2 + margin)))
    bottom = max(top + 1, min(height, math.ceil(y2 + margin)))
    part = Image.fromarray(photo[top:bottom, left:right])
    scale = min(1.0, side_px / max(part.size))
    if scale < 1:
        part = part.resize((max(1, round(part.width * scale)), max(1, round(part.height * scale))))
    buffer = io.BytesIO()
    part.save(buffer, "JPEG", quality=quality)
    return buffer.getvalue(), [round((v - o) * scale) for v, o in zip(box_xyxy, (left, top, left, top), strict=True)]


def wrong_value(fault: Mapping[str, Any], skip: int = 0) -> str:
    """One line for a fault that pydantic found; ``skip`` leaves out as many of the first parts of its place."""
    where = ".".join(str(part) for part in fault["loc"][skip:])
    return f"{where or 'the request'}: {brief(fault['msg'], 200)}"


def not_kept(answer: Answer) -> Answer:
    """The answer with a note for each route rule that would have to be kept for later drives."""
    rules = [rule.text for part in (answer, *answer.next) for rule in part.selection.rules if rule.stays]
    lifts = [rule.text for part in (answer, *answer.next) for rule in part.selection.lifts]
    notes = [f"not kept for later drives: call correct with what=rule and entity={text!r}" for text in rules]
    notes += [f"the rule still holds: call correct with what=lift and entity={text!r}" for text in lifts]
    return replace(answer, notes=(*answer.notes, *notes))
