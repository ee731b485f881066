"""Methods that the paper compares, and the yardsticks: (home, request, reasoner) → answer, on the same maps."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cartier import pipeline
from cartier.contracts import Reasoner
from cartier.home import Home
from cartier.models.minilm import TextEncoder
from cartier.types import Answer, Inventory, Selection
from cartier_bench.baselines import nlmap, vlmaps_query
from cartier_bench.metrics import canonical, listed_as
from cartier_bench.queries import Query


@dataclass
class Bench:
    """What the methods share: the reasoner under test, the text encoder of a yardstick, NLMap's threshold, the seed."""

    reasoner: Reasoner
    encode: TextEncoder
    nlmap_threshold: float
    seed: int


class Yardstick:
    """A reasoner by a rule: ``choose`` gets the words and what the home holds, ``propose`` the words."""

    def __init__(
        self, name: str, choose: Callable[[str, Inventory], Selection],
        propose: Callable[[str], list[str]] = lambda query: [],
    ) -> None:  # fmt: skip
        self.name, self._choose, self._propose = name, choose, propose

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        return self._choose(query, inventory)

    def propose(self, query: str) -> list[str]:
        return self._propose(query)


def drawing(seed: int, key: str) -> np.random.Generator:
    """Numbers that are the same for the same seed and key."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(f"{seed} {key}".encode()).digest()[:8], "big"))


def _random(home: Home, query: Query, bench: Bench) -> Yardstick:
    """Any object of the list."""

    def choose(words: str, inventory: Inventory) -> Selection:
        rng, names = drawing(bench.seed, f"{home.name} {query.id}"), inventory.names
        return Selection("found", names[int(rng.integers(len(names)))], "drawn at random")

    return Yardstick("random", choose)


def _nearest_name(home: Home, query: Query, bench: Bench) -> Yardstick:
    """The object whose name is nearest to the words in the shipped text encoder."""

    def choose(words: str, inventory: Inventory) -> Selection:
        cosines = bench.encode(inventory.names) @ bench.encode([words])[0]
        return Selection("found", inventory.names[int(cosines.argmax())], f"cosine {cosines.max():.2f}")

    return Yardstick("nearest name (all-MiniLM-L6-v2, int8)", choose)


def _without_list(home: Home, query: Query, bench: Bench) -> Yardstick:
    """The reasoner's first proposal, made without sight of the list; it counts if the list happens to hold it."""

    def choose(words: str, inventory: Inventory) -> Selection:
        proposals = bench.reasoner.propose(words)
        first = listed_as(proposals[0], inventory.names) if proposals else None
        if first is None:
            return Selection("not_found", reason=f"proposed {', '.join(proposals) or 'nothing'}")
        return Selection("found", first, f"proposed {proposals[0]}")

    return Yardstick(f"{bench.reasoner.name}, without the list", choose, bench.reasoner.propose)


def _true_object(home: Home, query: Query, bench: Bench) -> Yardstick:
    """The object that the request was written for: what is left is the cost of localising it."""

    def choose(words: str, inventory: Inventory) -> Selection:
        named = listed_as(query.target, inventory.names)
        if named is None or canonical(named) != canonical(query.target):
            return Selection("not_found", reason=f"the detector never found the {query.target}")
        return Selection("found", named, "told")

    return Yardstick("true object", choose, lambda words: [query.target])


Method = Callable[[Home, Query, Bench], Answer]


def _cartier(index: str) -> Method:
    return lambda home, query, bench: pipeline.ask(home, query.text, bench.reasoner, index=index)


def _yardstick(make: Callable[[Home, Query, Bench], Yardstick]) -> Method:
    return lambda home, query, bench: pipeline.ask(home, query.text, make(home, query, bench), index="object_depth")


METHODS: dict[str, Method] = {
    "object_depth": _cartier("object_depth"),
    "object_depth_paper": _cartier("object_depth_paper"),
    "object_viewpoint": _cartier("object_viewpoint"),
    "vlmaps": _cartier("vlmaps"),
    "nlmap": lambda home, query, bench: nlmap.ask(home, query.text, bench.reasoner, threshold=bench.nlmap_threshold),
    "vlmaps_query": lambda home, query, bench: vlmaps_query.ask(home, query.text),
    "random": _yardstick(_random),
    "nearest_name": _yardstick(_nearest_name),
    "llm_without_list": _yardstick(_without_list),
    "true_object": _yardstick(_true_object),
}
ASKING = ("object_depth", "object_depth_paper", "object_viewpoint", "vlmaps", "nlmap", "llm_without_list")
"""Those that ask the reasoner under test."""
