"""Corrections in conversation: "yes, it is there", "that is a pencil box", "this is Ben's room", and "undo that".

Only whole sentences of a few fixed forms count, and only about what the robot spoke of right before, or the room where
it stands: whatever else a person says is a request.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Literal, NamedTuple

from cartier.labels import name_key, plain, words
from cartier.types import Inventory, MapObject
from cartier.understanding.cards import Deck, read_deck
from cartier.understanding.owners import owner_told
from cartier.understanding.tentative import OFFER

NOTED = "Noted: "
"""How the robot's turn begins after a correction."""
SURELY = "(?:really |definitely |indeed |actually )?"
THERE = re.compile(rf"(?:yes |yeah |yep )?(?:it|that|this|the (?P<label>[^?]+)) (?:is|s) {SURELY}there(?: indeed)?")
IS_A = re.compile(
    rf"(?:no )?(?:that|this) (?:is|s) {SURELY}(?:a |an |the )?(?P<label>.+?)(?: (?:and )?not (?:a |an )?.+)?"
)
UNDO = re.compile(r"(?:no )?(?:undo|undo (?:that|it)|take (?:that|it) back)")
WHOSE = re.compile(
    r"\s*this is (?P<name>[^\W\d_][\w-]*['’]s (?:room|bedroom|study|office|kitchen|bathroom))[\s.!]*",
    re.IGNORECASE,
)
NUMBER = re.compile(r"#(\d{1,15})\b")


class SpokenCorrection(NamedTuple):
    """What to correct: an object by its id, or ``room:ID``; ``drive`` says whether a request was waiting for it."""

    what: Literal["confirm", "relabel", "name", "undo"]
    entity: str = ""
    name: str = ""
    drive: bool = False


def spoken_correction(
    text: str,
    dialogue: Sequence[tuple[str, str]],
    inventory: Inventory,
    here: int | None,
    knows: Collection[str] = (),
    deck: Deck | None = None,
) -> SpokenCorrection | None:
    """The correction that a person's words are after the turns of a dialogue, or None for any other words.

    ``here`` is the id of the room where the robot stands, ``knows`` are further labels that objects may have, and
    ``deck`` are the cards of others, by default those that ship.
    """
    if "?" in text:
        return None
    if here is not None and (whose := WHOSE.fullmatch(text)) is not None:
        return SpokenCorrection("name", f"room:{here}", whose["name"].replace("’", "'"))
    said, robot = " ".join(words(plain(text))), dialogue[-1][1] if dialogue else ""
    if (told := owner_told(text, robot, inventory)) is not None:
        return SpokenCorrection("name", *told, drive=True)
    if UNDO.fullmatch(said) and _left_to_undo(dialogue):
        return SpokenCorrection("undo")
    obj = _spoken_of(robot, inventory.objects)
    if obj is None:
        return None
    if (there := THERE.fullmatch(said)) is not None:
        same = there["label"] is None or name_key(there["label"]) in map(name_key, (obj.label, *obj.names))
        return SpokenCorrection("confirm", str(obj.id), drive=robot.endswith(OFFER)) if same else None
    if (other := IS_A.fullmatch(said)) is not None and name_key(other["label"]) != name_key(obj.label):
        known = {name_key(name) for name in (*inventory.names, *knows)}
        if name_key(other["label"]) in known or name_key(other["label"]) in (deck or read_deck()).by_key:
            return SpokenCorrection("relabel", str(obj.id), other["label"])
    return None


def _left_to_undo(dialogue: Sequence[tuple[str, str]]) -> bool:
    """Whether a correction of this dialogue still holds: those of others are not undone by words."""
    noted = [robot for _, robot in dialogue if robot.startswith(NOTED)]
    return 2 * sum(robot.startswith(f"{NOTED}undone") for robot in noted) < len(noted)


def _spoken_of(robot: str, objects: Sequence[MapObject]) -> MapObject | None:
    """The one object that the robot's turn is about: by its number, or offered as the only tentative one of a label."""
    numbers = {int(number) for number in NUMBER.findall(robot)}
    if numbers:
        found = [obj for obj in objects if numbers & {obj.id, *obj.aliases}]
    elif robot.endswith(OFFER):
        said = f" {' '.join(words(plain(robot)))} "
        found = [t for t in objects if not t.confirmed and f" {' '.join(words(plain(t.label)))} " in said]
    else:
        found = []
    return found[0] if len(found) == 1 and len(numbers) <= 1 else None
