"""Runners of a fleet: processes and a Ray cluster, with workers, the driver and a node killed in the middle."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cartier.blob_stores import StoreError, open_store
from cartier.errors import InputError, MissingExtra
from cartier.home import Home
from cartier_fleet import runners, worker
from cartier_fleet.jobs import MapSettings, Task
from cartier_fleet.publishing import key_of
from cartier_fleet.status import status
from cartier_fleet.worker import Outcome, Worker
from fleet.tiny import SETTINGS, broken, make_recordings, wait_for

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")


def check_whole(place: str, tasks: list[Task]) -> None:
    """Each recording has one home, which is whole, and nothing else is visible."""
    store = open_store(place)
    keys = {key_of(store, task.name) for task in tasks}
    assert len(keys) == len(tasks)
    assert {key.split("/")[1] for key in store.list("homes/")} == keys
    for key in keys:
        assert store.get(f"homes/{key}/home.json") is not None
    assert status(store)["done"] == len(tasks)
    assert len(store.list("catalog/new/")) == len(tasks)


def test_two_processes_map_each_recording_once(tmp_path: Path, place: str) -> None:
    tasks = make_recordings(tmp_path / "rec", 4)
    told = list[Any]()
    outcomes = runners.run(tasks, place, SETTINGS, workers=2, told=lambda *given: told.append(given))
    assert Counter(outcome.state for outcome in outcomes.values()) == {"mapped": 4}
    assert sorted(done for _, _, done, total in told if total == 4) == [1, 2, 3, 4]
    check_whole(place, tasks)
    outcomes = runners.run(tasks, place, SETTINGS)
    assert Counter(outcome.state for outcome in outcomes.values()) == {"finished": 4}


def test_killed_workers_are_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks, place = make_recordings(tmp_path / "rec", 4), str(tmp_path / "store")
    started = list[subprocess.Popen[str]]()
    start = runners.LocalPool.start

    def noted(pool: runners.LocalPool, worker: int) -> subprocess.Popen[str]:
        child = start(pool, worker)
        started.append(child)
        if len(started) <= 3:  # while it imports, claims, or maps
            threading.Timer(0.7 * len(started), child.kill).start()
        return child

    monkeypatch.setattr(runners.LocalPool, "start", noted)
    outcomes = runners.run(tasks, place, SETTINGS, workers=2)
    assert {outcome.state for outcome in outcomes.values()} <= {"mapped", "finished"}
    assert len(started) > 2
    check_whole(place, tasks)


def test_a_worker_that_dies_idle_is_replaced(tmp_path: Path) -> None:
    tasks, place = make_recordings(tmp_path / "rec", 3), str(tmp_path / "store")

    def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
        for child in children if len(children) <= 2 else ():
            child.kill()
            child.wait()

    children = list[subprocess.Popen[str]]()
    start = runners.LocalPool.start
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runners.LocalPool, "start", lambda *given: children.append(start(*given)) or children[-1])
        outcomes = runners.run(tasks, place, SETTINGS, workers=2, told=told)
    assert {outcome.state for outcome in outcomes.values()} <= {"mapped", "finished"} and len(children) > 2
    check_whole(place, tasks)


def test_a_killed_driver_is_run_again(tmp_path: Path) -> None:
    tasks, place = make_recordings(tmp_path / "rec", 6), str(tmp_path / "store")
    command = [
        sys.executable, "-m", "cartier", "fleet", "map", str(tmp_path / "rec"), "--store", place, "--lease", "2",
        "--detector", "ground_truth", "--every", "1", "--workers", "2", "--json",
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as driver:
        wait_for(lambda: open_store(place).list("jobs/"))
        driver.kill()
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    counted = json.loads(again.stdout)
    assert counted["mapped"] + counted["finished"] == 6 and counted["failed"] == 0
    check_whole(place, tasks)


def test_what_cannot_be_mapped_is_set_aside_in_one_line(tmp_path: Path) -> None:
    make_recordings(tmp_path / "rec", 2)
    broken(tmp_path / "rec")
    command = [sys.executable, "-m", "cartier", "fleet"]
    options = ["--store", str(tmp_path / "store"), "--detector", "ground_truth", "--every", "1"]
    ran = subprocess.run([*command, "map", str(tmp_path / "rec"), *options], capture_output=True, text=True)
    assert ran.returncode == 1 and "2 mapped, 0 were done before, 1 set aside" in ran.stdout
    assert ran.stderr.strip().splitlines()[-1].startswith("cartier: 1 of 3 recordings were set aside")
    found = subprocess.run([*command, "status", str(tmp_path / "store"), "--json"], capture_output=True, text=True)
    assert [row["name"] for row in json.loads(found.stdout)["set_aside"]] == ["broken"]
    pull = [*command, "pull", str(tmp_path / "store"), "flat-1", "-o", str(tmp_path / "home")]
    assert subprocess.run(pull, capture_output=True).returncode == 0
    assert Home.load(tmp_path / "home").name == "flat-1"


def test_a_store_that_fails_ends_the_run(tmp_path: Path) -> None:
    tasks = make_recordings(tmp_path / "rec", 2)
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "jobs").write_text("no folder")
    with pytest.raises(StoreError, match="cannot be written"):
        runners.run(tasks, str(tmp_path / "store"), SETTINGS)


def test_a_bad_runner_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="local or ray"):
        runners.run([], str(tmp_path), MapSettings(), runner="dask")
    with pytest.raises(InputError, match="workers"):
        runners.run([], str(tmp_path), MapSettings(), workers=0)
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingExtra, match="the runner ray needs the package 'ray'"):
        runners.run([], str(tmp_path), MapSettings(), runner="ray")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A head without processors and two nodes of one each."""
    ray = pytest.importorskip("ray", reason="needs pip install '.[test-fleet]'")
    from ray.cluster_utils import Cluster

    small = {"object_store_memory": 80_000_000}
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False, **small})
    nodes = [made.add_node(num_cpus=1, **small) for _ in range(2)]
    ray.init(address=made.address, log_to_driver=False)
    yield made, nodes
    ray.shutdown()
    made.shutdown()


