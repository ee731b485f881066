"""A running AI2-THOR build, watched: one that dies or hangs is noticed, stopped and named in one line.

The client itself waits for its whole time-out when a build dies, and starts another one without a message. So each call
of the client runs in a thread of its own, while this one looks after the build's process.
"""

from __future__ import annotations

import os
import shlex
import shutil
import threading
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from ai2thor.controller import Controller
from ai2thor.fifo_server import FifoServer
from ai2thor.wsgi_server import WsgiServer

from cartier.errors import BackendError, CartierError

T = TypeVar("T")
LOG = Path("~/.ai2thor/log/unity.log")
POLL_S = 0.05
NEVER_S = 1e6  # the client's own time-outs: the watch is quicker


class _Client(Controller):  # type: ignore[misc]
    """The real client, except that it never starts a second build after a crash."""

    def start(self, *args: Any, **options: Any) -> Any:
        if self.unity_pid is not None:
            self.server = _Stopped()
            raise BackendError("the AI2-THOR build crashed")
        return super().start(*args, **options)


class _Stopped:
    """In place of a server that is gone: the client stops its server once more when Python exits."""

    unity_proc = None

    def stop(self) -> None: ...


class Build:
    """One build from start to stop, with the client's own options; ``server`` is fifo or wsgi.

    ``load_s`` is how long it may take to start or to load a scene, ``step_s`` to answer one action.
    """

    def __init__(self, server: str, options: dict[str, Any], load_s: float, step_s: float) -> None:
        self._load_s, self._step_s = load_s, step_s
        self.running = True
        self._client: Any = object.__new__(_Client)  # its __init__ blocks, and must be watched as well
        self._process: Any = None
        self._log_begin = _log_size()
        start = {"server_timeout": NEVER_S, "server_start_timeout": NEVER_S, **options}
        start["server_class"] = WsgiServer if server == "wsgi" else FifoServer
        self._watched("starting", lambda: _Client.__init__(self._client, **start), load_s)

    def step(self, action: str, **arguments: Any) -> Any:
        """The event of one action. Raises BackendError if it fails or if the build is gone."""
        return _done(self._watched(f"doing {action}", lambda: self._client.step(action, **arguments), self._step_s))

    def reset(self, scene: str | dict[str, Any]) -> Any:
        """The first event of a scene: its name, or a ProcTHOR house."""
        name = scene if isinstance(scene, str) else "a ProcTHOR house"
        return _done(self._watched(f"loading {name}", lambda: self._client.reset(scene), self._load_s))

    def scenes(self) -> set[str]:
        """The names of the scenes in the build."""
        found = self._watched("listing its scenes", lambda: self._client.scenes_in_build, self._step_s)
        return {str(name) for name in found}

    def clip_planes_m(self) -> tuple[float, float]:
        """The camera's near and far plane, as the build reported them at its start (old builds: the client's guess)."""
        return float(self._client.server.camera_near_plane), float(self._client.server.camera_far_plane)

    def _watched(self, doing: str, work: Callable[[], T], limit_s: float) -> T:
        """What ``work`` returns, or a BackendError within moments of the build's end or ``limit_s`` of silence."""
        results: list[T] = []
        faults: list[BaseException] = []

        def run() -> None:
            try:
                results.append(work())
            except BaseException as error:
                faults.append(error)

        worker = threading.Thread(target=run, daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            worker.start()
            try:
                trouble = self._wait(worker, doing, limit_s)
            except BaseException:  # Ctrl-C: the answer to this action would be taken for the next one's
                self.stop(worker)
                raise
            if trouble is None and faults:
                trouble = self._ended(doing, wait_s=0.5) or _explain(doing, faults[0])
            if trouble is not None:
                self.stop(worker)
                raise BackendError(trouble) from (faults[0] if faults else None)
        return results[0]

    def _wait(self, worker: threading.Thread, doing: str, limit_s: float) -> str | None:
        """Wait for the worker; returns what went wrong with the build, if it did. A download may take any time."""
        deadline: float | None = None
        while True:
            worker.join(POLL_S)
            if not worker.is_alive():
                return None
            if ended := self._ended(doing):
                return ended
            if deadline is None and self._process is not None:
                deadline = time.monotonic() + limit_s
            if deadline is not None and time.monotonic() > deadline:
                return (
                    f"the AI2-THOR build hangs: no answer within {limit_s:g} s while {doing}, so it was stopped "
                    f"({_log(self._log_begin)}); "
                    "on a slow machine make the world with a larger timeout_s"
                )

    def _ended(self, doing: str, wait_s: float = 0.0) -> str | None:
        self._process = getattr(getattr(self._client, "server", None), "unity_proc", None) or self._process
        if self._process is None:
            return None
        give_up = time.monotonic() + wait_s
        while (code := self._process.poll()) is None and time.monotonic() < give_up:
            time.sleep(POLL_S)
        if code is None:
            return None
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        return f"the AI2-THOR build {how} while {doing} ({_log(self._log_begin)})"

    def stop(self, worker: threading.Thread | None = None) -> None:
        """End the build's process, and the worker that waits for it."""
        self.running = False
        server = getattr(self._client, "server", None)
        self._client.server = _Stopped()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        for name, flag in (("server_pipe_path", os.O_WRONLY), ("client_pipe_path", os.O_RDONLY)):
            with suppress(OSError, AttributeError):  # wakes a worker that waits for the other end to open a pipe
                os.close(os.open(getattr(server, name), flag | os.O_NONBLOCK))
        if worker is not None:
            worker.join(POLL_S)
        with suppress(Exception):  # closes the pipes, which ends a worker that reads or writes there
            getattr(server, "stop", lambda: None)()
        if worker is not None:
            worker.join(1.0)


def command_line(executable: str | Path) -> str:
    """A command line that the client can split; its program must be there."""
    text = shlex.quote(str(executable)) if Path(executable).is_file() else str(executable)
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise BackendError(f"the AI2-THOR build {text!r} is no command line ({error})") from error
    if not words or shutil.which(words[0]) is None:
        raise BackendError(f"there is no AI2-THOR build at {text!r}: the file is missing or not executable (chmod +x)")
    return text


def _done(event: Any) -> Any:
    metadata = event.metadata
    if not metadata["lastActionSuccess"]:
        raise BackendError(f"AI2-THOR refused {metadata.get('lastAction')}: {_line(metadata.get('errorMessage'))}")
    return event


def _explain(doing: str, fault: BaseException) -> str:
    """One line for an exception of the client."""
    if isinstance(fault, CartierError):
        return str(fault)
    text = _line(fault)
    if "no build exists" in text or "No build exists" in text or "ConnectionError" in type(fault).__name__:
        return (
            "there is no AI2-THOR build on this machine and none could be downloaded: connect to the network for the "
            "first run, or give the option executable=/path/to/the/build"
        )
    return f"AI2-THOR failed while {doing}: {text or type(fault).__name__}"


def _log_size() -> int:
    with suppress(OSError):
        return LOG.expanduser().stat().st_size
    return 0


def _log(begin: int) -> str:
    """Where the client keeps the output of all builds, and what this one, which began at byte ``begin``, said last."""
    with suppress(OSError), LOG.expanduser().open("rb") as log:
        log.seek(max(begin, log.seek(0, os.SEEK_END) - 4096))
        if said := log.read().decode(errors="replace").strip():
            return f"its log, {LOG}, ends: {_line(said.splitlines()[-1])[:120]}"
    return f"its log is {LOG}"


def _line(message: object) -> str:
    return " ".join(str(message or "").split())[:300]
