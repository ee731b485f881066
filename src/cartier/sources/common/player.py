"""Player of a recording's frames as a stream."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

from cartier.contracts import Recording
from cartier.errors import InputError, brief
from cartier.sources.common.pacing import QUIET_S, Pace
from cartier.types import Frame
from cartier.types.streams import Event, Fault, Stamped


class RecordingPlayer:
    """Obeys the Source contract.

    Args:
        recording: What is played.
        speed: How many seconds of the recording pass in a second; 0 does not wait.
    """

    def __init__(self, recording: Recording, speed: float) -> None:
        self.name, self.recording, self.waits = recording.name, recording, not speed
        self.notes: Sequence[str] = recording.notes
        self._closed = threading.Event()
        self._pace = Pace(speed, self._closed)

    def __iter__(self) -> Iterator[Event]:
        """Frames whose times do not rise are told apart by a nanosecond; a frame that cannot be read is left out.

        A thread reads one frame ahead, since a frame that is rendered on a busy computer may take over a second.
        """
        last_ns, count = -1, 0
        with ThreadPoolExecutor(1) as reader:
            numbers = iter(range(len(self.recording)))
            ahead = self._read(reader, next(numbers, None))
            while (reading := ahead) is not None and not self._closed.is_set():
                try:
                    frame = reading.result(QUIET_S)
                except TimeoutError:
                    yield Fault("silent", f"the next frame of {self.name} is still being read")
                    continue
                except InputError as error:
                    ahead = self._read(reader, next(numbers, None))
                    yield Fault("unreadable", brief(error, 300), 1)
                    continue
                ahead = self._read(reader, next(numbers, None))
                yield from self._pace.until(frame.time_s, f"{self.name} has no frame here")
                if self._closed.is_set():
                    return
                if frame.index != count:  # one before it was left out
                    frame = replace(frame, index=count)
                last_ns, count = max(round(frame.time_s * 1e9), last_ns + 1), count + 1
                yield Stamped(frame, last_ns)

    def _read(self, reader: ThreadPoolExecutor, number: int | None) -> Future[Frame] | None:
        return None if number is None else reader.submit(self.recording.__getitem__, number)

    def close(self) -> None:
        self._closed.set()
