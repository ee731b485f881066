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


class RandomObject:
    """Any object of the list, the same for the same seed and words."""

    name = "random"

    def __init__(self, seed: int, key: str) -> None:
        self._seed = int.from_bytes(hashlib.sha256(f"{seed} {key}".encode()).digest()[:8], "big")

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        names = inventory.names
        return Selection("found", names[int(np.random.default_rng(self._seed).integers(len(names)))], "drawn at random")

    def propose(self, query: str) -> list[str]:
        return []


class NearestName:
    """The object whose name is nearest to the words in the shipped text encoder."""

    name = "nearest name (all-MiniLM-L6-v2, int8)"

    def __init__(self, encode: TextEncoder) -> None:
        self._encode = encode

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        names = inventory.names
        cosines = self._encode(names) @ self._encode([query])[0]
        return Selection("found", names[int(cosines.argmax())], f"cosine {cosines.max():.2f}")

    def propose(self, query: str) -> list[str]:
        return []


class WithoutList:
    """The reasoner's first proposal, made without sight of the list; it counts if the list happens to hold it."""

    def __init__(self, reasoner: Reasoner) -> None:
        self._reasoner = reasoner
        self.name = f"{reasoner.name}, without the list"

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        proposals = self.propose(query)
        first = listed_as(proposals[0], inventory.names) if proposals else None
        if first is None:
            return Selection("not_found", reason=f"proposed {', '.join(proposals) or 'nothing'}")
        return Selection("found", first, f"proposed {proposals[0]}")

    def propose(self, query: str) -> list[str]:
        return self._reasoner.propose(query)


class TrueObject:
    """The object that the request was written for: what is left is the cost of localising it."""

    name = "true object"

    def __init__(self, target: str) -> None:
        self._target = target

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        named = listed_as(self._target, inventory.names)
        if named is None or canonical(named) != canonical(self._target):
            return Selection("not_found", reason=f"the detector never found the {self._target}")
        return Selection("found", named, "told")

    def propose(self, query: str) -> list[str]:
        return [self._target]


def _cartier(index: str) -> Callable[[Home, Query, Bench], Answer]:
    return lambda home, query, bench: pipeline.ask(home, query.text, bench.reasoner, index=index)


def _yardstick(make: Callable[[Home, Query, Bench], Reasoner]) -> Callable[[Home, Query, Bench], Answer]:
    return lambda home, query, bench: pipeline.ask(home, query.text, make(home, query, bench), index="object_depth")


METHODS: dict[str, Callable[[Home, Query, Bench], Answer]] = {
    "object_depth": _cartier("object_depth"),
    "object_depth_paper": _cartier("object_depth_paper"),
    "object_viewpoint": _cartier("object_viewpoint"),
    "vlmaps": _cartier("vlmaps"),
    "nlmap": lambda home, query, bench: nlmap.ask(home, query.text, bench.reasoner, threshold=bench.nlmap_threshold),
    "vlmaps_query": lambda home, query, bench: vlmaps_query.ask(home, query.text),
    "random": _yardstick(lambda home, query, bench: RandomObject(bench.seed, f"{home.name} {query.id}")),
    "nearest_name": _yardstick(lambda home, query, bench: NearestName(bench.encode)),
    "llm_without_list": _yardstick(lambda home, query, bench: WithoutList(bench.reasoner)),
    "true_object": _yardstick(lambda home, query, bench: TrueObject(query.target)),
}
ASKING = ("object_depth", "object_depth_paper", "object_viewpoint", "vlmaps", "nlmap", "llm_without_list")
"""Those that ask the reasoner under test."""
