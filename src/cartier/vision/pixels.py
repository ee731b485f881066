"""Answers to questions about looks without a vision model: colours as the map has them, and where nothing is known.

A map holds the colours of an object's surface and the passages of the floor plan, and its photographs tell of a lamp
or a screen that was seen both bright and dark. Of other states it knows nothing: to "is the fridge open?" the honest
answer is that a vision model would have to look.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

from cartier.labels import words
from cartier.spatial.describe import colours_of, whereabouts
from cartier.spatial.query import Scene
from cartier.types import Fact, Inventory, MapObject, Selection
from cartier.understanding.cards import Deck
from cartier.vision.attributes import PRONOUNS, Asked, read, read_of_last, read_unlisted
from cartier.vision.brightness import SeenTwice
from cartier.vision.candidates import meant, passages

BLIND = "I cannot tell by looking without a vision model"


def answer(said: str, inventory: Inventory, last: MapObject | None, model: str, deck: Deck) -> Selection | None:
    """The answer to a question about how objects look, as far as a map has it.

    Args:
        said: What the person says.
        inventory: The home's objects and rooms.
        last: The object that was mentioned before, which "it" stands for.
        model: The name of the reasoner that answers.
        deck: The cards of what it knows by name.

    Returns:
        The answer in words; None if something else is asked for, if what is asked about is not in the list, or if the
        list itself answers (what colour something is, or which one has a colour).
    """
    asked = read(said) or read_of_last(said) or read_unlisted(said)
    if asked is None or (asked.attribute == "colour" and asked.form != "state"):
        return None
    if asked.form == "which" and not _asks(said):
        return None  # a drive to "a clean towel": the list serves it, and its state is not known
    scene = Scene(inventory)
    if asked.attribute == "open":
        opened, shut = passages(asked, inventory, deck), passages(asked, inventory, deck, shut=True)
        if opened or shut:
            return _passage(asked, opened, shut, scene, model)
    it = [] if last is None else [last]
    found = it if asked.noun in PRONOUNS else meant(asked, inventory, deck)
    if not found:
        return None
    if asked.attribute == "colour":
        return _coloured(asked, found, scene, model)
    return _unknown(asked, found, scene, model)


def unchecked(said: str, chosen: Selection) -> Selection:
    """The choice of a drive to a thing in some state ("bring me a clean mug"), saying that the state is not known."""
    asked = read(said) if chosen.status == "found" else None
    if asked is None or asked.form != "which" or asked.attribute == "colour":
        return chosen
    return replace(chosen, reason=f"{chosen.reason.rstrip('.')}. {BLIND} whether it is {asked.value}.")


def twice(
    said: str, chosen: Selection, seen: Callable[[MapObject], SeenTwice | None], inventory: Inventory
) -> Selection:
    """The answer to whether a lamp or a screen is on, where its photographs tell; otherwise the choice as it is.

    ``seen`` says what the photographs of an object show; it is called only for such a question that has no answer.
    """
    asked = read(said) or read_of_last(said)
    fact = chosen.fact
    if asked is None or asked.attribute != "on" or asked.form != "state":
        return chosen
    if fact is None or fact.kind != "tell" or fact.value is not None or len(fact.objects) != 1:
        return chosen
    obj = next((obj for obj in inventory.objects if obj.id == fact.objects[0]), None)
    told = None if obj is None else seen(obj)
    if obj is None or told is None:
        return chosen
    was = {"on": "bright", "off": "dark"}[told.state], {"on": "dark", "off": "bright"}[told.state]
    why = f"it was {was[0]} in the photograph of frame {told.frame} and {was[1]} in that of frame {told.other}"
    named = _named(obj, Scene(inventory))
    text = f"{_yes(told.state == asked.value)}{named} was {told.state} when I saw it last: {why}."
    return replace(chosen, reason=why, text=text, fact=replace(fact, value=told.state))


def _asks(said: str) -> bool:
    """Whether words begin as a question about which object it is, or whether there is one."""
    return not {"where", "bring", "get", "fetch", "take", "find", "want", "need", "show", "give"} & set(words(said)[:4])


def _passage(
    asked: Asked, opened: Sequence[tuple[int, int]], shut: Sequence[tuple[int, int]], scene: Scene, model: str
) -> Selection:
    """A passage is on the floor plan because floor was seen in it: it was open then. A shut one was seen twice."""

    def between(rooms: tuple[int, int]) -> str:
        one, other = (scene.rooms[number].name for number in rooms)
        return f"between the {one} and the {other}"

    if opened and shut:
        text = f"Some: the way {between(opened[0])} was open when I saw it, the one {between(shut[0])} was shut."
        fact = Fact("tell", f"{len(opened)} of {len(opened) + len(shut)}")
        return Selection("answered", reason=text, text=text, fact=fact, model=model)
    state: Literal["open", "closed"] = "open" if opened else "closed"
    how = "open when I saw it" if opened else "shut when I saw it last; it was open before"
    text = f"{_yes(asked.value == state)}the way {between((*opened, *shut)[0])} was {how}."
    return Selection("answered", reason=text, text=text, fact=Fact("tell", state), model=model)


def _coloured(asked: Asked, found: Sequence[MapObject], scene: Scene, model: str) -> Selection:
    """Whether objects have a colour; of several that differ, how many have it."""
    known = [obj for obj in found if obj.colours]
    if not known:
        return _unknown(asked, found, scene, model)
    fit = [obj for obj in known if asked.value in colours_of(obj)]
    about = known[0]
    if len(known) > 1 and 0 < len(fit) < len(known):
        told = f"Some: {len(fit)} of {len(known)}, the nearest {whereabouts(scene, fit[0])}."
        fact = Fact("tell", f"{len(fit)} of {len(known)}", tuple(obj.id for obj in fit))
        return Selection("answered", fit[0].label, reason=told, text=told, fact=fact, object_id=fit[0].id, model=model)
    colours = colours_of(about)
    told = f"{_yes(bool(fit))}{_named(about, scene)} looks {asked.value if fit else ' and '.join(colours)}."
    fact = Fact("tell", asked.value if fit else colours[0], (about.id,))
    return Selection("answered", about.label, reason=told, text=told, fact=fact, object_id=about.id, model=model)


def _unknown(asked: Asked, found: Sequence[MapObject], scene: Scene, model: str) -> Selection:
    about = found[0]
    wish = {"text": "what is written on {}", "look": "what {} looks like"}.get(asked.attribute)
    one = _named(about, scene) if len(found) == 1 else f"the {about.label}"
    if wish is None:
        which = "whether any" if asked.noun.startswith(("a ", "an ", "any ", "some ")) else "which"
        wish = f"{which} {about.label} is {asked.value}" if asked.form == "which" else f"whether {{}} is {asked.value}"
    text = f"{BLIND} {wish.format(one)}."
    ids = tuple(obj.id for obj in found)
    number = about.id if len(found) == 1 else None
    return Selection(
        "answered", None if number is None else about.label, reason="the list of objects holds no such state",
        text=text, fact=Fact("tell", None, ids), object_id=number, model=model,
    )  # fmt: skip


def _named(obj: MapObject, scene: Scene) -> str:
    where = whereabouts(scene, obj)
    return f"the {obj.label}{f' {where}' if where else ''}"


def _yes(so: bool) -> str:
    return "Yes: " if so else "No: "
