"""Access to homes: which of them the token of a request may see, checked where a home is looked up by its name."""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class Access:
    """What a token may see.

    Args:
        who: Tells tokens apart without being one: the start of its digest.
        homes: Patterns of homes' names, as a shell has them; ``*`` is any text.
    """

    who: str = ""
    homes: tuple[str, ...] = ("*",)

    def sees(self, home: str) -> bool:
        """Whether the token may see a home."""
        return any(fnmatchcase(home, pattern) for pattern in self.homes)


ACCESS: ContextVar[Access | None] = ContextVar("access", default=None)
"""That of the request which is being answered; the guard sets it, and threads of the request have it, too."""
