"""A reply's way back to the list. Nothing that anybody says, a person or a model, can bring an object out of it."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from cartier.types import Selection, Status

MAX_REPLY_CHARS = 20_000
MAX_LINE_CHARS = 300
MAX_FURTHER = 3
MAX_ACCENTS = 30
NOTHING = "nothing"
"""What a model answers when no object of the list serves the person."""
SAY_AGAIN = "Could you say that in other words?"


def read_reply(reply: str, objects: Sequence[str], *, model: str = "", prompt: str = "") -> Selection | None:
    """A reply to any of the prompts as an answer, or None where it is none: rubbish, cut off, or not of the list.

    The last JSON object with a status or an object counts, as far as it is whole; what it names must be listed. A reply
    without one is free text, and ``parse_object`` looks for the name. Each of at most ``MAX_FURTHER`` further needs that
    names nothing in the list becomes a question.
    """
    text = reply.rpartition("</think>")[2][-MAX_REPLY_CHARS:]
    if "<think>" in text:  # cut off before the answer
        return None
    names = _names(tuple(objects))
    rows, is_cut = _rows(text)
    if not rows:
        stated = {status.lower() for status in _JSON_STATUS.findall(text)} or {"found"}
        if len(stated) > 1 or (is_cut and not _JSON_MEMBER.search(text)):
            return None
        rows = [{"status": stated.pop(), "object": parse_object(text, objects)}]
    first = _need(rows[-1], names, model)
    if first is None:
        return None
    listed = rows[-1].get("then")
    then: list[Selection] = []
    for row in [row for row in listed if isinstance(row, dict)][:MAX_FURTHER] if isinstance(listed, list) else []:
        need = _need(row, names, model) or no_answer("", model=model)
        if need.object is None or all(need.object != earlier.object for earlier in (first, *then)):
            then.append(need)  # models repeat themselves
    return replace(first, then=tuple(then), reply=reply, prompt=prompt)


def no_answer(reply: str, *, model: str = "", prompt: str = "") -> Selection:
    """What is said instead of a guess where ``read_reply`` found no answer."""
    reason = "the model's reply names nothing in the list"
    return Selection("clarify", reason=reason, question=SAY_AGAIN, reply=reply, model=model, prompt=prompt)


def _need(row: Mapping[str, Any], names: _Names, model: str) -> Selection | None:
    """One need as a model states it; None if it names what is not listed, or a status that there is not."""
    status, stated = row.get("status", "found"), row.get("object")
    status = status.strip().lower() if isinstance(status, str) else ""
    stated = stated[0] if isinstance(stated, list) and len(stated) == 1 else stated
    name = names.lookup(stated) if isinstance(stated, str) else None
    reason, question = _line(row.get("reason")), _line(row.get("question"))
    if status == "clarify":
        return Selection("clarify", reason=reason or "the model asks back", question=question or SAY_AGAIN, model=model)
    if status == "absent" or (status in ("found", "near") and name == NOTHING and name not in names.listed):
        return Selection("absent", reason=reason or "the model says that nothing here serves this", model=model)
    if status not in ("found", "near") or name is None:
        return None
    chosen: Status = "near" if status == "near" else "found"
    return Selection(chosen, name, reason or "chosen by the model", candidates=((name, 1.0),), model=model)


def _line(value: object) -> str:
    """What a model says to the person: one short printable line, or nothing if it is no text."""
    text = value if isinstance(value, str) else ""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:MAX_LINE_CHARS]


def _rows(text: str) -> tuple[list[dict[str, Any]], bool]:
    """The JSON objects in a text that state a status or an object, and whether the last object of all is cut off."""
    rows, at, is_cut = [], 0, False
    while not is_cut and (begin := _JSON_BEGIN.search(text, at)):
        row, at, is_cut = _members(text, begin.start() + 1)
        if "status" in row or "object" in row:
            rows.append(row)
    return rows, is_cut


def _members(text: str, at: int) -> tuple[dict[str, Any], int, bool]:
    """The whole members of a JSON object from behind its brace, where they end, and whether the object is cut off there."""
    row: dict[str, Any] = {}
    while member := _JSON_KEY.match(text, at):
        try:
            row[member[1]], at = _DECODER.raw_decode(text, member.end())
        except (ValueError, RecursionError):
            return row, at, True
    closing = _JSON_END.match(text, at)
    return row, closing.end() if closing else at, closing is None


def parse_object(reply: str, objects: Sequence[str]) -> str | None:
    """The listed object that a reply names, NOTHING if it says that nothing serves, or None if it names neither.

    The first of these that applies decides:

    1. A JSON member "object", anywhere: its value must be a listed name. One that is cut off is no answer.
    2. The whole reply, its last line or its first sentence is a name, bare or in quotes.
    3. One single name stands in quotes or bold: "... the object called `Bed'".
    4. The text holds one single name. One right after "not" does not count.
    5. One single name follows right after "go to the", "choose", "the answer is" or the like.
    6. The last sentence with a name holds one single name: who thinks aloud decides at the end.

    Else None: of two names that nothing tells apart, either would be a guess. Upper case, underscores, CamelCase and a
    plural's s do not matter where that is unambiguous, and "coffee machine" is never taken for "machine".
    """
    reply = reply.rpartition("</think>")[2][-MAX_REPLY_CHARS:].strip()
    names = _names(tuple(objects))
    if "<think>" in reply:  # cut off before the answer
        return None
    if _JSON_MEMBER.search(reply):
        stated = [m[2] for m in _JSON_OBJECT.finditer(" ".join(reply.split()))]
        return names.lookup(_unescaped(stated[-1])) if stated else None
    sentences = [s for s in _SENTENCE_END.split(reply) if s.strip()]
    first = re.match(r"[^.!?;:\n]+(?![^.!;:\n])", reply)  # "Bed? No, the sofa." decides nothing
    for part in (reply, reply.rpartition("\n")[2], first[0] if first else ""):
        if (name := names.lookup(part)) is not None:
            return name
    named = [names.mentions(sentence) for sentence in sentences]
    quoted = [name for q in _QUOTED.findall(reply) if (name := names.lookup(q)) is not None]
    told = [name for sentence in named for name, chosen in sentence if chosen]
    everywhere = [name for sentence in named for name, _ in sentence]
    last = next(([name for name, _ in sentence] for sentence in reversed(named) if sentence), [])
    return next((group[0] for group in (quoted, everywhere, told, last) if len(set(group)) == 1), None)


def parse_list(reply: str, most: int = 5) -> list[str]:
    """The names in a comma-separated or numbered reply, cleaned, each once."""
    parts = re.split(r"[,\n;]", reply[:MAX_REPLY_CHARS])
    names = (_LIST_MARKS.sub("", part).strip("\"'` ") for part in parts)
    return list(dict.fromkeys(name.lower() for name in names if 0 < len(name) <= 60))[:most]


# Each pattern takes time that grows with a text's length and no faster: what may be long is possessive (*+, ++), and a run
# is entered at its beginning only.
_DECODER = json.JSONDecoder()
_SENTENCE_END = re.compile(r"(?<![.!?;:])[.!?;:]++(?:\s++|$)|\n++")
_LIST_MARKS = re.compile(r"^[\s\d.)*\-]++|(?<![\s.])[\s.]++$")
_JSON_BEGIN = re.compile(r"\{(?=\s*\")")
_JSON_KEY = re.compile(r'\s*+(?:,\s*+)?"((?:[^"\\]|\\.)*+)"\s*+:\s*+')
_JSON_END = re.compile(r"\s*+(?:,\s*+)?\}")
_JSON_MEMBER = re.compile(r"[\"']object[\"'] ?:")
_JSON_STATUS = re.compile(r"""[\"']status[\"']\s*:\s*[\"'](\w+)[\"']""")
_JSON_OBJECT = re.compile(r"""[\"']object[\"'] ?: ?\[? ?([\"'])((?:\\.|(?!\1)[^\\])*)\1""")
_QUOTED = re.compile(r"(?<![`'\"“”‘’«*])[`'\"“‘«*]{1,3}([^`'\"“”‘’«»*\n]{1,80})[`'\"”’»*]")
_CHOSEN = re.compile(
    r"(?:\b(?:choose|choosing|pick|select|suggest|recommend|called|named|(?:go|drive|head|over) to|send \w+(?: \w+)? to)"
    r"|\b(?:answer|choice|object|option) (?:is|would be))(?: the| a| an| object)* $"
)
_REFUSED = re.compile(
    r"\b(?:no|(?:not|never|than|except|without|avoid|instead of)(?: (?:go|going|to|use|choose|pick|the|a|an))*) $"
)
_NOTHINGS = ("nothing", "none", "none of these", "none of them")
_PLURALS = {"knives": "knife", "shelves": "shelf", "loaves": "loaf", "leaves": "leaf", "scarves": "scarf"}


