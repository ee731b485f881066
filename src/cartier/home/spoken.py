"""Corrections of a saved home by what a person says in a conversation about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cartier.home.corrected import find_room
from cartier.home.entity import Home
from cartier.types import Answer, Selection
from cartier.types.route_rules import UNDERSTOOD
from cartier.understanding import alarm
from cartier.understanding.cards import deck_of
from cartier.understanding.spoken_corrections import NOTED, spoken_correction


def correct_by_words(
    home: Home,
    words: str,
    dialogue: Sequence[tuple[str, str]],
    *,
    index: str | None = None,
    from_xy: Sequence[float] | None = None,
    who: str = "a conversation",
    reasoner: object = None,
) -> tuple[Home, Selection | None] | None:
    """Correct a home if that is what the words do: the corrected home, and what to answer. None for other words.

    Without an answer, the words told which room a person's is: the request before them can now be served.
    ``dialogue`` are the earlier (person, robot) turns, ``from_xy`` (m) is where the robot stands, ``reasoner`` one that
    may have cards of its own. A home that was not loaded from a folder is never corrected. Raises InputError for a
    correction that is refused.
    """
    if home.store is None or alarm.screen(words) is not None:
        return None
    here = find_room(home.start_xy if from_xy is None else from_xy, home.rooms, home.grid)
    inventory, knows = home.inventory(index, from_xy), home.settings.get("knows", ())
    spoken = spoken_correction(words, dialogue, inventory, here, knows, deck_of(reasoner))
    if spoken is None:
        return None
    changed, done = home.correct(spoken.what, spoken.entity, name=spoken.name, who=who)
    if spoken.what == "name" and spoken.drive:
        return changed, None
    told = f"{NOTED}{done}."
    for obj in changed.objects:
        if str(obj.id) == spoken.entity:
            return changed, Selection(
                "found" if spoken.drive else "answered", obj.label, reason=told, object_id=obj.id, text=told
            )
    return changed, Selection("answered", text=told)


def keep_rules(home: Home, answer: Answer, who: str = "a conversation") -> tuple[Home, Answer]:
    """Keep the route rules of an answer that hold beyond one drive, and end those that it takes back.

    Gives the home with its new log, and the answer that says so. A home that was not loaded from a folder keeps none.
    """
    if home.store is None:
        return home, answer
    parts, kept = (answer, *answer.next), False
    for chosen in (part.selection for part in parts):
        for rule in chosen.lifts:
            if rule.id in {each.id for each in home.rules}:
                home, kept = home.correct("lift", rule.id, who=who)[0], True
        for rule in chosen.rules:
            if rule.stays and rule not in home.rules:
                home, kept = home.correct("rule", rule.text, name=rule.said, who=who)[0], True
    if kept and answer.selection.text.startswith(UNDERSTOOD):
        text = f"{NOTED}{answer.selection.text.removeprefix(UNDERSTOOD)}"
        answer = replace(answer, selection=replace(answer.selection, text=text))
    return home, answer
