"""Tokenised utterance: its words by sentence, the negated ones, and the names of objects in it."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator
from typing import NamedTuple

from cartier.labels import name_key, plain, words
from cartier.understanding.text import STOP

LONGEST_NAME = 4  # words
MOST_CHARACTERS = 8000  # the last ones, which hold the request
NEGATION_REACHES = 4  # words

MOTION = frozenset(words("back closer drive go head heading me move navigate next over ride roll straight us walk"))
SUBJECTS = frozenset(words("can could he i let lets might must please she should they we will would you"))
PLACING = frozenset(words("can could do does should to"))  # "where do my shirts go", "where should I put this book"
STORING = frozenset(words("belong drop go hang keep leave put store throw"))
VERBS = frozenset(
    words("book brush check clock comb fan hammer hang iron light mop plant ring screen switch tape vacuum watch water")
)
OBJECTS = frozenset(words("a an her his how if it me my on our that the their them this what whether your"))
LEADING = frozenset(words("and go just now please then"))
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
TOKEN = re.compile(r"[^\W_]+|[^\w\s]|_|\n")
ENDS = frozenset(".!?;:\n")


class Sentence(NamedTuple):
    """The words of one sentence and how much it counts (0 to 1).

    For each word, ``at`` is its place among the tokens, ``clauses`` its clause's start, ``negated`` if it is negated.
    """

    words: list[str]
    at: list[int]
    clauses: list[int]
    negated: list[bool]
    weight: float


class Utterance(NamedTuple):
    """A request: its tokens (words and punctuation, lower-case) and its sentences with content words."""

    tokens: list[str]
    sentences: list[Sentence]


class Mention(NamedTuple):
    """A name in the words: its key, wording, negation, tokens, and whether it is in the last sentence."""

    key: str
    said: str
    unwanted: bool
    start: int
    end: int
    last: bool


def listen(text: str, correct: Callable[[str], str] = str) -> Utterance:
    """Sentences of a request; the last, and those that wish for something, count more than stories of the past."""
    tokens = [t if t == "\n" else correct(t) for t in TOKEN.findall(plain(text[-MOST_CHARACTERS:]))]
    parts: list[list[int]] = [[]]
    for i, token in enumerate(tokens):
        if token in ENDS:
            parts.append([])
        elif token[0].isalnum() or token == ",":
            parts[-1].append(i)
    parts = [p for p in parts if any(tokens[i] not in STOP and tokens[i] != "," for i in p)]
    heard = []
    for n, part in enumerate(parts):
        said = " ".join(tokens[i] for i in part if tokens[i] != ",")
        wish = bool(WISH.search(said))
        weight = 1.0 if n == len(parts) - 1 else 0.93 if wish else 0.72 + 0.18 * n / len(parts)
        if PAST.search(said) and not wish:
            weight *= 0.7
        heard.append(_sentence(tokens, part, weight))
    return Utterance(tokens, heard)


def _sentence(tokens: list[str], part: list[int], weight: float) -> Sentence:
    """A negation reaches a few words further in its clause, not into the next."""
    sentence = Sentence([], [], [], [], weight)
    for clause in _clauses(tokens, part):
        here = [tokens[i] for i in clause]
        found = NEGATION.search(" ".join(here))
        first = len(" ".join(here)[: found.end()].split()) if found else len(here)
        sentence.clauses.extend([len(sentence.words)] * len(here))
        sentence.negated.extend(first <= i < first + NEGATION_REACHES for i in range(len(here)))
        sentence.words.extend(here)
        sentence.at.extend(clause)
    return sentence


def _clauses(tokens: list[str], part: list[int]) -> Iterator[list[int]]:
    clause: list[int] = []
    for i, after in zip(part, [*part[1:], None], strict=True):
        if tokens[i] in (",", "but", "because") or (tokens[i] == "and" and after and tokens[after] == "then"):
            yield clause
            clause = []
        if tokens[i] != ",":
            clause.append(i)
    yield clause


def mentions(heard: Utterance, known: Container[str]) -> Iterator[Mention]:
    """The known names in a request, longest first at each place: in ``toilet paper`` there is no ``toilet``."""
    for sentence in heard.sentences:
        yield from _mentions(sentence, known, sentence is heard.sentences[-1])


def _mentions(sentence: Sentence, known: Container[str], last: bool) -> Iterator[Mention]:
    said = sentence.words
    i = free_from = 0
    while i < len(said):
        for end in range(min(i + LONGEST_NAME, len(said)), i, -1):
            key, before, after = _key(said[i:end]), said[max(free_from, sentence.clauses[i]) : i], said[end:]
            if key in known and not all(w in STOP for w in said[i:end]) and not _is_verb(before, said[i], after):
                unwanted = sentence.negated[i] or _useless(said, i, end) or _put_away(before, after)
                yield Mention(key, " ".join(said[i:end]), unwanted, sentence.at[i], sentence.at[end - 1] + 1, last)
                i = free_from = end
                break
        else:
            i += 1


def _key(part: list[str]) -> str:
    """The key of a name as said; a ``box of tissues`` is a tissue box."""
    if len(part) >= 3 and part[1] in ("of", "for"):
        part = [*part[2:], part[0]]
    return name_key(" ".join(part))


def _put_away(before: list[str], after: list[str]) -> bool:
    """Whether the words ask where an object belongs: "where do my shirts go"."""
    asked = before[before.index("where") + 1 :] if "where" in before else []
    return bool(asked) and asked[0] in PLACING and not STORING.isdisjoint((*asked, *after))


def _is_verb(before: list[str], word: str, after: list[str]) -> bool:
    """Whether what may be a name is what is to be done: "we should book", "I want to iron", "check the oven"."""
    if before and (before[-1] in SUBJECTS or (before[-1] == "to" and (len(before) < 2 or before[-2] not in MOTION))):
        return True
    if word in MOTION and after[:1] and after[0] in MOTION | {"to"}:  # "roll over to the sofa"
        return True
    if not LEADING.issuperset(before[-1:]):
        return False
    return [word, *after[:1]] == ["switch", "off"] or (word in VERBS and OBJECTS.issuperset(after[:1] or ["?"]))


def _useless(said: list[str], start: int, end: int) -> bool:
    return said[max(start - 1, 0)] == "broken" or bool(USELESS.match(" ".join(said[end : end + 5])))
