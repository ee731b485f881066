"""Parser of referring expressions and questions: the kind of object, its relations, and what the person asks about it.

The parser finds names first. Words before a name (colour, size, "the biggest", "the other") and between two names
("next to", "in the") say the rest, so it also works in the middle of a story. ``spatial/query.py`` resolves the result
in a home.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from cartier.spatial.expressions import (
    EntityVocabulary,
    Kind,
    ParsedUtterance,
    ReferringExpression,
    SpatialRelation,
    merged,
)
from cartier.understanding.reference_words import (
    AFTER,
    AROUND,
    ARTICLES,
    BEFORE,
    COLOURS,
    COMMANDS,
    CONTRACTIONS,
    CUE,
    DEFINITE,
    ENDS,
    FILLERS,
    FIND,
    GENERIC,
    GO_THERE,
    LEFT,
    MOST,
    NEED,
    NEEDY,
    NOT_FIRST,
    NOT_THAT,
    OPEN_STATEMENT,
    ORDER,
    PLACING,
    PLURAL,
    POLITE,
    PUTTING,
    QUESTIONS,
    RELATIONS,
    SIDE,
    SIDES,
    SIZES,
    SOMEBODY,
    STANDS_FOR,
    STATED,
    UP_OR_DOWN,
    VERB_BEFORE,
    VERBS,
    WHICH_IS,
    WISHING,
    WORD,
)

Key = Callable[[str], str]
"""Makes a name's key of its words."""


LONGEST = 4
ABOUT = frozenset(
    {"find", "count", "exists", "where", "far", "when", "colour", "size", "room", "which", "sure"}
)  # an object


@dataclass(frozen=True)
class _Mention:
    start: int
    end: int
    phrase: ReferringExpression


def sentences(text: str) -> list[str]:
    """The sentences of a lower-case text, contractions written out."""
    for pattern, full in CONTRACTIONS:
        text = pattern.sub(full, text)
    text = re.sub(r"\b(from|to) where (?:i|we) (?:am|are|stand|sit)\b", r"\1 me", text)
    return [part.strip() for part in ENDS.split(text) if WORD.search(part)]


def parse(text: str, names: EntityVocabulary, key: Key) -> ParsedUtterance | None:
    """What a text asks of a home, the last sentence that does; None if it tells a need in other words.

    ``key`` makes a name's key of its words.
    """
    best: ParsedUtterance | None = None
    refused = NOT_FIRST.match(text)
    if refused is not None:  # "not the cup on the table, the one at the sink"
        best = parse(refused[1], names, key)
        best = (
            replace(best, head=replace(best.head, relations=())) if best is not None and best.head is not None else None
        )
        text = text[refused.end() :]
    for sentence in sentences(NOT_THAT.sub("", text)) or sentences(text):
        asked = _sentence(sentence, names, key)
        before = best.head if best is not None and best.head is not None and not best.head.generic else None
        if (
            GO_THERE.search(sentence)
            and (asked is None or _pronoun(asked))
            and best is not None
            and best.head is not None
        ):
            if best.kind != "find":  # "is there a bed? Take me there"
                best = ParsedUtterance("find", best.head, need=best.head.said, direct=True)
            continue
        if asked is not None and before is not None and asked.kind in ABOUT and _pronoun(asked):
            asked = replace(asked, head=before)  # "the alarm clock … where?", "has anybody seen my phone? Where is it?"
        elif asked is not None and before is not None and asked.head is not None and asked.head.said in STANDS_FOR:
            asked = replace(asked, head=merged(before, asked.head), direct=True)  # "the remote! The one on the table"
        if asked is None or (best is not None and (asked.kind in ("thanks", "bye", "able") or _says_less(asked, best))):
            continue
        best = asked
    return best


def _says_less(asked: ParsedUtterance, before: ParsedUtterance) -> bool:
    """Whether a later sentence adds nothing: "how many chairs are there? How many is it?"."""
    plain = asked.head is None or asked.head.bare
    return (asked.kind == "find" and plain) or (asked.kind == before.kind and _pronoun(asked))


