"""Command that maps a home while its frames are taken: live."""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import specs
from cartier.cli.common import Append, AsJson, Every, Threshold, missing, progress, say
from cartier.cli.option_groups import Answering, grouped
from cartier.cli.reader_options import Robot
from cartier.errors import InputError
from cartier.io.spool import SUFFIX
from cartier.labels import number_of

if TYPE_CHECKING:
    from cartier.contracts import Source
    from cartier.home import Home
    from cartier.live.session import Live

app = typer.Typer()
SAVE_S = 20.0  # between two saves of a home that is mapped from its beginning
LINE_S, JSON_S = 0.25, 1.0


@app.command()
@grouped
def live(
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="SOURCE",
            help="ros2, bag:PATH@SPEED, folder:DIR, dollhouse:HOME@SPEED or exec:'PROGRAM'.",
        ),
    ] = "ros2",
    home: Annotated[
        Path | None,
        typer.Argument(
            metavar="HOME",
            help="The folder to write; the keyframes are kept in HOME.spool. With --check: the source.",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Watch the stream for 10 seconds (--seconds), write nothing, say what is wrong."),
    ] = False,
    detector: Annotated[
        str | None, typer.Option(help="As for 'cartier map'. Default: photos, or embedded for the dollhouse.")
    ] = None,
    threshold: Threshold = None,
    every: Every = None,
    append: Append = False,
    align: Annotated[
        bool, typer.Option("--align", help="With --append: the robot's frame is another one; find where it lies.")
    ] = False,
    seconds: Annotated[float | None, typer.Option(help="End by itself after so many seconds.")] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Serve the page and the API of the growing home.")] = False,
    publish: Annotated[
        bool,
        typer.Option("--publish", help="Publish the objects on ROS 2 topics, and answer what comes on /cartier/ask."),
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="The TCP port of --serve.")] = 8735,
    host: Annotated[str, typer.Option(help="The address of --serve; any but a loopback address needs a token.")] = (
        "127.0.0.1"
    ),
    token_file: Annotated[Path | None, typer.Option(help="The file with the token of requests.")] = None,
    answering: Answering = Answering(),
    as_json: AsJson = False,
    robot: Robot = Robot(),
) -> None:
    """Map a home while its frames are taken, and answer meanwhile.

    Ctrl-C ends it whole. A session that was cut off goes on from HOME.spool.
    """
    from cartier.home.store import MANIFEST
    from cartier.io.atomic import check_ours, locked
    from cartier.live.session import Live
    from cartier.sources import open_source

    topics = robot.given()
    if check:
        return _checked(source if home is None else str(home), topics, seconds, as_json)
    if home is None:
        raise InputError("name the folder to write: cartier live HOME --from SOURCE; --check alone needs none")
    if align and not append:
        raise InputError("--align goes with --append: it moves the session into the pose frame of the home at HOME")
    check_ours(home, MANIFEST)
    spool = home.with_name(f"{home.name}{SUFFIX}")
    stream = open_source(source, **_of_source(source, topics, publish))
    detects = _detector(stream, detector, threshold)
    with locked(home, wait_s=0.0):
        onto = _onto(home, spool, append)
        session = Live(stream, detects, spool=spool, onto=onto, every=every, align=align)
        with progress("resuming") as step:
            session.start(step)
        if (resumed := session.state().resumed) > 0:
            say(f"{resumed} keyframes of {spool}, a session that was cut off: it goes on in the same pose frame")
        endings = _outlets(
            session, home, answering, (host, port, token_file) if serve else None, topics.get("domain"), publish
        )
        with _ended_by_signals() as asked:
            _follow(session, home, asked, seconds, as_json, save=onto is None)
        try:
            whole = _ended(session, home, onto)
        finally:
            for end in endings:
                end()
    _told(whole, home, spool, session, as_json)


def _checked(source: str, topics: dict[str, Any], seconds: float | None, as_json: bool) -> None:
    """Print what is wrong with a stream; exit code 1 if anything is."""
    from cartier.doctor.stream_check import SECONDS, check_stream
    from cartier.sources import open_source

    stream = open_source(source, **topics)
    with progress("watching") as step:
        report = check_stream(stream, SECONDS if seconds is None else seconds, step)
    if as_json:
        print(json.dumps(report.to_dict()))
    else:
        print(f"{report.name}: {report.frames} frames in {report.seconds:.0f} s")
        for line in report.sound:
            print(f"  {line}")
        for note in report.notes:
            print(f"  note    {note}")
        for fault in report.faults:
            print(f"  WRONG   {fault.fault}: {fault.evidence}\n          mend it: {fault.repair}")
        given = "".join(f" --{name} {value}" for name, value in topics.items())
        print(f"it can be mapped: cartier live HOME --from {source}{given}" if report.ok else "it cannot be mapped so")
    if not report.ok:
        raise typer.Exit(1)


