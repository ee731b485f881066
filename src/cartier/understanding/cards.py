"""Knowledge cards: read from TOML files, checked, and found again by the names that people and detectors use."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from cartier.contracts import ReasonerDefaults, optional
from cartier.errors import InputError, brief
from cartier.io.files import read_text
from cartier.labels import display_name, name_key, plain, words
from cartier.understanding.text import telling

SHIPPED = Path(__file__).with_name("cards")
BUILT = Path(__file__).with_name("cards.json")
"""The shipped cards, parsed and indexed, so that a first answer need not parse TOML and split 11,000 phrases."""
MAX_BYTES = 8_000_000
MOST_CARDS = 10_000
FIELDS = {
    "synonyms": (list, "a list of names"),
    "uses": (list, "a list of phrases"),
    "beside": (list, "a list of names"),
    "at_home": (bool, "true or false"),
}


@dataclass(frozen=True)
class Card:
    """The names of one kind of household object, its uses, and the places where it is usually kept."""

    name: str
    synonyms: tuple[str, ...]
    uses: tuple[str, ...]
    beside: tuple[str, ...]
    at_home: bool

    @property
    def names(self) -> tuple[str, ...]:
        return (self.name, *self.synonyms)


class Deck:
    """All cards, and the card of any name.

    ``telling[i][k]`` are the telling stems of card i's use k; ``used`` counts the words of all uses. ``built`` is what
    ``work_out`` made of the same cards before.
    """

    def __init__(self, cards: list[Card], built: dict[str, Any] | None = None) -> None:
        self.cards = cards
        built = built or work_out(cards)
        self.by_key: dict[str, int] = built["by_key"]
        self.telling: list[list[tuple[str, ...]]] = [[tuple(stems) for stems in uses] for uses in built["telling"]]
        self.used: Counter[str] = Counter(built["used"])

    def card_of(self, name: str) -> int | None:
        """The card of an object by its name, or by the end of its name: a ``blue kitchen chair`` is a chair."""
        parts = words(bare(name))
        tails = (self.by_key.get(name_key(" ".join(parts[i:]))) for i in range(len(parts)))
        return next((c for c in (self.by_key.get(name_key(name)), *tails) if c is not None), None)


def work_out(cards: list[Card]) -> dict[str, Any]:
    """What a deck knows besides its cards, as JSON has it."""
    return {
        "by_key": {name_key(n): i for i, card in enumerate(cards) for n in card.names},
        "telling": [[telling(use) for use in card.uses] for card in cards],
        "used": Counter(w for card in cards for use in card.uses for w in words(plain(use))),
    }


@cache
def bare(name: str) -> str:
    """A name as people say it, without its explanation: ``iron_(for_clothing)`` is an ``iron``."""
    return re.sub(r"\([^)]*\)", " ", display_name(name)).strip(" _") or name


def deck_of(reasoner: object) -> Deck:
    """The cards of a reasoner: its own, or those that ship."""
    own: Deck | None = optional(reasoner, ReasonerDefaults, "deck")
    return own or read_deck(SHIPPED)


@cache
def read_deck(path: Path = SHIPPED) -> Deck:
    """The deck of a card file, or of all card files of a folder. Raises InputError with one line when one is faulty."""
    built = _built() if path == SHIPPED else None
    return built or Deck(read_cards(path))


def read_cards(path: Path) -> list[Card]:
    """The cards of a TOML file, or of all in a folder. Raises InputError with one line when one is faulty."""
    files = sorted(path.glob("*.toml")) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path}: the folder holds no card file (*.toml)")
    owner: dict[str, str] = {}
    cards: list[Card] = []
    for file in files:
        cards.extend(_read(file, owner))
    if len(cards) > MOST_CARDS:
        raise InputError(f"{path}: holds {len(cards)} cards; at most {MOST_CARDS} are read")
    return cards


def source() -> str:
    """sha256 (hex) of the shipped card files, by which what was built of them is known to be of these."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(SHIPPED.glob("*.toml")))).hexdigest()


def _built() -> Deck | None:
    """The shipped deck as ``tools/build_cards.py`` left it; None if a card was changed since."""
    built = json.loads(BUILT.read_bytes()) if BUILT.is_file() else {}
    if built.get("sha256") != source():
        return None
    return Deck([Card(n, tuple(s), tuple(u), tuple(b), h) for n, s, u, b, h in built["cards"]], built)


def _read(path: Path, owner: dict[str, str]) -> list[Card]:
    try:
        tables = tomllib.loads(read_text(path, MAX_BYTES))
    except InputError as error:
        raise InputError(f"card file {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {brief(error)}") from error
    except (RecursionError, ValueError) as error:  # nested without end, or a number of thousands of digits
        raise InputError(f"{path} is no card file, or nested too deeply ({brief(error)})") from error
    if not tables:
        raise InputError(f"{path}: the card file holds no card; those in {SHIPPED.name}/ show what one looks like")
    cards = [_card(path, name, fields) for name, fields in tables.items()]
    for card in cards:
        for name in card.names:
            key = name_key(name)
            if key in owner:
                both = "twice" if owner[key] == card.name else f"that card {brief(owner[key])!r} has already"
                raise InputError(
                    f"{path}: card {brief(card.name)!r} has the name {brief(name)!r} {both}; "
                    "each name belongs to one card"
                )
            owner[key] = card.name
    return cards


def _card(path: Path, name: str, fields: Any) -> Card:
    where = f"{path}: card {brief(name)!r}"
    if not isinstance(fields, dict):
        raise InputError(f"{where}: a card is a table with uses, not a bare value")
    if not words(name.lower()):
        raise InputError(f"{where}: the name of a card holds letters or digits")
    for field, value in fields.items():
        if field not in FIELDS:
            raise InputError(f"{where}: there is no field {brief(field)!r}; a card has {', '.join(FIELDS)}")
        texts = value if isinstance(value, list) else []
        sort, form = FIELDS[field]
        if not isinstance(value, sort) or not all(isinstance(t, str) and words(t.lower()) for t in texts):
            raise InputError(f"{where}: {field} must be {form}")
    uses = tuple(fields.get("uses", ()))
    if not uses:
        raise InputError(f"{where}: has no uses; write 10 to 20 short phrases")
    names = tuple(fields.get("synonyms", ()))
    return Card(name, names, uses, tuple(fields.get("beside", ())), fields.get("at_home", True))
