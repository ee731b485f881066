"""Spelling correction: ``teh cofee tabel`` is the coffee table. Only unknown words are changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Iterable

from cartier.labels import words

SHORTEST, LONGEST = 3, 20  # letters of a word that may be corrected
LONG = 6  # letters from which one may be wrong: in short words, another letter makes another word
ENDINGS = ("s", "es", "d", "ed", "ing", "r", "er", "y", "ly", "ish", "n", "ness")
TYPED = frozenset(words("""
    arent aint bday brb btw bruh cant couldnt daren didnt dont doesnt duh hadn hasnt havent hes hows idk im isnt ive lol
    mins mustn needn oops omg plz pls shes shouldnt thats theres theyre thx tho tmrw ur wanna wasnt weve whats wheres
    whos wont wouldnt yall youre youve
    """))  # fmt: skip


class Spelling:
    """The nearest likely word within one slip: a letter too many, missing, wrong, or swapped with its neighbour.

    ``known`` words and their inflected forms stay as they are. A short word is only corrected to one of ``names``.
    """

    def __init__(self, known: Container[str], names: Iterable[str], others: Iterable[str]) -> None:
        self._known = known
        self._likely = dict.fromkeys(w for w in names if len(w) >= SHORTEST and w.isalpha())
        self._likely |= dict.fromkeys(w for w in others if len(w) >= 2 * SHORTEST - 1 and w.isalpha())
        self._of_length: defaultdict[int, list[str]] = defaultdict(list)
        for word in self._likely:
            self._of_length[len(word)].append(word)

    def __call__(self, word: str) -> str:
        if not SHORTEST <= len(word) <= LONGEST or not word.isalpha() or self._is_word(word):
            return word
        lengths = range(len(word) - 1, len(word) + 2)
        near = (w for length in lengths for w in self._of_length.get(length, ()) if _one_slip(word, w))
        return min(near, key=lambda w: _strangeness(word, w), default=word)

    def _is_word(self, word: str) -> bool:
        if word in self._known or word in self._likely or word in TYPED:
            return True
        roots = (word[: -len(e)] for e in ENDINGS if word.endswith(e))
        return any(len(r) > 2 and (r in self._known or r + "e" in self._known or r[:-1] in self._known) for r in roots)


def _strangeness(typed: str, meant: str) -> tuple[object, ...]:
    """People leave letters out and swap them more often than they add some, and seldom miss the first."""
    return meant[0] != typed[0], len(meant) < len(typed), sorted(meant) != sorted(typed), meant


def _one_slip(a: str, b: str) -> bool:
    if len(a) > len(b):
        a, b = b, a
    i = next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), len(a))
    if len(a) < len(b):
        return a[i:] == b[i + 1 :]
    swapped = a[i : i + 2] == b[i : i + 2][::-1] and a[i + 2 :] == b[i + 2 :]
    return swapped or (len(a) >= LONG and a[i + 1 :] == b[i + 1 :])
