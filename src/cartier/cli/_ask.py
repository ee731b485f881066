"""Commands that use a home: ask, show."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import specs
from cartier.cli._common import AsJson, HomeFolder, IndexName, numbers, say
from cartier.errors import InputError, ReasonerError
from cartier.language.prompts import check_query
from cartier.robots import send

if TYPE_CHECKING:
    from cartier.home import Home
    from cartier.types import Answer

app = typer.Typer()
QUIT = {"", "q", "quit", "exit", "bye", "goodbye", "bye bye"}


@app.command()
def ask(
    home: HomeFolder,
    words: Annotated[
        str | None, typer.Argument(metavar="[WORDS]", help="What the person says; without it a conversation begins.")
    ] = None,
    reasoner: Annotated[
        str, typer.Option(help="auto: the language model that is configured, else embedded; or any of 'cartier list'.")
    ] = "auto",
    model: Annotated[str | None, typer.Option(help="The language model's name on its server, or a FILE.gguf.")] = None,
    base_url: Annotated[str | None, typer.Option(help="The server's URL; default OPENAI_BASE_URL.")] = None,
    replies: Annotated[Path | None, typer.Option(help="Recorded replies, for --reasoner replay.")] = None,
    index: IndexName = None,
    start: Annotated[
        str | None,
        typer.Option("--from", metavar="X,Y", help="Where the robot stands; default: where the recording began."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the answer into this picture.")] = None,
    go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Send the goal: print, ros2, dollhouse (see 'cartier list').")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say what you need; get the object that serves it, its place, and a pose to drive to."""
    from cartier.conversation import Conversation
    from cartier.home import Home

    mapped = Home.load(home)
    thinks = specs.reasoner(reasoner, model=model, base_url=base_url, path=replies)
    robot = specs.robot(go, mapped) if go else None
    talk = Conversation(mapped, thinks, index=index, from_xy=numbers(start, 2, "--from"))
    told: set[str] = set()
    for said in [words] if words is not None else _heard(mapped.name):
        try:
            answer = talk.say(said)
        except (InputError, ReasonerError) as error:
            if words is not None:
                raise
            say(f"cartier: {error}")
            continue
        if plot:
            from cartier.picture import draw_answer

            draw_answer(mapped, answer, plot)
            say(f"picture: {plot}")
        print(json.dumps(answer.to_dict(), ensure_ascii=False)) if as_json else _print_answer(answer, told)
        if robot is not None:
            say(f"robot: {send(robot, answer)}")
        try:
            mapped.remember(answer)
        except InputError as error:
            say(f"the answer was not kept: {error}")


@app.command()
def show(
    home: HomeFolder,
    index: IndexName = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the floor plan with the objects into this picture.")] = None,
    find: Annotated[
        str | None,
        typer.Option(
            metavar="WORDS",
            help="Where any words fit best, and with --plot how well they fit each place (index vlmaps).",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what is in a home: every kind of object, how often it was seen, and where it is."""
    from cartier.home import Home

    mapped = Home.load(home)
    if find is not None:
        _find(mapped, check_query(find), index, plot, as_json)
        return
    rows = mapped.table(index)
    if plot:
        from cartier.picture import draw_home

        draw_home(mapped, plot, index)
        say(f"picture: {plot}")
    if as_json:
        about = {"home": mapped.name, "id": mapped.id, "detector": mapped.detector, "index": mapped.index(index)[0]}
        things = {"objects": rows, "glimpsed": list(mapped.glimpsed), "notes": list(mapped.notes)}
        print(json.dumps(about | things, ensure_ascii=False))
    else:
        _print_table(mapped, rows, mapped.index(index)[0])


def _find(home: Home, words: str, index: str | None, plot: Path | None, as_json: bool) -> None:
    name, searched = home.searchable(index)
    place = searched.locate(words)
    assert place is not None  # an index that holds nothing is not saved
    if plot:
        from cartier.picture import draw_find

        draw_find(home, words, plot, name)
    for note in searched.notes:
        say(note)
    about = {"home": home.name, "index": name, "encoder": searched.encoder, "detector": home.detector}
    if as_json:
        print(
            json.dumps(
                about | {"words": words, "place": place.to_dict(), "picture": str(plot) if plot else None},
                ensure_ascii=False,
            )
        )
        return
    x, y, z = place.position
    print(f"best   x {x:.2f}  y {y:.2f}  z {z:.2f} m   (cosine {place.score:.2f}, frame {place.frame})")
    print(f"  by     {name}, {searched.encoder}, {home.detector}")
    print(f"  look   {plot}" if plot else "  look   with --plot FILE.png")


def _heard(home: str) -> Iterator[str]:
    """What a person types, line by line, until they end it."""
    say(f"talking to {home}; an empty line or 'bye' ends it")
    while True:
        try:
            line = input("> " if sys.stdin.isatty() else "")
        except EOFError:
            return
        if line.strip().lower().strip(".!") in QUIT:
            return
        yield line


def _print_answer(answer: Answer, told: set[str]) -> None:
    chosen, place, goal = answer.selection, answer.place, answer.goal
    print(f"{chosen.status}: {chosen.object or chosen.question or chosen.reason}")
    if chosen.object and chosen.reason:
        print(f"  why    {chosen.reason}")
    if place:
        x, y, z = place.position
        what = "seen from" if place.view_yaw is not None else "place"
        print(f"  {what:6} x {x:.2f}  y {y:.2f}  z {z:.2f} m   (frame {place.frame}, score {place.score:.2f})")
    if goal:
        print(f"  goal   x {goal.x:.2f}  y {goal.y:.2f} m  yaw {goal.yaw:.2f} rad   ({goal.length_m:.2f} m to drive)")
    for note in answer.notes:
        if note not in told:  # in a conversation, once
            print(f"  note   {note}")
    told.update(answer.notes)
    if not answer.then:
        print(f"  by     {answer.reasoner}, {answer.index}, {answer.detector}")
    for further in answer.then:
        print("then ", end="")
        _print_answer(further, told)


def _print_table(home: Home, rows: list[dict[str, Any]], index: str) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "object",
        "frames",
        "best score",
        "x (m)",
        "y (m)",
        "z (m)",
        "evidence",
        box=box.SIMPLE,
        title=home.name,
        title_justify="left",
    )
    for row in rows:
        place = row["place"]
        where = [f"{v:.2f}" for v in place["position"]] + [f"frame {place['frame']}"] if place else ["–", "–", "–", "–"]
        table.add_row(row["object"], str(row["frames"]), f"{row['best_score']:.2f}", *where)
    console = Console(width=None if sys.stdout.isatty() else 100)
    console.print(table)
    console.print(
        f"index: {index}   detector: {home.detector}   robot radius: {home.robot_radius_m} m", highlight=False
    )
    if home.glimpsed:
        console.print(f"only glimpsed, not listed: {', '.join(home.glimpsed)}", highlight=False, markup=False)
    for note in home.notes:
        console.print(f"note: {note}", highlight=False, markup=False)
