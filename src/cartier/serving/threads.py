"""Threads for the work of requests: so many at once for each home, and none that the end of the server waits for."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import functools
import threading
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TypeVar

Value = TypeVar("Value")


class Threads:
    """Runs work in daemon threads, at most ``most`` at once under each name, or what ``mosts`` says of it.

    The worker threads of anyio are joined when the interpreter exits, however long a language model takes.
    """

    def __init__(self, most: int, mosts: Mapping[str, int] = MappingProxyType({})) -> None:
        self._most, self._mosts = most, mosts
        self._limits: dict[str, asyncio.Semaphore] = {}

    async def run(self, name: str, work: Callable[..., Value], *given: object) -> Value:
        """What the work returns or raises. Its place is free when the work has ended, also if nobody waits for it."""
        limit = self._limits.setdefault(name, asyncio.Semaphore(self._mosts.get(name, self._most)))
        await limit.acquire()
        loop = asyncio.get_running_loop()
        done: asyncio.Future[Value] = loop.create_future()

        def settle(tell: Callable[[], None]) -> None:
            limit.release()
            if not done.cancelled():
                tell()

        def run() -> None:
            try:
                tell = functools.partial(done.set_result, work(*given))
            except BaseException as error:
                tell = functools.partial(done.set_exception, error)
            with contextlib.suppress(RuntimeError):  # the server has ended
                loop.call_soon_threadsafe(settle, tell)

        context = contextvars.copy_context()
        threading.Thread(target=context.run, args=(run,), name="cartier work", daemon=True).start()
        return await done
