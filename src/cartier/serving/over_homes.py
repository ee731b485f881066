"""Operations over many homes: a question to all of a fleet, and the overview of one home among many."""

from __future__ import annotations

from collections import Counter
from typing import Any

from cartier.errors import InputError
from cartier.llm.prompts import check_query
from cartier.serving.operations import Operations


def ask_fleet(operations: Operations, words: str) -> dict[str, Any]:
    """Answer a question over all homes of the fleet that the request may see. Raises InputError for other words."""
    fleet = operations.homes.fleet
    if fleet is None:
        raise InputError("these homes are no fleet: ask one of them")
    found = fleet.ask(check_query(words), operations.homes.may_see)
    return {
        "text": found.text, "value": found.value, "has": list(found.has), "has_none": list(found.has_none),
        "cannot_tell": dict(found.cannot_tell),
    }  # fmt: skip


def overview(operations: Operations, home: str = "") -> dict[str, Any]:
    """The rooms of a home, how many objects of each label are in it, and what a person should know of its map."""
    mapped = operations.homes.get(home)
    counts = Counter(obj.label for obj in mapped.objects if obj.confirmed)
    notes = {"detector": mapped.detector, "notes": list(mapped.notes)}
    return operations.list_rooms(home) | {"objects": dict(sorted(counts.items()))} | notes
