"""Places of homes on the command line: a folder, a home of a fleet's store, or object storage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier.fleet.entity import Fleet
    from cartier.home import Home

HomePlace = Annotated[
    str, typer.Argument(metavar="HOME", help="A folder that 'cartier map' wrote, or STORE#NAME, a home of a fleet.")
]


def home_at(place: str) -> Home:
    """The home in a folder; at ``STORE#NAME``, the latest version of a fleet's home; or at ``s3://…/homes/VERSION``.

    Raises InputError if there is none.
    """
    from cartier.fleet.entity import Fleet
    from cartier.home import Home

    store, named, name = place.partition("#")
    if named and not Path(place).exists():
        return Fleet(store).home(name)
    if is_store(place):
        raise InputError(f"{place} is a fleet's store: name one of its homes, as {place}#NAME")
    return Home.load(place)


def fleet_at(places: Sequence[str]) -> Fleet | None:
    """The fleet at the only place; None where the places are folders of homes. Raises InputError for both."""
    from cartier.fleet.entity import Fleet

    stores = [place for place in places if is_store(place)]
    if stores and len(places) > 1:
        raise InputError(f"{stores[0]} is a fleet's store, with many homes: serve it alone")
    return Fleet(stores[0]) if stores else None


def is_store(place: str) -> bool:
    """Whether a place is a fleet's store, and not one home."""
    from cartier.blob_stores import open_store
    from cartier.home.store import MANIFEST

    if "://" in place:
        return open_store(place).get(MANIFEST) is None
    folder = Path(place)
    return (folder / "names").is_dir() and not (folder / MANIFEST).exists()
