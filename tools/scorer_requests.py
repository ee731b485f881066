"""Training requests of the embedded reasoner's scorer: texts, lists of objects to choose from, and variations.

Variations make more of the requests and of the cards: a story of somebody else's put before, a thing turned down, a
name asked for among others. Each is written down here as a frame, none is taken from a request that validates.
"""

from __future__ import annotations

import json
import random
import re
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from cartier.labels import display_name
from cartier.understanding.cards import Deck
from cartier.understanding.text import STOP

REQUESTS = Path(__file__).parent / "requests"
WRITTEN = Path(__file__).parent / "understanding" / "written"
NOT_LEARNED = ("hana_1", "hana_2", "hana_3", "olga_12", "pavel_12", "tara_2", "kara_1", "arno_1", "bodo_1")
"""Development lines of the parser (understanding/README.md)."""
FRAMES = json.loads((Path(__file__).parent / "scorer_frames.json").read_text(encoding="utf-8"))
REMOVED = 0.06  # of the requests meet a list from which all that serves is gone
NO_THINGS = {"ContainerFull", "Dirt", "MiscTableObject", "MassObjectSpawner", "TargetCircle", "Floor", "ScreenFrame"}


@dataclass(frozen=True)
class Request:
    """Words and what serves them: for each need in turn the cards of which any is right; ``avoid`` are distractors."""

    text: str
    kind: str
    style: str
    needs: tuple[tuple[int, ...], ...]
    avoid: tuple[int, ...]

    @property
    def right(self) -> frozenset[int]:
        return frozenset(card for need in self.needs for card in need)


@dataclass(frozen=True)
class Sample:
    """Words to train on: the cards that serve them (none: nothing does), distractors, cards that must not be listed.

    ``use`` is (card, place) where the words are, or end with, a use of that card, which must then not be matched.
    """

    text: str
    right: tuple[int, ...]
    avoid: tuple[int, ...] = ()
    unlisted: tuple[int, ...] = ()
    use: tuple[int, int] | None = None


def read_requests(deck: Deck) -> list[Request]:
    """All requests, by style (the file's name). Fails on a name without a card."""
    found = []
    for file in sorted(REQUESTS.glob("*.jsonl")):
        for line in file.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            groups = row["accept"] if row["kind"] == "several" else [row["accept"]] if row["accept"] else []
            needs = tuple(tuple(_card(deck, name) for name in group) for group in groups)
            avoid = tuple(_card(deck, name) for name in row["avoid"])
            found.append(Request(row["text"], row["kind"], file.stem, needs, avoid))
    return found


def written_needs(deck: Deck) -> list[Request]:
    """The needs among the marked lines of ``understanding/written``, whose answers are objects of a generated home."""
    from cartier_bench.marked_lines import read
    from cartier_bench.true_home import perfect_map

    found = []
    for file in sorted(WRITTEN.glob("*.txt")):
        for line in read(file) if file.stem not in NOT_LEARNED else ():
            if line.acts != ("need",) or line.context or any(line.rules):
                continue
            labels = {obj.id: display_name(obj.label) for obj in perfect_map(line.home).objects}
            ids = (int(number) for number in re.findall(r"\d+", line.answers[0]))
            right = {deck.card_of(labels[number]) for number in ids if number in labels} - {None}
            if right:
                found.append(Request(line.text, "implicit", "written", (tuple(sorted(right)),), ()))
    return found


def _voiced(text: str, rng: random.Random) -> str:
    """The words with an opening and a closing as one or another voice has them, or told in a hurry."""
    if rng.random() < 0.2:
        return " ".join(w for w in text.split() if w.lower() not in STOP or rng.random() < 0.5) or text
    if rng.random() < 0.7:
        opener = rng.choice(FRAMES["openers"])
        keep = text.startswith(("I ", "I'")) or opener[-1] in "!.:"
        text = f"{opener} {text if keep else text[0].lower() + text[1:]}"
    if rng.random() < 0.5:
        joint = rng.choice((", ", " ", ". "))
        text = f"{text.rstrip('.!?')}{joint}{rng.choice(FRAMES['closers'])}{rng.choice('.!?')}"
    return text


