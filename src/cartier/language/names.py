"""Names of objects and rooms: the forms that people and language models read."""

from __future__ import annotations

import re
import unicodedata

MAX_NAME_CHARS = 200
"""Of an object's name in any file; the longest of LVIS has 60."""


def display_name(label: str) -> str:
    """A detector's label as people write it: ``CoffeeMachine`` and ``coffee_machine`` become ``coffee machine``."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", unicodedata.normalize("NFC", label))
    words = re.sub(r"[\s_]+", " ", "".join(c if c.isprintable() else " " for c in spaced)).strip()
    return words.lower()


def object_ref(label: str, number: int) -> str:
    """Which of the objects of a name: ``cup #12``, in prompts, in replies, and in what the robot has said."""
    return f"{label} #{number}"


def room_ref(name: str, number: int) -> str:
    """Which room: ``kitchen (room 3)``."""
    return f"{name} (room {number})"
