"""Questions over many homes: the frame that speaks of homes, and the words about an object within it.

The frame ("which flats have no …", "how many … per home") is read here; what is left of the words is read as in one
home, by the one parser.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from cartier.errors import InputError, brief
from cartier.labels import plain

Form = Literal["which", "count_homes", "per_home", "total", "most", "fewest", "list", "extreme"]
NUMBERS = {
    w: n for n, w in enumerate(["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"])
}
HOMES = r"(?:homes?|flats?|houses?|apartments?|places?|dwellings?)"
HAVE = r"(?:have|has|got|contain|contains|own|owns|with|(?:have|has) got)"
LACK = (
    r"(?:lacks?|without|(?:is|are) missing|(?:have|has|with|got|contain|contains) (?:no|not any|not a|not an|none of)"
    r"|(?:do|does) (?:not|n t) (?:have|contain|own)|(?:don|doesn) t (?:have|contain|own)|(?:have|has) ?n t (?:got )?)"
)
WHICH = rf"(?:in )?(?:which|what) {HOMES}"
THOSE = rf"(?:(?:which|what)(?: of the)?|(?:list|show|name)(?: me)?(?: all| the)*) {HOMES} (?:that )?"
EACH = rf"(?:per|in each|in every|by|for each) {HOMES}"
ALL = rf"(?: in (?:all|the|any)(?: the)? {HOMES}| in total| altogether| overall)?"
ARTICLE = re.compile(r"^(?:a|an|any|some|the|one of the) ")
COUNTED = re.compile(rf"^(at least|more than|over|exactly|fewer than|less than|at most)? ?(\d+|{'|'.join(NUMBERS)}) ")
BIGGEST = r"(?:biggest|largest|smallest|tallest|shortest|highest|lowest)"
HELP = (
    "over many homes I can tell which homes have or lack something, how many, how many per home, in which most or "
    "fewest, the biggest one, and list them; for all else name one home"
)


@dataclass(frozen=True)
class FleetQuestion:
    """What is asked over all homes.

    Args:
        form: Which homes (``which``), how many homes, how many objects per home or in all, the home with most or fewest
            of them, their list, or the one object that is the biggest …
        about: The words about the object.
        negated: Whether the homes that lack it are meant.
        least: The least count that makes a home have it.
        most: The largest count, or None.
    """

    form: Form
    about: str
    negated: bool = False
    least: int = 1
    most: int | None = None


FRAMES: tuple[tuple[str, Form, bool], ...] = (
    (rf"{WHICH} (?:have|has|contains?) (?:the )?most (?P<x>.+)", "most", False),
    (rf"{WHICH} (?:have|has|contains?) (?:the )?(?:fewest|least) (?P<x>.+)", "fewest", False),
    (rf"{WHICH} (?:have|has|contains?|is|holds) (?P<x>the {BIGGEST} .+)", "extreme", False),
    (rf"(?:where is|what is|find|show) (?P<x>the {BIGGEST} .+?)(?: of all(?: {HOMES})?)?{ALL}", "extreme", False),
    (rf"how many {HOMES} {LACK} (?P<x>.+)", "count_homes", True),
    (rf"how many {HOMES} {HAVE} (?P<x>.+)", "count_homes", False),
    (rf"{THOSE}{LACK} (?P<x>.+)", "which", True),
    (rf"{THOSE}{HAVE} (?P<x>.+)", "which", False),
    (rf"{WHICH} (?:is|are) there no (?P<x>.+)", "which", True),
    (rf"{WHICH} (?:is|are) there (?P<x>.+)", "which", False),
    (rf"(?:is|are) there (?P<x>.+?) in any {HOMES}", "which", False),
    (rf"(?:do|does) any {HOMES} (?:have|contain) (?P<x>.+)", "which", False),
    (rf"how many (?P<x>.+?)(?: are there| do they have)? {EACH}", "per_home", False),
    (rf"how many (?P<x>.+?) does (?:each|every) {HOMES} have", "per_home", False),
    (rf"how many (?P<x>.+?)(?: are there| do I have| do we have)?{ALL}", "total", False),
    (rf"(?:list|show|where are|find)(?: me)?(?: all)?(?: the)? (?P<x>.+?){ALL}", "list", False),
)


def read_question(words: str) -> FleetQuestion:
    """What is asked. Raises InputError with what can be asked."""
    said = " ".join(re.sub(r"[^\w\s]", " ", plain(words)).split())
    for frame, form, negated in FRAMES:
        if (found := re.fullmatch(frame, said)) is not None:
            return _counted(form, found["x"], negated)
    raise InputError(f"{brief(words, 80)!r} is no question that I understand: {HELP}")


def _counted(form: Form, about: str, negated: bool) -> FleetQuestion:
    """The question with a number before its object taken off: "at least two beds"."""
    found = COUNTED.match(about) if form in ("which", "count_homes") else None
    if found is None:
        return FleetQuestion(form, about if form == "extreme" else ARTICLE.sub("", about), negated)
    number = int(found[2]) if found[2].isdigit() else NUMBERS[found[2]]
    least, most = {
        "more than": (number + 1, None), "over": (number + 1, None), "exactly": (number, number),
        "fewer than": (0, number - 1), "less than": (0, number - 1), "at most": (0, number),
    }.get(found[1] or "", (number, None))  # fmt: skip
    return FleetQuestion(form, about[found.end() :], negated, least, most)