def _pronoun(asked: ParsedUtterance) -> bool:
    return asked.head is None or (asked.head.generic and asked.head.bare)


def _sentence(sentence: str, names: EntityVocabulary, key: Key) -> ParsedUtterance | None:
    said = WORD.findall(sentence)
    clauses = [k for k, part in enumerate(sentence.split(",")) for _ in WORD.findall(part)]
    text = " ".join(said)
    core = AFTER.sub("", BEFORE.sub("", text))
    for command, pattern in COMMANDS:
        if pattern.search(BEFORE.sub("", text)):
            return ParsedUtterance(command, need=text)
    mentions = _mentions(said, names, key)
    kind, by, at = _question(core)
    if kind == "find" and sentence.rstrip().endswith("?") and OPEN_STATEMENT.search(core) and not CUE.search(core):
        kind = "exists"  # "there is a cup in the kitchen?"
    start = len(text[: len(text) - len(BEFORE.sub("", text)) + at].split())  # the question's first word
    if kind in ("where", "list") and _tells_which(said, start, mentions):
        kind = FIND
    elif kind == "where" and any(m.start > start and not m.phrase.generic for m in mentions):
        mentions = [m for m in mentions if m.start > start]
    phrases, used = _joined(said, mentions)
    _put_in_rooms(said, mentions, phrases, used)
    phrases = _with_what_it_is(phrases)
    if kind == "list" and phrases and phrases[0].rooms is None and not phrases[0].generic:
        place = said[_last_verb(said, mentions[0].start) : mentions[0].start]
        told = (_relation(place[k:]) for k in range(len(place)))  # "lying around on the"
        relation = next((kind for kind in told if kind in RELATIONS.values()), "")
        if relation in RELATIONS.values():  # "what is on the table"
            phrases = [
                ReferringExpression(
                    "things", generic=True, plural=True, relations=(SpatialRelation(relation, phrases[0]),)
                )
            ]
    if kind == "compare":
        return _compared(said, mentions, by, text)
    head = _head(phrases, kind)
    if kind == "exists" and head is not None and (head.generic or head.rooms is not None) and NEED.search(core):
        kind = FIND  # "is there something to sit on in the kitchen"
        head = _head(phrases, kind)
    if kind == "find":
        if head is None:
            return None
        if PUTTING.search(text) and head.relations and head.relations[0].kind in ("on", "in"):
            target = head.relations[0].target
            head = target if target is not None and target.labels else head  # "throw my socks in the laundry basket"
        need = _need(said, used)
        first = next((m for m in mentions if m.phrase.rooms is None and not m.phrase.generic), None)
        before = " ".join(said[: first.start]) if first else text
        names_in = {i for m in mentions for i in range(m.start, m.end)}
        here = [i for i in range(len(said)) if first is None or clauses[i] == clauses[first.start]]
        rest = [said[i] for i in here if i not in used and i not in names_in]
        telling = [w for w in rest if w not in FILLERS and w not in POLITE and w not in AROUND and w not in MOST]
        return ParsedUtterance(
            "find",
            head,
            need=need,
            direct=bool(CUE.search(before)) or (len(telling) < 2 and not CUE.search(text) and not STATED.search(core)),
        )
    if kind in ("count", "exists") and head is None:
        unknown = _unknown(core)
        head = ReferringExpression(unknown) if unknown else None
    if kind == "far":
        return _distance(head, phrases, text)
    return ParsedUtterance(kind, head, need=text)


def _distance(head: ReferringExpression | None, phrases: Sequence[ReferringExpression], text: str) -> ParsedUtterance:
    """How far one object is from another: "the sofa from the desk", "it from the bed to the desk"."""
    other = next((p for p in phrases if p is not head), None)
    start = next((c.target for c in head.relations if c.kind == "from"), None) if head is not None else None
    if head is not None and start is not None:
        head = replace(head, relations=tuple(c for c in head.relations if c.kind != "from"))
        head, other = (start, other) if _pronoun(ParsedUtterance("far", head)) else (head, start)
    return ParsedUtterance("far", head, other, need=text)


