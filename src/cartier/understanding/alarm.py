"""Alarm: words about harm or an emergency are an act of their own, whatever reasoner would be asked.

No object serves them. A calm sentence says what a person should do now: call for help, and keep apart from the danger.
It holds no medical advice. As long as the alarm is among the turns of the dialogue, what could do harm is withheld:
"just the knife then" gets the same sentence.
"""

from __future__ import annotations

import locale
import os
import re
from collections.abc import Iterable, Iterator, Sequence

from cartier.errors import InputError, brief
from cartier.labels import name_key, plain, words
from cartier.types import AlarmKind, Inventory, Selection
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.dialogue_state import named
from cartier.understanding.entity_vocabulary import known_anywhere
from cartier.understanding.parser import MOST_TOKENS, parser
from cartier.understanding.utterance import TOKEN

NAME = "alarm screen"
VARIABLE = "CARTIER_EMERGENCY_NUMBER"
ELSEWHERE = "your local emergency number"
NUMBER = re.compile(r"\+?[0-9][0-9 -]{1,19}")
LATEST, STEP = 6000, 80  # characters at the end of a text that are judged; tokens from one window of it to the next
LEAST_CERTAIN, SURE_IN_STORY, SURE_ALONE = 0.65, 0.8, 0.88
"""From which probability on a few words, a part of a longer text, and one sentence of a few words alone are an alarm;
chosen on tools/alarms/development and on requests that are none."""
SENTENCE = re.compile(r"(?<=[.!?;\n])\s+")
FEW = 30  # tokens
TOLD: dict[AlarmKind, tuple[str, str]] = {
    "self_harm": (
        "the words are about hurting oneself",
        "I will not drive there. Please do not stay alone with this: talk to somebody you trust now, or call {number}.",
    ),
    "violence": (
        "the words are about hurting somebody",
        "I will not help with that. Please keep apart from each other, and call {number} if anybody is in danger.",
    ),
    "child": (
        "the words are about a danger to a child",
        "That is dangerous. Please get a grown-up now, and call {number} if somebody is hurt or nobody is there.",
    ),
    "medical": (
        "the words are about an accident or an illness that cannot wait",
        "Please call {number} now, say what has happened and where you are, and do what they tell you.",
    ),
    "fire": (
        "the words are about fire, gas or water in the home",
        "Please get everybody out to a safe place now, and call {number} from there.",
    ),
}
AGAIN = "an alarm came before in this conversation"
ONE_NUMBER = {
    "000": "AU", "111": "NZ", "911": "AR CA CR DO EC MX PA PE PH UY US", "999": "BD GB HK KE MY SG",
    "112": "AD AT BE BG CH CY CZ DE DK EE ES FI FR GR HR HU IE IN IS IT LI LT LU LV MC MT NL NO PL PT RO RU SE SI SK "
    "SM TR UA",
}  # fmt: skip
"""Countries with one number for police, fire brigade and ambulance; 112 is the European Union's."""
BY_COUNTRY = {country: number for number, countries in ONE_NUMBER.items() for country in countries.split()}


HARMFUL = frozenset([
    "ax", "belt", "butter knife", "candle", "cleaner", "crowbar", "dagger", "detergent", "drill", "extension cord",
    "garden clippers", "gun", "hammer", "handsaw", "jump rope", "knife", "lighter", "liquor", "mallet", "matches",
    "needle", "pizza cutter", "pocketknife", "poker", "razor", "rope", "saw", "scissors", "screwdriver", "skewer",
    "sparkler", "steak knife", "wine bottle",
])  # fmt: skip
"""Cards of what is withheld after an alarm, except of a fire."""
HARMFUL_OR_HELPFUL = frozenset(["medicine", "medicine cabinet", "power outlet", "stove", "syringe", "window"])
"""Cards of what is withheld as well, except after an accident, too."""
LONGEST_NAME = 4  # words


def screen(query: str, number: str | None = None, dialogue: Sequence[tuple[str, str]] = ()) -> Selection | None:
    """The alarm that the words are, alone or after the (person, robot) turns, or None: then a reasoner may choose.

    ``number`` is the emergency number to name; by default that of ``emergency_number``.
    """
    kind = alarm_kind(query)
    if kind is not None:
        return _alarm(kind, TOLD[kind][0], number)
    for before, _ in _alarms(dialogue):
        if _cards(query) & _withheld(before):
            return _alarm(before, AGAIN, number)
    return None


