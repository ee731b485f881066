"""Fleet: what kills and a bad store leave, what a question over many homes takes, what the bookkeeping costs.

    python benchmarks/fleet.py kills [--rounds 3]        SIGKILL before and after each call of the store, and at random
    python benchmarks/fleet.py faults [--count 20]       a store that fails and is slow, and workers killed
    python benchmarks/fleet.py questions [--homes 50] [--copies 20] [--dense]
                                                         homes of the dollhouse, in a folder and on S3 by moto's server
    python benchmarks/fleet.py serve [--homes 1000]      the memory of a server of which every home was asked
    python benchmarks/fleet.py cost [--count 200]        tiny recordings: bookkeeping per job, one process and two

It needs pip install '.[test-fleet]'. Times are of this machine, whose processors others may use: the load is printed,
and of a question also what it took of a processor. ``--dense`` asks made-up homes of 100 objects, 90 of which are cups,
vases, tables and sinks: the worst case of relations, which look at each pair.
"""

from __future__ import annotations

import argparse
import collections
import io
import os
import random
import resource
import signal
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from command_line import Parser, run_script

import cartier
import cartier_fleet
from cartier.blob_stores import BlobStore, open_store
from cartier.home import Home
from cartier.home.repository import publish
from cartier.io.files import json_bytes
from cartier.types import Room
from cartier_bench.true_home import true_objects
from cartier_dollhouse.scene import load_home
from cartier_fleet import runners
from cartier_fleet.catalog import compact, read_catalog
from cartier_fleet.jobs import Task
from cartier_fleet.publishing import Pointer, home_store, key_of
from cartier_fleet.status import status
from flat import FLAT, obj
from fleet.catalogued import KNOWS, enter, home
from fleet.moto_server import moto_server
from fleet.tiny import SETTINGS, make_recordings, worker

FIRST = 71_000  # seed of the first home of the dollhouse
MOST_KILLS = 30  # of one run: a job whose worker died ten times is set aside
QUESTIONS = (
    "which homes have no fire extinguisher?", "how many cups per home?", "which homes have a sofa in the bedroom?",
    "which home has the most cups?", "where is the biggest sofa?", "how many red cups are there?",
    "which homes have a cup on the table?", "list the fire extinguishers", "how many cups near a sink are there?",
    "which homes have a red cup next to a table in the kitchen?",
)  # fmt: skip


def faults_of(store: BlobStore, tasks: list[Task]) -> list[str]:
    """What is lost, doubled, half or unfinished after all is mapped."""
    found = []
    keys = {task.name: key_of(store, task.name) for task in tasks}
    visible = {key.split("/")[1] for key in store.list("homes/") if key.endswith("/home.json")}
    if lost := [name for name, key in keys.items() if key not in visible]:
        found.append(f"lost {lost}")
    if len(visible) != len(tasks):
        found.append(f"doubled: {len(visible)} homes of {len(tasks)} recordings")
    fleet = cartier_fleet.Fleet(store.place)
    found += [f"half: {name}" for name in keys if not _whole(lambda name=name: fleet.home(name))]
    rows = read_catalog(store)["homes"]["home"].to_pylist()
    if sorted(rows) != sorted(keys):
        found.append(f"catalog: {len(rows)} homes")
    if status(store)["done"] != len(tasks):
        found.append(f"done: {status(store)['done']}")
    return found


def _whole(load: Callable[[], Home]) -> bool:
    try:
        read = load()
        return bool(read.objects) and all(len(read.photos[frame]) for frame in read.photos)
    except cartier.CartierError:
        return False


class KillingStore:
    """A store whose process is killed before or after its ``nth`` call."""

    def __init__(self, inner: BlobStore, nth: int, after: bool) -> None:
        self._inner, self._left, self._after, self.place = inner, nth, after, inner.place

    def __getattr__(self, verb: str) -> Callable[..., Any]:
        def call(*given: Any) -> Any:
            self._left -= 1
            if self._left == -1 and not self._after:
                os.kill(os.getpid(), signal.SIGKILL)
            result = getattr(self._inner, verb)(*given)
            if self._left == -1:
                os.kill(os.getpid(), signal.SIGKILL)
            return result

        return call


