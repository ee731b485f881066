"""Jobs of a fleet: what is to be mapped and how, and the claim, the commit and the failures of one job in the store.

A job is executed at least once and takes effect once. Which worker runs it is settled by a claim, which its owner
renews; correctness never rests on that, for the home's manifest, which is created last, is the only commit.

    jobs/KEY/claim.json     who works at it, how often it failed or its worker died
    jobs/KEY/failed.json    set aside, and why
    jobs/KEY/done.json      home, catalog and name are written
    homes/KEY/…             the home; home.json is created last
    names/NAME.json         the latest version (KEY) of a home
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cartier
from cartier import plugins
from cartier.blob_stores import Blob, BlobStore, open_store
from cartier.contracts import Detector, Recording, RecordingDefaults, optional
from cartier.errors import InputError, brief
from cartier.home.repository import SCHEMA
from cartier.io.files import json_bytes, parse_json, typed
from cartier.recordings.folder import HEAD

MAX_FAILURES = 3
MAX_DEATHS = 10  # kills and lost machines are seldom the job's fault
MAX_FAULT_CHARS = 300
DEEPEST = 6  # folders below RECORDINGS


@dataclass(frozen=True)
class MapSettings:
    """How recordings are mapped: the options of ``cartier map``, as plain values. None leaves a default."""

    detector: str | None = None
    threshold: float | None = None
    every: int | None = None
    indexes: tuple[str, ...] | None = None
    encoder: str = "embedded"
    config: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """sha256 (hex) of the settings and of this cartier's version."""
        return _digest({**asdict(self), "cartier": cartier.__version__, "schema": SCHEMA})


@dataclass(frozen=True)
class Task:
    """A recording to map (a path, or a place on object storage), and what its home is called: the path below all."""

    path: str
    name: str


@dataclass(frozen=True)
class Claim:
    """Which run works at a job, or worked and failed (``waiting``).

    Each renewal changes ``beat``; whoever sees none for the length of a lease, by its own clock, may take the job over:
    no two clocks are compared.
    """

    owner: str
    task: Task
    waiting: bool = False
    beat: int = 0
    deaths: int = 0
    faults: tuple[str, ...] = ()
    nonce: str = field(default_factory=lambda: secrets.token_hex(8))


def find_tasks(place: str | Path) -> list[Task]:
    """The recordings below a folder or a prefix of object storage, by name.

    Raises InputError if there are none, or two would share a name.
    """
    found = _tasks_there(str(place).rstrip("/")) if "://" in str(place) else _tasks_below(Path(place))
    names = dict[str, Task]()
    for task in found:
        if (other := names.setdefault(task.name, task)) is not task:
            raise InputError(f"{other.path} and {task.path} would both be called {task.name}: rename one")
    return found


def _tasks_below(root: Path) -> list[Task]:
    if not root.exists():
        raise InputError(f"{root} does not exist")
    if plugins.formats_of(root):
        return [Task(str(root.absolute()), _name(root.absolute(), root.absolute().parent))]
    found = [Task(str(path.absolute()), _name(path, root)) for path in _recordings(root, DEEPEST)]
    if not found:
        raise InputError(f"{root} holds no recording that cartier knows: 'cartier list' shows the formats")
    return found


def _tasks_there(place: str) -> list[Task]:
    """The recordings on object storage, which are those in cartier's own format."""
    folders = [key.removesuffix(HEAD).rstrip("/") for key in open_store(place).list() if key.split("/")[-1] == HEAD]
    if not folders:
        raise InputError(
            f"{place} holds no recording in cartier's own format ({HEAD}), which alone is read from object storage: "
            "'cartier convert RECORDING -o OUT' writes it"
        )
    if "" in folders:
        return [Task(place, _cleaned(place.split("/")[-1:]))]
    return [Task(f"{place}/{folder}", _cleaned(folder.split("/"))) for folder in folders]


def _recordings(folder: Path, deepest: int) -> list[Path]:
    found: list[Path] = []
    for path in sorted(path for path in folder.iterdir() if not path.name.startswith(".")):
        if plugins.formats_of(path):
            found.append(path)
        elif path.is_dir() and not path.is_symlink() and deepest:
            found += _recordings(path, deepest - 1)
    return found


def _name(path: Path, root: Path) -> str:
    """A recording's path below ``root`` as part of a key, without the suffix of a file."""
    relative = path.relative_to(root)
    parts = relative.with_suffix("").parts if path.is_file() else relative.parts
    return _cleaned(parts)


def _cleaned(parts: Iterable[str]) -> str:
    cleaned = ("".join(c if c.isascii() and (c.isalnum() or c in "_=-.") else "-" for c in part) for part in parts)
    return "/".join(part.lstrip(".") or "-" for part in cleaned)


