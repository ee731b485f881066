"""A home that is being mapped, served: each request gets the latest snapshot, and answers say of when it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.live.session import Live
from cartier.serving.homes import Homes
from cartier.types import AsOf


class LiveHomes(Homes):
    """One home, of a live session, by the name of the folder into which it is saved. It cannot be corrected yet."""

    def __init__(self, live: Live, name: str) -> None:
        self._live, self._name = live, name

    def _known(self) -> list[str]:
        return [self._name]

    def _has(self, name: str) -> bool:
        return name == self._name

    def get(self, home: str = "") -> Home:
        """The latest snapshot. Raises InputError before the first, and for one that is named and no longer the latest.

        So a number or a goal of an older map is not taken for one of this map.
        """
        self.name(home)
        latest, wanted = self._live.home(), home.partition("@")[2].strip()
        if wanted and wanted != latest.id:
            raise InputError(
                f"{self._name} has grown and is {latest.id} now, not {brief(wanted, 20)}: list its objects"
            )
        return latest

    def moment(self) -> AsOf | None:
        return self._live.moment()

    def start_xy(self, home: Home) -> Sequence[float]:
        """Where the robot is now (x, y), metres."""
        return self._live.robot_xy() or home.start_xy

    def state(self) -> dict[str, Any] | None:
        state = self._live.state()
        latest = None if state.as_of_s is None else self._live.home().id
        return state.to_dict() | {"camera": self._live.camera_pose(), "home_id": latest}
