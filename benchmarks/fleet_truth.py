"""Fleet of generated dollhouse homes: a node lost while they are mapped, and answers held against the homes' truth.

    python benchmarks/fleet_truth.py truth [--homes 200] [--workers 2]   ten questions over all homes, and who is right
    python benchmarks/fleet_truth.py node [--homes 20]                   Ray with three nodes, one killed in the middle

A camera turns around in the middle of each room: no robot's walk. The detector is ground truth, and so is what answers
are held against. It needs pip install '.[test-fleet]'.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Parser, run_script

import cartier_fleet
from cartier.blob_stores import open_store
from cartier.recordings import folder as own_format
from cartier.types import MapObject
from cartier_bench.true_home import true_objects
from cartier_dollhouse.model import Scene
from cartier_dollhouse.recording import DollhouseRecording, look, pinhole
from cartier_dollhouse.scene import load_home
from cartier_fleet import runners
from cartier_fleet.catalog import compact
from cartier_fleet.jobs import MapSettings, Task, find_tasks
from cartier_fleet.status import status
from cartier_fleet.worker import Outcome

FIRST = 71_000  # seed of the first home, far from those that anything was fitted on
TURNS, DOWN = 10, math.radians(25)
SETTINGS = MapSettings("ground_truth", every=1)
Count = Callable[[Scene, Sequence[MapObject]], int]


def named(*labels: str, room: str = "") -> Count:
    """Counts the true objects of some labels, in rooms of a kind."""

    def count(scene: Scene, objects: Sequence[MapObject]) -> int:
        kinds = [one.kind for one in scene.rooms]
        there = [o for o in objects if o.label in labels]
        return sum(not room or (o.room is not None and kinds[o.room] == room) for o in there)

    return count


SOFA = ("sofa", "couch")
QUESTIONS: tuple[tuple[str, Count, Callable[[int], bool]], ...] = (
    ("which homes have no television?", named("television", "tv"), lambda n: n > 0),
    ("which homes have a bathtub?", named("bathtub"), lambda n: n > 0),
    ("which homes have a sofa?", named(*SOFA), lambda n: n > 0),
    ("which homes have a microwave in the kitchen?", named("microwave", room="kitchen"), lambda n: n > 0),
    ("which homes have at least two beds?", named("bed"), lambda n: n >= 2),
    ("which homes have more than three chairs?", named("chair"), lambda n: n > 3),
    ("which homes have a desk in the bedroom?", named("desk", room="bedroom"), lambda n: n > 0),
    ("how many homes have no dining table?", named("dining table"), lambda n: n > 0),
    ("which homes have a fridge?", named("fridge", "refrigerator"), lambda n: n > 0),
    ("which homes have exactly one toilet?", named("toilet"), lambda n: n == 1),
)
"""Words, the count that decides, and whether a home with that many has what is asked for."""


def record(root: Path, count: int, width: int = 128, height: int = 96) -> list[Scene]:
    """Record the homes, and give them as they are built."""
    camera, scenes = pinhole(width, height, 75.0), []
    for number in range(FIRST, FIRST + count):
        scene = load_home(str(number))
        places = [((room.box[0] + room.box[2]) / 2, (room.box[1] + room.box[3]) / 2) for room in scene.rooms]
        poses = np.array([look(xy, 2 * math.pi * k / TURNS, DOWN) for xy in places for k in range(TURNS)])
        walk = DollhouseRecording(scene, camera, poses, None, ["turned around in each room"])
        own_format.save(walk, root / f"home-{number}")
        scenes.append(scene)
    return scenes


def truth(given: argparse.Namespace) -> int:
    """Map the homes, ask, and count who is right in each home."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        scenes = record(Path(folder) / "walks", given.homes)
        print(f"{len(scenes)} homes recorded: {time.perf_counter() - begin:.0f} s")
        begin, store = time.perf_counter(), f"{folder}/store"
        outcomes = runners.run(find_tasks(Path(folder) / "walks"), store, SETTINGS, workers=given.workers)
        states = dict(Counter(outcome.state for outcome in outcomes.values()))
        print(f"mapped: {states}, {time.perf_counter() - begin:.0f} s")
        compact(open_store(store))
        fleet = cartier_fleet.Fleet(store)
        true = {f"home-{FIRST + k}": (scene, true_objects(scene)) for k, scene in enumerate(scenes)}
        print(f"{'question':46} {'has':>4} {'right':>5}   {'none':>4} {'right':>5}   {'cannot tell':>11}")
        wrong = 0
        for words, count, holds in QUESTIONS:
            answer = fleet.ask(words)
            really = {home: holds(count(*about)) for home, about in true.items()}
            has, none = sum(really[home] for home in answer.has), sum(not really[home] for home in answer.has_none)
            wrong += len(answer.has) - has + len(answer.has_none) - none
            print(f"{words:46} {len(answer.has):4} {has:5}   {len(answer.has_none):4} {none:5}   "
                  f"{len(answer.cannot_tell):11}")  # fmt: skip
        print(f"{wrong} of {len(QUESTIONS) * len(scenes)} values are wrong")
        _print_costs(fleet)
    return 0