def kills(given: argparse.Namespace) -> int:
    """Kill a mapping process at each call of the store, then let another one finish; and workers at random moments."""
    counted: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        tasks = make_recordings(Path(folder) / "rec", 24)
        nth = killed = 0
        while True:
            before = killed
            for after in (False, True):
                store = open_store(f"{folder}/kill-{nth}-{after}")
                child = os.fork()
                if child == 0:
                    worker(KillingStore(store, nth, after)).map(tasks[0])  # type: ignore[arg-type]
                    os._exit(0)
                killed += os.WIFSIGNALED(os.waitpid(child, 0)[1])
                visible = [key.split("/")[1] for key in store.list("homes/") if key.endswith("/home.json")]
                for key in visible:
                    counted["half homes visible"] += not _whole(
                        lambda s=store, k=key: cartier_fleet.Fleet(s.place).home(k)
                    )
                worker(store).map(tasks[0])
                for fault in faults_of(store, tasks[:1]):
                    counted[fault] += 1
                    print(f"call {nth}, {'after' if after else 'before'}: {fault}")
            if killed == before:
                break
            nth += 1
        print(f"{killed} kills at {nth} calls of the store, each before and after")
        for number in range(given.rounds):
            place = f"{folder}/round-{number}"
            hits = _run_and_kill(tasks, place, random.Random(number))
            counted.update(faults_of(open_store(place), tasks))
            killed += hits
        print(f"{killed} kills in all: {dict(+counted) or '0 lost, 0 doubled, 0 half homes visible'}")
    return bool(sum(counted.values()))


def _run_and_kill(tasks: list[Task], place: str, dice: random.Random) -> int:
    """Map with two workers that are killed at random moments; how many kills hit."""
    hits, start = [0], runners.LocalPool.start

    def kill(child: Any) -> None:
        if child.poll() is None:
            child.kill()
            hits[0] += 1

    def started(pool: runners.LocalPool, number: int) -> Any:
        child = start(pool, number)
        if hits[0] < MOST_KILLS:
            timer = threading.Timer(dice.uniform(0.5, 1.6), kill, [child])
            timer.daemon = True
            timer.start()
        return child

    runners.LocalPool.start = started  # type: ignore[method-assign]
    try:
        runners.run(tasks, place, SETTINGS, workers=2, lease_s=5.0)
    finally:
        runners.LocalPool.start = start  # type: ignore[method-assign]
    return hits[0]


def faults(given: argparse.Namespace) -> int:
    """Map into a bucket of which a tenth of the calls fails, a twentieth loses its reply, a twentieth is slow."""
    with (
        tempfile.TemporaryDirectory() as folder,
        moto_server("--fail", "0.1", "--lose", "0.05", "--slow", "0.05") as s3,
    ):
        tasks = make_recordings(Path(folder) / "rec", given.count)
        begin = time.perf_counter()
        hits = _run_and_kill(tasks, s3, random.Random(1))
        found = faults_of(open_store(s3), tasks)
        took = time.perf_counter() - begin
        print(
            f"{len(tasks)} recordings, {hits} kills, {took:.0f} s: {found or '0 lost, 0 doubled, 0 half homes visible'}"
        )
    return bool(found)


