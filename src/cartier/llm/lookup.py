"""Lookup of names, objects and rooms of a home in a text, in any spelling."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from cartier.types import Inventory, MapObject

MAX_ACCENTS = 30
MOST_TENTATIVE, LEAST_TENTATIVE = 30, 0.1  # how many tentative objects are listed, and from which probability
NOTHING = "nothing"
"""The model's answer when no listed object serves the person."""

_CHOSEN = re.compile(
    r"(?:\b(?:choose|choosing|pick|select|suggest|recommend|called|named|(?:go|drive|head|over) to"
    r"|send \w+(?: \w+)? to)"
    r"|\b(?:answer|choice|object|option) (?:is|would be))(?: the| a| an| object)* $"
)
_REFUSED = re.compile(
    r"\b(?:no|(?:not|never|than|except|without|avoid|instead of)(?: (?:go|going|to|use|choose|pick|the|a|an))*) $"
)
_NOTHINGS = ("nothing", "none", "none of these", "none of them")
_PLURALS = {"knives": "knife", "shelves": "shelf", "loaves": "loaf", "leaves": "leaf", "scarves": "scarf"}


class Pick(NamedTuple):
    """The meaning of a text: a listed name or NOTHING, with an object's id; or a room's name and its id."""

    name: str
    object_id: int | None = None
    room: int | None = None


class Listed:
    """All entities that a prompt may list: names, the numbers of objects, and rooms."""

    def __init__(self, inventory: Inventory) -> None:
        self.names = names_of(tuple(inventory.names))
        self.objects: dict[int, MapObject] = {obj.id: obj for obj in inventory.objects if obj.confirmed}
        self._tentative = {obj.id: obj for obj in tentative(inventory)}
        self._tentative_names = names_of(tuple(sorted({obj.label for obj in self._tentative.values()})))
        self.rooms = {room.id: room.name for room in inventory.rooms}

    def find(self, text: str) -> Pick | None:
        """The meaning of a whole text. None for an unknown name, an unknown number, or the number of another name."""
        text = text.strip()
        if text in self.names.listed:
            return Pick(text)
        name, mark, number = text.rpartition("#")
        if mark and _is_number(number):
            for objects, names in ((self.objects, self.names), (self._tentative, self._tentative_names)):
                if (obj := objects.get(int(number))) is not None:
                    return Pick(obj.label, obj.id) if names.lookup(name) == obj.label else None
            return None
        name, mark, number = text.removesuffix(")").rpartition(" (room ")
        if mark and _is_number(number):
            room = int(number)
            return Pick(name, room=room) if self.rooms.get(room) == name else None
        if (listed := self.names.lookup(text)) is not None:
            return Pick(listed)
        rooms = [room for room, name in self.rooms.items() if name.casefold() == text.casefold()]
        return Pick(self.rooms[rooms[0]], room=rooms[0]) if len(rooms) == 1 else None


def tentative(inventory: Inventory) -> list[MapObject]:
    """The likeliest tentative object of each name that no confirmed one has, likeliest first."""
    names, best = set(inventory.names), dict[str, MapObject]()
    for obj in sorted(inventory.objects, key=lambda obj: (-obj.probability, obj.id)):
        if not obj.confirmed and obj.probability >= LEAST_TENTATIVE and names.isdisjoint((obj.label, *obj.names)):
            best.setdefault(obj.label, obj)
    return list(best.values())[:MOST_TENTATIVE]


class Names:
    """The listed names, to be found in a model's reply. A form that two names share matches neither."""

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
        """The name that a whole text is; NOTHING for a word of that meaning that is not itself listed."""
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
def names_of(objects: tuple[str, ...]) -> Names:
    """The names of a list; the last few lists are kept."""
    return Names(objects)


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def _words(text: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", unicodedata.normalize("NFKC", _stream_safe(text)))
    return re.sub(r"[\W_]+", " ", spaced.casefold()).split()


def _stream_safe(text: str) -> str:
    """A text with at most 30 accents per letter (Unicode's annex 15): sorting more takes quadratic time."""
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
