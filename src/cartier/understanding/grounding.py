"""Grounding: referring expressions and questions, resolved to the objects of a home in the context of the dialogue."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from cartier.labels import name_key, words
from cartier.spatial.describe import tell_apart, whereabouts
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression
from cartier.spatial.query import Scene, called
from cartier.types import MapObject, Selection
from cartier.understanding.answers import answer, one
from cartier.understanding.follow_ups import LATEST, SERVED, in_context
from cartier.understanding.reference_words import HURRY, NEEDY, STANDS_FOR
from cartier.understanding.references import parse, sentences
from cartier.understanding.tentative import maybe_there, offer
from cartier.understanding.text import STOP

STORY = 30  # words from which an utterance is a story, whose names in passing are not requests
SURE = 0.85  # least probability of an object that is preferred where any of several will do
MOST_ASKED = 4  # objects that a question offers for choice
DRIVES = re.compile(
    r"\b(?:go|drive|head|navigate|move|take|bring|lead|guide|roll|come|wait|meet|visit|walk|show|get|check|return|run"
    r"|to)\b"
)
OTHER = re.compile(r"\b(?:other|others|another|else|different)\b")
SAID: Mapping[str, str] = {
    "stop": "All right.", "come": "I do not know where you are: name a room or a thing beside you.",
    "back": "I do not know where back is: name a room or a thing.",
    "follow": "I cannot follow anybody: name a room or a thing.",
    "able": "I know where things are in this home: ask me where something is, or tell me what you need.",
    "thanks": "You are welcome.", "bye": "Goodbye.",
}  # fmt: skip
Serve = Callable[[str, tuple[str, ...]], Selection]


class ReferenceGrounder:
    """One request over one scene; ``asked`` is what its words refer to, None if they only tell a need.

    ``wanted``: the person wants even what nobody is sure of.
    """

    def __init__(
        self,
        said: str,
        scene: Scene,
        names: EntityVocabulary,
        dialogue: Sequence[tuple[str, str]],
        model: str,
        wanted: bool = False,
    ) -> None:
        self.scene, self._names, self._model, self._wanted = scene, names, model, wanted
        self.said = said[-LATEST:]
        self.served = [int(i) for _, robot in dialogue for i in SERVED.findall(robot) if int(i) in scene.by_id]
        self.last = scene.by_id[self.served[-1]] if self.served else None
        self.asked = in_context(self.said, dialogue, self._parsed, scene.by_id)
        self._replied = self.asked != self._parsed(self.said)

    def _parsed(self, said: str) -> ParsedUtterance | None:
        """What words ask for by themselves; of a story only what its last sentence asks for by name."""
        if len(words(said)) <= STORY:
            return parse(said, self._names, name_key)
        last = (sentences(said) or [""])[-1]
        asked = parse(last, self._names, name_key) if len(last.split()) <= STORY else None
        if asked is None or asked.head is None or not asked.head.labels:
            return None
        return asked if asked.kind != "find" or (asked.direct and not asked.head.bare) else None

    @property
    def outright(self) -> bool:
        """Whether the words are a question, or a reply to what the robot said: no statement, and no prohibition."""
        return self.asked is not None and (self.asked.kind != "find" or self._replied)

    @property
    def anywhere(self) -> bool:
        """Whether the words say nothing about where the object is."""
        return self.asked is None or self.asked.head is None or not self.asked.head.relations

    def answer(self, serve: Serve) -> Selection | None:
        """The answer to a request or question; None for a need in other words. ``serve`` judges a need among names."""
        asked = self.asked
        if asked is None:
            return None
        if asked.kind == "back" and len(dict.fromkeys(self.served)) > 1:
            before = self.scene.by_id[list(dict.fromkeys(reversed(self.served)))[1]]
            return self._found(ReferringExpression(before.label, frozenset({before.label}), obj=before.id))
        if asked.kind in SAID:
            return Selection("answered", reason=SAID[asked.kind], text=SAID[asked.kind], model=self._model)
        if asked.kind != "find":
            return answer(asked, self.scene, self.last, self._model)
        head = asked.head
        if head is None:
            return None
        if head.rooms is not None:
            return self._room(head, asked)
        if head.generic and head.most and head.said not in NEEDY and asked.direct:  # the biggest thing in the bedroom
            return self._found(head)
        if head.generic:
            return None if head.bare or head.said in STANDS_FOR else self._need(head, asked, serve)
        if head.labels and asked.direct and not (head.bare and self._common(head)):
            return self._found(head)
        placed = any(c.kind != "from" for c in head.relations)
        wanted = asked.direct and placed and asked.need  # an unlisted name may mean an object listed by another name
        return self.placed(head, serve(asked.need, ())) if wanted else None

    def _common(self, head: ReferringExpression) -> bool:
        """Whether a name is that of a kind, not one that people gave to a particular object."""
        return not any(head.labels & set(obj.names) for obj in self.scene.objects)

    def refined(self, chosen: Selection) -> Selection:
        """The object of the chosen name that the words describe, else the nearest of that name."""
        asked = self.asked if self.asked is not None and self.asked.kind == "find" else None
        if (
            chosen.status in ("likely_near", "not_found", "clarify")
            and asked is not None
            and asked.head is not None
            and asked.direct
        ):
            here = [o for o in self.scene.objects if called(o, asked.head.labels)]
            if here and asked.head.bare and not asked.head.generic:  # a general word for a listed object: "the soap"
                obj = self._likely(here)[0]
                say = self._one_of(obj, here) if len(here) > 1 else ""
                return replace(
                    chosen,
                    status="found",
                    question=None,
                    object=obj.label,
                    object_id=obj.id,
                    reason=f"'{asked.head.said}' was asked for",
                    text=say,
                )
        same = [o for o in self.scene.objects if called(o, [chosen.object or ""])]
        if (
            asked is not None
            and asked.head is not None
            and asked.head.bare
            and chosen.status == "found"
            and chosen.object in asked.head.labels
        ):
            same = [
                o for o in self.scene.objects if called(o, asked.head.labels)
            ]  # "the lamp", of floor lamps and desk lamps
            best = self._likely(same)[0]
            chosen = chosen if called(best, [chosen.object or ""]) else replace(chosen, object=best.label)
        if chosen.status not in ("found", "likely_near") or chosen.object_id is not None or not same:
            return chosen
        if len(same) == 1:
            return replace(chosen, object_id=same[0].id)
        head = self.asked.head if self.asked is not None and self.asked.kind == "find" else None
        if head is None or chosen.object not in head.labels or chosen.status == "likely_near":
            return chosen
        meant = [o for o in self.scene.meant(head)[0] if called(o, [chosen.object or ""])] if not head.bare else []
        obj = (meant if not head.bare and meant else self._likely(same))[0]
        return replace(chosen, object_id=obj.id, text=self._one_of(obj, same))

    def placed(self, head: ReferringExpression, chosen: Selection) -> Selection:
        """A substitute for an object that is not listed, at the place where the words put that object."""
        same = [o for o in self.scene.objects if called(o, [chosen.object or ""])]
        if chosen.status != "found" or not same:
            return chosen
        meant = replace(head, labels=frozenset({o.label for o in same}))
        there = self.scene.meant(meant)[0]
        return replace(chosen, object_id=there[0].id) if there else self._none(meant, True)

    def _likely(self, same: Sequence[MapObject]) -> list[MapObject]:
        """The nearest first, of those that are surely there if any are."""
        sure = [o for o in same if o.probability >= SURE] or list(same)
        return sorted(sure, key=self.scene.distance_m)

    def _one_of(self, obj: MapObject, same: Sequence[MapObject]) -> str:
        where = whereabouts(self.scene, obj)
        rest = [o for o in same if o.id != obj.id]
        others = [whereabouts(self.scene, o) for o in self._likely(rest)]
        apart = list(dict.fromkeys(words for words in others if words and words != where))[:2]
        offer = f" Or do you mean {' or '.join(f'the one {words}' for words in apart)}?" if apart else ""
        return f"There are {len(same)}; this is the nearest{f', {where}' if where else ''}.{offer}"

    def _found(self, head: ReferringExpression) -> Selection:
        without = self.served if head.other else ()
        found, emptied = self.scene.meant(head, without)
        if (
            not found and head.relations and not OTHER.search(self.said)
        ):  # "no, the one in the kitchen" may be the same again
            found, emptied = self.scene.meant(head)
        if not found and (like := self._names.like(name_key(head.said))):  # "the cup by the sink" may be a mug
            found = self.scene.meant(replace(head, labels=like), without)[0]
        if not found and not head.other and (maybe := self.scene.perhaps(head)) is not None:
            return maybe_there(maybe, self._model) if self._wanted else offer(maybe, self.scene, self._model)
        if not found:
            return self._none(head, emptied is not None)
        if len(found) > 1 and not (head.other or HURRY.search(self.said) or head.plural):
            return self._which(found)
        obj, where = found[0], whereabouts(self.scene, found[0])
        name = next((name for name in obj.names if name in head.labels), obj.label)
        say = f"{name if name in obj.names else f'The {name}'}{f' {where}' if where else ''}."
        return Selection(
            "found", name, reason=f"this is {where or 'the one'}", object_id=obj.id, text=say,
            candidates=((name, 1.0),), model=self._model,
        )  # fmt: skip

    def _which(self, found: Sequence[MapObject]) -> Selection:
        """A question that separates the candidates; where nothing does, the nearest, with the others listed."""
        few = list(found[:MOST_ASKED])
        apart = tell_apart(self.scene, few)
        if all(apart):
            ones = [words if words.startswith("the ") else f"the one {words}" for words in apart]
            question = f"Which {few[0].label}: {_or(ones)}?"
            return Selection(
                "clarify", reason=f"{len(found)} fit what was said", question=question, text=question, model=self._model
            )
        obj = self._likely(found)[0]
        return Selection(
            "found",
            obj.label,
            reason="the nearest of several",
            object_id=obj.id,
            text=self._one_of(obj, found),
            model=self._model,
        )

    def _none(self, head: ReferringExpression, emptied: bool) -> Selection:
        others = [o for o in self.scene.objects if called(o, head.labels)]
        if head.other and others:
            say = f"I know no other {others[0].label}."
        elif others and emptied:
            say = f"There is {one(others[0].label)} {whereabouts(self.scene, others[0])}, but none as you say."
        else:
            say = f"I have not seen any {head.said if not head.generic else 'such obj'}."
        return Selection("not_found", reason=say, text=say, model=self._model)

    def _room(self, head: ReferringExpression, asked: ParsedUtterance) -> Selection | None:
        """A drive to a room, if the words ask for nothing else."""
        rest = [
            word
            for word in words(asked.need)
            if word not in STOP and word not in head.said.split() and not DRIVES.fullmatch(word)
        ]
        if not DRIVES.search(asked.need) or len(rest) > 1:
            return None
        rooms = [self.scene.rooms[i] for i in head.rooms or ()]
        if not rooms:
            known = _or([f"the {room.name}" for room in self.scene.rooms.values()]) or "no room that I know"
            say = f"I know no {head.said} here; there is {known}."
            return Selection("not_found", reason=say, text=say, model=self._model)
        inside = {room.id: [o for o in self.scene.objects if o.room == room.id] for room in rooms}
        room = min(rooms, key=lambda room: min(map(self.scene.distance_m, inside[room.id]), default=1e9))
        return Selection(
            "found",
            room.name,
            reason="the room was asked for",
            text=f"The {room.name}.",
            room=room.id,
            model=self._model,
        )

    def _need(self, head: ReferringExpression, asked: ParsedUtterance, serve: Serve) -> Selection | None:
        """A need with a place: "something to sit on in the kitchen"."""
        there, _ = self.scene.meant(head)
        names = tuple(sorted({o.label for o in there}))
        if all(word in STOP for word in words(asked.need)):
            return None
        if not names:  # "drink something from a cup" is no place
            return self._none(head, True) if any(c.target and c.target.rooms for c in head.relations) else None
        chosen = serve(asked.need, names)
        fitting = [o for o in there if called(o, [chosen.object or ""])]
        if chosen.status != "found" or not fitting:
            return chosen if chosen.status != "likely_near" else self._none(head, True)
        obj = self._likely(fitting)[0]
        return replace(chosen, object_id=obj.id, text=f"The {obj.label} {whereabouts(self.scene, obj)}.")


def _or(parts: Sequence[str]) -> str:
    return " or ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} or {parts[-1]}"
