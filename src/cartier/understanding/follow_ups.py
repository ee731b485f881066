"""Follow-ups: turns that depend on earlier ones, such as "the other one", "the one by the sink", "take me to it"."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

from cartier.labels import plain, words
from cartier.spatial.expressions import ParsedUtterance, ReferringExpression, SpatialRelation, merged
from cartier.types import MapObject
from cartier.understanding.reference_words import COMMANDS, GO_THERE, NEEDY, STANDS_FOR
from cartier.understanding.references import sentences

LATEST = 3000  # characters at the end of a text that are read
SERVED = re.compile(r"#(\d+)")
TURNING_DOWN = re.compile(
    r"^(?:(?:no|nope|nah|not (?:that|this)(?: one)?|not it|wrong(?: one)?|i (?:mean|meant|said)|sorry|actually"
    r"|rather)(?: |$))+"
)
TURNED_DOWN = re.compile(r"^(?:no|nope|not|wrong)\b")
FRAGMENT = re.compile(
    r"^(?:no |not that |i mean |i meant |sorry |rather |actually )*(?:the one )?(?=(?:on|in|at|by|near|next|beside"
    r"|under|close|closest|nearest|behind|to the|between|with|from)\b)"
)
EITHER = re.compile(
    r"\b(?:either|any|whichever|you choose|your choice|nearest|closest|do not mind|don t mind|don t care|no matter"
    r"|yes|yeah|ok|okay|sure)\b"
)
GO_ON = re.compile(
    r"^(?:(?:ok|okay|yes|yeah|great|good|fine|super|perfect|nice|please|then|now|so|and|thanks|robot|can you"
    r"|could you) )*"
    r"(?:go|drive|bring me|take me|lead me|show me|head)(?: (?:there|to it|to that(?: one)?|over))?(?: (?:please|now"
    r"|then|quick|quickly))*$"
)
REFUSED = re.compile(
    r"^(?:no |nope |sorry |also )*(?:that s |that is |this is |this s |it s "
    r"|it is )?(?:not (?:it|that|this|that one|this one|the one|the right one)|wrong(?: \w+)?)$"
    r"|^(?:no|nope)(?: (?:that|this|it) (?:is|s) (?:not it|wrong|not the one))?$"
)
COMMANDED = frozenset(kind for kind, _ in COMMANDS)
SHORT = 6  # most words of a reply that chooses one
Parse = Callable[[str], ParsedUtterance | None]


def in_context(
    said: str, dialogue: Sequence[tuple[str, str]], parse: Parse, by_id: dict[int, MapObject]
) -> ParsedUtterance | None:
    """What the latest words ask for; ``dialogue``: the earlier (person, robot) turns, ``by_id``: the home's objects."""
    before: ParsedUtterance | None = None
    robot, last = "", None
    for person, reply in dialogue:
        asked = _resolved(
            " ".join(words(plain(person[-LATEST:]))), parse(plain(person[-LATEST:])), before, robot, last, parse
        )
        before = asked if asked is not None and asked.head is not None and asked.head.labels else before
        robot = reply
        last = next((by_id[int(i)] for i in reversed(SERVED.findall(reply)) if int(i) in by_id), last)
    return _resolved(" ".join(words(" ".join(sentences(said)))), parse(said), before, robot, last, parse)


def _resolved(
    said: str,
    asked: ParsedUtterance | None,
    before: ParsedUtterance | None,
    robot: str,
    last: MapObject | None,
    parse: Parse,
) -> ParsedUtterance | None:
    if not robot or (asked is not None and asked.kind in COMMANDED):
        return asked
    short = TURNING_DOWN.sub("", said)
    if short != said:
        asked = parse(short) or asked
    fragment = FRAGMENT.sub("", short)
    if fragment != short or FRAGMENT.match(short):
        asked = parse(f"the one {fragment}") or asked
    meant = before.head if before is not None else None
    replying = robot.rstrip().endswith("?") and meant is not None
    there = (GO_THERE.search(short) and (asked is None or _pronoun(asked.head))) or GO_ON.search(said)
    if last is not None and there and not replying:
        return ParsedUtterance("find", _same(last), need=last.label, direct=True)
    if last is not None and meant is not None and not replying and last.label in meant.labels and REFUSED.search(said):
        return ParsedUtterance("find", replace(meant, other=True, obj=None, relations=()), need=last.label, direct=True)
    if asked is not None and asked.kind in ("which", "sure"):
        return replace(asked, head=_asked_of(asked.head, meant, last))
    if asked is None or asked.head is None or asked.kind != "find":
        if (
            replying
            and before is not None
            and meant is not None
            and EITHER.search(short)
            and len(short.split()) <= SHORT
        ):
            return ParsedUtterance("find", replace(meant, most="nearest"), need=before.need, direct=True)
        return asked
    head = asked.head
    if meant is not None:
        room = ReferringExpression("", relations=(SpatialRelation("in", head),)) if head.rooms is not None else None
        if room is not None and (replying or len(short.split()) <= 3) and not GO_THERE.search(short):
            return replace(asked, head=merged(meant, room), direct=True)  # "the one in the kitchen?" "bedroom"
        if replying and ((head.generic and head.said not in NEEDY) or head.labels & meant.labels):
            return replace(asked, head=merged(meant, head), direct=True)
    if last is None:
        return asked
    if not head.generic:
        return replace(asked, head=_beside_it(head, last))
    if head.bare or head.said in NEEDY:
        return asked
    kind = meant.labels if meant is not None else frozenset()
    kept = kind if last.label in kind else frozenset({last.label})
    other = head.other or TURNED_DOWN.search(said) is not None
    again = replace(_beside_it(head, last), generic=False, labels=kept, said=last.label, other=other)
    return replace(asked, head=again, direct=True)


def _asked_of(
    head: ReferringExpression | None, meant: ReferringExpression | None, last: MapObject | None
) -> ReferringExpression | None:
    """What "which is bigger" and "are you sure" are about."""
    if head is not None and not _pronoun(replace(head, most="")):
        return head
    if head is not None and head.most and meant is not None:
        return merged(meant, head)
    return _same(last) if last is not None else meant or head


def _pronoun(head: ReferringExpression | None) -> bool:
    return head is None or (head.generic and head.bare)


def _same(obj: MapObject) -> ReferringExpression:
    return ReferringExpression(obj.label, frozenset({obj.label}), obj=obj.id)


def _beside_it(head: ReferringExpression, last: MapObject) -> ReferringExpression:
    """With "it" in "the bed next to it" resolved to the object mentioned before."""
    told = (
        replace(c, target=_same(last)) if c.target is not None and c.target.bare and c.target.said in STANDS_FOR else c
        for c in head.relations
    )
    return replace(head, relations=tuple(told))