def questions(given: argparse.Namespace) -> int:
    """Time questions over homes as they are built, or over dense ones, half of which have a fire extinguisher."""
    with tempfile.TemporaryDirectory() as folder, moto_server() as s3:
        chunks = Path(folder) / "made"
        (_make_dense if given.dense else _make_homes)(open_store(str(chunks)), given.homes)
        for place in (str(chunks), s3):
            store = open_store(place)
            if place == s3:
                for key in (source := open_store(str(chunks))).list("catalog/"):
                    held = source.get(key)
                    assert held is not None
                    store.put(key, held.data)
            else:
                begin = time.perf_counter()
                made = compact(store)
                print(
                    f"{made['homes']} homes, {made['objects']} objects compacted: {time.perf_counter() - begin:.1f} s"
                )
                if given.copies > 1:
                    print(
                        f"{given.homes * given.copies} homes, {_copy_rows(store, given.copies)} objects after copying"
                    )
            fleet = cartier_fleet.Fleet(place)
            begin = time.perf_counter()
            fleet.ask(QUESTIONS[0])
            print(f"\n{'folder' if place != s3 else 'S3 by moto'}: first question, with reading the catalog: "
                  f"{(time.perf_counter() - begin) * 1e3:.0f} ms")  # fmt: skip
            for question in QUESTIONS:
                times, busy = [], []
                for _ in range(7):
                    begin, used = time.perf_counter(), time.process_time()
                    answer = fleet.ask(question)
                    times.append((time.perf_counter() - begin) * 1e3)
                    busy.append((time.process_time() - used) * 1e3)
                counts = f"{len(answer.has)} / {len(answer.has_none)} / {len(answer.cannot_tell)}"
                print(f"  {statistics.median(times):7.1f} ms, {statistics.median(busy):7.1f} of a processor  "
                      f"{question:58} has / none / cannot tell: {counts}")  # fmt: skip
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    return 0


