"""Reader of questions about how objects look: which attribute or state is asked of which noun phrase.

It reads forms of questions, not meaning: what the noun phrase stands for is left to the parser and the home
(``candidates.py``).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from cartier.labels import plain

ON_OFF, OPEN_SHUT, FULL_EMPTY, CLEAN_DIRTY = ("on", "off"), ("open", "closed"), ("full", "empty"), ("clean", "dirty")
COLOURS = ("black", "grey", "white", "red", "orange", "yellow", "green", "blue", "purple", "pink", "brown")
CLOSED: Mapping[str, tuple[str, ...]] = {
    "clean": CLEAN_DIRTY, "on": ON_OFF, "open": OPEN_SHUT, "full": FULL_EMPTY, "colour": COLOURS,
}  # fmt: skip
"""The closed set of answers to each attribute that has one; "text" and "look" are open."""
_SAID: Mapping[str, Sequence[str]] = {
    "clean": ("clean", "washed", "spotless"), "dirty": ("dirty", "unwashed", "filthy", "stained", "muddy", "dusty"),
    "on": ("on", "switched on", "turned on", "lit", "running"), "off": ("off", "switched off", "turned off"),
    "open": ("open", "opened", "ajar"), "closed": ("closed", "shut"),
    "full": ("full", "filled"), "empty": ("empty",),
}  # fmt: skip
VALUES: Mapping[str, str] = (
    {word: value for value, words in _SAID.items() for word in words}
    | {word: word for word in COLOURS}
    | {"gray": "grey"}
)
"""What words call an answer."""
_STATE = "|".join(sorted(VALUES, key=lambda word: (-len(word), word)))
_BEFORE = "|".join(word for word in VALUES if word not in ("on", "off", "running", "switched on", "turned on"))
_NP = r"(?P<np>(?:the|my|our|your|his|her|their|that|this|these|those|all the|any of the)\b.+?)"
_POLITE = re.compile(
    r"^(?:(?:please|hey|hi|hello|so|and|well|robot|excuse me|could you|can you|would you|tell me|do you know|check|see|"
    r"look|find out|i wonder|i want to know|let me know|whether|if)\b[ ,]*)+"
)
_INDIRECT = re.compile(r"^(?P<np>(?:the|my|our|your|this|that) .+?) (?P<verb>is|are) (?P<rest>.+)$")
"""The order of words after "tell me whether"."""
_WHETHER = re.compile(r"\b(?:whether|if|check|see|tell me|find out|wonder|know)\b")
"""What makes a question of words in the order of a statement: "the mug is dirty" alone asks nothing."""
_STILL = r"(?:(?:still|really|currently|already|all|both|left|now) )*"
_END = r"(?: (?:now|right now|at the moment|still|again|yet|today|please|or not))*$"
Form = Literal["state", "which", "what"]
_LEFT = r"(?:leave|left|turn|turned|switch|switched|forget|forgotten)"
_WISH = (
    r"(?:(?:bring|get|fetch|hand|give|pass|show)(?: me| us)?|(?:i|we) (?:need|want|would like)|i'd like|find(?: me)?|"
    r"take me to|go to|drive to|where(?: is|'s| are))(?: to)?"
)
_TEXT_OF = r"(?:written|printed|the (?:text|label|title|name|number))"
_READ = r"(?:what is (?:written )?on|what it says on|the (?:label|title|text|number) (?:on|of))"
_PATTERNS: Sequence[tuple[Form, str | None, str]] = (
    ("what", "colour", rf"(?:what|which) colou?r (?:is|are|has|have|does|do) {_NP}(?: (?:have|got))?"),
    ("what", "colour", rf"what(?: is|'s) the colou?r of {_NP}"),
    ("what", "text", rf"what (?:does|do) (?:it say on |the (?:label|sign|title) (?:of|on) )?{_NP} say"),
    ("what", "text", rf"what does it say on {_NP}"),
    ("what", "text", rf"what(?: is|'s)? (?:is )?{_TEXT_OF} (?:on|of) {_NP}"),
    ("what", "text", rf"(?:what|which) (?:number|letter|word|text|name|title) (?:is|stands|does it say) on {_NP}"),
    ("what", "text", rf"read (?:me |out )?{_READ} {_NP}"),
    ("what", "look", rf"what (?:does|do) {_NP} look like"),
    ("what", "look", rf"how (?:does|do) {_NP} look"),
    ("which", None, rf"(?:which|what)(?: one)? (?:of )?(?P<np>.+?) (?:is|are|looks?|was)(?: left)? (?:the )?"
     rf"(?P<value>{_STATE})(?: one| ones)?"),
    ("which", None, rf"(?:is|are) there (?P<np>(?:an?|any|some) (?P<value>{_BEFORE}) .+?)"),
    ("which", None, rf"{_WISH} (?P<np>(?:an?|the|some|any|my) (?P<value>{_BEFORE}) .+?)"),
    ("state", None, rf"(?:is|are|was|were) {_NP} {_STILL}(?P<value>{_STATE})(?: or (?:{_STATE}|not))?"),
    ("state", None, rf"(?:does|do) {_NP} look {_STILL}(?P<value>{_STATE})"),
    ("state", None, rf"(?:did|have|has) (?:i|we|you|some(?:body|one)|anybody) {_LEFT} {_NP} (?P<value>on|off|open)"),
)  # fmt: skip
_FORMS = [(form, attribute, re.compile(f"^{pattern}{_END}")) for form, attribute, pattern in _PATTERNS]
_UNLISTED = (
    "broken|cracked|damaged|scratched|torn|wet|dry|warm|hot|cold|cool|fresh|ripe|rotten|spoiled|alive|dead|wilted|made|"
    "unmade|tidy|messy|locked|unlocked|plugged in|unplugged|charged|charging|working|ready|done|finished|boiling|sharp|"
    "blunt|comfortable|soft|heavy|loose|new|worn|made of \\w+|wooden|flat|inflated|loaded|free|occupied|in use"
)
"""Predicates that no list of objects holds, and that no closed set of answers fits."""
_UNLISTED_FORM = re.compile(rf"^(?:is|are|was|were) {_NP} {_STILL}(?P<value>{_UNLISTED})(?: or not)?{_END}")
PRONOUNS = frozenset(("it", "this", "that", "this one", "that one", "they", "them", "these", "those"))
_PRONOUN = re.compile(
    rf"^(?:is|are|was|were) (?P<np>{'|'.join(sorted(PRONOUNS, key=len, reverse=True))}) "
    rf"{_STILL}(?P<value>{_STATE})(?: or (?:{_STATE}|not))?{_END}"
)


@dataclass(frozen=True)
class Asked:
    """What is asked about how an object looks.

    Args:
        form: "state" (is it so?), "which" (which of several is so?) or "what" (what is it like?).
        attribute: As in ``VisualQuestion``.
        noun: The noun phrase, with articles and places, without the value: "the mug in the kitchen".
        value: The answer that the words hope for or presume, or empty.
    """

    form: Form
    attribute: str
    noun: str
    value: str = ""

    @property
    def choices(self) -> tuple[str, ...]:
        """The closed set of answers; empty for an open question."""
        return CLOSED.get(self.attribute, ())


def read(words: str) -> Asked | None:
    """The question about how something looks that a person's words are, or None if they ask for something else."""
    said = _asked_words(words)
    for form, attribute, pattern in _FORMS:
        found = pattern.match(said)
        if found is None:
            continue
        groups = found.groupdict()
        noun, value = groups["np"], VALUES.get(groups.get("value") or "", "")
        if form == "which" and groups.get("value"):
            noun = re.sub(rf"\b{re.escape(groups['value'])} ", "", noun, count=1)
        asked = attribute or next(name for name, choices in CLOSED.items() if value in choices)
        if asked == "colour" and form == "which" and _is_go(said):
            continue
        return Asked(form, asked, noun, value)
    return None


def read_unlisted(words: str) -> Asked | None:
    """A question about a state that neither a list nor a closed set of answers holds ("is the chair broken?"), or
    None."""
    found = _UNLISTED_FORM.match(_asked_words(words))
    return None if found is None else Asked("state", "other", found["np"], found["value"])


def read_of_last(words: str) -> Asked | None:
    """The question about a state of what was mentioned before ("is it open?"), or None."""
    found = _PRONOUN.match(_asked_words(words))
    if found is None:
        return None
    value = VALUES[found["value"]]
    return Asked("state", next(name for name, choices in CLOSED.items() if value in choices), found["np"], value)


def _asked_words(words: str) -> str:
    """The words without marks and courtesies, in the order of a question."""
    said = " ".join(re.sub(r"[^\w\s',-]", " ", plain(words)).split()).strip(" ,")
    bare = _POLITE.sub("", said)
    return _INDIRECT.sub(r"\g<verb> \g<np> \g<rest>", bare) if _WHETHER.search(said[: len(said) - len(bare)]) else bare


def _is_go(said: str) -> bool:
    """A drive or a place: the list knows colours, and what it finds by them is not asked again."""
    return not said.startswith(("which", "what", "is", "are"))
