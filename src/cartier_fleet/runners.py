"""Runners of a fleet: processes of this machine, or actors of a Ray cluster; both give tasks to workers one at a time.

A worker that dies is started again. No task is given to two workers of one run at once, so that a claim of this run is
that of a worker which died, and is taken over without waiting for its lease to end.
"""

from __future__ import annotations

import importlib
import json
import secrets
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Protocol

from cartier.blob_stores import StoreError
from cartier.errors import MissingExtra, need
from cartier.plugins import install
from cartier_fleet.jobs import MapSettings, Task
from cartier_fleet.scheduler import Scheduler
from cartier_fleet.worker import Outcome

MAPPING = "cartier_fleet.worker"
"""The module whose ``serving`` maps recordings."""
LEASE_S = 60.0
POLL_S = 0.5
START_S = 60.0
"""After so long, a task that waits for an actor which no node has room for goes to a worker that runs."""
NO_ROOM = "no node of the cluster had room for its worker"
RUNNERS = ("local", "ray")
Told = Callable[[Task, Outcome, int, int], None]


class Pool(Protocol):
    """Workers by number."""

    def give(self, worker: int, task: Task, stale: str | None) -> None:
        """Start a task on a worker that is idle."""

    def ended(self, wait_s: float) -> Iterable[tuple[int, Outcome]]:
        """The workers that became idle, with their outcomes, after a while at most."""

    def close(self) -> None:
        """End the workers; what they are doing is finished by nobody."""


def run(
    tasks: Iterable[Task], store: str, settings: MapSettings, *, runner: str = "local", workers: int = 1,
    gpus: float = 0.0, lease_s: float = LEASE_S, told: Told | None = None,
) -> dict[str, Outcome]:  # fmt: skip
    """Map recordings into a store, and wait until each is mapped or set aside.

    Args:
        tasks: The recordings.
        store: The place of the store, the same for all workers.
        settings: How to map.
        runner: "local" or "ray".
        workers: How many work at once.
        gpus: Ray: the share of a GPU that each worker reserves.
        lease_s: After how many seconds without a sign of life a claim is taken over.
        told: Called after each outcome with the task, the outcome, and how many of how many tasks have ended.

    Returns:
        The last outcome of each task by its name.

    Raises:
        InputError: The store failed, or a number is out of range.
        MissingExtra: Ray is not installed.
    """
    owner = f"{socket.gethostname()[:40]}-{secrets.token_hex(4)}"  # of all claims of this run
    about = {"store": store, "settings": asdict(settings), "lease_s": lease_s, "owner": owner}
    return work(tasks, about, runner=runner, workers=workers, gpus=gpus, lease_s=lease_s, told=told)


def work(
    tasks: Iterable[Task], about: dict[str, Any], *, module: str = MAPPING, runner: str = "local", workers: int = 1,
    gpus: float = 0.0, lease_s: float = LEASE_S, told: Told | None = None,
) -> dict[str, Outcome]:  # fmt: skip
    """As ``run``, of any work: ``serving(about)`` of a module gives what does a task.

    Raises InputError for numbers out of range, or with the line of an outcome "stopped"; MissingExtra without Ray.
    """
    check_workers(runner, workers)
    schedule = Scheduler(tasks, lease_s)
    made = RayPool(about, gpus, module) if runner == "ray" else LocalPool(about, module)
    pool: Pool = made
    try:
        _drive(schedule, pool, workers, told)
    finally:
        pool.close()
    return schedule.outcomes


def check_workers(runner: str, workers: int) -> None:
    """Raises InputError for a runner that there is not, or a number of workers out of range."""
    need(runner in RUNNERS, f"the runner is {' or '.join(RUNNERS)}, got {runner!r}")
    need(1 <= workers <= 10_000, f"workers must be 1 to 10000, got {workers}")


def _drive(schedule: Scheduler, pool: Pool, workers: int, told: Told | None) -> None:
    idle, busy = list(reversed(range(workers))), dict[int, Task]()
    while not schedule.ended:
        while idle and (given := schedule.next(time.monotonic())) is not None:
            task, stale = given
            busy[idle[-1]] = task
            pool.give(idle.pop(), task, stale)
        if not busy:
            time.sleep(POLL_S)
            continue
        for worker, outcome in pool.ended(POLL_S):
            if worker not in busy:
                continue  # it died while it was idle
            task = busy.pop(worker)
            idle.insert(0 if outcome.state == "unplaced" else len(idle), worker)  # one that runs comes first
            if outcome.state == "stopped":
                raise StoreError(outcome.line)
            schedule.took(task, outcome, time.monotonic())
            if told:
                told(task, outcome, len(schedule.outcomes), schedule.total)