def _need(said: Sequence[str], used: set[int]) -> str:
    """The words without what only says where, and without "that is" before that."""
    out = set(used)
    for i in sorted(used, reverse=True):
        while i - 1 not in used and i > 0 and said[i - 1] in WHICH_IS:
            i -= 1
            out.add(i)
    return " ".join(word for i, word in enumerate(said) if i not in out)


def _compared(said: Sequence[str], mentions: Sequence[_Mention], by: str, text: str) -> ParsedUtterance | None:
    """The names on both sides of "or" or "than"; what else is named is what the nearer one is nearer to."""
    middle = next(i for i, word in enumerate(said) if word in ("or", "than"))
    objs = [m for m in mentions if m.phrase.rooms is None and not m.phrase.generic]
    left, right = ([m for m in objs if (m.end <= middle) == before] for before in (True, False))
    if not left or not right:
        return None
    one, other = left[-1].phrase, right[0].phrase
    to = next((m.phrase for m in objs if m.phrase is not one and m.phrase is not other), None)
    clean = [replace(phrase, size="", most="") for phrase in (one, other)]
    return ParsedUtterance("compare", clean[0], clean[1], SIZES.get(by, by), text, to=to)


def _with_what_it_is(phrases: Sequence[ReferringExpression]) -> list[ReferringExpression]:
    """What is said of "it" or "one" belongs to what was named before: "my mug, I left it on the desk"."""
    told: list[ReferringExpression] = []
    for phrase in phrases:
        stands = phrase.said in STANDS_FOR and (phrase.definite or not phrase.said.startswith("one"))
        if told and stands and not phrase.bare and not told[-1].generic and told[-1].rooms is None:
            told[-1] = merged(told[-1], phrase)
        else:
            told.append(phrase)
    return told


def _put_in_rooms(
    said: Sequence[str], mentions: Sequence[_Mention], phrases: list[ReferringExpression], used: set[int]
) -> None:
    """Add the room of a phrase of its own: "in the kitchen, the lamp", "something to eat in the kitchen"."""
    objs = [p for p in phrases if p.rooms is None]
    rooms = [p for p in phrases if p.rooms is not None]
    if len(rooms) != 1 or not objs:
        return
    at = next((m for m in mentions if m.phrase.rooms == rooms[0].rooms and m.phrase.said == rooms[0].said), None)
    before = [word for word in said[: at.start] if word not in ARTICLES][-1:] if at else []
    if at is None or before not in (["in"], ["inside"], ["from"], ["within"], ["of"]):
        return
    first = phrases.index(objs[0])
    phrases[first] = replace(objs[0], relations=(SpatialRelation("in", rooms[0]), *objs[0].relations))
    phrases.remove(rooms[0])
    preposition = max((i for i in range(at.start) if said[i] == before[0]), default=at.start)
    used |= set(range(preposition, at.end))


def _last_verb(said: Sequence[str], end: int) -> int:
    """Where the words begin that stand between a question's verb and the first name: the place, "on the"."""
    start = end
    while (
        start > 0
        and (said[start - 1] in FILLERS or said[start - 1] in PLACING)
        and said[start - 1] not in ("is", "are")
    ):
        start -= 1
    return start


def _tells_which(said: Sequence[str], start: int, mentions: Sequence[_Mention]) -> bool:
    """Whether a question word only specifies an object: "the shelf where the statue is"."""
    word, after = said[start : start + 1], said[start + 1 : start + 2]
    named = any(m.end == start and m.phrase.rooms is None for m in mentions)
    if word == ["where"] and said[start - 1 : start] in (["to"], ["from"]):
        return True  # "closest to where I sleep"
    return named and (word == ["which"] or (word == ["where"] and (ARTICLES | SOMEBODY).issuperset(after)))


def _question(core: str) -> tuple[Kind, str, int]:
    """What a sentence asks to know, by what measure, and where in it the question begins."""
    for kind, pattern in QUESTIONS:
        found = pattern.search(core)
        if found:
            return kind, found[1] if pattern.groups and found[1] else "", found.start()
    return "find", "", 0


