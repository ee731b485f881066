"""Commands that give other programs access to homes: serve, mcp, export."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier.cli.common import missing, say
from cartier.cli.option_groups import Answering, Listening, Looking, grouped
from cartier.cli.places import HomePlace, home_at, homes_at
from cartier.errors import CartierError
from cartier.types import DriveProgress

if TYPE_CHECKING:
    from cartier.serving.access import Access
    from cartier.serving.operations import Operations

app = typer.Typer()
HomePlaces = Annotated[
    list[str],
    typer.Argument(metavar="HOME...", help="Folders that 'cartier map' wrote; or one fleet's STORE, with all homes."),
]
Port = Annotated[int, typer.Option(min=1, max=65535, help="The TCP port to listen on.")]
Memory = Annotated[int, typer.Option("--memory-mb", min=1, help="The memory for all loaded homes, in MiB.")]


@app.command()
@grouped
def serve(
    homes: HomePlaces,
    port: Port = 8735,
    listening: Listening = Listening(),
    answering: Answering = Answering(),
    memory_mb: Memory = 1024,
    looking: Looking = Looking(),
) -> None:
    """Serve homes over HTTP: web page and API.

    The page shows, answers and corrects; the API has an OpenAPI description.
    """
    operations = answering.operations(lambda: homes_at(homes, memory_mb), looking.allowed())
    _, app, open_paths = _page(operations)
    _listen(app, operations, port, listening, open_paths=open_paths)


def serve_beside(operations: Operations, host: str, port: int, token_file: Path | None) -> Callable[[], None]:
    """Serve the page and the API in a thread; returns what ends that."""
    server, app, open_paths = _page(operations)
    end: Callable[[], None] = server.listen_beside(
        app, host, port, _guarded(operations, host, token_file), say, open_paths
    )
    return end


def _page(operations: Operations) -> tuple[ModuleType, Any, tuple[str, ...]]:
    """What listens, the app with the page and the API, and its paths that need no token."""
    try:
        from cartier.serving import http, page, server
    except ModuleNotFoundError as error:
        raise missing("serve", error) from error
    return server, http.make(operations), (*page.files(), http.DOCUMENTATION)


def _listen(app: Any, operations: Operations, port: int, listening: Listening, **options: Any) -> None:
    from cartier.serving.server import listen

    tokens, tls = _guarded(operations, listening.host, listening.token_file), (listening.tls_cert, listening.tls_key)
    listen(app, listening.host, port, listening.name or [], tokens, tls, say, **options)


def _guarded(operations: Operations, host: str, token_file: Path | None) -> Mapping[bytes, Access] | None:
    """The tokens of requests; where there are any, a home is shown to those alone that may see it."""
    from cartier.serving.guard import read_tokens

    tokens = read_tokens(host, token_file)
    operations.homes.guarded = tokens is not None
    return tokens


@app.command()
@grouped
def mcp(
    homes: HomePlaces,
    http: Annotated[bool, typer.Option("--http", help="Streamable HTTP at /mcp instead of standard input.")] = False,
    port: Port = 8736,
    listening: Listening = Listening(),
    allow_go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Let agents send this robot; each time a person must agree.")
    ] = None,
    answering: Answering = Answering(),
    memory_mb: Memory = 1024,
    looking: Looking = Looking(),
) -> None:
    """Serve homes to agents over MCP.

    The Model Context Protocol server has ten tools that read, correct and undo, and with --look auto one that
    verifies.
    """
    operations = answering.operations(lambda: homes_at(homes, memory_mb), looking.allowed())
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
        checked = TransportSecuritySettings(enable_dns_rebinding_protection=False)  # the guard checks all paths
        _listen(server.streamable_http_app(transport_security=checked), operations, port, listening, told=told)


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
