"""Dialogue state: what pronouns, "the blue one" and "the other one" stand for, from the turns before."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from cartier.labels import name_key, plain, singular, words
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation, merged
from cartier.spatial.query import HERE
from cartier.types import MapObject
from cartier.understanding.cards import bare
from cartier.understanding.owners import unknown_owner, with_owner
from cartier.understanding.phrase_words import LISTED
from cartier.understanding.reference_words import STANDS_FOR
from cartier.understanding.tags import NOTHING_ASKED, NOUNS, Clause

LONGEST_NAME = 5
SERVED = re.compile(r"#(\d+)")
LEAST_DRIVING = 0.2  # probability of a drive from which words that do not begin as a question are one
ASKING = frozenset(words("what which who whose where when how why is are was do does did has have can could tell"))
WHERE_NOW = re.compile(r"\bwhere (?:are|am) (?:you|we|i)\b")
"""A question that few authors wrote, and the parser takes for what the robot can do or for a way back."""
LEAST_ASKING = 0.35  # probability of a request from which words that seem to ask for nothing are one


RETURNS = ("go", "correct", "another", "choose")
"""Acts of words that go back to what was served."""
SEEKING = ("count", "exists", "where", "list")
GOES_ON = re.compile(r"(?:so )?(?:and|(?:and )?(?:what|how) about) (?:in|on|at|under|near|by|next|beside|the|my|our)\b")
MOST_SHOWING = 4  # words of a drive to what was spoken of: "show me then"


@dataclass(frozen=True)
class DialogueState:
    """The latest query about objects, what the robot named last, all that it was sent to, and what it offered just now
    or, in ``rest``, before and was not taken. ``choices`` are the objects that it asked about just now, each with the
    words that tell it apart; ``questioned``: whether its last turn was a question. ``listed`` are the objects of its
    last answer in their order; ``pointed``: whether it named one of them by its number."""

    before: ParsedUtterance | None = None
    last: MapObject | None = None
    served: tuple[int, ...] = ()
    offered: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    choices: tuple[tuple[str, int], ...] = ()
    questioned: bool = False
    listed: tuple[int, ...] = ()
    pointed: bool = False

    def then(
        self, asked: ParsedUtterance | None, served: Sequence[MapObject], offered: Sequence[str] = ()
    ) -> DialogueState:
        """The state after a resolved query, the objects that the robot named in its reply and the names it asked of."""
        head = asked.head if asked is not None else None
        kept = asked is not None and (
            asked.kind == "need" or (head is not None and bool(head.labels or head.obj)) or bool(unknown_owner(asked))
        )
        ids = tuple(obj.id for obj in served)
        last = served[-1] if served else self.last
        rest = tuple(name for name in self.offered or self.rest if name not in {obj.label for obj in served})
        return DialogueState(asked if kept else self.before, last, self.served + ids, tuple(offered), rest)


def in_context(clause: Clause, state: DialogueState) -> Clause:
    """The clause with the act that it has here: a "no" to what was served wants another, and words that seem to ask
    for nothing are a request where that is nearly as likely."""
    second, likely = clause.second
    if clause.act == "deny" and any(span.role == "t" for span in clause.spans):  # "no, the sink"
        return clause._replace(act="go")
    if clause.act == "deny" and not state.questioned and state.last is not None:
        return clause._replace(act="another")
    nouns = [span.words[-1] for span in clause.spans if span.role in NOUNS]
    if clause.act == "sure" and not nouns and state == DialogueState():
        return clause._replace(act=second)  # "how are you?": there is nothing yet to be sure of
    if clause.act in ("able", "back", "other") and not nouns and WHERE_NOW.search(" ".join(clause.tokens)):
        return clause._replace(act="where")
    alone = len(nouns) == 1 and nouns[0] in STANDS_FOR
    if clause.act == "compare" and alone and second in RETURNS and state.last is not None:
        return clause._replace(act="another")  # "and the smaller one?"
    if clause.act in ("which", "where") and second == "go" and likely >= LEAST_DRIVING:
        return clause if ASKING & set(clause.tokens[:3]) else clause._replace(act="go")  # "closest plant to us"
    if clause.act not in NOTHING_ASKED or second not in ("go", "need") or likely < LEAST_ASKING:
        return clause
    spans = tuple(span._replace(role="n") if span.role == "t" else span for span in clause.spans)
    return clause._replace(act=second, spans=spans if clause.act == "prohibit" else clause.spans)


def resolve(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance:
    """A query in which stand-ins are replaced by what they stand for, and a reply by the request that it makes."""
    head, before = asked.head, state.before.head if state.before is not None else None
    if state.before is not None and unknown_owner(state.before) and (rooms := _rooms(head)):
        return with_owner(state.before, rooms)  # "which room is Ben's?" "the bedroom"
    if (of_list := _of_list(asked, state)) is not None:
        return of_list
    if (asked.kind, head) == ("go", None) and state.last is not None and len(asked.need.split()) <= MOST_SHOWING:
        return replace(asked, head=same(state.last))  # "show me"
    if before is not None and before.labels and (goes_on := _goes_on(asked, state)) is not None:
        return goes_on
    if asked.kind == "another":
        named = head is not None and bool(head.labels)
        if not named and (before is None or not before.labels):
            return _need_again(asked, state)
        if named or before is None:
            return replace(asked, kind="go", head=_other(head))
        told = head is not None and bool(head.colours or head.size or head.most or head.relations)
        return replace(asked, kind="go", head=_other(replace(again(before, head), recalled=not told)))
    chosen = asked.kind == "go" and head is not None and head.rooms is not None and state.offered
    placed = asked.kind == "go" and head is not None and head.generic and not head.said and bool(head.relations)
    if chosen or asked.kind in ("correct", "choose") or (placed and before is not None):  # "on the desk"
        return _replied(asked, state)
    if head is not None:
        head = _landmarks(head, state.last)
        means = head.said or head.most or head.size or head.order or head.colours
        if head.generic and means and state.last is not None and asked.kind != "need":
            if before is not None and before.labels and head.said in LISTED and asked.kind == "count":
                head = again(before, head)  # "how many of them"
            else:
                head = _stood_for(head, before, state.last)
    return replace(asked, head=head)


def _of_list(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance | None:
    """The query about what the robot listed just now: "the second of them", "how many of them are red", "bring me
    that"; None where the words name something themselves."""
    head = asked.head
    if head is None or not state.listed or not head.generic or head.other or asked.kind == "need":
        return None
    several = len(state.listed) > 1
    described = head.order or head.most or head.size or head.colours or head.relations
    if head.said in ("it", "that", "this") and head.bare:
        if state.pointed:
            return None
    elif not several or not (head.said in LISTED or (head.said in ("one", "ones") and described)):
        return None
    kind = "go" if asked.kind in ("another", "choose", "correct") else asked.kind
    return replace(asked, kind=kind, head=replace(_landmarks(head, state.last), among=state.listed))