def _head(phrases: Sequence[ReferringExpression], kind: Kind) -> ReferringExpression | None:
    """The object that a sentence is about: the first that is one, and for a list also a room."""
    objs = [phrase for phrase in phrases if phrase.rooms is None]
    named = [phrase for phrase in objs if not phrase.generic or not phrase.bare]
    if kind == "list" and phrases:
        return next((p for p in objs if p.relations), phrases[-1])
    if kind == "find":
        asked = [p for p in named if not p.bare] or named
        return asked[0] if asked else phrases[0] if phrases else None
    return next(iter(named or objs or phrases), None)


def _unknown(core: str) -> str:
    """What is asked for, of which no name is known: "is there a unicorn"."""
    found = re.search(
        r"\b(?:how many|(?:is|are) there(?: any| a| an| some)?|any|have(?: a| an| any)"
        r"|see(?: a| an| any))((?: \w+){1,3}?)(?: (?:in|on|are|is|at|do|here|there)\b|$)",
        core,
    )
    return found[1].strip() if found else ""


def _mentions(said: Sequence[str], names: EntityVocabulary, key: Key) -> list[_Mention]:
    """Names of objects and rooms, longest first at each place, with the words before them."""
    found, i, free_from = [], 0, 0
    while i < len(said):
        for end in range(min(i + LONGEST, len(said)), i, -1):
            phrase = _named(said, i, end, names, key)
            if phrase is not None and i > 1 and said[i - 1] == "no":  # "tonight no television"
                i = free_from = end
                break
            if phrase is not None:
                found.append(_Mention(*_described(said, free_from, i, end, phrase)))
                i = free_from = end
                break
        else:
            i += 1
    return found


def _named(said: Sequence[str], start: int, end: int, names: EntityVocabulary, key: Key) -> ReferringExpression | None:
    words = " ".join(said[start:end])
    name = key(words)
    plural = said[end - 1] != name and said[end - 1].endswith("s") and not name.endswith("s")
    if (end - start == 1 and (words in COLOURS or words in SIDES)) or (end - start > 1 and said[start] in AROUND):
        return None
    if name in names.rooms:
        return ReferringExpression(words, rooms=names.rooms[name])
    room_first = end - start > 1 and any(key(" ".join(said[start:k])) in names.rooms for k in range(start + 1, end))
    if room_first and name not in map(key, names.objs.get(name, ())):
        return None  # the bathroom sink is a sink in the bathroom
    if name in names.objs:
        before = ["", "", *said[:start]][-2:]
        verb = before[1] in VERB_BEFORE or (before[1] == "to" and before[0] in WISHING | NEEDY)
        verb = verb or (start == 0 and words in VERBS and "".join(said[end : end + 1]) in ARTICLES)  # light the way
        verb = verb or (
            words in ("switch", "sink", "roll") and said[end : end + 1] in UP_OR_DOWN
        )  # switch on, sink into
        labels = names.objs[name]
        last = key(said[end - 1])
        if not labels and last in names.objs:  # a wine bottle is a bottle
            labels = frozenset(label for label in names.objs[last] if key(label) == last)
        return None if verb and end - start == 1 else ReferringExpression(words, labels, plural=plural)
    if (
        end - start == 1
        and words in GENERIC
        and not (words == "one" and end < len(said) and said[end] in ("of", "more"))
        and not (words == "it" and said[max(start - 1, 0)] == "of")
    ):
        return ReferringExpression(words, generic=True, plural=words in PLURAL)
    if words in ("other", "others", "another") and end == len(said):
        return ReferringExpression(words, generic=True, other=True)
    return None


def _described(
    said: Sequence[str], free_from: int, start: int, end: int, phrase: ReferringExpression
) -> tuple[int, int, ReferringExpression]:
    """A name with the adjectives and the article before it, and "on the left" after it."""
    i, colours = start, list[str]()
    while i > free_from:
        word = said[i - 1]
        if word in COLOURS:
            colours += COLOURS[word]
        elif word in MOST:
            phrase = replace(phrase, most=MOST[word])
        elif word in SIZES:
            phrase = replace(phrase, size=SIZES[word])
        elif word in ORDER and phrase.rooms is None:
            phrase = replace(phrase, order=ORDER[word])
        elif word in ("other", "another", "different", "else"):
            phrase = replace(phrase, other=True)
        elif (
            word in ARTICLES
            or (word == "of" and i - 1 > free_from and said[i - 2] in MOST)
            or word in ("all", "two", "three")
        ):
            phrase = replace(phrase, definite=phrase.definite or word in DEFINITE)
        else:
            break
        i -= 1
    if colours:
        phrase = replace(phrase, colours=tuple(dict.fromkeys(colours)))
    return i, end, phrase