class LocalPool:
    """Processes of this machine, which speak JSON lines."""

    def __init__(self, about: dict[str, Any], module: str = MAPPING) -> None:
        self._about, self._module = about, module
        self._children = dict[int, subprocess.Popen[str]]()
        self._ears = selectors.DefaultSelector()

    def give(self, worker: int, task: Task, stale: str | None) -> None:
        child = self._children.get(worker)
        if child is not None and child.poll() is not None:  # it died while it was idle
            self._end(worker)
            child = None
        child = child or self.start(worker)
        assert child.stdin is not None
        with suppress(BrokenPipeError):  # it died, which its standard output tells
            child.stdin.write(json.dumps({"task": asdict(task), "stale": stale}) + "\n")
            child.stdin.flush()

    def ended(self, wait_s: float) -> list[tuple[int, Outcome]]:
        found = []
        for key, _ in self._ears.select(wait_s):
            worker, child = key.data, self._children[key.data]
            assert child.stdout is not None
            line = child.stdout.readline()
            if line.endswith("\n"):
                found.append((worker, Outcome(**json.loads(line))))
                continue
            self._end(worker)
            found.append((worker, Outcome("died", f"the worker's process ended with {child.wait()}")))
        return found

    def close(self) -> None:
        for worker in list(self._children):
            self._children[worker].kill()
            self._end(worker)
        self._ears.close()

    def start(self, worker: int) -> subprocess.Popen[str]:
        """Start the process of a worker."""
        child = subprocess.Popen(
            [sys.executable, "-m", "cartier_fleet.worker", self._module],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert child.stdin is not None and child.stdout is not None
        self._children[worker] = child
        self._ears.register(child.stdout, selectors.EVENT_READ, worker)
        child.stdin.write(json.dumps(self._about) + "\n")
        return child

    def _end(self, worker: int) -> None:
        child = self._children.pop(worker)
        assert child.stdin is not None and child.stdout is not None
        self._ears.unregister(child.stdout)
        child.wait()
        for stream in (child.stdout, child.stdin):
            with suppress(BrokenPipeError):
                stream.close()


class RayPool:
    """Actors of a Ray cluster, or of one on this machine where none is running; one that dies is made anew."""

    def __init__(self, about: dict[str, Any], gpus: float, module: str = MAPPING) -> None:
        try:
            import ray
        except ModuleNotFoundError as error:
            raise MissingExtra(f"the runner ray needs the package 'ray': {install('fleet', 'ray')}") from error
        self._ray, self._about, self._module = ray, about, module
        if not ray.is_initialized():
            ray.init(log_to_driver=False, include_dashboard=False)
        self._kind = ray.remote(num_cpus=1, num_gpus=gpus or None, max_restarts=0)(RayWorker)
        self._actors, self._running = dict[int, Any](), dict[Any, int]()
        self._starting = dict[int, tuple[Any, float]]()

    def give(self, worker: int, task: Task, stale: str | None) -> None:
        if worker not in self._actors:
            self._actors[worker] = actor = self._kind.remote(self._about, self._module)
            self._starting[worker] = actor.__ray_ready__.remote(), time.monotonic()
        self._running[self._actors[worker].map.remote(asdict(task), stale)] = worker

    def ended(self, wait_s: float) -> list[tuple[int, Outcome]]:
        ready, _ = self._ray.wait(list(self._running), num_returns=1, timeout=wait_s)
        found = []
        for reference in ready:
            worker = self._running.pop(reference)
            try:
                found.append((worker, Outcome(**self._ray.get(reference))))
            except self._ray.exceptions.RayError as error:
                del self._actors[worker]
                found.append((worker, Outcome("died", type(error).__name__)))
        return found + [(worker, Outcome("unplaced", NO_ROOM)) for worker in self._unplaced()]

    def _unplaced(self) -> list[int]:
        """Workers for which no node had room in time; their actors are given up."""
        late = list[int]()
        for worker, (ready, since_s) in list(self._starting.items()):
            if self._ray.wait([ready], timeout=0)[0]:
                del self._starting[worker]
            elif time.monotonic() - since_s >= START_S:
                del self._starting[worker]
                self._ray.kill(self._actors.pop(worker))
                self._running = {reference: of for reference, of in self._running.items() if of != worker}
                late.append(worker)
        return late

    def close(self) -> None:
        for actor in self._actors.values():
            self._ray.kill(actor)


class RayWorker:
    """A worker as an actor; what it is given and gives back are plain values."""

    def __init__(self, about: dict[str, Any], module: str) -> None:
        self._serve = importlib.import_module(module).serving(about)

    def map(self, task: dict[str, str], stale: str | None) -> dict[str, Any]:
        """The outcome of a task."""
        done: dict[str, Any] = self._serve({"task": task, "stale": stale})
        return done