def signature(place: str) -> str:
    """A digest of the names, sizes and times (on object storage, versions) of a recording's files.

    It is the same while nobody wrote to them.
    """
    if "://" in place:
        from cartier.blob_stores.bucket import BucketBlobs, open_bucket

        return _digest(BucketBlobs(open_bucket(place), place).listing())
    path = Path(place)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    about = [(file.relative_to(path.parent).as_posix(), file.stat()) for file in files if file.is_file()]
    return _digest([(name, seen.st_size, seen.st_mtime_ns) for name, seen in about])


def job_key(recording: Recording, detector: Detector, settings: MapSettings, name: str) -> str:
    """What names a job and its home: the content of the recording, and all that makes the map."""
    return _digest({
        "recording": recording.fingerprint(), "read_with": dict(optional(recording, RecordingDefaults, "read_with")),
        "detector": [detector.name, optional(detector, Detector, "sha256")], "settings": settings.digest, "name": name,
    })[:32]  # fmt: skip


def unreadable_key(task: Task, settings: MapSettings) -> str:
    """What names the job of a recording that cannot be opened."""
    return _digest({"unreadable": task.path, "settings": settings.digest, "name": task.name})[:32]


class Job:
    """One job in a store."""

    def __init__(self, store: BlobStore, key: str, task: Task, owner: str) -> None:
        self.key, self._store, self._task, self._owner = key, store, task, owner
        self._claim: Claim | None = None
        self._version = ""

    @property
    def finished(self) -> str:
        """ "done" or "failed", or "" while it is neither."""
        for state in ("done", "failed"):
            if self._store.get(self._at(state)) is not None:
                return state
        return ""

    def claim(self, stale: str | None = None) -> str | None:
        """Take the job: None if it is this worker's now, else the version of another's claim.

        A claim whose version is ``stale`` is taken over; so is one of the same run, whose worker died.
        """
        mine = Claim(self._owner, self._task)
        while not self._store.create(self._at("claim"), json_bytes(asdict(mine))):
            if (held := self._store.get(self._at("claim"))) is None:
                continue
            theirs = claim_from(held)
            died = not theirs.waiting
            if died and theirs.owner != self._owner and held.version != stale:
                return held.version
            if theirs.deaths + died >= MAX_DEATHS:
                self._set_aside(f"its worker died {MAX_DEATHS} times", theirs)
                return held.version
            mine = Claim(self._owner, self._task, deaths=theirs.deaths + died, faults=theirs.faults)
            if self._store.swap(self._at("claim"), json_bytes(asdict(mine)), held.version):
                break
        self._keep(mine)
        return None

    def renew(self) -> bool:
        """Show that the worker lives; False if another one took the job over."""
        assert self._claim is not None
        return self._swap(replace(self._claim, beat=self._claim.beat + 1))

    def fail(self, line: str) -> bool:
        """Note a failure: whether it was the last one, so that the job is set aside."""
        assert self._claim is not None
        faults = (*self._claim.faults, brief(line, MAX_FAULT_CHARS))
        if len(faults) >= MAX_FAILURES:
            self._set_aside(faults[-1], replace(self._claim, faults=faults))
            return True
        self._swap(replace(self._claim, waiting=True, faults=faults))
        return False

    def finish(self, about: Mapping[str, Any]) -> None:
        """Note that home, catalog and name are written."""
        self._store.create(self._at("done"), json_bytes({**about, **asdict(self._task)}))

    def _set_aside(self, line: str, claim: Claim) -> None:
        about = {"why": line, "failures": len(claim.faults), "deaths": claim.deaths, **asdict(self._task)}
        self._store.create(self._at("failed"), json_bytes(about))

    def _swap(self, claim: Claim) -> bool:
        if not self._store.swap(self._at("claim"), json_bytes(asdict(claim)), self._version):
            return False
        self._keep(claim)
        return True

    def _keep(self, claim: Claim) -> None:
        self._claim = claim
        held = self._store.get(self._at("claim"))
        self._version = held.version if held is not None and held.data == json_bytes(asdict(claim)) else ""

    def _at(self, what: str) -> str:
        return f"jobs/{self.key}/{what}.json"


def claim_from(held: Blob) -> Claim:
    """The claim in a store. Raises InputError for what is none."""
    try:
        claim: Claim = typed(parse_json(held.data, "a claim"), Claim)
        return claim
    except (TypeError, ValueError) as error:
        raise InputError(f"a claim in the store is damaged ({brief(error)}): delete it") from error


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
