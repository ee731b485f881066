"""A program that writes frames to its standard output: exec:'PROGRAM ARGUMENTS', for everything without a source.

docs/live.md has the framing and a whole program of 30 lines.
"""

from __future__ import annotations

import contextlib
import queue
import shlex
import subprocess
import threading
from collections.abc import Iterator, Sequence

from cartier.contracts import Source
from cartier.errors import InputError, brief
from cartier.sources.common.framing import read_event
from cartier.sources.common.pacing import QUIET_S
from cartier.types.streams import Event, Fault, Stamped

END_S = 2.0  # how long the program may take to end when it is asked to
MOST_WAITING = 4


def make(model: str) -> Source:
    """``model`` is the command, split as a shell splits it; no shell runs it. Raises InputError for an empty one."""
    try:
        words = shlex.split(model)
    except ValueError as error:
        raise InputError(f"exec:{brief(model, 80)}: {error}") from error
    if not words:
        raise InputError("source exec needs a program: exec:'PROGRAM ARGUMENTS'")
    return Program(words)


class Program:
    """Obeys the Source contract. The program's standard error goes to ours."""

    waits = False
    recording = None
    notes: Sequence[str] = ()

    def __init__(self, words: Sequence[str]) -> None:
        self.name, self._words = words[0], words
        self._closed = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None

    def __iter__(self) -> Iterator[Event]:
        """Raises InputError if the program cannot be started, or writes something else than frames."""
        try:
            process = subprocess.Popen(self._words, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
        except OSError as error:
            raise InputError(f"{self.name} cannot be started: {error.strerror or error}") from error
        self._process = process
        events: queue.Queue[Event | InputError | None] = queue.Queue(MOST_WAITING)
        threading.Thread(target=self._read, args=(process, events), daemon=True).start()
        last_ns = -1
        try:
            while not self._closed.is_set():
                try:
                    event = events.get(timeout=QUIET_S)
                except queue.Empty:
                    yield Fault("silent", f"{self.name} writes nothing")
                    continue
                if event is None:
                    yield from self._ended(process)
                    return
                if isinstance(event, InputError):
                    raise InputError(f"{self.name} writes what is no frame: {event}")
                if isinstance(event, Stamped):
                    if event.stamp_ns <= last_ns:
                        yield Fault("late", f"{self.name}: a frame's stamp is not later than the one before it", 1)
                        continue
                    last_ns = event.stamp_ns
                yield event
        finally:
            self.close()

    def close(self) -> None:
        self._closed.set()
        process = self._process
        if process is None or process.poll() is not None:
            return
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _ended(self, process: subprocess.Popen[bytes]) -> Iterator[Event]:
        code = process.wait()
        if code:
            yield Fault("ended", f"{self.name} ended with exit code {code}")

    def _read(self, process: subprocess.Popen[bytes], events: queue.Queue[Event | InputError | None]) -> None:
        """Read events until the end; what goes wrong here ends the stream, with its line."""
        assert process.stdout is not None
        count = 0
        with process.stdout as pipe:
            while not self._closed.is_set():
                try:
                    event: Event | InputError | None = read_event(pipe, count)
                except InputError as error:
                    event = error
                except Exception as error:  # a fault of ours; the thread must not die silently
                    event = InputError(f"the reader failed: {type(error).__name__}: {brief(error, 200)}")
                count += isinstance(event, Stamped)
                self._put(events, event)
                if event is None or isinstance(event, InputError):
                    return

    def _put(self, events: queue.Queue[Event | InputError | None], event: Event | InputError | None) -> None:
        while not self._closed.is_set():
            with contextlib.suppress(queue.Full):
                events.put(event, timeout=QUIET_S)
                return
