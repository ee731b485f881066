"""NLMap baseline (Chen et al. 2022, arXiv 2209.09874): propose names, keep those that the map holds, then choose."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence, Set

import numpy as np

from cartier.contracts import Reasoner
from cartier.errors import InputError
from cartier.home import Home
from cartier.llm.prompts import check_query
from cartier.pipeline import serve
from cartier.types import Answer, Inventory, Selection


def ask(
    home: Home,
    query: str,
    reasoner: Reasoner,
    *,
    threshold: float,
    index: str | None = None,
    from_xy: Sequence[float] | None = None,
    dialogue: Sequence[tuple[str, str]] = (),
) -> Answer:
    """Answer with one of the objects that the reasoner proposes without seeing any list (arXiv 2307.11865, baselines).

    A proposal is kept where the best similarity in the VLMaps index reaches ``threshold``. The paper's 12.05 belongs to
    its own features: ``calibrate`` finds the one for other features. Raises InputError if the home has no index to
    search.
    """
    query = check_query(query)
    name, searched = home.searchable(index)
    begin = time.perf_counter()
    places = {proposal: searched.locate(proposal) for proposal in reasoner.propose(query)}
    kept = {proposal: place for proposal, place in places.items() if place is not None and place.score >= threshold}
    if kept:
        chosen = reasoner.select(query, Inventory.of(kept), dialogue)
    else:
        said = ", ".join(places) or "nothing"
        chosen = Selection("not_found", reason=f"proposed {said}; the map holds none of it")
    took = {"select": (time.perf_counter() - begin) * 1e3}
    place = kept.get(chosen.object) if chosen.object is not None else None
    alone = Selection(
        chosen.status, chosen.object, chosen.reason, chosen.question, chosen.candidates, model=chosen.model
    )
    return serve(home, query, alone, reasoner.name, index=name, place=place, from_xy=from_xy, timing_ms=took)


def calibrate(homes: Sequence[tuple[Home, Set[str]]], names: Sequence[str]) -> float:
    """The similarity that best tells names of objects that are in a home from names of objects that are not.

    ``homes`` are mapped homes with the names of what is truly there and was seen; ``names`` is the vocabulary to try.
    It maximises the share of present names kept plus the share of absent names dropped (Youden's J).
    """
    scores: Mapping[bool, list[float]] = {True: [], False: []}
    for home, present in homes:
        searched = home.searchable()[1]
        for name in names:
            place = searched.locate(name)
            if place is not None:
                scores[name in present].append(place.score)
    if not scores[True] or not scores[False]:
        raise InputError("calibrating NLMap's threshold needs homes that hold some of the names, and lack others")
    there, missing = np.sort(scores[True]), np.sort(scores[False])
    tried = np.unique(np.concatenate([there, missing]))
    kept = 1 - np.searchsorted(there, tried) / len(there)
    dropped = np.searchsorted(missing, tried) / len(missing)
    best = int(np.argmax(kept + dropped))
    below = tried[best - 1] if best else tried[best]
    return round(float(tried[best] + below) / 2, 4)
