"""Commands that bring homes within reach of others: mcp, serve, export."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import plugins, specs
from cartier.cli._common import HomeFolder, say
from cartier.errors import InputError, MissingExtra

if TYPE_CHECKING:
    from cartier.serving.guard import App
    from cartier.serving.operations import Operations

app = typer.Typer()
HomeFolders = Annotated[list[Path], typer.Argument(metavar="HOME...", help="Folders that 'cartier map' made.")]
Reasoner = Annotated[
    str, typer.Option(help="auto: the language model that is configured, else embedded; or any of 'cartier list'.")
]
Model = Annotated[str | None, typer.Option(help="The language model's name on its server, or a FILE.gguf.")]
Host = Annotated[str, typer.Option(help="The address to listen on; any but this machine's own needs a token.")]
Names = Annotated[
    list[str] | None, typer.Option("--name", help="Another name that this server goes by, for the check of Host.")
]
TokenFile = Annotated[
    Path | None, typer.Option(help="A file with the token that requests must bear; else CARTIER_TOKEN.")
]
Certificate = Annotated[Path | None, typer.Option(help="TLS certificate (PEM); needs --tls-key.")]
Key = Annotated[Path | None, typer.Option(help="TLS private key (PEM).")]


@app.command()
def serve(
    homes: HomeFolders,
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8735,
    host: Host = "127.0.0.1",
    name: Names = None,
    token_file: TokenFile = None,
    tls_cert: Certificate = None,
    tls_key: Key = None,
    reasoner: Reasoner = "auto",
    model: Model = None,
    memory_mb: Annotated[int, typer.Option(min=1, help="How much loaded homes may take together.")] = 1024,
) -> None:
    """Serve homes to a browser and to programs: a page to see, ask and correct, and an HTTP API with OpenAPI."""
    operations = _operations(homes, reasoner, model, memory_mb)
    try:
        from cartier.serving.http import make
        from cartier.serving.page import files
    except ModuleNotFoundError as error:
        raise _missing("serve", error) from error
    _listen(make(operations), host, port, name or [], token_file, (tls_cert, tls_key), files())


@app.command()
def mcp(
    homes: HomeFolders,
    http: Annotated[bool, typer.Option("--http", help="Streamable HTTP at /mcp instead of standard input.")] = False,
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8736,
    host: Host = "127.0.0.1",
    name: Names = None,
    token_file: TokenFile = None,
    tls_cert: Certificate = None,
    tls_key: Key = None,
    allow_go: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="Let agents send this robot; a person is asked each time.")
    ] = None,
    reasoner: Reasoner = "auto",
    model: Model = None,
    memory_mb: Annotated[int, typer.Option(min=1, help="How much loaded homes may take together.")] = 1024,
) -> None:
    """Serve homes to agents over the Model Context Protocol: ten tools that read, correct and undo."""
    operations = _operations(homes, reasoner, model, memory_mb)
    try:
        from mcp.server.transport_security import TransportSecuritySettings

        from cartier.serving.mcp_server import make
    except ModuleNotFoundError as error:
        raise _missing("mcp", error) from error
    server = make(operations, allow_go)
    if not http:
        server.run("stdio")
        return
    checked = TransportSecuritySettings(enable_dns_rebinding_protection=False)  # the guard does, for all paths
    _listen(
        server.streamable_http_app(transport_security=checked), host, port, name or [], token_file, (tls_cert, tls_key)
    )


@app.command()
def export(
    home: HomeFolder,
    to: Annotated[
        Path,
        typer.Option("--to", metavar="FILE", help="FILE.glb, .ply, .mcap, .geojson, .csv or .json says the format."),
    ],
) -> None:
    """Write a home for other programs: Blender, MeshLab, Lichtblick, QGIS, a spreadsheet."""
    from cartier.exports import export as write
    from cartier.home import Home

    for file in write(Home.load(home), to):
        print(file)


def _operations(homes: list[Path], reasoner: str, model: str | None, memory_mb: int) -> Operations:
    from cartier.serving.homes import Homes
    from cartier.serving.operations import Operations

    return Operations(Homes(homes, memory_mb * 2**20), specs.reasoner(reasoner, model=model))


def _listen(
    served: Any, host: str, port: int, names: list[str], token_file: Path | None, tls: tuple[Path | None, Path | None],
    open_paths: Iterable[str] = (),
) -> None:  # fmt: skip
    import uvicorn

    from cartier.serving.connections import Connection
    from cartier.serving.guard import Guard, host_names, read_token

    if (tls[0] is None) != (tls[1] is None):
        raise InputError("TLS needs both --tls-cert and --tls-key")
    for file in tls:
        if file is not None and not file.is_file():
            raise InputError(f"{file} is missing")
    token = read_token(host, token_file)
    guarded: App = Guard(served, host_names(host, port, names), token, tls=tls[0] is not None, open_paths=open_paths)
    shown = f"[{host}]" if ":" in host else host
    say(
        f"serving at http{'s' if tls[0] else ''}://{shown}:{port}/{'' if token is None else ' (with the token)'}; Ctrl-C ends it"
    )
    if token is not None and tls[0] is None:
        say(
            "without --tls-cert the token and the home travel in the clear: put a TLS proxy before it, or give a certificate"
        )
    uvicorn.run(
        guarded, host=host, port=port, ssl_certfile=tls[0], ssl_keyfile=tls[1], log_level="warning", access_log=False,
        server_header=False, timeout_keep_alive=15, timeout_graceful_shutdown=5, backlog=512, ws="none", proxy_headers=False,
        http=Connection, h11_max_incomplete_event_size=16_384,
    )  # fmt: skip


def _missing(extra: str, error: ModuleNotFoundError) -> MissingExtra:
    package = (error.name or "").split(".")[0]
    if package in ("", "cartier"):  # a broken import of our own is a bug and keeps its traceback
        raise error
    return MissingExtra(f"this needs the package {package!r}: {plugins.install(extra, package)}")
