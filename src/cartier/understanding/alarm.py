"""Alarm: words about harm or an emergency are an act of their own, whatever reasoner would be asked.

No object serves them. A calm sentence says what a person should do now: call for help, and keep apart from the danger.
It holds no medical advice.
"""

from __future__ import annotations

import locale
import os
import re

from cartier.errors import InputError, brief
from cartier.types import AlarmKind, Selection
from cartier.understanding.act_classifier import alarm_kind

NAME = "alarm screen"
VARIABLE = "CARTIER_EMERGENCY_NUMBER"
ELSEWHERE = "your local emergency number"
NUMBER = re.compile(r"\+?[0-9][0-9 -]{1,19}")
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
ONE_NUMBER = {
    "000": "AU", "111": "NZ", "911": "AR CA CR DO EC MX PA PE PH UY US", "999": "BD GB HK KE MY SG",
    "112": "AD AT BE BG CH CY CZ DE DK EE ES FI FR GR HR HU IE IN IS IT LI LT LU LV MC MT NL NO PL PT RO RU SE SI SK "
    "SM TR UA",
}  # fmt: skip
"""Countries with one number for police, fire brigade and ambulance; 112 is the European Union's."""
BY_COUNTRY = {country: number for number, countries in ONE_NUMBER.items() for country in countries.split()}


def screen(query: str, number: str | None = None) -> Selection | None:
    """The alarm that the words are, or None: then a reasoner may choose.

    ``number`` is the emergency number to name; by default that of ``emergency_number``.
    """
    kind = alarm_kind(query)
    if kind is None:
        return None
    why, say = TOLD[kind]
    text = say.format(number=emergency_number(number))
    return Selection("alarm", reason=why, text=text, model=NAME, alarm=kind)


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
