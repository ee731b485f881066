"""Knowledge cards: read from a TOML file, checked, and indexed by their words."""

from __future__ import annotations

import math
import re
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from cartier.errors import InputError
from cartier.reasoners._words import STOP, name_key, stem, words

SHIPPED = Path(__file__).with_name("cards.toml")
MAX_BYTES = 8_000_000
RAREST = 5.0  # idf of a word that one card knows, whatever the number of cards
FIELDS = {
    "names": (list, "a list of names"),
    "phrases": (list, "a list of phrases"),
    "kind": (str, "a text"),
    "at_home": (bool, "true or false"),
}


@dataclass(frozen=True)
class Card:
    """What one sort of household thing is called and serves; cards of one ``kind`` serve a need alike."""

    name: str
    names: tuple[str, ...]
    phrases: tuple[str, ...]
    kind: str
    at_home: bool


@dataclass(frozen=True)
class Phrase:
    """A phrase's telling stems and their summed idf; ``card`` is an index into the deck."""

    card: int
    text: str
    stems: tuple[str, ...]
    mass: float


class Deck:
    """Cards with an inverted index over the stems of their phrases."""

    def __init__(self, cards: list[Card]) -> None:
        self.cards = cards
        self.by_key = {name_key(n): i for i, card in enumerate(cards) for n in (card.name, *card.names)}
        texts = [(i, text, telling(text)) for i, card in enumerate(cards) for text in card.phrases]
        knowing: defaultdict[str, set[int]] = defaultdict(set)
        for i, _, stems in texts:
            for s in stems:
                knowing[s].add(i)
        self.stems = [frozenset().union(*(telling(p) for p in card.phrases)) for card in cards]
        scale = RAREST / math.log((len(cards) + 1) / 1.5)
        self.idf = {s: scale * math.log((len(cards) + 1) / (len(known) + 0.5)) for s, known in knowing.items()}
        self.phrases = [Phrase(i, text, stems, sum(self.idf[s] for s in stems)) for i, text, stems in texts]
        self.postings: defaultdict[str, list[int]] = defaultdict(list)
        for p, phrase in enumerate(self.phrases):
            for s in phrase.stems:
                self.postings[s].append(p)

    def card_of(self, name: str) -> int | None:
        """The card of a thing by its name, or by the end of its name: a ``blue kitchen chair`` is a chair."""
        parts = words(bare(name))
        tails = (self.by_key.get(name_key(" ".join(parts[i:]))) for i in range(len(parts)))
        return next((c for c in (self.by_key.get(name_key(name)), *tails) if c is not None), None)


def bare(name: str) -> str:
    """A name without its explanation: ``iron_(for_clothing)`` is an ``iron``."""
    return re.sub(r"\([^)]*\)", " ", name.lower()).strip(" _") or name


@lru_cache(maxsize=1 << 14)
def telling(phrase: str) -> tuple[str, ...]:
    """The stems of the words that tell something, each once, in their order."""
    return tuple(dict.fromkeys(stem(w) for w in words(phrase.lower()) if w not in STOP))


@cache
def read_deck(path: Path) -> Deck:
    """The deck of a card file. Raises InputError with one line when the file is not what it should be."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: a card file holds at most {MAX_BYTES // 1_000_000} MB")
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: the card file cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: the card file is not UTF-8 text") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: the card file is nested too deeply") from error
    if not tables:
        raise InputError(f"{path}: the card file holds no card; the head of {SHIPPED.name} shows what one looks like")
    cards = [_card(path, name, fields) for name, fields in tables.items()]
    _check_names(path, cards)
    return Deck(cards)


def _card(path: Path, name: str, fields: Any) -> Card:
    where = f"{path}: card {name!r}"
    if not isinstance(fields, dict):
        raise InputError(f"{where}: a card is a table with phrases, not a bare value")
    for field, value in fields.items():
        if field not in FIELDS:
            raise InputError(f"{where}: there is no field {field!r}; a card has {', '.join(FIELDS)}")
        texts = value if isinstance(value, list) else []
        sort, form = FIELDS[field]
        if not isinstance(value, sort) or not all(isinstance(t, str) and words(t) for t in texts):
            raise InputError(f"{where}: {field} must be {form}")
    phrases = tuple(fields.get("phrases", ()))
    if not phrases:
        raise InputError(f"{where}: has no phrases; write 10 to 20 short ones")
    empty = next((p for p in phrases if not telling(p)), None)
    if empty is not None:
        raise InputError(f"{where}: the phrase {empty!r} holds no telling word")
    return Card(name, tuple(fields.get("names", ())), phrases, fields.get("kind", name), fields.get("at_home", True))


def _check_names(path: Path, cards: list[Card]) -> None:
    owner: dict[str, str] = {}
    for card in cards:
        for name in (card.name, *card.names):
            key = name_key(name)
            if key in owner:
                both = "twice" if owner[key] == card.name else f"that card {owner[key]!r} has already"
                raise InputError(
                    f"{path}: card {card.name!r} has the name {name!r} {both}; each name belongs to one card"
                )
            owner[key] = card.name
