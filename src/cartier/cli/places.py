"""Places of homes on the command line: a folder, a home of a fleet's store, or object storage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier import plugins
from cartier.home.store import MANIFEST

if TYPE_CHECKING:
    from cartier.home import Home
    from cartier.serving.homes import Homes

HomePlace = Annotated[
    str, typer.Argument(metavar="HOME", help="A folder that 'cartier map' wrote, or STORE#NAME, a home of a fleet.")
]


def home_at(place: str) -> Home:
    """The home in a folder; at ``STORE#NAME``, the latest version of a fleet's home; or at ``s3://…/homes/VERSION``.

    Raises InputError if there is none.
    """
    from cartier.home import Home

    if _is_plain(place):
        return Home.load(place)
    found: Home = plugins.neighbour("homes", "fleet").home_at(place)
    return found


def homes_at(places: Sequence[str], memory_mb: int) -> Homes:
    """The homes to serve: those in folders, or all of one fleet's store. Raises InputError for both together."""
    from cartier.serving.homes import Homes

    if all(map(_is_plain, places)):
        return Homes([Path(place) for place in places], memory_mb * 2**20)
    homes: Homes = plugins.neighbour("homes", "fleet").homes_at(places, memory_mb * 2**20)
    return homes


def _is_plain(place: str) -> bool:
    """Whether a place is a folder of a home, or nothing at all."""
    folder = Path(place)
    nothing = not folder.exists() and "#" not in place and "://" not in place
    return nothing or (folder / MANIFEST).exists() or (not (folder / "names").is_dir() and folder.exists())