def _copy_rows(store: BlobStore, copies: int) -> int:
    """Put each home into the snapshot many times, under other names; how many objects there are then."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    count = 0
    for key in [key for key in store.list("catalog/") if key.endswith(".parquet")]:
        held = store.get(key)
        assert held is not None
        table, more = pq.read_table(io.BytesIO(held.data)), []
        for number in range(copies):
            copy = table
            for place, column in enumerate(("home", "version")):
                copy = copy.set_column(place, column, pc.binary_join_element_wise(table[column], str(number), "-"))
            more.append(copy)
        buffer = io.BytesIO()
        pq.write_table(pa.concat_tables(more), buffer, compression="zstd")
        store.put(key, buffer.getvalue())
        count = table.num_rows * copies if "objects" in key else count
    return count


def serve(given: argparse.Namespace) -> int:
    """Ask for every home of a server in turn; each has a floor plan of 200 x 200 cells."""
    from cartier_fleet.served import FleetHomes

    with tempfile.TemporaryDirectory() as folder:
        store, (task, *_) = open_store(f"{folder}/store"), make_recordings(Path(folder) / "rec", 1)
        worker(open_store(f"{folder}/mapped")).map(task)
        made = cartier_fleet.Fleet(f"{folder}/mapped").home(task.name)
        assert made.grid is not None
        more = [(0, max(0, 200 - side)) for side in made.grid.cells.shape]
        cells, tall = (np.pad(of, more) for of in (made.grid.cells, made.grid.height_m))
        padded = replace(made, grid=replace(made.grid, cells=cells, height_m=tall, floor_kinds=None))
        publish(padded, home_store(store, "one"))
        for number in range(given.homes):
            store.put(f"names/home-{number:05d}.json", json_bytes(asdict(Pointer("one", 1, "", ""))))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        served, begin = FleetHomes(cartier_fleet.Fleet(store.place), given.memory_mb * 2**20), time.perf_counter()
        for name in served.names:
            served.get(name)
        took, peak = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"{len(served.names)} homes asked for, {took / given.homes * 1e3:.1f} ms each; with --memory-mb "
              f"{given.memory_mb} at most {peak / 1024:.0f} MB, {before / 1024:.0f} before")  # fmt: skip
    return 0


def _make_homes(store: BlobStore, count: int) -> None:
    """Homes of the dollhouse with all their objects as they are built, half with a fire extinguisher more."""
    for number in range(count):
        scene = load_home(str(FIRST + number))
        none = np.zeros((1, 2), np.int32)
        rooms = [Room(k, room.name, room.kind, none) for k, room in enumerate(scene.rooms)]
        more = [obj(3000, "fire extinguisher", (0.3, 0.3, 0.4), (0.2, 0.2, 0.5), 0, ["red"])] if number % 2 else []
        made = home((*true_objects(scene), *more), rooms, seen=0.5 if number % 7 == 0 else 1.0)
        enter(store, f"home-{number:05d}", replace(made, detector="ground truth (dollhouse)"))


def _make_dense(store: BlobStore, count: int) -> None:
    dice = random.Random(0)
    for number in range(count):
        more = [
            obj(100 + k, dice.choice(("cup", "vase", "table", "sink")), (dice.uniform(0, 5), dice.uniform(0, 4), 0.5),
                (0.2, 0.2, 0.3), dice.choice((0, 1, 2)), [dice.choice(("red", "blue", "white"))])
            for k in range(90)
        ]  # fmt: skip
        more += [obj(300, "fire extinguisher", (0.3, 0.3, 0.4), (0.2, 0.2, 0.5), 0, ["red"])] if number % 2 else []
        more += [obj(301, "sofa", (5.0, 5.0, 0.5), (1 + dice.random(), 1.0, 1.0), 1)] if number % 3 else []
        knows = KNOWS if number % 5 else KNOWS[:4]
        enter(
            store, f"home-{number:05d}", home((*FLAT.objects, *more), knows=knows, seen=0.5 if number % 7 == 0 else 1.0)
        )


def cost(given: argparse.Namespace) -> int:
    """Map tiny recordings by one process and by two; what of a job is bookkeeping."""
    with tempfile.TemporaryDirectory() as folder:
        tasks = make_recordings(Path(folder) / "rec", given.count)
        one = worker(open_store(f"{folder}/warm"))
        one.map(tasks[0])
        times = dict.fromkeys(("map and save", "job"), 0.0)
        for task in tasks[: min(50, len(tasks))]:
            begin = time.perf_counter()
            recording = cartier.open_recording(task.path)
            truth = cartier.make("detectors", "ground_truth", truth=recording.truth, source=recording.name)
            cartier.map_home(recording, truth, every=1).save(f"{folder}/saved/{task.name}")
            times["map and save"] += time.perf_counter() - begin
            begin = time.perf_counter()
            one_more = worker(open_store(f"{folder}/single"))
            one_more.map(replace(task))
            times["job"] += time.perf_counter() - begin
        per = {name: took / min(50, len(tasks)) for name, took in times.items()}
        extra = per["job"] - per["map and save"]
        print(f"a tiny job {per['job'] * 1e3:.0f} ms, of which {extra * 1e3:.0f} ms are bookkeeping into a folder: "
              f"{extra / 10:.1%} of a job of ten seconds")  # fmt: skip
        took = {}
        for workers in (1, 2):
            begin = time.perf_counter()
            runners.run(tasks, f"{folder}/store-{workers}", SETTINGS, workers=workers)
            took[workers] = time.perf_counter() - begin
            found = faults_of(open_store(f"{folder}/store-{workers}"), tasks)
            print(f"{len(tasks)} homes, {workers} processes: {took[workers]:.1f} s; {found or 'all there, each once'}")
        print(f"two processes are {took[1] / took[2]:.2f} times as fast as one")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    return 0


def main() -> int:
    parser = Parser(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("kills").add_argument(
        "--rounds", type=int, default=3, help="runs with workers killed at random"
    )
    commands.add_parser("faults").add_argument("--count", type=int, default=20, help="recordings")
    asked = commands.add_parser("questions")
    asked.add_argument("--homes", type=int, default=50, help="different homes")
    asked.add_argument("--copies", type=int, default=20, help="how often each is in the catalog, by other names")
    asked.add_argument("--dense", action="store_true", help="made-up homes of 100 objects")
    served = commands.add_parser("serve")
    served.add_argument("--homes", type=int, default=1000, help="homes")
    served.add_argument("--memory-mb", type=int, default=1024, help="as for cartier serve")
    commands.add_parser("cost").add_argument("--count", type=int, default=200, help="tiny recordings")
    given = parser.parse_args()
    return {"kills": kills, "faults": faults, "questions": questions, "serve": serve, "cost": cost}[given.command](
        given
    )


if __name__ == "__main__":
    run_script(main)