def _card(deck: Deck, name: str) -> int:
    card = deck.card_of(name)
    if card is None:
        raise SystemExit(f"there is no card for {name!r}")
    return card


class Homes:
    """Lists of 25 to 60 things as homes have them: of the dollhouse, of AI2-THOR's types, and of LVIS's."""

    def __init__(self, deck: Deck, reference: Path) -> None:
        from cartier_dollhouse import make

        self.deck = deck
        world = make()
        types = json.loads((reference / "thor_object_types.json").read_text(encoding="utf-8"))["SimObjType"]
        rows = json.loads((reference / "lvis_v1_categories.json").read_text(encoding="utf-8"))
        self.houses = [self.named({candidate.label for candidate in world.objects(home)}) for home in world.homes()]
        self.thor = self.named(set(types) - NO_THINGS)
        self.lvis = self.named({row["name"] for row in rows if row["frequency"] != "r"})

    def named(self, labels: set[str]) -> list[tuple[int, str]]:
        """(card, name) of labels, one for each card."""
        cards: dict[int, str] = {}
        for label in sorted(labels):
            card = self.deck.card_of(display_name(label))
            if card is not None:
                cards.setdefault(card, display_name(label))
        return sorted(cards.items())

    def sample(self, request: Request, rng: random.Random, serve: bool = True) -> list[str]:
        """Names with at least one that serves each need, and mostly the distractors; with ``serve`` False, none that
        does."""
        kind = rng.random()
        if kind < 0.45:
            base = rng.choice(self.houses) + rng.sample(self.thor, 10)
        elif kind < 0.7:
            base = self.thor
        else:
            base = rng.sample(self.thor, 50) + rng.sample(self.lvis, 60)
        candidates = dict(base)
        listed = dict(rng.sample(sorted(candidates.items()), min(rng.randint(25, 60), len(candidates))))
        for need in request.needs if serve else ():
            if not listed.keys() & set(need):
                card = rng.choice(need)
                listed[card] = self.deck.cards[card].name
        for card in request.avoid:
            if rng.random() < 0.8:
                listed.setdefault(card, self.deck.cards[card].name)
        names = [name for card, name in listed.items() if serve or card not in request.right]
        rng.shuffle(names)
        return names


