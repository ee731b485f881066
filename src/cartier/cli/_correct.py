"""Commands that correct a home: name, forget, move, undo."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier.cli._common import HomeFolder, numbers

if TYPE_CHECKING:
    from cartier.home import corrections

app = typer.Typer()
Object = Annotated[
    str, typer.Argument(metavar="OBJECT", help="Its id, its name, or its label if it is the only one with it.")
]
Who = Annotated[str | None, typer.Option("--who", help="Who makes the correction. Default: the user of this machine.")]


@app.command()
def name(
    home: HomeFolder,
    entity: Annotated[
        str, typer.Argument(metavar="ROOM_OR_OBJECT", help="An object's id or label, a room's name, or room:ID.")
    ],
    called: Annotated[str, typer.Argument(metavar="NAME", help='The new name, for example "Ayo\'s room".')],
    who: Who = None,
) -> None:
    """Name an object or a room."""
    _correct(home, "name", entity, name=called, who=who)


@app.command()
def forget(home: HomeFolder, obj: Object, who: Who = None) -> None:
    """Remove an object that is not there."""
    _correct(home, "forget", obj, who=who)


@app.command(context_settings={"ignore_unknown_options": True})  # -1,2 is a place
def move(
    home: HomeFolder,
    obj: Object,
    to: Annotated[str, typer.Argument(metavar="X,Y", help="The new middle, in metres of the floor plan.")],
    who: Who = None,
) -> None:
    """Move an object to where it stands now."""
    _correct(home, "move", obj, to_xy=numbers(to, 2, "X,Y") or (), who=who)


@app.command()
def undo(home: HomeFolder, who: Who = None) -> None:
    """Undo the latest correction."""
    _correct(home, "undo", who=who)


def _correct(
    home: Path, what: corrections.CorrectionKind, entity: str = "", *,
    name: str = "", to_xy: Sequence[float] = (), who: str | None,
) -> None:  # fmt: skip
    from cartier.home import Home

    print(Home.load(home).correct(what, entity, name=name, to_xy=to_xy, who=who or _user())[1])


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user id without an account, as in a container
        return "somebody"
