"""VLMaps baseline: the words of the request go straight to the VLMaps index, without a language model."""

from __future__ import annotations

import time
from collections.abc import Sequence

from cartier.contracts import Reasoner
from cartier.home import Home
from cartier.llm.prompts import check_query
from cartier.pipeline import serve
from cartier.types import Answer, Selection


def ask(
    home: Home,
    query: str,
    reasoner: Reasoner | None = None,
    *,
    index: str | None = None,
    from_xy: Sequence[float] | None = None,
    dialogue: Sequence[tuple[str, str]] = (),
) -> Answer:
    """Answer with the cell most similar to the words (arXiv 2307.11865, section on baselines).

    The text encoder reads as far as its token limit reaches. The object is what the home's index locates nearest to
    that cell. ``reasoner`` and ``dialogue`` are not used. Raises InputError if the home has no index to search.
    """
    query = check_query(query)
    name, searched = home.searchable(index)
    begin = time.perf_counter()
    place = searched.locate(query)
    took = {"locate": (time.perf_counter() - begin) * 1e3}
    if place is None:
        return serve(
            home, query, Selection("not_found", reason="the map is empty"), "none", index=name, from_xy=from_xy
        )
    there = {label: known.position for label in home.names if (known := searched.locate(label)) is not None}
    nearest = min(there, key=lambda label: sum((a - b) ** 2 for a, b in zip(there[label], place.position, strict=True)))
    chosen = Selection(
        "found", nearest, "nearest to the spot that is most similar to the words", model=searched.encoder
    )
    return serve(home, query, chosen, "none", index=name, place=place, from_xy=from_xy, timing_ms=took)