def _joined(said: Sequence[str], mentions: Sequence[_Mention]) -> tuple[list[ReferringExpression], set[int]]:
    """The phrases with their relations, and the words that only say where."""
    phrases, used, k = list[ReferringExpression](), set[int](), len(mentions) - 1
    after: ReferringExpression | None = None  # the phrase to the right, with all that belongs to it
    spare: ReferringExpression | None = None  # the one after it, for "between"
    for k in range(len(mentions) - 1, -1, -1):
        here = mentions[k]
        phrase, gap_end = here.phrase, mentions[k + 1].start if k + 1 < len(mentions) else len(said)
        kind = _relation(said[here.end : gap_end])
        if after is not None and after.most in ("nearest", "farthest") and kind == "" and phrase.rooms is None:
            after, kind = replace(after, most=""), after.most  # "the one nearest the door"
        if kind == "to" and phrase.most in ("nearest", "farthest"):
            phrase, kind = replace(phrase, most=""), phrase.most
        gap, last = said[here.end : gap_end], 0
        if kind == "?" and phrase.said in NEEDY:  # "something to drink from on the table"
            ends = (k for k in range(1, len(gap)) if _relation(gap[k:]) in RELATIONS and gap[k - 1] in PLACING)
            last = next(ends, 0)
            kind = _relation(gap[last:]) if last else kind
        if after is not None and kind == "" and gap_end == here.end and phrase.rooms is not None:
            after = replace(after, relations=(SpatialRelation("in", phrase), *after.relations))  # the kitchen table
            used |= set(range(here.start, here.end))
            continue
        if after is not None and kind in RELATIONS.values() and not (phrase.rooms is not None):
            constraint = SpatialRelation(
                "in" if kind == "of" and after.rooms is not None else kind, after, spare if kind == "between" else None
            )
            if kind != "of" or after.rooms is not None:
                phrase = replace(phrase, relations=(constraint, *phrase.relations))
                used |= set(range(here.end + last, mentions[k + 1].end))
                spare, after = None, phrase
                continue
        if after is not None:
            phrases.insert(0, after)
        spare = after if _relation(said[here.end : gap_end]) == "and" else None
        after = _side(phrase, said[here.end : gap_end])
    if after is not None:
        phrases.insert(0, after)
    return phrases, used


def _side(phrase: ReferringExpression, rest: Sequence[str]) -> ReferringExpression:
    """ "The lamp on the left", "the lamp closest to me", "the one farthest away"."""
    text = " ".join(word for word in rest if word not in ("the", "that", "is", "which", "one"))
    found = SIDE.match(text)
    if not found:
        colour = re.match(r"(?:in |of )?(\w+)(?: colou?r)?$", text)
        return replace(phrase, colours=COLOURS[colour[1]]) if colour and colour[1] in COLOURS else phrase
    side = {"left": "leftmost", "right": "rightmost"}.get(found[1] or "", "") or {**SIZES, **MOST}.get(
        found[2] or found[3] or "", ""
    )
    return replace(phrase, most=side)


def _is_side(gap: Sequence[str], k: int) -> bool:
    """Whether "right" is a side, "to the right of", and not "right there"."""
    return gap[k + 1 : k + 2] in (["of"], ["side"])


def _relation(gap: Sequence[str]) -> str:
    """The relation that the words between two names tell; "" for no word, "?" for words that tell none."""
    words = [word for k, word in enumerate(gap) if word not in FILLERS or (word == "right" and _is_side(gap, k))]
    text = LEFT.sub("", " ".join(words))
    if text in RELATIONS:
        return RELATIONS[text]
    return text if text in ("", "to", "and") else "?"
