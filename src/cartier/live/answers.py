"""Answers from a map that still grows: they say of when they are, and "not seen yet" instead of "not here"."""

from __future__ import annotations

from dataclasses import replace

from cartier.errors import InputError
from cartier.spatial.floor_seen import WHOLE
from cartier.types import Answer, AsOf, Selection


def as_of(answer: Answer, moment: AsOf) -> Answer:
    """The answer of a live map, with that of each further need in it.

    Args:
        answer: What the latest map answers.
        moment: Of when that map is.
    """
    unseen = moment.floor_seen < WHOLE and _denies(answer.selection)
    selection = _not_yet(answer.selection, moment) if unseen else answer.selection
    notes = [f"as of {moment.age_s:.0f} s ago; {moment.floor_seen:.0%} of the floor was looked at so far"]
    notes += ["the map is being corrected: places may still move"] if moment.correcting else []
    return replace(
        answer,
        selection=selection,
        notes=(*notes, *answer.notes),
        next=tuple(as_of(each, moment) for each in answer.next),
        as_of=replace(moment, not_seen_yet=unseen),
    )


def check_epoch(of_goal: int, now: int) -> None:
    """Raises InputError for a goal of another frame epoch than that of the map now."""
    if of_goal != now:
        raise InputError(
            f"this goal is of frame epoch {of_goal}, and corrected poses have moved the map since (epoch {now}): "
            "ask again, and drive to the new goal"
        )


def _denies(chosen: Selection) -> bool:
    """Whether an answer says that something is not there, or that there is none of it."""
    if chosen.status == "not_found":
        return True
    fact = chosen.fact
    asks = fact is not None and fact.kind in ("exists", "count", "list", "where")
    return asks and fact is not None and not fact.value and not fact.objects


def _not_yet(chosen: Selection, moment: AsOf) -> Selection:
    so_far = f"I have looked at {moment.floor_seen:.0%} of the floor so far"
    text = f"Not seen yet: {so_far}."
    reason = f"not seen yet; {so_far[:1].lower()}{so_far[1:]}" if chosen.status == "not_found" else chosen.reason
    return replace(chosen, text=text, reason=reason)
