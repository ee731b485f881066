"""Names of a home's entities: which listed names and rooms people's words may mean."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from functools import cache, lru_cache

from cartier.labels import name_key, plain, words
from cartier.spatial.expressions import EntityVocabulary
from cartier.types import Inventory
from cartier.understanding.cards import SHIPPED, Deck, bare, read_deck
from cartier.understanding.text import STOP

ROOMS = {
    "living room": (
        "lounge", "sitting room", "sittingroom", "telly room", "tv room", "day room", "living area", "parlour",
        "parlor", "front room",
    ),
    "bathroom": ("restroom", "washroom", "bath room", "shower room", "wet room", "toilet room", "wc", "en suite"),
    "hall": ("hallway", "corridor", "entrance", "passage", "entrance hall", "entryway", "foyer", "vestibule", "lobby"),
    "study": ("office", "home office", "workroom", "den"),
    "bedroom": ("bed room", "sleeping room", "bedchamber", "boudoir", "guest room", "spare room"),
    "kitchen": ("kitchenette", "cooking area", "kitchen area", "galley"), "dining room": ("dining area",),
}  # fmt: skip
SORTS = {
    name_key(word): frozenset(map(name_key, names.split(", ")))
    for word, names in {
        "seat": "sofa, couch, arm chair, chair, stool, bench, ottoman, desk chair, dining chair",
        "plant": "house plant, potted plant", "cup": "mug", "mug": "cup", "soap": "soap bar, soap bottle",
        "shelf": "shelving unit, bookcase, bookshelf", "cushion": "pillow",
        "bookcase": "shelving unit, shelf, bookshelf", "bookshelf": "shelving unit, shelf, bookcase",
        "light": "floor lamp, desk lamp, table lamp", "shower": "shower head, shower door, shower curtain",
        "figurine": "statue", "table lamp": "desk lamp", "desk lamp": "table lamp", "standing lamp": "floor lamp",
        "computer": "laptop, desktop", "rug": "carpet", "picture": "painting, poster", "bin": "garbage can, trash can",
        "saucepan": "pot, pan", "frying pan": "pan", "salad": "lettuce", "hob": "stove burner, stove",
        "stove": "stove burner, hob", "cooker": "stove burner, stove", "glass": "cup", "wall clock": "clock",
        "freezer": "fridge", "key": "key chain", "telephone": "cell phone, phone", "phone": "cell phone, telephone",
        "cell": "cell phone", "mobile": "cell phone", "throne": "toilet", "lavvy": "toilet", "privy": "toilet",
        "bog": "toilet", "john": "toilet", "khazi": "toilet", "ring": "stove burner", "hob ring": "stove burner",
        "vessel": "pot, vase, bowl",
        "burner": "stove burner", "telly stand": "tv stand", "tv bench": "tv stand", "telly box": "tv stand",
        "skillet": "pan", "sprayer": "spray bottle", "gaming chair": "desk chair", "swivel chair": "desk chair",
        "washing up liquid": "soap bottle, dish soap", "dish soap": "soap bottle", "bottle of soap": "soap bottle",
        "paper holder": "toilet paper hanger, paper towel roll", "loo roll holder": "toilet paper hanger",
        "washing basket": "laundry hamper", "basket": "laundry hamper", "weight": "dumbbell", "spud": "potato",
        "basketball": "basket ball", "ball": "basket ball, football", "stand": "tv stand, desk", "rack": "towel holder",
        "bedside cabinet": "side table", "nightstand": "side table", "bedside table": "side table",
    }.items()
}  # fmt: skip
"""General words, and the names of what they mean."""
NUMBERED = {"1": ("one", "first"), "2": ("two", "second"), "3": ("three", "third"), "4": ("four", "fourth")}
NO_ENDS = frozenset(words("top head bar stand can holder hanger machine paper control bag board"))


class _Things(Mapping[str, frozenset[str]]):
    """The listed labels that a key stands for: of that name, of names that end so ("lamp"), of a sort or of the
    same card. None of them for what is known and not listed."""

    def __init__(self, deck: Deck, names: Sequence[str], not_these: Container[str]) -> None:
        self._deck, self._without = deck, not_these
        self._own, self._ends = dict[str, set[str]](), dict[str, set[str]]()
        self._cards = dict[int, set[str]]()
        for name in names:
            parts = words(plain(bare(name)))
            self._own.setdefault(name_key(bare(name)), set()).add(name)
            card = deck.card_of(name)
            if card is not None:
                self._cards.setdefault(card, set()).add(name)
            for i in range(1, len(parts)):
                end = name_key(" ".join(parts[i:]))
                if end in deck.by_key and end not in NO_ENDS:  # a floor lamp is a lamp; a counter top is no top
                    self._ends.setdefault(end, set()).add(name)
        self._found: dict[str, frozenset[str]] = {}

    def __contains__(self, key: object) -> bool:
        known = key in self._own or key in self._ends or key in self._deck.by_key or key in SORTS
        return known and key not in self._without and key not in STOP

    def __getitem__(self, key: str) -> frozenset[str]:
        if key not in self._found:
            card = self._deck.by_key.get(key)
            of_card = self._cards.get(card, ()) if card is not None else ()
            self._found[key] = frozenset(self._own.get(key) or self._ends.get(key) or self.like(key) or of_card)
        return self._found[key]

    def like(self, key: str) -> frozenset[str]:
        """Listed names that may be meant where none has the very name: a mug for a cup, an arm chair for a chair."""
        sort = {name for own, listed in self._own.items() if own in SORTS.get(key, ()) for name in listed}
        return frozenset(self._ends.get(key, set()) | sort)

    def __iter__(self) -> Iterator[str]:
        return iter({*self._own, *self._ends, *self._deck.by_key})

    def __len__(self) -> int:
        return sum(1 for _ in self)


def lexicon(deck: Deck, inventory: Inventory) -> EntityVocabulary:
    """What may be named in a home: its objects by all names that their cards have, what it has not, and its rooms."""
    return _lexicon(deck, tuple(inventory.names), tuple((room.id, room.name, room.kind) for room in inventory.rooms))


@cache
def known_anywhere() -> EntityVocabulary:
    """The names that are known without a home."""
    return lexicon(read_deck(SHIPPED), Inventory.of(()))


@lru_cache(maxsize=16)
def _lexicon(deck: Deck, names: tuple[str, ...], rooms: tuple[tuple[int, str, str], ...]) -> EntityVocabulary:
    called: dict[str, tuple[int, ...]] = {}
    for kind, more in ROOMS.items():
        of_kind = tuple(number for number, _, room_kind in rooms if room_kind == kind)
        called |= dict.fromkeys(map(name_key, (kind, *more)), of_kind)
    called |= {name_key(name): (number,) for number, name, kind in rooms if name != kind}
    for number, name, _ in rooms:  # "bedroom one", "the first bedroom"
        kind, _, digit = name.rpartition(" ")
        for word in NUMBERED.get(digit, ()) if kind else ():
            called |= dict.fromkeys((name_key(f"{kind} {word}"), name_key(f"{word} {kind}")), (number,))
    objs = _Things(deck, names, called)
    return EntityVocabulary(objs, called, objs.like, frozenset(name_key(bare(card.name)) for card in deck.cards))
