"""Text normalisation: plain letters, stems, stop words, and keys under which names are equal."""

from __future__ import annotations

from functools import lru_cache

from cartier.labels import IRREGULAR_PLURALS, PLURAL_ONLY, singular, words

STOP = frozenset(
    words("""
        a about actually after again ah all almost already also always am an and another any anybody anyone anything
        anyway anywhere are around as at away back be because been before being believe best better between bit both
        bring but by came can cannot come comes coming could d day days did do does doing don done down each either else
        enough even ever every everybody everyone everything everywhere fetch few find first for from get gets getting
        give given go goes going gone good got great had has have having he hello help her here hers hey hi him his
        honestly how i if imagine in into is it its itself just keep keeps kind know last lately later least let lets
        like little ll look looks lot lots m made make makes many may maybe me mean might mine minute more most much
        must my myself near nearly need needed needs never next nice no nobody nor not nothing now o of off oh ok okay
        old on once one ones only or other our ours out over own perhaps please pretty put quite rather re really rid
        right robot s said same say says see seem seems shall she should show since so some somebody someone something
        sometimes somewhere soon still stuff such sure t take tell than thank thanks that the their them then there
        these they thing things think this those though thought three through to today together told tomorrow too took
        two ugh under until up upon us use used ve very want wanted wants was way we well went were what whatever when
        where whether which while who whole whom whose why will with within without wo won would yeah yes yesterday yet
        you your yours
        """)
)
"""Words that are said around any need."""

IRREGULAR = IRREGULAR_PLURALS | {
    "children": "child", "kids": "child", "kid": "child", "men": "man", "women": "woman", "people": "person",
    "ate": "eat", "eaten": "eat", "drank": "drink", "drunk": "drink", "slept": "sleep", "asleep": "sleep",
    "wrote": "write", "written": "write", "broke": "break", "broken": "break", "spilt": "spill", "bought": "buy",
    "wore": "wear", "worn": "wear", "tore": "tear", "torn": "tear", "sat": "sit", "stood": "stand", "felt": "feel",
    "fell": "fall", "hung": "hang", "burnt": "burn", "froze": "freeze", "frozen": "freeze", "stank": "stink",
    "stunk": "stink", "swept": "sweep", "sang": "sing", "rang": "ring", "woke": "wake", "awake": "wake",
    "woken": "wake", "lit": "light", "lying": "lie", "dying": "die", "dried": "dry", "heard": "hear", "paid": "pay",
    "wept": "weep", "swam": "swim", "rode": "ride", "ridden": "ride", "bled": "bleed", "blood": "bleed",
    "bloody": "bleed", "hotter": "hot", "colder": "cold", "warmer": "warm", "faster": "fast", "movie": "film",
    "movies": "film", "rubbish": "trash", "garbage": "trash", "email": "mail", "emails": "mail", "telly": "television",
    "tv": "television", "fridge": "refrigerator", "filthy": "dirty", "wrinkly": "wrinkle", "wobbly": "wobble",
    "cuddly": "cuddle", "mum": "mother", "mom": "mother", "dad": "father", "puppy": "dog", "grandmother": "grandma",
    "scared": "afraid", "colour": "color", "colourful": "color", "hunger": "hungry", "thirst": "thirsty",
}  # fmt: skip
"""Forms that no suffix rule reaches, and a few everyday twins."""

WHOLE = PLURAL_ONLY | {"early", "string", "spring", "evening", "morning", "ceiling", "king", "family"}
SUFFIXES = ("ingly", "ing", "ily", "ies", "ied", "ed", "ly", "es", "s", "y", "e")


@lru_cache(maxsize=1 << 14)
def stem(word: str) -> str:
    """A word's stem by irregular forms, then by suffixes: ``sleepy``, ``sleeping`` and ``slept`` all give ``sleep``."""
    word = IRREGULAR.get(word, word)
    for suffix in () if word in WHOLE or singular(word) in WHOLE else SUFFIXES:
        base = word.removesuffix(suffix)
        if base != word and len(base) >= 3 and not _belongs(base, suffix):
            return _tidy(base)
    return word


def _belongs(base: str, suffix: str) -> bool:
    """Whether what looks like a suffix is part of the word: gla-ss, bl-eed, smel-ly."""
    return base[-1] in {"s": "su", "es": "u", "ed": "e", "ly": "l"}.get(suffix, "")


def _tidy(base: str) -> str:
    """``runn`` becomes ``run``; a last e or y goes, as it does from the bare word."""
    if len(base) > 3 and base[-1] == base[-2] and base[-1] not in "elsfz":
        return base[:-1]
    return base[:-1] if len(base) > 3 and base[-1] in "ey" else base


@lru_cache(maxsize=1 << 15)
def telling(phrase: str) -> tuple[str, ...]:
    """The stems of the content words, each once, in their order."""
    return tuple(dict.fromkeys(stem(w) for w in words(phrase.lower()) if w not in STOP))