def _detector(stream: Source, chosen: str | None, threshold: float | None) -> Any:
    """The detector that is asked for, or that fits what is played."""
    from cartier.contracts import SourceDefaults, optional

    own = specs.own_detector(optional(stream, SourceDefaults, "detector"), chosen, threshold)
    if own is not None:
        say(f"detector: {own.name}")
        return own
    played = optional(stream, SourceDefaults, "recording")
    if chosen is None:
        chosen, why = specs.detector_for(played) if played is not None else (specs.PHOTOS, "for photographs")
        say(f"detector: {chosen}, {why}; --detector takes another")
    if played is None and chosen.partition(":")[0] == "ground_truth":
        raise InputError("ground_truth needs a simulator's recording: --from dollhouse:HOME")
    return specs.detector(chosen, played, threshold=threshold)


def _onto(home: Path, spool: Path, append: bool) -> Home | None:
    """The home to grow. Raises InputError where an ended session would be lost."""
    from cartier.home import Home
    from cartier.io.spool import Spool

    ended = spool.exists() and Spool(spool).ended
    if append:
        return Home.load(home)
    if ended:
        raise InputError(
            f"{spool} is the recording of a session that ended: --append goes on with its home; or move both away"
        )
    return None


@contextmanager
def _ended_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and a request to end set; a second one ends the program at once."""
    asked = threading.Event()

    def ask(number: int, frame: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _follow(
    session: Live, home: Path, asked: threading.Event, seconds: float | None, as_json: bool, save: bool
) -> None:
    """Show the state until the stream ends or somebody asks for the end; save the home now and then."""
    terminal = sys.stderr.isatty() and not as_json
    begin = saved_s = told_s = time.monotonic()
    version, objects = -1, -1
    while session.running() and not asked.wait(LINE_S):
        now_s, state = time.monotonic(), session.state()
        if seconds is not None and now_s - begin >= seconds:
            break
        if terminal:
            print(f"\r\x1b[2K{state.line()[:150]}", end="", file=sys.stderr, flush=True)
        elif as_json and now_s - told_s >= JSON_S:
            told_s = now_s
            print(json.dumps(state.to_dict()), flush=True)
        if save and now_s - saved_s >= SAVE_S and state.looked != version and state.as_of_s is not None:
            saved_s, version = now_s, state.looked
            session.home().save(home)
        if not terminal and not as_json and state.confirmed != objects:
            objects = state.confirmed
            say(state.line())
    if terminal:
        print("\r\x1b[2K", end="", file=sys.stderr)


def _ended(session: Live, folder: Path, onto: Home | None) -> Home:
    """Map what still waits, and save the whole home."""
    from dataclasses import replace

    with progress("looking at what was put off") as step:
        whole = session.stop(step)
    if onto is None:
        whole = replace(whole, name=folder.resolve().name or whole.name)
    whole.save(folder)
    session.saved()
    return whole


def _told(whole: Home, home: Path, spool: Path, session: Live, as_json: bool) -> None:
    state = session.state()
    if as_json:
        about = {"home": str(home), "id": whole.id, "names": whole.names, "notes": list(whole.notes)}
        print(json.dumps(state.to_dict() | about))
        return
    for note in whole.notes:
        say(note)
    sure = sum(obj.confirmed for obj in whole.objects)
    objects, kinds = number_of(sure, "object"), number_of(len(whole.names), "kind")
    print(f"{home}: {objects} of {kinds} in {state.looked} of {state.frames_in} frames")
    print(f"the keyframes are in {spool}: cartier map {spool} -o HOME maps them again")
    print(f'ask it something:  cartier ask {home} "I would love to sit down"')


def _of_source(source: str, topics: dict[str, Any], publish: bool) -> dict[str, Any]:
    """The options of the source; with --publish, --domain may be that of the published topics alone."""
    from cartier import plugins

    if publish and not plugins.takes("sources", source.partition(":")[0], "domain"):
        return {name: value for name, value in topics.items() if name != "domain"}
    return topics


def _outlets(
    session: Live, home: Path, answering: Answering, served: tuple[str, int, Path | None] | None, domain: int | None,
    publish: bool,
) -> list[Callable[[], None]]:  # fmt: skip
    """Serve the growing home and publish it, as asked; returns what ends that."""
    from cartier import plugins
    from cartier.cli._serve import serve_beside
    from cartier.contracts import SourceDefaults, optional
    from cartier.serving.live_homes import LiveHomes

    if served is None and not publish:
        return []
    operations = answering.operations(lambda: LiveHomes(session, home.resolve().name))
    endings = [serve_beside(operations, *served)] if served is not None else []
    if publish:
        try:
            topics = plugins.neighbour("topics", "ros2")(
                operations, domain, lambda: optional(session.source, SourceDefaults, "world_frame")
            )
        except ModuleNotFoundError as error:
            raise missing("ros", error) from error
        say(f"domain {topics.domain}: /cartier/objects, /cartier/markers; /cartier/ask gets /cartier/answer")
        endings.append(topics.close)
    return endings
