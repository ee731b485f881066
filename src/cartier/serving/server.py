"""Web server of homes: uvicorn behind the guard, with bounds on connections that send no request; needs uvicorn."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from cartier.errors import InputError
from cartier.serving.access import Access
from cartier.serving.guard import App, Guard, host_names

START_S = 0.05
HEAD_S = 5.0  # from the start of a connection, or the first byte of a head, until the head of the request is complete
Tokens = Mapping[bytes, Access] | None
MAX_CONNECTIONS = 800  # below the 1,024 files that a process may usually open


def listen(
    served: Any, host: str, port: int, names: Iterable[str], tokens: Tokens,
    tls: tuple[Path | None, Path | None], say: Callable[[str], None], open_paths: Iterable[str] = (),
    told: Callable[[int, Any], None] | None = None,
) -> None:  # fmt: skip
    """Serve an ASGI app until Ctrl-C; ``say`` gets the lines for the operator.

    ``tls`` is the certificate and its key, both or none. ``open_paths`` need no token. ``told`` hears of a signal at
    once, before the server ends. Raises InputError for a bad option.
    """
    settings = _settings(served, host, port, names, tokens, tls, say, open_paths)
    if told is None:
        uvicorn.run(**settings)
        return
    server = uvicorn.Server(uvicorn.Config(**settings))
    ends = server.handle_exit

    def handle(number: int, frame: Any) -> None:
        told(number, frame)
        ends(number, frame)

    server.handle_exit = handle  # type: ignore[method-assign, assignment]  # uvicorn makes it the handler of its signals
    server.run()
    if not server.started:
        raise InputError(f"cannot listen at {host}:{port}: choose another --port")


def listen_beside(
    served: Any, host: str, port: int, tokens: Tokens, say: Callable[[str], None], open_paths: Iterable[str]
) -> Callable[[], None]:
    """Serve an ASGI app in a thread of its own; returns what ends that.

    Raises InputError for a bad option, or if the port is taken.
    """
    settings = _settings(served, host, port, (), tokens, (None, None), say, open_paths)
    server = uvicorn.Server(uvicorn.Config(**settings))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while thread.is_alive() and not server.started:
        time.sleep(START_S)
    if not server.started:
        raise InputError(f"cannot listen at {host}:{port}: choose another --port")

    def end() -> None:
        server.should_exit = True
        thread.join()

    return end


def _settings(
    served: Any, host: str, port: int, names: Iterable[str], tokens: Tokens,
    tls: tuple[Path | None, Path | None], say: Callable[[str], None], open_paths: Iterable[str],
) -> dict[str, Any]:  # fmt: skip
    """What uvicorn is started with."""
    if (tls[0] is None) != (tls[1] is None):
        raise InputError("TLS needs both --tls-cert and --tls-key")
    for file in tls:
        if file is not None and not file.is_file():
            raise InputError(f"{file} is missing")
    guarded: App = Guard(served, host_names(host, port, names), tokens, tls=tls[0] is not None, open_paths=open_paths)
    shown, scheme = f"[{host}]" if ":" in host else host, "https" if tls[0] else "http"
    say(f"serving at {scheme}://{shown}:{port}/{'' if tokens is None else ' (with a token)'}; Ctrl-C ends it")
    if tokens is not None and tls[0] is None:
        say("without --tls-cert the token and the home are not encrypted: use a TLS proxy, or give a certificate")
    return {
        "app": guarded, "host": host, "port": port, "ssl_certfile": tls[0], "ssl_keyfile": tls[1],
        "log_level": "warning", "access_log": False, "server_header": False, "timeout_keep_alive": 15,
        "timeout_graceful_shutdown": 2, "backlog": 512, "ws": "none", "proxy_headers": False, "http": Connection,
        "h11_max_incomplete_event_size": 16_384,
    }  # fmt: skip


class Connection(H11Protocol):
    """uvicorn's HTTP/1.1 with bounds on the time for a head and on the number of connections.

    Its own ``timeout_keep_alive`` ends with the first byte, so a byte now and then would hold a connection forever.
    """

    _due: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
            return
        self._due = self.loop.call_later(HEAD_S, self._late)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._cancel()
        elif self._due is None:
            self._due = self.loop.call_later(HEAD_S, self._late)

    def connection_lost(self, exc: Exception | None) -> None:
        self._cancel()
        super().connection_lost(exc)

    def shutdown(self) -> None:
        super().shutdown()
        self.config.app.end()  # type: ignore[union-attr]  # the guard, which tells those who still wait

    def _late(self) -> None:
        self._due = None
        if self.conn.their_state is h11.IDLE:
            self.transport.abort()

    def _cancel(self) -> None:
        if self._due is not None:
            self._due.cancel()
            self._due = None
