"""Worker of a fleet: maps one recording after another into the store, and keeps its detector loaded between them.

python -m cartier_fleet.worker [MODULE]     reads its settings and then tasks as JSON lines, answers each with one

``serving`` of MODULE, this one by default, says what is done with a task.
"""

from __future__ import annotations

import importlib
import json
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from cartier import plugins, specs
from cartier.blob_stores import BlobStore, StoreError, open_store
from cartier.contracts import Detector, Recording
from cartier.errors import CartierError, InputError, brief
from cartier.io.files import typed
from cartier.mapping.config import MappingConfig
from cartier.pipeline import map_home
from cartier_fleet.jobs import Job, MapSettings, Task, job_key, signature, unreadable_key
from cartier_fleet.publishing import is_current, publish, published

BEATS = 4  # renewals of a claim in the length of its lease


@dataclass(frozen=True)
class Outcome:
    """What became of a task: "mapped" now, "finished" before, "failed" for good, to be tried "again", "busy" because
    another worker has claimed it in ``version``; or "stopped", for the store failed, or its worker "died" or was
    "unplaced": no node had room for it."""

    state: str
    line: str = ""
    version: str = ""
    frames: int = 0


class LeaseLost(Exception):
    """Another worker took the job over: what this one still does is in vain."""


class Worker:
    """Maps recordings. ``owner`` names its run in claims."""

    def __init__(self, store: BlobStore, settings: MapSettings, owner: str, lease_s: float) -> None:
        self._store, self._settings, self._owner, self._lease_s = store, settings, owner, lease_s
        self._config = MappingConfig.from_dict(settings.config)
        self._detectors = dict[str, Detector]()

    def map(self, task: Task, stale: str | None = None) -> Outcome:
        """Map one recording, unless that is done. Raises InputError if the store cannot be used."""
        seen = signature(task.path)
        if is_current(self._store, task.name, seen, self._settings):
            return Outcome("finished")
        try:
            recording = plugins.open_recording(task.path)
            detector = self._detector(recording)
            key = job_key(recording, detector, self._settings, task.name)
        except Exception as error:
            return self._work(Job(self._store, unreadable_key(task, self._settings), task, self._owner), stale, error)
        job = Job(self._store, key, task, self._owner)
        return self._work(job, stale, lambda lost: self._home_of(job, task, seen, recording, detector, lost))

    def _work(self, job: Job, stale: str | None, work: Exception | Callable[[threading.Event], int]) -> Outcome:
        """Claim a job and do its work, which gives the number of frames; an exception is what it fails with.

        Faults of the store are not the job's.
        """
        if state := job.finished:
            return Outcome("finished" if state == "done" else "failed", "set aside before")
        if (version := job.claim(stale)) is not None:
            return Outcome("busy", version=version)
        try:
            if isinstance(work, Exception):
                raise work
            with _renewed(job, self._lease_s) as lost:
                return Outcome("mapped", frames=work(lost))
        except LeaseLost:
            return Outcome("again", "its lease ran out")
        except StoreError:
            raise
        except Exception as error:
            line = str(error)
            if not isinstance(error, CartierError):  # a fault of a backend or of ours, which somebody has to mend
                line = f"{type(error).__name__}: {brief(error)}"
                traceback.print_exception(error)
            return Outcome("failed" if job.fail(line) else "again", line)

    def _home_of(
        self, job: Job, task: Task, seen: str, recording: Recording, detector: Detector, lost: threading.Event
    ) -> int:
        """Map and publish a home; one whose worker died after the commit is only entered into the catalog."""

        def check(done: int, total: int) -> None:
            if lost.is_set():
                raise LeaseLost

        began, busy = time.monotonic(), time.process_time()
        home = published(self._store, job.key)
        if home is None:
            home = map_home(
                recording, detector, self._settings.indexes, encoder=self._settings.encoder, config=self._config,
                every=self._settings.every, progress=check,
            )  # fmt: skip
            home = replace(home, name=Path(task.name).name)
        cost = {"wall_s": time.monotonic() - began, "core_s": time.process_time() - busy}
        publish(self._store, job, task, home, seen, self._settings, cost)
        return len(recording)

    def _detector(self, recording: Recording) -> Detector:
        spec = self._settings.detector or specs.detector_for(recording)[0]
        options = {"threshold": self._settings.threshold}
        if spec.startswith("ground_truth") or spec.endswith((".json", ".jsonl")):  # it knows one recording
            return specs.detector(spec, recording, **options)
        if spec not in self._detectors:
            self._detectors[spec] = specs.detector(spec, recording, **options)
        return self._detectors[spec]


@contextmanager
def _renewed(job: Job, lease_s: float) -> Iterator[threading.Event]:
    """Renew a claim while the block runs; the event is set if another worker took it over."""
    ended, lost = threading.Event(), threading.Event()

    def renew() -> None:
        while not ended.wait(lease_s / BEATS):
            try:
                held = job.renew()
            except InputError:  # the store may be away for a moment
                continue
            except Exception:
                traceback.print_exc()
                held = False
            if not held:
                lost.set()
                return

    thread = threading.Thread(target=renew, daemon=True)
    thread.start()
    try:
        yield lost
    finally:
        ended.set()
        thread.join()


def serving(about: dict[str, Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A worker that takes tasks and gives outcomes as plain values. ``about``: store, settings, owner and lease_s."""
    settings: MapSettings = typed(json.loads(json.dumps(about["settings"])), MapSettings)
    worker = Worker(open_store(about["store"]), settings, about["owner"], about["lease_s"])

    def serve(given: dict[str, Any]) -> dict[str, Any]:
        try:
            return asdict(worker.map(Task(**given["task"]), given["stale"]))
        except CartierError as error:
            return asdict(Outcome("stopped", str(error)))

    return serve


def main() -> None:
    """Answer tasks until standard input ends."""
    out, sys.stdout = sys.stdout, sys.stderr  # what a library prints is no answer
    module = importlib.import_module(sys.argv[1] if len(sys.argv) > 1 else "cartier_fleet.worker")
    serve = module.serving(json.loads(sys.stdin.readline()))
    for line in sys.stdin:
        print(json.dumps(serve(json.loads(line))), file=out, flush=True)


if __name__ == "__main__":
    main()
