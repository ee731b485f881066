"""Operations on homes for MCP, HTTP and Python: flat typed arguments in, plain JSON values out.

Every result names the home, its id and its age; a result about an object also has its certainty, its evidence and
whether it can be reached. A fault is an InputError whose line names the operation to call next.
"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import Any

import numpy as np

from cartier import specs
from cartier.contracts import Reasoner
from cartier.conversation import CORRECTION, robot_turn
from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.home.correction_log import CorrectionKind
from cartier.home.corrections import find
from cartier.home.dates import age_h
from cartier.home.photos import photo_of
from cartier.home.spoken import correct_by_words, keep_rules
from cartier.live.answers import as_of
from cartier.llm.prompts import check_query, recent
from cartier.navigation.planning import plan
from cartier.pipeline import ask, plan_for, serve
from cartier.serving.alarms import Alarms
from cartier.serving.driver import Driver
from cartier.serving.homes import Homes
from cartier.serving.lookup import confirmed_of, named, placed, start_of
from cartier.serving.values import (
    answer_values,
    called,
    certainty,
    crop,
    evidence,
    not_kept,
    place_of,
    pose,
    room_name,
    room_row,
    rule_row,
    xyz,
)
from cartier.serving.verification import Verification
from cartier.spatial import relations
from cartier.types import Goal, MapObject, RobotModel, Room
from cartier.understanding import alarm
from cartier.vision.permission import Look

PAGE = 5  # objects on a page of a list: few enough for a small model
FOUND = 5  # objects that find shows
MAX_CONVERSATIONS, MAX_CONVERSATION_CHARS = 1000, 64
NO_PLAN = "there is no goal: without depth the home has no floor plan to plan on"


class Operations:
    """The operations on some homes, for one kind of robot. Thread-safe."""

    def __init__(
        self,
        homes: Homes,
        reasoner: Reasoner,
        robot: RobotModel | None = None,
        emergency_number: str | None = None,
        on_alarm: Callable[[dict[str, Any]], str] | None = None,
        look: Look | None = None,
    ) -> None:
        """``look``: the owner's choice of who may look at photographs; no client can change it."""
        self.homes, self.reasoner, self.robot = homes, reasoner, robot or RobotModel()
        alarm.emergency_number(emergency_number)  # a mistake is told now, not in an emergency
        self.emergency_number = emergency_number
        self._alarms, self._look = Alarms(on_alarm) if on_alarm is not None else None, look
        self._turns: OrderedDict[tuple[str, str, str], list[tuple[str, str]]] = OrderedDict()
        self._lock = threading.Lock()
        self.verification, self.driver = Verification(look), Driver()

    def ask(
        self,
        words: str,
        home: str = "",
        conversation: str = "",
        from_x: float | None = None,
        from_y: float | None = None,
        corrects: bool = False,
    ) -> dict[str, Any]:
        """Answer a person's words, with the earlier turns of ``conversation`` (any short text) as context.

        With ``corrects``, words that correct the home do so: "yes, it is there", "that is a pencil box".
        """
        moment, words, mapped = self.homes.moment(), check_query(words), self.homes.get(home)  # the moment first
        key = (self.homes.name(home), conversation.strip()[:MAX_CONVERSATION_CHARS], self.homes.asker)
        with self._lock:
            turns = list(self._turns.get(key, ()))
        start = start_of(self.homes.start_xy(mapped), from_x, from_y)
        corrected = correct_by_words(mapped, words, turns, from_xy=start, reasoner=self.reasoner) if corrects else None
        mapped, chosen = corrected or (mapped, None)
        if chosen is not None:
            answer = serve(mapped, words, chosen, CORRECTION, from_xy=start, robot=self.robot)
        else:
            waiting = turns.pop()[0] if corrected is not None else words  # "which room is Ben's?" is answered
            answer = ask(
                mapped, waiting, self.reasoner, from_xy=start, robot=self.robot, dialogue=turns,
                emergency_number=self.emergency_number, look=self._look,
            )  # fmt: skip
            mapped, answer = keep_rules(mapped, answer) if corrects else (mapped, not_kept(answer))
        answer = answer if moment is None else as_of(answer, moment)
        if answer.selection.status == "alarm" and self._alarms is not None:
            told = {"conversation": key[1]} | answer.to_dict()
            self._alarms.ring(key, told)  # the person does not wait for it
        if key[1]:
            with self._lock:
                self._turns[key] = recent([*turns, (words, robot_turn(answer))])
                self._turns.move_to_end(key)
                if len(self._turns) > MAX_CONVERSATIONS:
                    self._turns.popitem(last=False)
        known = {"corrected": True} if corrected is not None else {}
        return self.about(home, mapped) | answer_values(mapped, answer) | known

    def find(self, name: str, home: str = "") -> dict[str, Any]:
        """Objects and rooms by name, the most probable first; similar spellings if none has the name.

        ``maybe`` counts further objects that are tentative, or have the name in some frames only. If there are none
        but such, they are shown, and ``matched`` says by which label.
        """
        mapped, wanted = self.homes.get(home), " ".join(name.casefold().split())
        if not wanted:
            raise InputError("find needs a name: call list_objects to see all")
        found = named(mapped.objects, wanted)
        rows = [
            self._row(mapped, t) | ({"matched": found.weak[t.id]} if t.id in found.weak else {})
            for t in found.sure[:FOUND]
        ]
        rooms = [{"room": f"room:{r.id}", "name": r.name} for r in mapped.rooms if wanted in r.name.casefold()]
        result: dict[str, Any] = {"total": len(found.sure), "objects": rows, "rooms": rooms}
        result |= {"maybe": found.maybe} if found.maybe else {}
        result |= {"spelt": found.spelt} if found.spelt else {}
        if not found.sure and not rooms:
            no_hit = f"nothing is called {brief(name, 40)!r}"
            result["next"] = f"{no_hit}: ask understands needs in any words, list_objects shows all"
        return self.about(home, mapped) | result

    def describe(self, entity: str, home: str = "") -> dict[str, Any]:
        """All that is known about one object or room."""
        mapped, one = self._one(entity, home)
        about = self.about(home, mapped) | self._row(mapped, one)
        goal = self._goal(mapped, one, self.homes.start_xy(mapped))
        if isinstance(one, Room):
            labels = {obj.label for obj in mapped.objects if obj.room == one.id and obj.confirmed}
            return about | {"holds": sorted(labels)[:30]} | goal
        held = relations.supports(mapped.objects)
        on, beside = held.get(one.id), relations.next_to(one, confirmed_of(mapped))
        return about | {
            "size_m": [round(high - low, 2) for low, high in zip(one.box_min, one.box_max, strict=True)],
            "colours": [name for name, _ in one.colours[:3]],
            "also_called": [name for name, _ in one.labels if name != one.label][:3],
            "stands": None if on is None else f"{on.kind} {called(mapped, on.object)}",
            "holds": [called(mapped, k) for k, r in held.items() if r.object == one.id][:6],
            "next_to": [called(mapped, r.subject) for r in beside if r.probability >= 0.5][:4],
            "last_seen_s": round(one.last_seen_s, 1), "last_looked_s": round(one.last_looked_s, 1), **goal,
        }  # fmt: skip

    def list_objects(self, room: str = "", page: int = 1, tentative: bool = False, home: str = "") -> dict[str, Any]:
        """The objects of a home or of one room, one page at a time; with ``tentative`` those, too, after the others.

        Without it, ``maybe`` counts them.
        """
        mapped = self.homes.get(home)
        listed = list(mapped.objects)
        if room:
            one = find(room, (), mapped.rooms)
            listed = [t for t in listed if t.room == one.id]
        rows = [t for t in listed if t.confirmed or tentative]
        rows.sort(key=lambda t: (not t.confirmed, t.label, t.id))
        pages = max(1, math.ceil(len(rows) / PAGE))
        if not 1 <= page <= pages:
            raise InputError(f"there is no page {page}: call list_objects with page 1 to {pages}")
        shown = [self._row(mapped, t) for t in rows[(page - 1) * PAGE : page * PAGE]]
        maybe = {"maybe": len(listed) - len(rows)} if len(listed) > len(rows) else {}
        counts = {"total": len(rows), "page": page, "pages": pages}
        return self.about(home, mapped) | counts | maybe | {"objects": shown}

    def list_rooms(self, home: str = "") -> dict[str, Any]:
        """The rooms of a home."""
        mapped = self.homes.get(home)
        return self.about(home, mapped) | {"rooms": [room_row(mapped, r) for r in mapped.rooms]}

    def list_rules(self, home: str = "") -> dict[str, Any]:
        """The route rules of a home: what people said of how to drive, and did not take back."""
        mapped, now = self.homes.get(home), datetime.now().astimezone()
        return self.about(home, mapped) | {"rules": [rule_row(rule, now) for rule in mapped.rules]}

    def relate(self, entity: str, other: str, home: str = "") -> dict[str, Any]:
        """The spatial relations of two objects, seen from the goal pose of the second."""
        mapped = self.homes.get(home)
        a, b = (_an_object(find(each, mapped.objects, mapped.rooms)) for each in (entity, other))
        if a.id == b.id:
            raise InputError(f"{brief(entity, 40)} and {brief(other, 40)} are one object {a.id}: relate needs two")
        goal, _ = self._planned(mapped, b, self.homes.start_xy(mapped))
        seen_from = (goal.x, goal.y) if goal is not None else self.homes.start_xy(mapped)
        rows, side = placed(a, b, confirmed_of(mapped, a, b), seen_from)
        kinds = [f"{r.kind} than" if r.kind == "bigger" else r.kind for r in rows]
        lines = [
            f"{called(mapped, r.subject)} is {kind} {called(mapped, r.object)}"
            for r, kind in zip(rows, kinds, strict=True)
        ]
        gap = np.maximum(0, np.maximum(np.subtract(a.box_min, b.box_max), np.subtract(b.box_min, a.box_max)))
        return self.about(home, mapped) | {
            "relations": lines, "certainty": [round(r.probability, 2) for r in rows], "side": side,
            "apart_m": round(float(np.linalg.norm(gap)), 2), "same_room": a.room == b.room,
            "seen_from": [round(v, 2) for v in seen_from], "evidence": [evidence(a), evidence(b)],
        }  # fmt: skip

    def goal_for(
        self, entity: str, home: str = "", from_x: float | None = None, from_y: float | None = None
    ) -> dict[str, Any]:
        """A goal pose that faces an object or lies in a room, reachable from the start."""
        about = self.about(home, self.homes.get(home))  # first, so that the goal is of no older epoch than it says
        mapped, one = self._one(entity, home)
        start = start_of(self.homes.start_xy(mapped), from_x, from_y)
        return about | self._row(mapped, one) | self._goal(mapped, one, start)

    def goal(self, entity: str, home: str = "", from_x: float | None = None, from_y: float | None = None) -> Goal:
        """The pose of ``goal_for``. Raises InputError if there is none."""
        mapped, one = self._one(entity, home)
        goal, why_not = self._obeying(mapped, one, start_of(self.homes.start_xy(mapped), from_x, from_y))
        if goal is None:
            raise InputError(why_not)
        return goal

    def go(self, entity: str, robot: str, home: str = "", frame_epoch: int | None = None) -> dict[str, Any]:
        """Send a robot (as for ``--go``) to the pose of ``goal_for``, with a person's consent; not for an old epoch."""
        self.homes.check_epoch(frame_epoch)
        goal = self.goal(entity, home)
        said = self.driver.go(specs.robot(robot, self.homes.get(home), self.robot), goal)
        return self.goal_for(entity, home) | {"sent": said}

    def stop(self, home: str = "") -> dict[str, Any]:
        """Stop the robot that ``go`` sent, and wait until it says so; "unknown" means that it may still be driving."""
        told = self.driver.stop()
        return self.about(home, self.homes.get(home)) | {"robot": told.status, "says": told.text}

    def look_at(self, entity: str, view: int = 1, home: str = "") -> tuple[dict[str, Any], bytes]:
        """The evidence of an object: one of its best views, and a JPEG of the photo around its box.

        View 0 is the floor plan with the object or room and the path to it.
        """
        mapped, found = self._one(entity, home)
        if view == 0:
            return self._floor_plan(found, home, mapped)
        one = _an_object(found)
        views = [v for v in one.views if v.frame in mapped.photos]
        if not views:
            raise InputError(f"the home keeps no photo of object {one.id}: call describe for all that is known")
        if not 1 <= view <= len(views):
            raise InputError(f"object {one.id} has the views 1 to {len(views)}, not {view}")
        seen = views[view - 1]
        photo = photo_of(mapped, seen.frame)
        assert photo is not None  # it is among the photos
        jpeg, box = crop(photo, seen.box_xyxy)
        result = {"frame": seen.frame, "box_in_picture": box, "score": round(seen.score, 2), "views": len(views)}
        return self.about(home, mapped) | self._row(mapped, one) | result, jpeg

    def _floor_plan(self, one: MapObject | Room, home: str, mapped: Home) -> tuple[dict[str, Any], bytes]:
        from cartier.render.floor_plan import plan_jpeg  # loads matplotlib

        if mapped.grid is None:
            raise InputError("the home has no floor plan: it was mapped without depth; view 1 is the photo")
        goal, _ = self._obeying(mapped, one, self.homes.start_xy(mapped))
        row = self._row(mapped, one) | {"picture": "floor plan, x to the right, y up"}
        return self.about(home, mapped) | row, plan_jpeg(mapped, place_of(one, mapped), goal, self.robot)

    def correct(
        self,
        what: CorrectionKind,
        entity: str = "",
        name: str = "",
        x: float | None = None,
        y: float | None = None,
        home: str = "",
        who: str = "somebody",
        other: str = "",
    ) -> dict[str, Any]:
        """Correct a home as ``Home.correct`` does; ``entity`` is "home" for the home itself."""
        mapped, to_xy = self.homes.get(home), () if x is None or y is None else (x, y)
        if what == "move" and not to_xy:
            raise InputError("move needs x and y, in metres of the map: describe says where the object is now")
        _, result = mapped.correct(what, entity, name=name, to_xy=to_xy, other=other, who=who)
        return self.about(home, self.homes.get(home)) | {"done": result, "next": "undo takes it back"}

    def undo(self, home: str = "", who: str = "somebody") -> dict[str, Any]:
        """Undo the latest correction."""
        result = self.correct("undo", home=home, who=who)
        return {key: value for key, value in result.items() if key != "next"}

    def verify(self, home: str = "") -> dict[str, Any]:
        """Ask the owner's vision model once about doubtful objects; what it says is evidence in the log of the home."""
        told = self.verification.of(self.homes, home)
        return self.about(home, self.homes.get(home)) | told

    def about(self, home: str, mapped: Home) -> dict[str, Any]:
        """The name and id of a home, and the hours since it was recorded (None where its recordings have no date)."""
        moment = self.homes.moment()  # a bag that is played has a clock of its own
        age = age_h(mapped.objects, time.time()) if moment is None else round(moment.age_s / 3600, 3)
        about = {"home": self.homes.name(home), "home_id": mapped.id, "age_h": age}
        moment = self.homes.moment()
        return about if moment is None else about | {"as_of": asdict(moment)}

    def _one(self, entity: str, home: str) -> tuple[Home, MapObject | Room]:
        """A home, and the object or room in it that is meant."""
        mapped = self.homes.get(home)
        return mapped, find(entity, mapped.objects, mapped.rooms)

    def _planned(self, mapped: Home, one: MapObject | Room, start: Sequence[float]) -> tuple[Goal | None, str]:
        """The goal pose at an object or in a room, or why there is none."""
        return (None, NO_PLAN) if mapped.grid is None else plan(mapped.grid, place_of(one, mapped), start, self.robot)

    def _obeying(self, mapped: Home, one: MapObject | Room, start: Sequence[float]) -> tuple[Goal | None, str]:
        """The goal pose under the route rules of the home, or why there is none."""
        if mapped.grid is None:
            return None, NO_PLAN
        now = datetime.now().astimezone()
        rules = [rule for rule in mapped.rules if rule.holds(now)]
        planned = plan_for(mapped, place_of(one, mapped), start, self.robot, rules)
        mend = ": ask, and a person may agree" if planned.breach is not None else ""
        return planned.goal, f"{planned.why_not}{mend}" if planned.goal is None else ""

    def _goal(self, mapped: Home, one: MapObject | Room, start: Sequence[float]) -> dict[str, Any]:
        goal, why_not = self._obeying(mapped, one, start)
        return {"goal": None, "why_no_goal": why_not} if goal is None else {"goal": pose(goal)}

    def _row(self, mapped: Home, one: MapObject | Room) -> dict[str, Any]:
        if isinstance(one, Room):
            return room_row(mapped, one)
        named = {"name": one.names[0]} if one.names else {}
        return {
            "id": one.id, "label": one.label, **named, "room": room_name(mapped, one), **xyz(one.position),
            **certainty(one), "reachable": self._planned(mapped, one, self.homes.start_xy(mapped))[0] is not None,
        } | ({} if one.confirmed else {"confirmed": False})  # fmt: skip


def _an_object(obj: MapObject | Room) -> MapObject:
    if isinstance(obj, Room):
        hint = f"pass an object; list_objects with room={obj.name!r} shows what is in it"
        raise InputError(f"{obj.name} is a room: {hint}")
    return obj