class _Names:
    """The listed names, to be found again in what a model writes. A form that two of them share names neither."""

    def __init__(self, objects: Sequence[str]) -> None:
        self.exact: dict[str, str | None] = {}
        self.folded: dict[str, str | None] = {}
        self.joined: dict[str, str | None] = {}
        self.listed = dict.fromkeys(objects)
        for name in self.listed:
            words = _words(name)
            if words:
                self.exact.setdefault(" ".join(words), name)
                for table, key in ((self.folded, _fold(words)), (self.joined, _fold(words).replace(" ", ""))):
                    table[key] = None if table.get(key, name) != name else name
        self.lengths = sorted({1, *(len(_words(name)) for name in self.listed)} - {0}, reverse=True)

    def lookup(self, value: str) -> str | None:
        """The name that a text is, not merely holds; NOTHING for a word that says so and is not itself listed."""
        value = value.strip()
        if value in self.listed:
            return value
        words = _words(value)
        for said in (words, words[1:] if words[:1] in (["the"], ["a"], ["an"]) else []):
            if (name := self._find(said) or self.joined.get(_fold(said).replace(" ", ""))) is not None:
                return name
        return NOTHING if " ".join(words) in _NOTHINGS else None

    def mentions(self, sentence: str) -> list[tuple[str, bool]]:
        """The names in a sentence in their order, and whether a word of choosing stands right before each."""
        words, found, at = _words(sentence), [], 0
        while at < len(words):
            length, name = next(
                ((n, name) for n in self.lengths if (name := self._find(words[at : at + n])) is not None), (1, None)
            )
            before = " ".join(words[max(0, at - 8) : at]) + " "
            if name is not None and not _REFUSED.search(before):
                is_offer = words[at + length : at + length + 1] == ["or"]
                found.append((name, bool(_CHOSEN.search(before)) and not is_offer))
            at += length
        return found

    def _find(self, words: list[str]) -> str | None:
        one_word = self.joined.get(_fold(words)) if len(words) == 1 else None
        return self.exact.get(" ".join(words)) or self.folded.get(_fold(words)) or one_word


