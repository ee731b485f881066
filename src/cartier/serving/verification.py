"""Verification of a served home: only where its owner lets photographs leave, and by one asker at a time."""

from __future__ import annotations

import threading
from typing import Any

from cartier.errors import InputError
from cartier.home.looking import name_of, verify
from cartier.serving.homes import Homes
from cartier.vision.permission import Look


class Verification:
    """What ``--look auto`` allows a server to ask about doubtful objects. Thread-safe."""

    def __init__(self, look: Look | None) -> None:
        self._look = look
        self._under_way, self._lock = set[str](), threading.Lock()

    @property
    def allowed(self) -> bool:
        """Whether the owner lets photographs leave without being asked each time."""
        return self._look is not None and self._look.when == "auto"

    def of(self, homes: Homes, home: str) -> dict[str, Any]:
        """Ask about the doubtful objects of a home, and add what is said to its log.

        Returns plain values. Raises InputError where no photograph may leave, and where the home is being verified;
        ReasonerError if the model cannot be reached.
        """
        if self._look is None or not self.allowed:
            raise InputError("no photograph may leave here: the owner starts the server with --look auto to verify")
        mapped, name = homes.get(home), homes.name(home)
        with self._lock:
            if name in self._under_way:
                raise InputError(f"{name} is being verified: call verify again when that has ended")
            self._under_way.add(name)
        try:
            calibration, checked = verify(mapped, self._look)
        finally:
            with self._lock:
                self._under_way.discard(name)
        after = {obj.id: obj.probability for obj in homes.get(home).objects}
        asked = [each for each in checked if each.trace.reply is not None]
        return {
            "model": name_of(self._look.model), "weights": calibration.to_dict(),
            "asked": [each.to_dict(after[each.obj.id]) for each in asked], "not_asked": len(checked) - len(asked),
            "next": "undo takes the latest back" if asked else "nothing changed",
        }  # fmt: skip
