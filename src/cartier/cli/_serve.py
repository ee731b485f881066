"""Commands that give other programs access to homes: serve, mcp, export."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import specs
from cartier.cli.common import (
    Blur,
    EmergencyNumber,
    LookWhen,
    ModelName,
    OnAlarm,
    ReasonerName,
    VisionName,
    missing,
    say,
)
from cartier.cli.places import HomePlace, home_at, homes_at
from cartier.errors import CartierError
from cartier.io.command import OwnerCommand
from cartier.types import DriveProgress

if TYPE_CHECKING:
    from cartier.serving.access import Access
    from cartier.serving.operations import Operations
    from cartier.vision.permission import Look

app = typer.Typer()
TOKENS = "A file with a token a line, and the homes that it may see if not all. Default: the token CARTIER_TOKEN."
HomePlaces = Annotated[
    list[str],
    typer.Argument(metavar="HOME...", help="Folders that 'cartier map' wrote; or one fleet's STORE, with all homes."),
]
Port = Annotated[int, typer.Option(min=1, max=65535, help="The TCP port to listen on.")]
Host = Annotated[str, typer.Option(help="The address to listen on; any but a loopback address needs a token.")]
Names = Annotated[list[str] | None, typer.Option("--name", help="Another host name of this server.")]
TokenFile = Annotated[Path | None, typer.Option(help=TOKENS)]
Certificate = Annotated[Path | None, typer.Option(help="TLS certificate (PEM); needs --tls-key.")]
Key = Annotated[Path | None, typer.Option(help="TLS private key (PEM).")]
Memory = Annotated[int, typer.Option("--memory-mb", min=1, help="The memory for all loaded homes, in MiB.")]


@app.command()
def serve(
    homes: HomePlaces,
    port: Port = 8735,
    host: Host = "127.0.0.1",
    name: Names = None,
    token_file: TokenFile = None,
    tls_cert: Certificate = None,
    tls_key: Key = None,
    reasoner: ReasonerName = "auto",
    model: ModelName = None,
    memory_mb: Memory = 1024,
    emergency_number: EmergencyNumber = None,
    on_alarm: OnAlarm = None,
    look: LookWhen = "never",
    vision: VisionName = "openai",
    blur: Blur = False,
) -> None:
    """Serve homes over HTTP: web page and API.

    The page shows, answers and corrects; the API has an OpenAPI description.
    """
    operations = _operations(
        homes, reasoner, model, memory_mb, emergency_number, on_alarm, specs.look(look, vision, None, blur)
    )
    serve_page(operations, host, port, name or [], token_file, (tls_cert, tls_key))


def serve_page(
    operations: Operations, host: str, port: int, names: list[str], token_file: Path | None,
    tls: tuple[Path | None, Path | None],
) -> None:  # fmt: skip
    """Serve the page and the API until Ctrl-C."""
    try:
        from cartier.serving.http import DOCUMENTATION, make
        from cartier.serving.page import files
        from cartier.serving.server import listen
    except ModuleNotFoundError as error:
        raise missing("serve", error) from error
    tokens = _guarded(operations, host, token_file)
    listen(make(operations), host, port, names, tokens, tls, say, open_paths=(*files(), DOCUMENTATION))


def serve_beside(operations: Operations, host: str, port: int, token_file: Path | None) -> Callable[[], None]:
    """Serve the page and the API in a thread; returns what ends that."""
    try:
        from cartier.serving.http import DOCUMENTATION, make
        from cartier.serving.page import files
        from cartier.serving.server import listen_beside
    except ModuleNotFoundError as error:
        raise missing("serve", error) from error
    tokens = _guarded(operations, host, token_file)
    return listen_beside(make(operations), host, port, tokens, say, (*files(), DOCUMENTATION))


def _guarded(operations: Operations, host: str, token_file: Path | None) -> Mapping[bytes, Access] | None:
    """The tokens of requests; where there are any, a home is shown to those alone that may see it."""
    from cartier.serving.guard import read_tokens

    tokens = read_tokens(host, token_file)
    operations.homes.guarded = tokens is not None
    return tokens


@app.command()
def mcp(
    homes: HomePlaces,
    http: Annotated[bool, typer.Option("--http", help="Streamable HTTP at /mcp instead of standard input.")] = False,
    port: Port = 8736,
    host: Host = "127.0.0.1",
    name: Names = None,
    token_file: TokenFile = None,
    tls_cert: Certificate = None,
    tls_key: Key = None,
    allow_go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Let agents send this robot; each time a person must agree.")
    ] = None,
    reasoner: ReasonerName = "auto",
    model: ModelName = None,
    memory_mb: Memory = 1024,
    emergency_number: EmergencyNumber = None,
    on_alarm: OnAlarm = None,
    look: LookWhen = "never",
    vision: VisionName = "openai",
    blur: Blur = False,
) -> None:
    """Serve homes to agents over MCP.

    The Model Context Protocol server has ten tools that read, correct and undo, and with --look auto one that
    verifies.
    """
    operations = _operations(
        homes, reasoner, model, memory_mb, emergency_number, on_alarm, specs.look(look, vision, None, blur)
    )
    try:
        from mcp.server.transport_security import TransportSecuritySettings

        from cartier.serving.mcp_server import make
    except ModuleNotFoundError as error:
        raise missing("mcp", error) from error
    server = make(operations, allow_go)
    with _robot_stops(operations, ends=not http) if allow_go is not None else nullcontext() as told:
        if not http:
            server.run("stdio")
            return
        from cartier.serving.server import listen

        checked = TransportSecuritySettings(enable_dns_rebinding_protection=False)  # the guard checks all paths
        app = server.streamable_http_app(transport_security=checked)
        tokens = _guarded(operations, host, token_file)
        listen(app, host, port, name or [], tokens, (tls_cert, tls_key), say, told=told)


@contextmanager
def _robot_stops(operations: Operations, ends: bool) -> Iterator[Callable[[int, Any], None]]:
    """Stop a robot that was sent, by a signal at once and in any case at the end; yields what hears of a signal.

    Args:
        operations: Whose robot.
        ends: Whether a signal also ends the program, which may wait for its standard input.
    """
    from cartier.robots import Sent
    from cartier.robots.common.signals import signals_do

    codes = list[int]()

    def stop(number: int) -> None:
        try:
            sent = Sent("", operations.driver.stop(), number)
        except CartierError as error:
            sent = Sent("", DriveProgress("unknown", str(error)), number)
        codes.append(sent.exit_code)
        with suppress(OSError):  # a terminal that is closed
            say(f"robot: {sent.end.text if sent.end else ''}")
        if ends:
            os._exit(sent.exit_code)
        os.kill(os.getpid(), signal.SIGTERM)  # the web server ends by this one and by Ctrl-C alone

    with signals_do(stop) as signals:
        try:
            yield signals.note
        finally:
            signals.end()
            operations.driver.stop()
    if codes:
        raise typer.Exit(codes[0])


@app.command()
def export(
    home: HomePlace,
    to: Annotated[
        Path,
        typer.Option(
            "--to",
            metavar="FILE",
            help="The file to write: .glb, .ply, .mcap, .geojson, .csv or .json; or nav2, a folder.",
        ),
    ],
) -> None:
    """Export a home to other programs.

    For example Blender, MeshLab, Lichtblick, QGIS or a spreadsheet. The folder for Nav2 has the floor plan, masks of
    the home's route rules, a route graph and parameters.
    """
    from cartier.exports import export as write

    for file in write(home_at(home), to):
        print(file)


def _operations(
    homes: list[str], reasoner: str, model: str | None, memory_mb: int, emergency_number: str | None,
    on_alarm: str | None, look: Look | None,
) -> Operations:  # fmt: skip
    from cartier.serving.operations import Operations

    told = OwnerCommand(on_alarm, "--on-alarm") if on_alarm is not None else None
    return Operations(
        homes_at(homes, memory_mb), specs.reasoner(reasoner, model=model), emergency_number=emergency_number,
        on_alarm=None if told is None else told.run, look=look,
    )  # fmt: skip
