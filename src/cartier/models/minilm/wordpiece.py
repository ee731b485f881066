"""BERT's uncased WordPiece (Devlin et al. 2019): 60 lines, because the tokenizers library brings a hub client along."""

from __future__ import annotations

import unicodedata
from pathlib import Path

UNKNOWN, BEGIN, END = 100, 101, 102
LONGEST_WORD = 100  # characters; longer "words" are unknown, as in the original


class WordPiece:
    """Token ids of a text, with [CLS] and [SEP] around them."""

    def __init__(self, vocabulary: Path) -> None:
        lines = vocabulary.read_text(encoding="utf-8").split("\n")
        self._ids = {token: number for number, token in enumerate(lines) if token}

    def __call__(self, text: str, limit: int) -> tuple[list[int], bool]:
        """At most ``limit`` ids, and whether the text had to be cut."""
        ids = [BEGIN]
        for word in _words(text):
            ids.extend(self._pieces(word))
            if len(ids) >= limit:
                break
        cut = len(ids) > limit - 1
        return [*ids[: limit - 1], END], cut

    def _pieces(self, word: str) -> list[int]:
        if len(word) > LONGEST_WORD:
            return [UNKNOWN]
        ids, start = [], 0
        while start < len(word):
            for end in range(len(word), start, -1):
                found = self._ids.get(("##" if start else "") + word[start:end])
                if found is not None:
                    ids.append(found)
                    start = end
                    break
            else:
                return [UNKNOWN]
        return ids


def _words(text: str) -> list[str]:
    """Lower-case words without accents; punctuation and CJK characters stand alone."""
    plain = []
    for char in text:
        kind = unicodedata.category(char)
        if char in "\t\n\r" or kind == "Zs":
            plain.append(" ")
        elif char in "\0�" or kind.startswith("C"):
            continue
        elif _is_cjk(ord(char)):
            plain.append(f" {char} ")
        else:
            plain.append(char)
    bare = (c for c in unicodedata.normalize("NFD", "".join(plain)) if unicodedata.category(c) != "Mn")
    lowered = "".join(bare).lower()
    return "".join(f" {c} " if _is_punctuation(c) else c for c in lowered).split()


def _is_punctuation(char: str) -> bool:
    return (char.isascii() and char.isprintable() and not char.isalnum() and char != " ") or (
        unicodedata.category(char).startswith("P")
    )


def _is_cjk(code: int) -> bool:
    return (
        0x4E00 <= code <= 0x9FFF
        or 0x3400 <= code <= 0x4DBF
        or 0xF900 <= code <= 0xFAFF
        or 0x20000 <= code <= 0x2CEAF
        or 0x2F800 <= code <= 0x2FA1F
    )
