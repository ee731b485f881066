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
    r"(?: ?(?P<part>a ?m|p ?m|at night|tonight"
    r"|(?:in the|each|every|this|of an?|a) (?:morning|afternoon|evening|night|a ?m|p ?m)))?\b"
)
BEFORE_TIME = re.compile(r"\b(?:until|till|til|before|by|after|from|past|between|to|and|at|around) $")
HALF_DAY = re.compile(r"\b([ap]) ?\. ?m\b(?: ?\.)?")  # p.m., and as the tokens have it, p . m .
NIGHT = re.compile(r"\b(?:nights?|evenings?|sleeps?|dark)\b")
DAY_TIME = re.compile(r"\b(?:day|morning|afternoon|noon)\b")
AFTER_TIME = re.compile(r" (?:until|till|til|to)\b")
"""What stands before and after "one" where it is a time."""
DAYPARTS = {
    "night": "22:00-06:00", "morning": "06:00-12:00", "afternoon": "12:00-18:00", "evening": "18:00-22:00",
    "(?:the|by|during) day": "06:00-22:00", "day ?time": "06:00-22:00",
}  # fmt: skip
NIGHT_ENDS, DAY = 6 * 60, 24 * 60
STANDING = re.compile(
    r"\b(?:from (?:now|today|here) on|from today|always|ever|in future|for good|any ?more|as a rule"
    r"|(?:until|till) (?:i|we|further|you hear)|(?:every|each) time|permanently)\b"
)
DRIVE = re.compile(
    r"\b(?:once|right now|for now|last bit|final bit"
    r"|(?:this|on the) (?:time|trip|drive|one|run|errand|journey|round|tour|way))\b"
)
UNTIL = re.compile(r"\b(?:until|till|til|before|by|up to|to|latest)\b")
FROM = re.compile(r"\b(?:after|from|past|later)\b")
ONE_DAY = re.compile(r"\b(?:today|tonight|rest of the day|for the night|this (?:evening|afternoon|morning))\b")


def scope_of(said: str, default: str = "standing", around: str = "") -> str:
    """The scope of a rule by the words for it; words that tell nothing known give the default.

    ``around`` is the whole sentence: it may speak of the night.
    """
    told = " ".join(HALF_DAY.sub(r"\1m", plain(said)).replace(" : ", ":").replace("'", " ").split())
    times = list(_times(told))
    if len(times) >= 2:
        return _daily(times[0], times[1], told, plain(around)) or default
    if STANDING.search(told):
        return "standing"
    if DRIVE.search(told):
        return "drive"
    if UNTIL.search(told):
        if times and "tomorrow" not in told:
            return f"until:{_clock(times[0][-1])}"
        return "until:tomorrow" if re.search(r"\b(?:tomorrow|morning)\b", told) else default
    if times and FROM.search(told) and (begin := times[0][-1]) != NIGHT_ENDS:
        return f"daily:{_clock(begin)}-{_clock(NIGHT_ENDS)}"
    if ONE_DAY.search(told):
        return "until:tomorrow"
    parts = (f"daily:{hours}" for part, hours in DAYPARTS.items() if re.search(rf"\b{part}(?:s|time)?\b", told))
    return next(parts, default)


def _daily(begins: tuple[int, ...], ends: tuple[int, ...], told: str, around: str) -> str:
    """The span between two times: of those that the words may mean the shortest, by night where the words say so.

    Of two that are equally long, as from nine to five, the one by day.
    """
    late = NIGHT.search(f"{told} {around}") is not None and not DAY_TIME.search(told)

    def rank(begin: int, end: int) -> tuple[bool, int, bool]:
        return late and not 16 * 60 <= begin < DAY, (end - begin) % DAY, not 7 * 60 <= begin < 19 * 60

    pairs = [(begin, end) for begin in begins for end in ends if begin != end]
    if not pairs:
        return ""
    begin, end = min(pairs, key=lambda pair: rank(*pair))
    return f"daily:{_clock(begin)}-{_clock(end)}"


def _clock(minutes: int) -> str:
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


def _times(told: str) -> Iterator[tuple[int, ...]]:
    """The times of a day in words, in minutes: one, or two where it may be before or after noon.

    Alone, without "morning", the later one is meant.
    """
    for found in TIME.finditer(told):
        name, part = found["hour"], (found["part"] or "").replace(" ", "")
        if name == "one" and not (part or found["past"] or BEFORE_TIME.search(told[: found.start()])
                                  or AFTER_TIME.match(told[found.end() :])):  # fmt: skip
            continue
        hour, minute = NAMED.get(name, -1), found["minute"] or "0"
        hour = int(name) if hour < 0 else hour
        if hour > 23:
            continue
        minutes = PAST[found["past"] or ""] + (MINUTES.get(minute) or int(minute))
        exact = hour > 12 or name[0] == "0" or name in ("noon", "midday", "midnight")
        if part.endswith(("am", "morning")):
            hours: tuple[int, ...] = (hour % 12,)
        elif part.endswith("night") and part != "tonight":
            hours = (hour % 12 + (12 if 5 <= hour < 12 else 0),)
        elif part:
            hours = (hour % 12 + 12,)
        elif hour == 12:
            hours = (12,)
        else:
            hours = (hour,) if exact else (hour % 12, hour % 12 + 12)
        yield tuple((60 * each + minutes) % DAY for each in hours)
