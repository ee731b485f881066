"""Command that answers requests about a home: ask."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import plugins, specs
from cartier.cli.arrive import send_and_look
from cartier.cli.common import AsJson, BaseUrl, IndexName, numbers, say
from cartier.cli.option_groups import Answering, Looking, grouped
from cartier.cli.places import HomePlace, home_at
from cartier.errors import InputError, ReasonerError
from cartier.robots import Sent, send

if TYPE_CHECKING:
    from cartier.home import Home
    from cartier.types import Answer, CandidateView, DriveProgress, VisualQuestion

app = typer.Typer()
QUIT = {"", "q", "quit", "exit", "bye", "goodbye", "bye bye"}


@app.command()
@grouped
def ask(
    home: HomePlace,
    words: Annotated[
        str | None, typer.Argument(metavar="[WORDS]", help="The request; without it a conversation starts.")
    ] = None,
    answering: Answering = Answering(),
    base_url: BaseUrl = None,
    replies: Annotated[Path | None, typer.Option(help="The recorded replies for --reasoner replay.")] = None,
    index: IndexName = None,
    start: Annotated[
        str | None, typer.Option("--from", metavar="X,Y", help="The robot's position. Default: the recording's start.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the answer into this image.")] = None,
    radius: Annotated[float, typer.Option(help="The robot's radius in metres.")] = 0.2,
    camera_height: Annotated[float, typer.Option(help="The height of the robot's camera in metres.")] = 1.5,
    wheels: Annotated[
        str | None,
        typer.Option(metavar="WHEELS", help="What carpet costs the robot: small, large, tracks, or a FILE.toml."),
    ] = None,
    go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Send the goal to a robot: print, ros2, dollhouse.")
    ] = None,
    show_prompt: Annotated[
        bool, typer.Option("--show-prompt", help="Print the prompt for a language model, and send nothing.")
    ] = False,
    looking: Looking = Looking(),
    as_json: AsJson = False,
) -> None:
    """Answer a request with an object and a goal pose."""
    from cartier.conversation import Conversation
    from cartier.navigation.traction import traction_of
    from cartier.types import RobotModel

    traction = traction_of(wheels) if wheels is not None else ()
    from_xy, model_of_robot = numbers(start, 2, "--from"), RobotModel(radius, camera_height, traction)
    told, reasoner, model = answering.alarm_command, answering.reasoner, answering.model
    mapped = home_at(home)
    if show_prompt:
        _show_prompt(mapped, words, specs.model_asked(reasoner, model, base_url), index, from_xy, as_json)
        return
    allowed = looking.allowed(_agreed, model=None if ":" in looking.vision else model, base_url=base_url)
    if allowed is not None and not plugins.takes("reasoners", reasoner.partition(":")[0], "model"):
        model = base_url = None  # they are the vision model's alone
    chosen = specs.reasoner(reasoner, model=model, base_url=base_url, path=replies)
    talk = Conversation(
        mapped, chosen, index=index, from_xy=from_xy, robot=model_of_robot,
        emergency_number=answering.emergency_number, look=allowed,
    )  # fmt: skip
    robot = specs.robot(go, mapped, model_of_robot) if go else None
    see = specs.camera_at_goals(go, mapped, model_of_robot) if go and allowed is not None else None
    shown, sent = set[str](), Sent("")
    for request in [words] if words is not None else _typed(mapped.name):
        try:
            answer = talk.say(request)
        except (InputError, ReasonerError) as error:
            if words is not None:
                raise
            say(f"cartier: {error}")
            continue
        if plot:
            from cartier.render.floor_plan import draw_answer

            draw_answer(talk.home, answer, plot, model_of_robot)
            say(f"image: {plot}")
        print(json.dumps(answer.to_dict(), ensure_ascii=False)) if as_json else _print_answer(answer, shown)
        if told is not None and answer.selection.status == "alarm":
            say(f"on alarm: {told.run(answer.to_dict())}")
        if robot is not None and allowed is not None and see is not None:
            for sent in send_and_look(robot, answer, talk.home, model_of_robot, allowed, see):
                say(f"robot: {sent.text}")
        elif robot is not None:
            sent = send(robot, answer, _watched)
            say(f"robot: {sent.text}")
        try:
            mapped.remember(answer)
        except InputError as error:
            say(f"the answer was not saved: {error}")
        if sent.exit_code and (words is not None or sent.signal not in (None, signal.SIGINT)):  # a talk outlives Ctrl-C
            raise typer.Exit(sent.exit_code)


def _watched(progress: DriveProgress) -> None:
    """Show how a drive goes, in a line that the next one replaces."""
    if sys.stderr.isatty():
        line = "" if progress.ended else f"robot: {progress.text[:150]}; Ctrl-C stops it"
        print(f"\r\x1b[2K{line}", end="", file=sys.stderr, flush=True)


def _agreed(question: VisualQuestion, pictures: Sequence[CandidateView]) -> bool:
    """Whether the person at the terminal lets these photographs leave; nobody at a terminal does not."""
    if not sys.stdin.isatty():
        return False
    frames = ", ".join(f"frame {each.frame} ({each.label})" for each in pictures)
    return typer.confirm(f"send photographs ({frames}) to the vision model: {question.words}", err=True)


def _show_prompt(
    home: Home, words: str | None, asked: tuple[str, str] | None, index: str | None,
    from_xy: tuple[float, ...] | None, as_json: bool,
) -> None:  # fmt: skip
    """Print the prompt, and the server that it would go to."""
    from cartier.llm.network import proxy_to
    from cartier.llm.prompts import check_query, prompt_named
    from cartier.navigation.planning import check_start
    from cartier.understanding import alarm

    if words is None:
        raise InputError('--show-prompt needs the words: cartier ask HOME "I would love to sit down" --show-prompt')
    words = check_query(words)
    asked = None if alarm.screen(words) else asked  # answered here, whatever the reasoner
    server, model = asked or ("", "")
    to, through = f"{server.rstrip('/')}/chat/completions" if server else None, proxy_to(server) if server else None
    body: dict[str, Any] | None = None
    if asked is not None:
        inventory = home.inventory(index, check_start(home.start_xy if from_xy is None else from_xy))
        body = prompt_named("rich").request(words, inventory).body(model)
    if as_json:
        proxy = through.shown if through else None
        print(json.dumps({"to": to, "through": proxy, "body": body}, ensure_ascii=False))
        return
    way = f" through {through}" if through else ""
    print(f"this is sent to {to}{way} and nowhere else" if to else "nothing leaves this machine")
    if body is None:
        return
    print(f"model {model}, temperature {body['temperature']:g}, at most {body['max_tokens']} tokens")
    for message in body["messages"]:
        print(f"\n--- {message['role']}\n{message['content']}")
    print(f"\n--- the schema of replies\n{json.dumps(body['response_format'], ensure_ascii=False)}")


def _typed(home: str) -> Iterator[str]:
    """The lines that a person types, until they end the conversation."""
    say(f"talking to {home}; an empty line or 'bye' ends it")
    while True:
        try:
            line = input("> " if sys.stdin.isatty() else "")
        except EOFError:
            return
        if line.strip().lower().strip(".!") in QUIT:
            return
        yield line


def _print_answer(answer: Answer, shown: set[str]) -> None:
    chosen, place, goal = answer.selection, answer.place, answer.goal
    print(f"{chosen.status}: {chosen.text or chosen.object or chosen.question or chosen.reason}")
    if chosen.object and chosen.reason:
        print(f"  why    {chosen.reason}")
    if place:
        x, y, z = place.middle
        what = "seen from" if place.view_yaw is not None and place.middle == place.position else "place"
        print(f"  {what:6} x {x:.2f}  y {y:.2f}  z {z:.2f} m   (frame {place.frame}, score {place.score:.2f})")
    if goal:
        print(f"  goal   x {goal.x:.2f}  y {goal.y:.2f} m  yaw {goal.yaw:.2f} rad   ({goal.length_m:.2f} m to drive)")
    if goal and goal.route:
        print(f"  way    {'; '.join(goal.route.directions)}")
        for other in goal.route.alternatives:
            print(f"  or     {other.words}")
    for note in answer.notes:
        if note not in shown:  # once in a conversation
            print(f"  note   {note}")
    shown.update(answer.notes)
    if not answer.next:
        print(f"  by     {answer.reasoner}, {answer.index}, {answer.detector}")
    for further in answer.next:
        print("then ", end="")
        _print_answer(further, shown)
