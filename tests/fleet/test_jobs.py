"""Jobs of a fleet: once claimed, once committed; taken over, failed thrice, entered again after a kill."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cartier.blob_stores import BlobStore, StoreError, open_store
from cartier.errors import InputError
from cartier.home import Home
from cartier.home.store import PublishedStore
from cartier.plugins import make, open_recording
from cartier_fleet import jobs, publishing
from cartier_fleet.jobs import Job, MapSettings, Task, find_tasks, job_key, signature
from cartier_fleet.publishing import key_of, pull
from cartier_fleet.scheduler import Scheduler
from cartier_fleet.status import status
from cartier_fleet.worker import Outcome, Worker
from fleet.tiny import SETTINGS, broken, content_of, make_recordings, work, worker

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")
TASK = Task("/nowhere/flat", "flat")


@pytest.fixture
def recorded(tmp_path: Path) -> list[Task]:
    return make_recordings(tmp_path / "rec")


@pytest.fixture
def store(tmp_path: Path) -> BlobStore:
    return open_store(str(tmp_path / "store"))


def job(store: BlobStore, owner: str, key: str = "k") -> Job:
    return Job(store, key, TASK, owner)


def test_one_of_two_workers_gets_a_job(store: BlobStore) -> None:
    assert job(store, "a").claim() is None
    version = job(store, "b").claim()
    assert version
    assert job(store, "b").claim("another version") == version


def test_a_restarted_worker_takes_its_own_claim(store: BlobStore) -> None:
    job(store, "a").claim()
    assert job(store, "a").claim() is None
    held = store.get("jobs/k/claim.json")
    assert held and json.loads(held.data)["deaths"] == 1


def test_a_claim_that_is_not_renewed_is_taken_over(store: BlobStore) -> None:
    first, second = job(store, "a"), job(store, "b")
    first.claim()
    stale = second.claim()
    assert first.renew(), "its owner lives"
    assert second.claim(stale) not in (None, stale)
    assert second.claim(second.claim()) is None
    assert not first.renew(), "it was taken over"


def test_of_two_that_take_over_one_does(store: BlobStore) -> None:
    job(store, "a").claim()
    stale = job(store, "b").claim()
    assert job(store, "b").claim(stale) is None
    assert job(store, "c").claim(stale) is not None


def test_the_third_failure_sets_a_job_aside(store: BlobStore) -> None:
    for number, owner in enumerate("abc"):
        one = job(store, owner)
        assert one.claim() is None
        assert one.fail(f"reason {number}") is (number == 2)
    assert job(store, "d").finished == "failed"
    assert status(store)["reasons"] == {"reason 2": 1}


def test_a_job_that_kills_its_workers_is_set_aside(store: BlobStore) -> None:
    for _ in range(jobs.MAX_DEATHS):
        assert job(store, "a").claim() is None
    assert job(store, "a").claim() is not None
    assert "died" in next(iter(status(store)["reasons"]))


def test_a_damaged_claim_is_one_line(store: BlobStore) -> None:
    store.put("jobs/k/claim.json", b'{"owner": 3}')
    with pytest.raises(InputError, match="a claim in the store is damaged"):
        job(store, "a").claim()


def test_a_key_names_content_and_settings(recorded: list[Task]) -> None:
    def key(task: Task, settings: MapSettings = SETTINGS, name: str = "x", detector: str = "ground_truth") -> str:
        recording = open_recording(task.path)
        made = make("detectors", detector, truth=recording.truth, source="x") if detector == "ground_truth" else None
        return job_key(recording, made or make("detectors", detector), settings, name)

    assert key(recorded[0]) == key(recorded[0])
    others = [
        key(recorded[1]), key(recorded[0], MapSettings(every=2)), key(recorded[0], name="y"),
        key(recorded[0], detector="embedded"),
    ]  # fmt: skip
    assert len({key(recorded[0]), *others}) == 5


def test_a_signature_changes_with_the_files(recorded: list[Task]) -> None:
    path = Path(recorded[0].path)
    before = signature(str(path))
    assert signature(str(path)) == before
    (path / "rgb" / "extra.png").write_bytes(b"1")
    assert signature(str(path)) != before


def test_recordings_are_found_and_named(recorded: list[Task], tmp_path: Path) -> None:
    assert [task.name for task in recorded] == ["flat-1", "flat-2", "nested/flat-0"]
    assert [task.name for task in find_tasks(tmp_path / "rec" / "flat-1")] == ["flat-1"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no recording"):
        find_tasks(tmp_path / "empty")
    (tmp_path / "rec" / "flat-1").rename(tmp_path / "rec" / "a b")
    (tmp_path / "rec" / "flat-2").rename(tmp_path / "rec" / "a,b")
    with pytest.raises(InputError, match="would both be called a-b"):
        find_tasks(tmp_path / "rec")


def test_homes_are_those_of_map(recorded: list[Task], place: str, tmp_path: Path) -> None:
    """Bit for bit, in a folder and in a bucket; and running again does nothing."""
    from interrupted import run

    store = open_store(place)
    assert work(store, recorded) == ["mapped"] * 3
    before = store.list()
    for task in recorded:
        options = ["--detector", "ground_truth", "--every", "1", "-o", tmp_path / "maps" / task.name]
        assert run(["map", task.path, *options], tmp_path)[0] == 0
        pull(store, task.name, tmp_path / "pulled" / task.name)
        assert content_of(tmp_path / "pulled" / task.name) == content_of(tmp_path / "maps" / task.name)
    assert work(store, recorded, "two") == ["finished"] * 3
    assert store.list() == before


def test_a_home_in_a_store_is_loaded_where_it_is(recorded: list[Task], s3: str) -> None:
    place = f"{s3}/loaded"
    store = open_store(place)
    work(store, recorded[:1])
    home = Home.load(f"{place}/homes/{key_of(store, 'flat-1')}")
    assert home.names and len(home.photos) > 0 and home.photo(home.objects[0].id)
    with pytest.raises(InputError, match="published and stays as it is"):
        home.correct("name", home.objects[0].id, name="mine")


def test_pull_keeps_corrections_and_refuses_damage(recorded: list[Task], store: BlobStore, tmp_path: Path) -> None:
    work(store, recorded[:1])
    pulled = pull(store, "flat-1", tmp_path / "h")
    Home.load(tmp_path / "h").correct("name", pulled.objects[0].id, name="Fred")
    pull(store, "flat-1", tmp_path / "h")
    assert "Fred" in Home.load(tmp_path / "h").names
    before = content_of(tmp_path / "h")
    blob = next(key for key in store.list("homes/") if "/objects-" in key)
    store.put(blob, b"[]")
    with pytest.raises(InputError, match="damaged"):
        pull(store, "flat-1", tmp_path / "h")
    assert content_of(tmp_path / "h") == before
    with pytest.raises(InputError, match="no home called"):
        pull(store, "flat-9", tmp_path / "h")


def test_a_failure_is_tried_three_times_and_told(store: BlobStore, tmp_path: Path) -> None:
    task = broken(tmp_path / "rec")
    assert work(store, [task, task, task, task]) == ["again", "again", "failed", "failed"]
    assert "000000" in next(iter(status(store)["reasons"]))
    missing = Task(str(tmp_path / "rec" / "gone"), "gone")
    assert work(store, [missing] * 3)[-1] == "failed"
    assert status(store)["failed"] == 2


class Crash(BaseException): ...


class CrashingStore:
    """A store whose client dies before its ``nth`` write; reads go through."""

    def __init__(self, inner: BlobStore, nth: int) -> None:
        self._inner, self._left, self.place = inner, nth, inner.place
        self.get, self.list = inner.get, inner.list

    def __getattr__(self, verb: str):
        def write(*given):
            self._left -= 1
            if self._left < 0:
                raise Crash
            return getattr(self._inner, verb)(*given)

        return write


def state_of(store: BlobStore) -> dict[str, bytes]:
    """All that readers see: homes, names and who is done; claims and costs differ from run to run."""
    kept = [key for key in store.list() if not key.startswith(("jobs/", "catalog/"))]
    found = {}
    for key in kept:
        held = store.get(key)
        assert held is not None
        found[key] = held.data
    return found


def test_killed_at_each_write_nothing_is_lost_doubled_or_half(recorded: list[Task], tmp_path: Path) -> None:
    task = recorded[0]
    whole = open_store(str(tmp_path / "whole"))
    work(whole, [task])
    catalog = whole.list("catalog/")
    writes = len(whole.list()) + 5
    crashed = 0
    for nth in range(writes):
        store = open_store(str(tmp_path / f"store-{nth}"))
        try:
            worker(CrashingStore(store, nth)).map(task)  # type: ignore[arg-type]
        except Crash:
            crashed += 1
        for key in {key.split("/")[1] for key in store.list("homes/") if key.endswith("/home.json")}:
            Home.load(Path(store.place) / "homes" / key)  # a home that is visible is whole
        assert work(store, [task]) in (["mapped"], ["finished"])
        assert work(store, [task]) == ["finished"]
        assert state_of(store) == state_of(whole)
        assert store.list("catalog/") == catalog
    assert crashed > 15


def test_a_home_that_is_committed_is_not_mapped_again(
    recorded: list[Task], store: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Dying(CrashingStore):
        def __getattr__(self, verb: str):
            def write(key: str, *given):
                if key.startswith("catalog/"):
                    raise Crash
                return getattr(self._inner, verb)(key, *given)

            return write

    with pytest.raises(Crash):
        worker(Dying(store, 0)).map(recorded[0])  # type: ignore[arg-type]
    monkeypatch.setattr("cartier_fleet.worker.map_home", None)
    assert work(store, recorded[:1]) == ["mapped"]
    assert key_of(store, "flat-1") and len(store.list("catalog/new/")) == 1


def test_a_home_is_published_whole_or_not_at_all(recorded: list[Task], tmp_path: Path) -> None:
    """The manifest comes after every blob that it names."""
    store = open_store(str(tmp_path / "store"))
    seen = list[str]()

    class Noting(CrashingStore):
        def __getattr__(self, verb: str):
            return lambda key, *given: (seen.append(key), getattr(self._inner, verb)(key, *given))[1]

    worker(Noting(store, 0)).map(recorded[0])  # type: ignore[arg-type]
    homes = [key for key in seen if key.startswith("homes/")]
    assert homes[-1].endswith("/home.json") and len(homes) > 10
    order = [next(k for k, key in enumerate(seen) if key.startswith(begin)) for begin in ("catalog/", "names/")]
    assert seen.index(homes[-1]) < order[0] < order[1] < len(seen) - 1
    assert seen[-1].endswith("/done.json")


class DoublingStore(CrashingStore):
    """A store to which every write is delivered twice."""

    def __getattr__(self, verb: str):
        def write(*given):
            getattr(self._inner, verb)(*given)
            return getattr(self._inner, verb)(*given)

        return write


def test_every_write_delivered_twice_changes_nothing(recorded: list[Task], tmp_path: Path) -> None:
    once, twice = open_store(str(tmp_path / "once")), open_store(str(tmp_path / "twice"))
    assert work(once, recorded) == ["mapped"] * 3
    assert work(DoublingStore(twice, 0), recorded) == ["mapped"] * 3  # type: ignore[arg-type]
    assert state_of(once) == state_of(twice)
    assert len(twice.list("jobs/")) == len(once.list("jobs/"))


def test_a_slow_worker_that_finishes_late_changes_nothing(
    recorded: list[Task], store: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its lease runs out while it maps; another one takes over and is done first."""
    task, late = recorded[0], list[dict[str, bytes]]()
    real = publishing.publish_home

    def slow(home: Home, at: PublishedStore) -> None:
        monkeypatch.setattr(publishing, "publish_home", real)
        stale = worker(store, "fast").map(task).version
        assert worker(store, "fast").map(task, stale).state == "mapped"
        late.append(state_of(store))
        real(home, at)

    monkeypatch.setattr(publishing, "publish_home", slow)
    assert worker(store, "slow").map(task).state == "mapped"
    assert state_of(store) == late[0]
    assert status(store) | {"store": ""} == {
        "store": "", "done": 1, "running": 0, "waiting": 0, "failed": 0, "reasons": {}, "set_aside": [],
    }  # fmt: skip