def test_ray_with_a_worker_killed_and_a_node_lost(tmp_path: Path, cluster: Any) -> None:
    made, nodes = cluster
    tasks, place = make_recordings(tmp_path / "rec", 8), str(tmp_path / "store")
    died, step = list[str](), threading.Event()

    def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
        if outcome.state == "died":
            died.append(outcome.line)
        if done == 2 and not step.is_set():
            step.set()
            made.remove_node(nodes.pop(), allow_graceful=False)
            made.add_node(num_cpus=1, object_store_memory=80_000_000)

    outcomes = runners.run(tasks, place, SETTINGS, runner="ray", workers=2, told=told)
    assert step.is_set() and died, "the node was lost while its worker had a task"
    assert {outcome.state for outcome in outcomes.values()} <= {"mapped", "finished"}
    check_whole(place, tasks)


def test_a_killed_worker_leaves_no_home_in_temporary_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A home is never below the temporary folder, also while it is published."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (task,) = make_recordings(tmp_path / "rec", 1)
    store, during = open_store(str(tmp_path / "store")), list[list[Path]]()
    put = store.put

    def looked(key: str, data: bytes) -> None:
        during.append(list((tmp_path / "temporary").rglob("*")))
        put(key, data)

    monkeypatch.setattr(store, "put", looked)
    assert Worker(store, SETTINGS, "me", 60.0).map(task).state == "mapped"
    assert len(during) > 3 and not any(during)
    check_whole(str(tmp_path / "store"), [task])


def test_a_fault_of_ours_keeps_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*given: object, **options: object) -> Home:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(worker, "map_home", fails)
    (task,) = make_recordings(tmp_path / "rec", 1)
    outcome = Worker(open_store(str(tmp_path / "store")), SETTINGS, "me", 60.0).map(task)
    assert (outcome.state, outcome.line) == ("again", "ZeroDivisionError: ours")
    assert "in fails" in capsys.readouterr().err


def test_a_claim_whose_renewal_breaks_is_given_up(capsys: pytest.CaptureFixture[str]) -> None:
    class Breaks:
        def renew(self) -> bool:
            raise ZeroDivisionError("ours")

    with worker._renewed(Breaks(), 0.04) as lost:  # type: ignore[arg-type]
        assert lost.wait(5)
    assert "ZeroDivisionError: ours" in capsys.readouterr().err


def test_ray_with_a_node_lost_and_not_replaced(tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work of its worker, which no other node has room for, goes to the worker that is left."""
    made, _ = cluster
    monkeypatch.setattr(runners, "START_S", 4.0)
    tasks, place, lost = make_recordings(tmp_path / "rec", 4), str(tmp_path / "store"), list[Any]()

    def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
        if not lost:
            lost.extend(node for node in made.list_all_nodes() if node is not made.head_node)
            made.remove_node(lost[0], allow_graceful=False)

    outcomes = runners.run(tasks, place, SETTINGS, runner="ray", workers=2, told=told)
    assert lost and {outcome.state for outcome in outcomes.values()} <= {"mapped", "finished"}
    check_whole(place, tasks)
