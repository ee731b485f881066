"""Prefetching of frames by reader threads, and the batch size for the detector."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TypeVar

from cartier.contracts import Detector, Recording, RecordingDefaults, optional
from cartier.types import Camera, Frame

T = TypeVar("T")
# Of the frames that wait for the detector, and of those that are read ahead: with depth some 250 MB each.
MOST_PIXELS = 16 * 1920 * 1080


def prefetch(recording: Recording, batch: int = 1) -> Iterator[Frame]:
    """All frames in order. Other threads read the next few meanwhile, as many as the recording's ``readers`` allow.

    At most two frames per thread are held, or as many as will be in one ``batch``. Raises what reading a frame raises,
    when it is that frame's turn.
    """
    reads = (partial(recording.__getitem__, number) for number in range(len(recording)))
    return read_ahead(reads, optional(recording, RecordingDefaults, "readers"), batch)


def read_ahead(reads: Iterable[Callable[[], T]], readers: int, batch: int = 1) -> Iterator[T]:
    """What each call gives, in order, while at most ``readers`` threads, one a core, make the next few calls."""
    cores = os.cpu_count() or 1
    threads = min(cores, readers)
    if cores == 1 or threads < 1:
        yield from (read() for read in reads)
        return
    waiting, most = deque[Future[T]](), max(2 * threads, batch)
    with ThreadPoolExecutor(threads, "cartier reader") as pool:
        try:
            for read in reads:
                waiting.append(pool.submit(read))
                if len(waiting) >= most:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:  # a consumer that stops early does not wait for frames that it will not use
            for future in waiting:
                future.cancel()


def batch_size(detector: Detector, camera: Camera) -> int:
    """How many frames of a camera the detector is given at once: as many as it likes best, fewer of large ones."""
    most = max(1, MOST_PIXELS // (camera.width * camera.height))
    return min(int(optional(detector, Detector, "batch")), most)