@pytest.mark.parametrize("hours", [-1, 1])
def test_clocks_an_hour_off_take_nothing_over(
    recorded: list[Task], store: BlobStore, monkeypatch: pytest.MonkeyPatch, hours: int
) -> None:
    """No two clocks are compared: a claim is stale for whoever watched it, by its own clock."""
    import time

    Job(store, key := job_key_of(recorded[0]), recorded[0], "other").claim()
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + hours * 3600)
    assert worker(store, "mine").map(recorded[0]).state == "busy"
    held = store.get(f"jobs/{key}/claim.json")
    assert held and json.loads(held.data)["owner"] == "other"


def job_key_of(task: Task) -> str:
    recording = open_recording(task.path)
    truth = make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
    return job_key(recording, truth, SETTINGS, task.name)


def test_mapped_again_with_other_settings_is_the_latest(recorded: list[Task], store: BlobStore) -> None:
    work(store, recorded[:1])
    first = key_of(store, "flat-1")
    others = MapSettings("ground_truth", every=1, indexes=("object_depth",))
    assert Worker(store, others, "two", 60.0).map(recorded[0]).state == "mapped"
    assert key_of(store, "flat-1") != first
    assert key_of(store, first) == first, "a version can be named"


def test_a_store_that_fails_is_not_the_jobs_fault(recorded: list[Task], store: BlobStore) -> None:
    class Failing(CrashingStore):
        def __getattr__(self, verb: str):
            def write(key: str, *given):
                if key.startswith("homes/"):
                    raise StoreError("the store is away")
                return getattr(self._inner, verb)(key, *given)

            return write

    for _ in range(4):
        with pytest.raises(StoreError):
            worker(Failing(store, 0)).map(recorded[0])  # type: ignore[arg-type]
    assert work(store, recorded[:1]) == ["mapped"]


