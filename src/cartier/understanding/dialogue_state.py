"""Dialogue state: what pronouns, "the blue one" and "the other one" stand for, from the turns before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation, merged
from cartier.types import MapObject

ABOUT_OBJECTS = ("go", "need", "count", "exists", "where", "list", "compare", "correct", "another", "choose")


@dataclass(frozen=True)
class DialogueState:
    """The latest query about objects, the object that the robot named last, and all that it was sent to."""

    before: ParsedUtterance | None = None
    last: MapObject | None = None
    served: tuple[int, ...] = ()

    def then(self, asked: ParsedUtterance | None, served: Sequence[MapObject]) -> DialogueState:
        """The state after a resolved query and the objects that the robot named in its reply."""
        kept = asked is not None and asked.head is not None and bool(asked.head.labels or asked.head.obj is not None)
        ids = tuple(obj.id for obj in served)
        return DialogueState(asked if kept else self.before, served[-1] if served else self.last, self.served + ids)


def resolve(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance:
    """A query whose stand-ins are replaced by what they stand for; ``without`` tells what a reply turns down."""
    head, before = asked.head, state.before.head if state.before is not None else None
    if asked.kind == "another":
        named = head is not None and bool(head.labels)
        kind = head if named or before is None else _again(before, head)
        return replace(asked, kind="go", head=_other(kind), direct=True)
    if asked.kind in ("correct", "choose"):
        return _replied(asked, state)
    if head is not None:
        head = _landmarks(head, state.last)
        if head.generic and head.said and state.last is not None:
            head = _stood_for(head, before, state.last)
    return replace(asked, head=head)


def _replied(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance:
    """A correction or a choice: what it names, else what was asked before with what it adds."""
    head, before = asked.head, state.before.head if state.before is not None else None
    if head is not None and head.rooms is not None and before is not None:  # "no, the kitchen"
        head = ReferringExpression("", generic=True, relations=(SpatialRelation("in", head),))
    if head is not None and (head.labels or before is None):
        return replace(asked, kind="go", head=_landmarks(head, state.last), direct=True)
    if before is None:
        return replace(asked, kind="go", direct=True)
    kind = _again(before, head)
    turned_down = asked.kind == "correct" and (head is None or head.bare)
    return replace(asked, kind="go", head=_other(kind) if turned_down else _landmarks(kind, state.last), direct=True)


def _again(before: ReferringExpression, now: ReferringExpression | None) -> ReferringExpression:
    """The earlier expression with what is added; new relations replace the old ones."""
    if now is None or now.bare:
        return replace(before, obj=None)
    kept = replace(before, relations=() if now.relations else before.relations, obj=None)
    if now.colours or now.most or now.size or now.order:
        kept = replace(kept, colours=(), most="", size="", order=0)
    return merged(kept, now)


def _other(head: ReferringExpression | None) -> ReferringExpression | None:
    """Another object of the kind, wherever it is."""
    return replace(head, other=True, obj=None) if head is not None else None


def _landmarks(head: ReferringExpression, last: MapObject | None) -> ReferringExpression:
    """With "it" in "next to it" replaced by the object that was named last."""
    if last is None:
        return head
    told = (
        replace(relation, target=_same(last))
        if relation.target is not None and relation.target.generic and relation.target.bare
        else relation
        for relation in head.relations
    )
    return replace(head, relations=tuple(told))


def _stood_for(head: ReferringExpression, before: ReferringExpression | None, last: MapObject) -> ReferringExpression:
    """What "it" or "the blue one" stands for."""
    if head.bare and not head.said.startswith(("one", "some")):
        return _same(last)
    labels = before.labels if before is not None and before.labels else frozenset({last.label})
    return replace(head, generic=False, labels=labels, said=last.label)


def _same(obj: MapObject) -> ReferringExpression:
    return ReferringExpression(obj.label, frozenset({obj.label}), obj=obj.id)
