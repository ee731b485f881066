"""Grounding: referring expressions and questions, resolved to the objects of a home in the context of the dialogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from cartier.labels import name_key
from cartier.spatial.describe import tell_apart, the, whereabouts
from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression
from cartier.spatial.query import Scene, called, is_door
from cartier.types import MapObject, Selection
from cartier.understanding.answers import answer, between, listing, one, passages, where
from cartier.understanding.dialogue_state import DialogueState
from cartier.understanding.owners import MOST_ASKED, owner_question, unknown_owner, which_is
from cartier.understanding.reference_words import HURRY, NEEDY
from cartier.understanding.tentative import maybe_there, offer

MODEL = "embedded (knowledge cards, MiniLM, learned scorer)"
SURE = 0.85  # least probability of an object that is preferred where any of several will do
SAID: Mapping[str, str] = {
    "stop": "All right.", "come": "I do not know where you are: name a room or a thing beside you.",
    "back": "I do not know where back is: name a room or a thing.",
    "follow": "I cannot follow anybody: name a room or a thing.",
    "able": "I know where things are in this home: ask me where something is, or tell me what you need.",
    "thanks": "You are welcome.", "bye": "Goodbye.",
}  # fmt: skip
Serve = Callable[[str, tuple[str, ...]], Selection]


class ReferenceGrounder:
    """One resolved query over one scene; ``wanted``: the person wants even what nobody is sure of."""

    def __init__(
        self, asked: ParsedUtterance, scene: Scene, names: EntityVocabulary, state: DialogueState, said: str,
        wanted: bool = False,
    ) -> None:  # fmt: skip
        self.asked, self.scene, self.state, self.said = asked, scene, state, said
        self._names, self._wanted = names, wanted

    @property
    def anywhere(self) -> bool:
        """Whether the words say nothing about where the object is."""
        return self.asked.head is None or not self.asked.head.relations

    def answer(self, serve: Serve) -> Selection | None:
        """The answer to a request or question; None for a need in other words. ``serve`` judges a need among names."""
        asked, head = self.asked, self.asked.head
        if owner := unknown_owner(asked):
            question = owner_question(owner, [room.name for room in self.scene.rooms.values()])
            return Selection(
                "clarify", reason=f"no room is called {owner}", question=question, text=question, model=MODEL
            )
        if asked.kind == "back" and len(dict.fromkeys(self.state.served)) > 1:
            before = self.scene.by_id[list(dict.fromkeys(reversed(self.state.served)))[1]]
            return self._found(ReferringExpression(before.label, frozenset({before.label}), obj=before.id))
        if asked.kind in SAID:
            return Selection("answered", reason=SAID[asked.kind], text=SAID[asked.kind], model=MODEL)
        if asked.kind not in ("go", "need"):
            return answer(asked, self.scene, self.state.last, MODEL)
        if head is None:
            return None
        if head.rooms is not None and asked.kind == "go":
            return self._room(head)
        if asked.kind == "need":
            return self._need(head, asked, serve) if head.relations else None
        if head.generic and (head.most or head.size or head.colours) and head.said not in NEEDY:
            return self._found(head)
        if head.among:
            return self._found(head)
        if head.generic:
            return None if head.bare else self._need(head, asked, serve)
        told = not head.bare or any(noun.colours and noun.labels & head.labels for noun in asked.rejected)
        if head.obj is not None or (head.labels and (told or head.usually is not None or not self._common(head))):
            return self._found(head)
        if not head.labels and (self.scene.doors(head) or is_door(head)):
            return self._door(head)
        if head.bare and (there := self.scene.meant(head)[0]):
            return self._named(head, [o for o in there if any(name.lower() in self.said for name in o.names)] or there)
        placed = any(c.kind != "from" for c in head.relations)
        return self.placed(head, serve(head.said, ())) if placed else None  # it may be listed by another name

    def _common(self, head: ReferringExpression) -> bool:
        """Whether a name is that of a kind, not one that people gave to a particular object."""
        return not any(head.labels & set(obj.names) for obj in self.scene.objects)

    def whose(self, name: str) -> Selection | None:
        """A question for the object that is called "Ben's chair", where there are several and none has that name."""
        head = self.asked.head
        found = self.scene.meant(head)[0][:MOST_ASKED] if head is not None else []
        label = found[0].label if found else ""
        if len(found) < 2 or any(obj.label != label or name_key(name) in map(name_key, obj.names) for obj in found):
            return None
        if not all(apart := tell_apart(self.scene, found)):
            return None
        question = which_is(name, label, apart)
        return Selection("clarify", reason=f"nothing is called {name}", question=question, text=question, model=MODEL)

    def refined(self, chosen: Selection) -> Selection:
        """The object of the chosen name that the words describe, else the nearest of that name."""
        asked = self.asked if self.asked.kind == "go" else None
        if chosen.status in ("likely_near", "not_found", "clarify") and asked is not None and asked.head is not None:
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
        head = asked.head if asked is not None else None
        named = head is not None and chosen.object in head.labels
        if chosen.status == "likely_near" or (not named and self.asked.kind != "need"):
            return chosen
        described = self.scene.meant(head)[0] if named and head is not None and not head.bare else []
        obj = ([o for o in described if called(o, [chosen.object or ""])] or self._likely(same))[0]
        return replace(chosen, object_id=obj.id, text=self._one_of(obj, same))

    def placed(self, head: ReferringExpression, chosen: Selection) -> Selection:
        """A substitute for an object that is not listed, at the place where the words put that object."""
        same = [o for o in self.scene.objects if called(o, [chosen.object or ""])]
        if chosen.status != "found" or not same:
            return chosen
        meant = replace(head, labels=frozenset({o.label for o in same}))
        there = self.scene.meant(meant)[0]
        return replace(chosen, object_id=there[0].id) if there else self._none(meant)

    def _likely(self, same: Sequence[MapObject]) -> list[MapObject]:
        """The nearest first, of those that are surely there if any are."""
        sure = [o for o in same if o.probability >= SURE] or list(same)
        return sorted(sure, key=self.scene.way_m)

    def _one_of(self, obj: MapObject, same: Sequence[MapObject]) -> str:
        where = whereabouts(self.scene, obj)
        rest = [o for o in same if o.id != obj.id]
        others = [whereabouts(self.scene, o) for o in self._likely(rest)]
        apart = list(dict.fromkeys(words for words in others if words and words != where))[:2]
        offer = f" Or do you mean {' or '.join(f'the one {words}' for words in apart)}?" if apart else ""
        return f"There are {len(same)}; this is the nearest{f', {where}' if where else ''}.{offer}"

    def _found(self, head: ReferringExpression) -> Selection:
        out = {obj.id for noun in self.asked.rejected for obj in self.scene.meant(noun)[0]}
        without = out.union(self.state.served if head.other else ())
        found, _ = self.scene.meant(head, without)
        if not found and head.other:  # all were served before: the other one is not the last of them
            without = out.union(self.state.served[-1:])
            found, _ = self.scene.meant(head, without)
        if not found and head.other and head.relations:  # "the other one" may stand elsewhere
            found, _ = self.scene.meant(replace(head, relations=()), without)
        if not found and head.other and head.recalled:  # after "the red one", it may be blue
            found, _ = self.scene.meant(replace(head, relations=(), colours=(), size="", most=""), without)
        elif not found and head.relations and not head.other:  # "no, the one in the kitchen" may be the same again
            found, _ = self.scene.meant(head)
        found = [obj for obj in found if obj.id != self.asked.instead_of] or found
        if not found and not head.other and (maybe := self.scene.perhaps(head)) is not None:
            return maybe_there(maybe, MODEL) if self._wanted else offer(maybe, self.scene, MODEL)
        if not found:
            return self._none(head)
        if len(found) > 1 and not (head.other or HURRY.search(self.said) or head.plural or head.usually is not None):
            return self._which(found)
        obj, where = found[0], whereabouts(self.scene, found[0])
        name = next((name for name in obj.names if name in head.labels), obj.label)
        say = f"{name if name in obj.names else f'The {name}'}{f' {where}' if where else ''}."
        return Selection(
            "found", name, reason=f"this is {where or 'the one'}", object_id=obj.id, text=say,
            candidates=((name, 1.0),), model=MODEL,
        )  # fmt: skip

    def _named(self, head: ReferringExpression, there: Sequence[MapObject]) -> Selection:
        """The nearest of the objects that a mere name may mean."""
        obj, reason = self._likely(there)[0], f"'{head.said}' was asked for by name"
        say, sure = self._one_of(obj, there) if len(there) > 1 else "", ((obj.label, 1.0),)
        return Selection("found", obj.label, reason, object_id=obj.id, text=say, candidates=sure, model=MODEL)

    def _which(self, found: Sequence[MapObject]) -> Selection:
        """A question that separates the candidates; where nothing does, the nearest, with the others listed."""
        few = list(found[:MOST_ASKED])
        labels = [obj.label for obj in few]
        apart = [the(label) for label in labels] if len(set(labels)) == len(few) else tell_apart(self.scene, few)
        if all(apart):
            ones = [words if words.startswith("the ") else f"the one {words}" for words in apart]
            question = f"Which {labels[0] if len(set(labels)) == 1 else 'of them'}: {_or(ones)}?"
            return Selection(
                "clarify", reason=f"{len(found)} fit what was said", question=question, text=question, model=MODEL
            )
        obj = self._likely(found)[0]
        return Selection(
            "found",
            obj.label,
            reason="the nearest of several",
            object_id=obj.id,
            text=self._one_of(obj, found),
            model=MODEL,
        )

    def _none(self, head: ReferringExpression) -> Selection:
        others = [o for o in self.scene.objects if called(o, head.labels)]
        if head.other and others:
            say = f"I know no other {others[0].label}."
        elif others:
            there = f"There is {one(others[0].label)} {whereabouts(self.scene, others[0])}".rstrip()
            say = f"{there}, but none as you say."
        else:
            say = f"I have not seen any {head.said if not head.generic else 'such object'}."
        return Selection("not_found", reason=say, text=say, model=MODEL)

    def _door(self, head: ReferringExpression) -> Selection:
        """A drive to the nearest passage between rooms that is meant."""
        doors = self.scene.doors(head)
        if not doors:
            every = self.scene.doors(replace(head, said="door", relations=()))
            there = f"; there {passages(self.scene, every)}" if every else ""
            say = f"I know no {head.said}{where(head)} here{there}."
            return Selection("not_found", reason=say, text=say, model=MODEL)
        door = (max if head.most == "farthest" else min)(doors, key=self.scene.door_distance_m)
        say = f"The passage between {between(self.scene, door)}."
        if len(doors) > 1 and not head.most:
            say = f"There are {len(doors)}; this is the nearest, between {between(self.scene, door)}."
        return Selection(
            "found",
            "door",
            reason="the passage was asked for",
            text=say,
            door=self.scene.every_door.index(door),
            model=MODEL,
        )

    def _room(self, head: ReferringExpression) -> Selection:
        """A drive to a room."""
        rooms = [self.scene.rooms[i] for i in head.rooms or ()]
        if not rooms:
            if len(head.said.split()) == 1 and head.said in ("room", "one", "place"):
                say = "I know no such room here."
                return Selection("not_found", reason=say, text=say, model=MODEL)
            known = [the(room.name) for room in self.scene.rooms.values()]
            say = f"I know no {head.said} here{f', only {listing(known)}' if known else ''}."
            return Selection("not_found", reason=say, text=say, model=MODEL)
        inside = {room.id: [o for o in self.scene.objects if o.room == room.id] for room in rooms}
        room = min(rooms, key=lambda room: min(map(self.scene.way_m, inside[room.id]), default=1e9))
        return Selection(
            "found",
            room.name,
            reason="the room was asked for",
            text=f"{the(room.name)[:1].upper()}{the(room.name)[1:]}.",
            room=room.id,
            model=MODEL,
        )

    def _need(self, head: ReferringExpression, asked: ParsedUtterance, serve: Serve) -> Selection | None:
        """A need with a place: "something to sit on in the kitchen"."""
        there, _ = self.scene.meant(head)
        names = tuple(sorted({o.label for o in there}))
        if not names:  # "drink something from a cup" is no place
            return self._none(head) if any(c.target and c.target.rooms for c in head.relations) else None
        chosen = serve(asked.need, names)
        fitting = [o for o in there if called(o, [chosen.object or ""])]
        if chosen.status != "found" or not fitting:
            return chosen if chosen.status != "likely_near" else self._none(head)
        obj = self._likely(fitting)[0]
        return replace(chosen, object_id=obj.id, text=f"The {obj.label} {whereabouts(self.scene, obj)}.")


def _or(parts: Sequence[str]) -> str:
    return " or ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} or {parts[-1]}"
