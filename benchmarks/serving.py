"""Load benchmark of ``cartier serve``: clients on loopback that check every answer; latencies and memory.

python benchmarks/serving.py HOME [--clients 200] [--seconds 60]
python benchmarks/serving.py HOME --objects 50 300 1000: processor time of a warm answer in a home of so many
"""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import json
import os
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
from command_line import Parser, run_script

from cartier import ask
from cartier.home import Home

QUESTIONS = (
    "I am tired, I want to go to sleep", "how many chairs are there?", "the cup on the dining table",
    "so much work tonight and I am getting really sleepy, we better do something about that", "where is the mug?",
    "the biggest cabinet in the kitchen", "the apple on the table next to the fridge", "which chairs are there?",
    "are there any plates under the table?",
)  # fmt: skip


async def client(
    number: int, base: str, home: str, labels: dict[str, int], until: float, took: dict[str, list[float]]
) -> list[str]:
    """One client's requests until the time is over; returns what was wrong."""
    wrong, names = [], sorted(labels)
    async with httpx.AsyncClient(base_url=base, timeout=60) as web:
        turn = number
        while time.perf_counter() < until:
            name, kind = names[turn % len(names)], ("goal", "find", "ask", "describe")[turn % 4]
            begin = time.perf_counter()
            if kind == "ask":
                got = await web.post(
                    f"/api/homes/{home}/ask", json={"words": f"go to the {name}", "conversation": f"{number}-{turn}"}
                )
            elif kind == "find":
                got = await web.get(f"/api/homes/{home}/find", params={"name": name})
            else:
                got = await web.get(f"/api/homes/{home}/{kind}", params={"entity": str(labels[name])})
            took.setdefault(kind, []).append(time.perf_counter() - begin)
            result = got.json()
            said = {"ask": result.get("object"), "find": result.get("objects", [{}])[0].get("label")}.get(
                kind, result.get("label")
            )
            if got.status_code != 200 or said != name:
                wrong.append(f"{kind} {name}: {got.status_code} {json.dumps(result)[:200]}")
            turn += 1
    return wrong


def resident_mb(process: int) -> float:
    """The memory of a process (Linux)."""
    line = next(row for row in Path(f"/proc/{process}/status").read_text().splitlines() if row.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


async def load(base: str, home: str, labels: dict[str, int], clients: int, seconds: float, process: int) -> None:
    took: dict[str, list[float]] = {}
    await client(0, base, home, labels, time.perf_counter() + 2, {})  # warm
    memory = [resident_mb(process)]
    until = time.perf_counter() + seconds

    async def watch() -> list[str]:
        while time.perf_counter() < until:
            await asyncio.sleep(seconds / 6)
            memory.append(resident_mb(process))
        return []

    runs = await asyncio.gather(watch(), *(client(k, base, home, labels, until, took) for k in range(clients)))
    wrong = [line for run in runs for line in run]
    every = np.concatenate([np.array(times) for times in took.values()])
    rate = f"{len(every)} answers, {len(every) / seconds:.0f} a second, {len(wrong)} wrong"
    print(f"{clients} clients, {seconds:g} s: {rate}")
    for kind, times in [*sorted(took.items()), ("all", every.tolist())]:
        middle, high = np.percentile(times, (50, 99)) * 1e3
        print(f"  {kind:9} {len(times):6}  median {middle:7.1f} ms  p99 {high:7.1f} ms  ({high / middle:.1f} x)")
    print("  memory    " + " ".join(f"{mb:.0f}" for mb in memory) + " MB")
    print("\n".join(wrong[:5]))


def grown(home: Home, number: int) -> Home:
    """The home with so many objects: its own, then copies of them elsewhere."""
    rng, objects = np.random.default_rng(0), list(home.objects[:number])
    for obj in itertools.islice(itertools.cycle(home.objects), number - len(objects)):
        by_m = (*rng.normal(0, 1, 2), 0.0)
        at, low, high = (tuple((p + by_m).tolist()) for p in np.array([obj.position, obj.box_min, obj.box_max]))
        new = max(t.id for t in objects) + 1
        objects.append(replace(obj, id=new, position=at, box_min=low, box_max=high, oriented=None, aliases=()))
    for index in home.indexes.values():
        index.set_objects(objects)
    return replace(home, objects=tuple(objects))


def growth(folder: Path, sizes: list[int]) -> None:
    """The processor time of warm answers by the number of objects; a digest shows whether two versions answer alike."""
    for number in sizes:
        home, took, answers = grown(Home.load(folder), number), [], []
        for words in QUESTIONS:
            answers.append(ask(home, words).to_dict() | {"timing_ms": None})
            times = []
            for _ in range(7):
                begin = time.process_time()
                ask(home, words)
                times.append((time.process_time() - begin) * 1e3)
            took.append(float(np.median(times)))
        digest = hashlib.sha256(json.dumps(answers, sort_keys=True).encode()).hexdigest()[:12]
        each = " ".join(f"{ms:.0f}" for ms in took)
        print(f"{number:5} objects: an answer takes {np.median(took):.1f} ms (each: {each}); answers {digest}")


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("--objects", type=int, nargs="+", help="only time answers, in homes of so many objects")
    parser.add_argument("home", type=Path, help="folder of a mapped home")
    parser.add_argument("--clients", type=int, default=200, help="at the same time (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=60.0, help="for how long (default: %(default)s)")
    asked = parser.parse_args()
    if asked.objects:
        return growth(asked.home, asked.objects)
    objects = [obj for obj in Home.load(asked.home).objects if obj.confirmed]
    single = {t.label: t.id for t in objects if sum(o.label == t.label for o in objects) == 1}
    single = {name: k for name, k in single.items() if not any(name in o.label and name != o.label for o in objects)}
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = listening.getsockname()[1]
    line = [sys.executable, "-m", "cartier", "serve", str(asked.home), "--port", str(port)]
    server = subprocess.Popen(line, env=os.environ | {"OMP_NUM_THREADS": "1"}, stderr=subprocess.DEVNULL)
    try:
        for _ in range(200):
            with socket.socket() as asking:
                if asking.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.1)
        asyncio.run(load(f"http://127.0.0.1:{port}", asked.home.name, single, asked.clients, asked.seconds, server.pid))
    finally:
        server.terminate()


if __name__ == "__main__":
    run_script(main)