class Variations:
    """Samples for one pass over the training requests, different in every pass."""

    def __init__(self, requests: list[Request], deck: Deck, homes: Homes, near: list[list[int]]) -> None:
        self.requests = [r for r in requests if r.kind != "several"]
        self.deck, self.near = deck, near
        self.common = [card for card, _ in homes.thor]
        self.uses = [(c, u) for c, card in enumerate(deck.cards) for u in range(len(card.uses))]

    @cached_property
    def stories(self) -> list[list[str]]:
        """Beginnings of long requests, without the sentences in which the need comes."""
        long = (re.split(r"(?<=[.!?])\s+", r.text) for r in self.requests if r.kind == "conversational")
        return [parts[:-2] for parts in long if len(parts) >= 4]

    def passes(self, number: int, names: int, rng: random.Random) -> list[list[Sample]]:
        """As many passes; half of the uses of the cards occur once in all, each request once in every pass."""
        uses = rng.sample(self.uses, len(self.uses) // 2)
        share = -(-len(uses) // number)
        return [
            [self._request(r, rng) for r in self.requests]
            + [self._use(*use, rng) for use in uses[i * share : (i + 1) * share]]
            + [self._name(rng) for _ in range(names)]
            for i in range(number)
        ]

    def _request(self, request: Request, rng: random.Random) -> Sample:
        text, avoid = request.text, request.avoid
        if request.kind == "implicit" and rng.random() < 0.5:
            text = f"{self._story(rng, 3)} {text}"
        if request.kind in ("implicit", "conversational") and rng.random() < 0.3:
            text, avoid = self._turned_down(text, request.needs[0], avoid, rng, request.kind == "implicit")
        if request.kind != "conversational" and rng.random() < 0.4:
            text = _voiced(text, rng)
        right = tuple(sorted(request.right))
        if rng.random() < REMOVED:
            return Sample(text, (), avoid, unlisted=right)
        return Sample(text, right, avoid)

    def _use(self, card: int, place: int, rng: random.Random) -> Sample:
        text, chance = self.deck.cards[card].uses[place], rng.random()
        if rng.random() < 0.5:
            text = _voiced(text, rng)
        avoid: tuple[int, ...] = ()
        if not self.deck.cards[card].at_home:
            return Sample(text, (), use=(card, place))
        if chance < 0.2:
            text = f"{self._story(rng, 2)} {text[0].upper()}{text[1:]}."
        elif chance < 0.4:
            text, avoid = self._turned_down(text, (card,), (), rng, True)
        return Sample(text, (card,), avoid, use=(card, place))

    def _name(self, rng: random.Random) -> Sample:
        """Somebody asks by name: for one thing among others, for one that is not listed, or for what no home has."""
        card = rng.choice(self.common) if rng.random() < 0.4 else rng.randrange(len(self.deck.cards))
        name, chance, other = self._called(card, rng), rng.random(), self._other((card,), rng)
        solo = rng.choice(FRAMES["solo"])
        if not self.deck.cards[card].at_home:
            sample = Sample(solo.format(y=name), ())
        elif chance < 0.05:
            sample = Sample(solo.format(y=rng.choice(FRAMES["unknown"])), ())
        elif chance < 0.2:
            sample = Sample(solo.format(y=name), (), unlisted=(card, *self.near[card][:6]))
        elif chance < 0.5 or other is None:
            sample = Sample(solo.format(y=name), (card,))
        else:
            text = rng.choice(FRAMES["pairs"]).format(y=name, x=self._called(other, rng))
            sample = Sample(text, (card,), (other,))
        return replace(sample, text=_voiced(sample.text, rng)) if rng.random() < 0.5 else sample

    def _story(self, rng: random.Random, most: int) -> str:
        story = rng.choice(self.stories)
        start = rng.randrange(len(story))
        return " ".join(story[start : start + rng.randint(1, most)])

    def _called(self, card: int, rng: random.Random) -> str:
        names = self.deck.cards[card].names
        return names[0] if rng.random() < 0.6 else rng.choice(names)

    def _other(self, right: tuple[int, ...], rng: random.Random) -> int | None:
        """Another thing, often one that is like the right one."""
        chance = rng.random()
        if chance < 0.6:
            card = rng.choice(self.near[rng.choice(right)])
        else:
            card = rng.choice(self.common) if chance < 0.85 else rng.randrange(len(self.deck.cards))
        return card if card not in right and self.deck.cards[card].at_home else None

    def _turned_down(
        self, text: str, right: tuple[int, ...], avoid: tuple[int, ...], rng: random.Random, short: bool
    ) -> tuple[str, tuple[int, ...]]:
        card = self._other(right, rng)
        if card is None:
            return text, avoid
        name, chance = self._called(card, rng), rng.random()
        if short and chance < 0.4:
            begin = text if text.startswith(("I ", "I'")) else text[0].lower() + text[1:]
            text = rng.choice(FRAMES["inline"]).format(x=name, r=begin.rstrip(".")) + "."
        elif chance < 0.75:
            text = f"{rng.choice(FRAMES['before']).format(x=name)} {text}"
        else:
            stop = "" if text[-1:] in ".!?" else "."
            text = f"{text}{stop} {rng.choice(FRAMES['after']).format(x=name)}"
        return text, (*avoid, card)