def _print_costs(fleet: cartier_fleet.Fleet) -> None:
    sql = "select count(*), sum(frames), sum(core_s) / count(*), sum(frames) / sum(core_s) from homes"
    homes, frames, core_s, speed = fleet.query(sql)[1][0]
    print(f"{homes} homes of {frames} frames: {core_s:.2f} core-seconds a home, {speed:.0f} frames a core-second")


def node(given: argparse.Namespace) -> int:
    """Map the homes on a Ray cluster of three nodes on this machine, one of which is killed and replaced."""
    import ray
    from ray.cluster_utils import Cluster

    small: dict[str, Any] = {"num_cpus": 1, "object_store_memory": 80_000_000}
    with tempfile.TemporaryDirectory() as folder:
        record(Path(folder) / "walks", given.homes)
        tasks, store = find_tasks(Path(folder) / "walks"), f"{folder}/store"
        head = {"num_cpus": 0, "include_dashboard": False, "object_store_memory": 80_000_000}
        cluster = Cluster(initialize_head=True, head_node_args=head)
        nodes = [cluster.add_node(**small) for _ in range(2)]
        ray.init(address=cluster.address, log_to_driver=False)
        begin = time.perf_counter()

        def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
            took = time.perf_counter() - begin
            print(f"{took:6.1f} s  {done:2} of {total}  {task.name}: {outcome.state} {outcome.line}", flush=True)
            if done == total // 2 and nodes:
                cluster.remove_node(nodes.pop(), allow_graceful=False)
                nodes.clear()
                cluster.add_node(**small)
                print(f"{time.perf_counter() - begin:6.1f} s  a node was killed, and another one came", flush=True)

        outcomes = runners.run(tasks, store, SETTINGS, runner="ray", workers=2, told=told)
        print(dict(Counter(outcome.state for outcome in outcomes.values())))
        print({key: value for key, value in status(open_store(store)).items() if key not in ("store", "set_aside")})
        alone = f"{folder}/alone"
        runners.run(tasks, alone, SETTINGS)
        same = sum(_bytes_of(store, task) == _bytes_of(alone, task) for task in tasks)
        print(f"{same} of {len(tasks)} homes are, bit for bit, those of one process")
        ray.shutdown()
        cluster.shutdown()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    return same != len(tasks)


def _bytes_of(place: str, task: Task) -> dict[str, bytes]:
    from cartier_fleet.publishing import key_of

    store = open_store(place)
    prefix = f"homes/{key_of(store, task.name)}/"
    held = {key.removeprefix(prefix): store.get(key) for key in store.list(prefix)}
    return {key: blob.data for key, blob in held.items() if blob is not None}


def main() -> int:
    parser = Parser(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, count in (("truth", 200), ("node", 20)):
        command = commands.add_parser(name)
        command.add_argument("--homes", type=int, default=count, help="homes of the dollhouse")
        command.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args()
    return {"truth": truth, "node": node}[given.command](given)


if __name__ == "__main__":
    run_script(main)
