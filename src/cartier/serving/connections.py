"""Connections that would keep others waiting before there is any request that the guard could refuse; needs uvicorn."""

from __future__ import annotations

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 5.0  # from a connection's begin, or a head's first byte, until the head of the request is whole
MAX_CONNECTIONS = 800  # below the 1,024 files that a process may usually open


class Connection(H11Protocol):
    """uvicorn's HTTP/1.1 with two bounds that it lacks: on how long a head may take, and on how many may be connected.

    Its own ``timeout_keep_alive`` ends with the first byte, so that one byte now and then would hold a connection for ever.
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
            self._forget()
        elif self._due is None:
            self._due = self.loop.call_later(HEAD_S, self._late)

    def connection_lost(self, exc: Exception | None) -> None:
        self._forget()
        super().connection_lost(exc)

    def _late(self) -> None:
        self._due = None
        if self.conn.their_state is h11.IDLE:
            self.transport.abort()

    def _forget(self) -> None:
        if self._due is not None:
            self._due.cancel()
            self._due = None
