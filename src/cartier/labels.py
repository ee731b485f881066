"""Labels and names of objects and rooms: display form, references, plurals, and keys of equal names."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

MAX_NAME_CHARS = 200
"""The longest name of an object in any file; the longest of LVIS has 60 characters."""
WORD = re.compile(r"[^\W_]+")
IRREGULAR_PLURALS = {
    "feet": "foot", "teeth": "tooth", "knives": "knife", "shelves": "shelf", "leaves": "leaf", "loaves": "loaf",
    "mice": "mouse",
}  # fmt: skip
PLURAL_ONLY = frozenset([
    "clothes", "glasses", "goggles", "headphones", "jeans", "news", "pants", "scissors", "series", "shorts", "tights",
    "trousers",
])  # fmt: skip


def display_name(label: str) -> str:
    """A detector's label as people write it: ``CoffeeMachine`` and ``coffee_machine`` become ``coffee machine``."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", unicodedata.normalize("NFC", label))
    words = re.sub(r"[\s_]+", " ", "".join(c if c.isprintable() else " " for c in spaced)).strip()
    return words.lower()


def object_ref(label: str, number: int) -> str:
    """How prompts, replies and the robot's turns refer to one object: ``cup #12``."""
    return f"{label} #{number}"


def room_ref(name: str, number: int) -> str:
    """How they refer to a room: ``kitchen (room 3)``."""
    return f"{name} (room {number})"


def number_of(count: int, noun: str) -> str:
    """``1 object``, ``2 objects``; for nouns whose plural takes an s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def plain(text: str) -> str:
    """Lower-case text in plain letters."""
    lower = text.lower().replace("’", "'")
    if lower.isascii():
        return lower
    folded = unicodedata.normalize("NFKD", lower)
    return "".join(c for c in folded if not unicodedata.combining(c))


def words(text: str) -> list[str]:
    """The words of a lower-case text; ``i'd`` becomes ``i d`` and ``don't`` becomes ``don t``."""
    return WORD.findall(text)


@lru_cache(maxsize=1 << 14)
def singular(word: str) -> str:
    """A noun without its plural ending; no other ending is removed, so ``painting`` is not ``paint``."""
    if word in IRREGULAR_PLURALS:
        return IRREGULAR_PLURALS[word]
    if word.endswith("shelves"):
        return word.removesuffix("ves") + "f"
    if word in PLURAL_ONLY or len(word) < 4 or not word.endswith("s") or word.endswith(("ss", "us", "is")):
        return word
    if word.endswith("ies"):
        return word[:-1] if word in ("cookies", "brownies", "smoothies", "movies") else word[:-3] + "y"
    return word[:-2] if word.endswith(("shes", "ches", "sses", "xes", "toes")) else word[:-1]


@lru_cache(maxsize=1 << 14)
def name_key(name: str) -> str:
    """A key that spellings of one name share: ``Bath Tubs``, ``bath-tub`` and ``bathtub`` all give ``bathtub``."""
    parts = [singular(w) for w in words(plain(name))]
    if len(parts) > 1 and parts[-1] == "glasses":  # ``glasses`` alone are spectacles
        parts[-1] = "glass"
    return "".join(parts)
