"""The command that talks to a home: ask."""

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
    radius: Annotated[float, typer.Option(help="The robot's radius in metres.")] = 0.2,
    camera_height: Annotated[float, typer.Option(help="The height of its camera in metres.")] = 1.5,
    go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Send the goal: print, ros2, dollhouse (see 'cartier list').")
    ] = None,
    show_prompt: Annotated[
        bool,
        typer.Option(
            "--show-prompt",
            help="Print exactly what would be sent to a language model, and send nothing; no key is needed.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Say what you need; get the object that serves it, its place, and a pose to drive to."""
    from cartier.home import Home
    from cartier.pipeline import Conversation
    from cartier.types import RobotModel

    from_xy, model_of_robot = numbers(start, 2, "--from"), RobotModel(radius, camera_height)
    mapped = Home.load(home)
    if show_prompt:
        _show_prompt(mapped, words, specs.model_asked(reasoner, model, base_url), index, from_xy, as_json)
        return
    thinks = specs.reasoner(reasoner, model=model, base_url=base_url, path=replies)
    talk = Conversation(mapped, thinks, index=index, from_xy=from_xy, robot=model_of_robot)
    robot = specs.robot(go, mapped, model_of_robot) if go else None
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
            from cartier.render.picture import draw_answer

            draw_answer(mapped, answer, plot, model_of_robot)
            say(f"picture: {plot}")
        print(json.dumps(answer.to_dict(), ensure_ascii=False)) if as_json else _print_answer(answer, told)
        if robot is not None:
            say(f"robot: {send(robot, answer)}")
        try:
            mapped.remember(answer)
        except InputError as error:
            say(f"the answer was not kept: {error}")


def _show_prompt(
    home: Home, words: str | None, asked: tuple[str, str] | None, index: str | None, from_xy: tuple[float, ...] | None,
    as_json: bool,
) -> None:  # fmt: skip
    """What would be sent to a server, or read by a model in this process."""
    from cartier.llm.prompts import check_query, prompt_named
    from cartier.navigation.planning import check_start

    if words is None:
        raise InputError('--show-prompt needs the words: cartier ask HOME "I would love to sit down" --show-prompt')
    words = check_query(words)
    server, model = asked or ("", "")
    to = f"{server.rstrip('/')}/chat/completions" if server else None
    body: dict[str, Any] | None = None
    if asked is not None:
        inventory = home.inventory(index, check_start(home.start_xy if from_xy is None else from_xy))
        body = prompt_named("rich").request(words, inventory).body(model)
    if as_json:
        print(json.dumps({"to": to, "body": body}, ensure_ascii=False))
        return
    print(f"this goes to {to} and nowhere else" if to else "nothing leaves this machine")
    if body is None:
        return
    print(f"model {model}, temperature {body['temperature']:g}, at most {body['max_tokens']} tokens")
    for message in body["messages"]:
        print(f"\n--- {message['role']}\n{message['content']}")
    print(f"\n--- what a reply may be\n{json.dumps(body['response_format'], ensure_ascii=False)}")


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
    print(f"{chosen.status}: {chosen.text or chosen.object or chosen.question or chosen.reason}")
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
    if not answer.next:
        print(f"  by     {answer.reasoner}, {answer.index}, {answer.detector}")
    for further in answer.next:
        print("then ", end="")
        _print_answer(further, told)
