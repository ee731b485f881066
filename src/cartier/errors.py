"""What goes wrong on the user's side: each message is one line that says what, where, and how to mend it."""

from __future__ import annotations

import re

ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")  # of an object, as Python prints it: it tells nobody anything


class CartierError(Exception):
    """A fault that the user can mend. The command line prints the message alone and exits with 1.

    What stands in a message may come from a stranger's file: line breaks and control characters become blanks.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(_printable(str(message)))


class InputError(CartierError):
    """A recording, a detections file, a model or a saved home is not what it should be."""


class BackendError(CartierError):
    """A backend is unknown, was given an option that it does not have, or misbehaved."""


class MissingExtra(BackendError):
    """A backend needs a package that is not installed."""


class ReasonerError(CartierError):
    """A language model could not be reached or refused to work. Rubbish in a reply is not an error but no answer."""


def brief(foreign: object, most: int = 100) -> str:
    """What a file, a server or a library says, for a message: one printable line of ``most`` characters at most."""
    try:
        text = foreign[: 4 * most] if isinstance(foreign, str) else str(foreign)
    except (ValueError, RecursionError):  # a number of thousands of digits, a list nested without end
        text = type(foreign).__name__
    line = " ".join(_printable(ADDRESS.sub("", text[: 4 * most])).split())
    return line if len(line) <= most else line[: most - 1] + "…"


def _printable(text: str) -> str:
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
