"""Commands that correct a home: name, confirm, relabel, add, merge, split, forget, move, undo."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from cartier.cli.common import numbers
from cartier.cli.places import HomePlace, home_at
from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier.home.correction_log import CorrectionKind

app = typer.Typer()
Object = Annotated[
    str, typer.Argument(metavar="OBJECT", help="Its id, its name, or its label if it is the only one with it.")
]
ObjectOrRoom = Annotated[
    str, typer.Argument(metavar="OBJECT_OR_ROOM", help="An object's id or label, a room's name, or room:ID.")
]
Who = Annotated[str | None, typer.Option("--who", help="Who makes the correction. Default: the user of this machine.")]


@app.command()
def name(
    home: HomePlace,
    entity: Annotated[
        str | None,
        typer.Argument(metavar="[ROOM_OR_OBJECT]", help="An object's id or label, a room's name, or room:ID."),
    ] = None,
    called: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help='The new name, for example "Ayo\'s room".')
    ] = None,
    of_home: Annotated[str | None, typer.Option("--home", metavar="NAME", help="Name the home itself.")] = None,
    who: Who = None,
) -> None:
    """Name an object, a room, or with --home the home."""
    if of_home is not None and entity is None:
        _correct(home, "name", "home", name=of_home, who=who)
    elif of_home is None and entity is not None and called is not None:
        _correct(home, "name", entity, name=called, who=who)
    else:
        raise InputError("name one thing: cartier name HOME ROOM_OR_OBJECT NAME, or cartier name HOME --home NAME")


@app.command()
def confirm(home: HomePlace, obj: Object, who: Who = None) -> None:
    """Say that an object is there, however sure the map is."""
    _correct(home, "confirm", obj, who=who)


@app.command()
def relabel(
    home: HomePlace,
    obj: Object,
    label: Annotated[str, typer.Argument(metavar="LABEL", help='What it is, for example "pencil box".')],
    who: Who = None,
) -> None:
    """Say what an object is, if the map calls it something else."""
    _correct(home, "relabel", obj, name=label, who=who)


@app.command(context_settings={"ignore_unknown_options": True})  # -1,2 is a place
def add(
    home: HomePlace,
    label: Annotated[str, typer.Argument(metavar="LABEL", help='What it is, for example "pencil box".')],
    at: Annotated[
        str, typer.Argument(metavar="X,Y|ENTITY", help="Its middle in metres, what it stands on, or a room.")
    ],
    who: Who = None,
) -> None:
    """Add an object that the map lacks."""
    try:
        entity, to_xy = "", numbers(at, 2, "X,Y") or ()
    except InputError:
        entity, to_xy = at, ()
    _correct(home, "add", entity, name=label, to_xy=to_xy, who=who)


@app.command()
def merge(
    home: HomePlace,
    obj: ObjectOrRoom,
    other: Annotated[str, typer.Argument(metavar="OTHER", help="The object or room that becomes part of it.")],
    who: Who = None,
) -> None:
    """Say that two objects, or two rooms, are one."""
    _correct(home, "merge", obj, other=other, who=who)


@app.command(context_settings={"ignore_unknown_options": True})  # -1,2 is a place
def split(
    home: HomePlace,
    obj: ObjectOrRoom,
    second: Annotated[
        str | None,
        typer.Argument(
            metavar="[X,Y]", help="A point in the second object (default: larger x or y), or where a room ends."
        ),
    ] = None,
    label: Annotated[str, typer.Option(help="What the second object is, or the second room's name.")] = "",
    who: Who = None,
) -> None:
    """Say that an object is two, side by side, or that a room is two, divided where you point."""
    _correct(home, "split", obj, name=label, to_xy=numbers(second, 2, "X,Y") or (), who=who)


@app.command()
def forget(home: HomePlace, obj: Object, who: Who = None) -> None:
    """Remove an object that is not there."""
    _correct(home, "forget", obj, who=who)


@app.command(context_settings={"ignore_unknown_options": True})  # -1,2 is a place
def move(
    home: HomePlace,
    obj: Object,
    to: Annotated[str, typer.Argument(metavar="X,Y", help="The new middle, in metres of the floor plan.")],
    who: Who = None,
) -> None:
    """Move an object to where it stands now."""
    _correct(home, "move", obj, to_xy=numbers(to, 2, "X,Y") or (), who=who)


@app.command()
def undo(home: HomePlace, who: Who = None) -> None:
    """Undo the latest correction."""
    _correct(home, "undo", who=who)


def _correct(
    home: str, what: CorrectionKind, entity: str = "", *,
    name: str = "", to_xy: Sequence[float] = (), other: str = "", who: str | None,
) -> None:  # fmt: skip
    _, told = home_at(home).correct(what, entity, name=name, to_xy=to_xy, other=other, who=who or user())
    print(told)


def user() -> str:
    """The user of this machine."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user id without an account, as in a container
        return "somebody"