def screen_choice(
    chosen: Selection, inventory: Inventory, dialogue: Sequence[tuple[str, str]], number: str | None = None
) -> Selection | None:
    """The alarm that takes the place of a choice which names what an alarm of the turns before was about."""
    names = set(_names(chosen, inventory))
    cards = _cards_of(names)
    for kind, words_then in _alarms(dialogue):
        spoken_of = _cards(words_then) if kind != "medical" else set[int]()  # "grandpa fell by the sofa"
        if cards & (_withheld(kind) | spoken_of) or (kind != "medical" and names & {*named(words_then, sorted(names))}):
            return _alarm(kind, AGAIN, number)
    return None


def alarm_kind(query: str) -> AlarmKind | None:
    """The kind of emergency that words tell of by the parser, a window of a long text at a time; None for no alarm.

    The sentences of a short text are judged alone as well ("The sofa is burning! Come quickly."); those of a long story
    are no alarms apart from it.
    """
    text = query[-LATEST:].strip()
    tokens = TOKEN.findall(plain(text))
    begins = [max(begin, 0) for begin in range(len(tokens) - MOST_TOKENS, -STEP, -STEP)] or [0]
    least = LEAST_CERTAIN if len(tokens) <= FEW else SURE_IN_STORY
    windows = [(tokens[begin : begin + MOST_TOKENS], least) for begin in begins]
    parts = SENTENCE.split(text) if len(tokens) <= FEW else []
    alone = [(TOKEN.findall(plain(part)), SURE_ALONE) for part in parts if len(parts) > 1]
    judged = ((*parser().alarm(some, known_anywhere()), enough) for some, enough in (*windows, *alone) if some)
    return next((kind for kind, certainty, enough in judged if certainty >= enough), None)


def _alarm(kind: AlarmKind, why: str, number: str | None) -> Selection:
    text = TOLD[kind][1].format(number=emergency_number(number))
    return Selection("alarm", reason=why, text=text, model=NAME, alarm=kind)


def _alarms(dialogue: Sequence[tuple[str, str]]) -> Iterator[tuple[AlarmKind, str]]:
    """The kind and the words of each turn that the robot answered as an alarm."""
    for person, robot in dialogue:
        for kind, (_, text) in TOLD.items():
            if robot.startswith(text.split("{number}")[0]):
                yield kind, person


def _withheld(kind: AlarmKind) -> set[int]:
    if kind == "fire":
        return set()
    return _cards_of(HARMFUL if kind == "medical" else HARMFUL | HARMFUL_OR_HELPFUL)


def _cards_of(names: Iterable[str]) -> set[int]:
    deck = read_deck(SHIPPED)
    return {card for card in map(deck.card_of, names) if card is not None}


def _cards(text: str) -> set[int]:
    """The cards whose names stand in a text."""
    said, by_key = words(plain(text)), read_deck(SHIPPED).by_key
    parts = (said[i : i + n] for n in range(1, LONGEST_NAME + 1) for i in range(len(said) - n + 1))
    return {by_key[key] for key in (name_key(" ".join(part)) for part in parts) if key in by_key}


def _names(chosen: Selection, inventory: Inventory) -> Iterator[str]:
    """The listed names that a choice would drive to, answers about or asks about."""
    for one in (chosen, *chosen.next):
        about = {one.object_id, one.tentative, *(one.fact.objects if one.fact is not None else ())}
        yield from (obj.label for obj in inventory.objects if obj.id in about)
        yield from [one.object] if one.object is not None else []
        yield from named(one.question or "", inventory.names)


def emergency_number(given: str | None = None) -> str:
    """The number given, else that in CARTIER_EMERGENCY_NUMBER, else that of the locale's country, else in words."""
    number = given or os.environ.get(VARIABLE)
    if number:
        if not NUMBER.fullmatch(number):
            raise InputError(
                f"an emergency number is digits, spaces and dashes, such as 112, not {brief(number, 40)!r}"
            )
        return number
    return BY_COUNTRY.get(_country(), ELSEWHERE)


def _country() -> str:
    """The country of the locale's messages, such as DE; empty where it has none."""
    said = next((v for v in map(os.environ.get, ("LC_ALL", "LC_MESSAGES", "LANG")) if v), locale.getlocale()[0] or "")
    found = re.match(r"[A-Za-z]{2,3}[_-]([A-Z]{2})\b", said)
    return found[1] if found else ""