def tasks(*names: str) -> list[Task]:
    return [Task(f"/{name}", name) for name in names]


def test_scheduler_gives_each_task_once() -> None:
    schedule = Scheduler(tasks("a", "b"), 60.0)
    first, second = schedule.next(0.0), schedule.next(0.0)
    assert first == (tasks("a")[0], None) and second == (tasks("b")[0], None) and schedule.next(0.0) is None
    assert not schedule.ended
    schedule.took(tasks("a")[0], Outcome("mapped"), 1.0)
    schedule.took(tasks("b")[0], Outcome("finished"), 1.0)
    assert schedule.ended and set(schedule.outcomes) == {"a", "b"}


def test_scheduler_waits_a_lease_before_it_takes_over() -> None:
    schedule = Scheduler(tasks("a"), 60.0)
    schedule.next(0.0)
    schedule.took(tasks("a")[0], Outcome("busy", version="v1"), 100.0)
    assert schedule.next(159.0) is None
    assert schedule.next(160.0) == (tasks("a")[0], "v1")
    schedule.took(tasks("a")[0], Outcome("busy", version="v2"), 161.0)
    assert schedule.next(200.0) is None, "its owner renewed it: it is watched anew"


def test_scheduler_tries_again_and_not_for_ever() -> None:
    schedule = Scheduler(tasks("a"), 60.0)
    for number in range(100):
        given = schedule.next(float(number))
        if given is None:
            break
        schedule.took(given[0], Outcome("died"), float(number))
    assert schedule.outcomes["a"].state == "died" and number == 30
