"""What was said: sentences by how much they count, words that are negated, and the names of things that occur."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from typing import NamedTuple

from cartier.reasoners._words import STOP, name_key, sentences, words

ASKED_FOR, MENTIONED = 0.95, 0.4  # how strongly a name that is asked for, or merely occurs, speaks for its thing
LONGEST_NAME = 4  # words
MOST_CHARACTERS = 8000  # the last ones, for there the request is
NEGATION_REACHES = 4  # words

CUES = frozenset(
    words("""bring drive fetch find get give go grab hand head heading locate look looking move navigate need pass prefer
    reach roll search see show stand take use visit want where wheres""")
)
MOTION = frozenset(words("back closer drive go head heading me move navigate next over ride roll straight us walk"))
JOINING = frozenset(words("and or the a an my some your our"))  # "the cup or the bowl"
SUBJECTS = frozenset(words("can could he i let lets might must please she should they we will would you"))
PLACING = frozenset(words("can could do does should to"))  # "where do my shirts go", "where should I put this book"
STORING = frozenset(words("belong drop go hang keep leave put store throw"))
WISH = re.compile(
    r"\b(need|want|please|where|should|must|fancy|have to|got to|lets?|(would|d) (like|love)|(can|could) (you|i|we))\b"
)
PAST = re.compile(r"\b(yesterday|ago|used to|last (week|night|month|year|time|summer|winter))\b")
NEGATION = re.compile(
    r"\bnot (?:the|a|an|my|that|this|in|on|at|to the|into|with)\b"
    r"|\b(?:do not|don t|dont|never) (?:want|need|like|bring|take|use|go|get|give|show)\b(?! to\b)"
    r"|\b(?:instead of|rather than|except|anything but|other than)\b"
)
USELESS = re.compile(
    r"(?:is|are|was|s)(?: \w+)? (?:broken|dirty|empty|taken|occupied|dead|blocked|clogged)\b"
    r"|(?:does not|doesn t|will not|won t|do not|don t) work|(?:is not|isn t|are not|aren t) working"
)


class Sentence(NamedTuple):
    """The words of one sentence and how much it counts (0 to 1); for each word where its clause starts, and if it is negated."""

    words: list[str]
    clauses: list[int]
    negated: list[bool]
    weight: float


class Mention(NamedTuple):
    """A name that occurred: its key, the words as said, how strongly it was asked for, whether it was turned down."""

    key: str
    said: str
    score: float
    unwanted: bool


def listen(text: str, importance: float = 1.0) -> list[Sentence]:
    """Sentences of a request; the last, and those that wish for something, count more than stories of the past."""
    heard = []
    parts = [p for p in sentences(text[-MOST_CHARACTERS:]) if not all(w in STOP for w in words(p))]
    for i, part in enumerate(parts):
        plain = " ".join(words(part))
        wish = bool(WISH.search(plain))
        weight = 1.0 if i == len(parts) - 1 else 0.93 if wish else 0.72 + 0.18 * i / len(parts)
        if PAST.search(plain) and not wish:
            weight *= 0.7
        heard.append(_sentence(part, weight * importance))
    return heard


def _sentence(text: str, weight: float) -> Sentence:
    """A negation reaches a few words further in its clause, not into the next."""
    sentence = Sentence([], [], [], weight)
    for clause in re.split(r",|\bbut\b|\bbecause\b|\band then\b", text):
        here = words(clause)
        found = NEGATION.search(" ".join(here))
        first = len(" ".join(here)[: found.end()].split()) if found else len(here)
        sentence.clauses.extend([len(sentence.words)] * len(here))
        sentence.negated.extend(first <= i < first + NEGATION_REACHES for i in range(len(here)))
        sentence.words.extend(here)
    return sentence


def mentions(sentence: Sentence, known: Container[str]) -> Iterator[Mention]:
    """The known names in a sentence, longest first at each place: in ``toilet paper`` there is no ``toilet``."""
    i, free_from, strength = 0, 0, 0.0
    while i < len(sentence.words):
        for end in range(min(i + LONGEST_NAME, len(sentence.words)), i, -1):
            part = sentence.words[i:end]
            key = name_key(" ".join(part))
            if key in known and not all(w in STOP for w in part):
                if not (strength and free_from < i and JOINING.issuperset(sentence.words[free_from:i])):
                    strength = _asked_for(sentence.words, max(free_from, sentence.clauses[i]), i, end) * sentence.weight
                yield Mention(key, " ".join(part), strength, sentence.negated[i] or _useless(sentence.words, i, end))
                i = free_from = end
                break
        else:
            i += 1


def _asked_for(said: list[str], free_from: int, start: int, end: int) -> float:
    """How strongly a name is asked for: ``take me to the sofa``, but not ``the book on the sofa`` or ``to book``."""
    before = said[free_from:start]
    if before and (before[-1] in SUBJECTS or (before[-1] == "to" and (len(before) < 2 or before[-2] not in MOTION))):
        return MENTIONED / 3  # a verb: "we should book", "I want to iron"
    if all(w in STOP for w in said[:start] + said[end:]):
        return ASKED_FOR
    cue = next((i for i in range(len(before) - 1, -1, -1) if _is_cue(before, i)), None)
    if cue is None:
        return MENTIONED
    between = before[cue + 1 :]
    if before[cue] == "where" and between and between[0] in PLACING and STORING & {*between, *said[end:]}:
        return MENTIONED
    other = [w for w in between if w not in STOP]
    if not other:
        return ASKED_FOR
    return MENTIONED if "to" in between or len(other) > 2 else ASKED_FOR - 0.1 * len(other)


def _is_cue(said: list[str], i: int) -> bool:
    if said[i] in ("like", "love"):
        return i > 0 and said[i - 1] in ("d", "would")
    if said[i] == "have":
        return i > 1 and said[i - 1] in ("i", "we") and said[i - 2] in ("can", "could", "may")
    return said[i] in CUES


def _useless(said: list[str], start: int, end: int) -> bool:
    return said[max(start - 1, 0)] == "broken" or bool(USELESS.match(" ".join(said[end : end + 5])))
