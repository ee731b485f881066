"""Threads of requests: how many run at once, and what becomes of one that nobody waits for any more."""

from __future__ import annotations

import asyncio
import threading

import pytest

from cartier.serving.threads import Threads


def test_a_place_is_kept_until_the_work_has_ended() -> None:
    may_end, running, most = threading.Event(), list[int](), list[int]()

    def work() -> int:
        running.append(1)
        most.append(len(running))
        assert may_end.wait(20)
        running.pop()
        return len(most)

    async def run() -> None:
        threads = Threads(2)
        waiting = [asyncio.ensure_future(threads.run("room", work)) for _ in range(6)]
        while len(most) < 2:
            await asyncio.sleep(0.001)
        waiting[0].cancel()  # its client is gone; its thread is not
        assert await threads.run("other", lambda: "now") == "now"
        assert len(most) == 2
        may_end.set()
        await asyncio.gather(*waiting, return_exceptions=True)

    asyncio.run(run())
    assert max(most) == 2 and len(most) == 6


def test_what_the_work_raises_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        asyncio.run(Threads(1).run("room", lambda: 1 // 0))


def test_the_threads_are_daemons() -> None:
    assert asyncio.run(Threads(1).run("room", lambda: threading.current_thread().daemon))
