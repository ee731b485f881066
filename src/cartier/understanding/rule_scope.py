"""How long a route rule holds, by the words for it: "until three", "after ten at night", "just this once"."""

from __future__ import annotations

import re
from collections.abc import Iterator

from cartier.labels import plain, words

HOURS = words("one two three four five six seven eight nine ten eleven twelve")
NAMED = {name: hour for hour, name in enumerate(HOURS, start=1)} | {"noon": 12, "midday": 12, "midnight": 0}
PAST = {"half past": 30, "half": 30, "quarter past": 15, "quarter to": -15, "": 0}
MINUTES = {"thirty": 30, "fifteen": 15}
TIME = re.compile(
    rf"\b(?:(?P<past>half past|half|quarter past|quarter to) )?(?P<hour>\d{{1,2}}|{'|'.join(NAMED)})"
    r"(?:[ :.h]+(?P<minute>[0-5]\d|thirty|fifteen))?(?: ?o ?clock)?"
    r"(?: ?(?P<part>a ?m|p ?m|at night|in the (?:morning|afternoon|evening)|tonight))?\b"
)
BEFORE_TIME = re.compile(r"\b(?:until|till|til|before|by|after|from|past|between|to|and|at|around) $")
"""What stands before "one" where it is a time."""
DAYPARTS = {
    "night": "22:00-06:00", "morning": "06:00-12:00", "afternoon": "12:00-18:00", "evening": "18:00-22:00",
    "(?:the|by|during) day": "06:00-22:00", "day ?time": "06:00-22:00",
}  # fmt: skip
NIGHT_ENDS = "06:00"
STANDING = re.compile(
    r"\b(?:from (?:now|today|here) on|from today|always|ever|in future|for good|any ?more|as a rule"
    r"|(?:until|till) (?:i|we|further|you hear)|(?:every|each) time|permanently)\b"
)
DRIVE = re.compile(r"\b(?:once|this (?:time|trip|drive|one)|right now|for now|on (?:this|the) (?:way|drive|trip))\b")
UNTIL, FROM = re.compile(r"\b(?:until|till|til|before|by)\b"), re.compile(r"\b(?:after|from|past|later)\b")
ONE_DAY = re.compile(r"\b(?:today|tonight|for the night|this (?:evening|afternoon|morning))\b")


def scope_of(said: str, default: str = "standing") -> str:
    """The scope of a rule by the words for it; words that tell nothing known give the default."""
    told = " ".join(plain(said).replace(" : ", ":").replace("'", " ").split())
    if STANDING.search(told):
        return "standing"
    if DRIVE.search(told):
        return "drive"
    times = list(_times(told))
    if len(times) >= 2:
        return f"daily:{times[0]}-{times[1]}" if times[0] != times[1] else default
    if UNTIL.search(told):
        if times and "tomorrow" not in told:
            return f"until:{times[0]}"
        return "until:tomorrow" if re.search(r"\b(?:tomorrow|morning)\b", told) else default
    if times and FROM.search(told) and times[0] != NIGHT_ENDS:
        return f"daily:{times[0]}-{NIGHT_ENDS}"
    if ONE_DAY.search(told):
        return "until:tomorrow"
    parts = (f"daily:{hours}" for part, hours in DAYPARTS.items() if re.search(rf"\b{part}(?:s|time)?\b", told))
    return next(parts, default)


def _times(told: str) -> Iterator[str]:
    """The times of a day in words, as HH:MM.

    Without "morning" or "evening", one to seven are after noon; after "after" or "from" eight to eleven are, too.
    """
    late = FROM.search(told.replace("half past", "").replace("quarter past", "")) is not None
    for found in TIME.finditer(told):
        name, part = found["hour"], (found["part"] or "").replace(" ", "")
        if name == "one" and not (part or found["past"] or BEFORE_TIME.search(told[: found.start()])):
            continue
        hour, minute = NAMED.get(name, -1), found["minute"] or "0"
        hour = int(name) if hour < 0 else hour
        if hour > 23:
            continue
        clock = name[0] == "0" or name in ("noon", "midday", "midnight")
        if part == "atnight":
            hour = hour % 12 + (12 if 5 <= hour < 12 else 0)
        elif part in ("pm", "intheafternoon", "intheevening", "tonight"):
            hour = hour % 12 + 12
        elif part in ("am", "inthemorning"):
            hour %= 12
        elif not clock and (1 <= hour <= 7 or (late and 8 <= hour <= 11)):
            hour += 12
        minutes = 60 * hour + PAST[found["past"] or ""] + (MINUTES.get(minute) or int(minute))
        yield f"{minutes // 60 % 24:02d}:{minutes % 60:02d}"