@lru_cache(maxsize=8)
def _names(objects: tuple[str, ...]) -> _Names:
    return _Names(objects)


def _words(text: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", unicodedata.normalize("NFKC", _stream_safe(text)))
    return re.sub(r"[\W_]+", " ", spaced.casefold()).split()


def _stream_safe(text: str) -> str:
    """A text without the accents beyond 30 on one letter (Unicode's annex 15): to sort them takes the square of their number."""
    if text.isascii():
        return text
    kept, accents = [], 0
    for character in text:
        accents = accents + 1 if unicodedata.combining(character) else 0
        if accents <= MAX_ACCENTS:
            kept.append(character)
    return "".join(kept)


def _fold(words: list[str]) -> str:
    return " ".join(map(_singular, words))


def _singular(word: str) -> str:
    if len(word) < 4 or not word.endswith("s") or word.endswith(("ss", "us", "is")):
        return word
    if word.endswith("ies") and len(word) > 4:
        return word[:-3] + "y"
    return _PLURALS.get(word, word[:-2] if word.endswith(("xes", "ches", "shes", "sses")) else word[:-1])


def _unescaped(literal: str) -> str:
    try:
        return str(json.loads(f'"{literal}"'))
    except ValueError:  # Python's quotes instead of JSON's
        return literal