def _goes_on(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance | None:
    """The question before, asked of another place: "and in the kitchen?"; None for any other words."""
    head, before = asked.head, state.before
    if head is None or before is None or before.head is None or not GOES_ON.match(asked.need):
        return None
    if asked.kind not in SEEKING or before.kind not in SEEKING:
        return None
    if head.rooms is not None:
        head = ReferringExpression("", generic=True, relations=(SpatialRelation("in", head),))
    if not head.generic or head.said or not head.relations:
        return None
    return replace(before, head=again(before.head, _landmarks(head, state.last)), need=asked.need)


def _rooms(head: ReferringExpression | None) -> tuple[int, ...]:
    """The rooms that words name which name nothing else: "the kitchen", "it is the kitchen"."""
    if head is None or head.labels:
        return ()
    inside = (relation.target for relation in head.relations if relation.kind == "in")
    return head.rooms or next((target.rooms for target in inside if target is not None and target.rooms), ())


def _need_again(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance:
    """The need of before, where no object was named."""
    if state.before is None:
        return replace(asked, kind="go")
    again = state.before.head or ReferringExpression("", generic=True)
    return replace(state.before, rejected=asked.rejected, head=_other(again))


def _replied(asked: ParsedUtterance, state: DialogueState) -> ParsedUtterance:
    """A correction or a choice: what it names, else what was asked before with what it adds."""
    head, before = asked.head, state.before.head if state.before is not None else None
    if asked.kind == "correct" and state.last is not None:
        asked = replace(asked, instead_of=state.last.id)
    if head is not None and head.rooms is not None and before is not None:  # "no, the kitchen"
        head = ReferringExpression("", generic=True, relations=(SpatialRelation("in", head),))
    if head is not None and (head.labels or before is None or not before.labels):
        return replace(asked, kind="go", head=_landmarks(head, state.last))
    if before is None or not before.labels:
        return _need_again(asked, state)
    kind = again(before, head)
    turned_down = asked.kind == "correct" and (head is None or head.bare)
    return replace(asked, kind="go", head=_other(kind) if turned_down else _landmarks(kind, state.last))


def again(before: ReferringExpression, now: ReferringExpression | None) -> ReferringExpression:
    """The earlier expression with what is added; new relations replace the old ones."""
    if now is None or now.bare:
        return replace(before, obj=None)
    kept = replace(before, relations=() if now.relations else before.relations, obj=None)
    if now.colours or now.most or now.size or now.order:
        kept = replace(kept, colours=(), most="", size="", order=0)
    return merged(kept, now)


def _other(head: ReferringExpression | None) -> ReferringExpression | None:
    """Another object of the kind, wherever it is."""
    return replace(head, other=True, obj=None, order=0) if head is not None else None


def _landmarks(head: ReferringExpression, last: MapObject | None) -> ReferringExpression:
    """With "it" in "next to it" replaced by the object that was named last."""
    if last is None:
        return head
    told = (
        replace(relation, target=same(last))
        if relation.target is not None
        and relation.target.generic
        and relation.target.bare
        and relation.target.said not in HERE
        else relation
        for relation in head.relations
    )
    return replace(head, relations=tuple(told))


def _stood_for(head: ReferringExpression, before: ReferringExpression | None, last: MapObject) -> ReferringExpression:
    """What "it" or "the blue one" stands for."""
    if head.bare and not head.said.startswith(("one", "some")):
        return same(last)
    labels = before.labels if before is not None and before.labels else frozenset({last.label})
    return replace(head, generic=False, labels=labels, said=last.label)


def same(obj: MapObject) -> ReferringExpression:
    return ReferringExpression(obj.label, frozenset({obj.label}), obj=obj.id)


def named(text: str, names: Sequence[str]) -> list[str]:
    """The listed names that occur in a text, longest first at each place, in their order."""
    said = [singular(w) for w in words(plain(text))]
    keys: dict[str, str] = {}
    for name in names:
        keys.setdefault(name_key(name), name)
        keys.setdefault(name_key(bare(name)), name)
    found, i = [], 0
    while i < len(said):
        for end in range(min(i + LONGEST_NAME, len(said)), i, -1):
            meant = keys.get(name_key(" ".join(said[i:end])))
            if meant is not None:
                found.append(meant)
                i = end
                break
        else:
            i += 1
    return list(dict.fromkeys(found))
