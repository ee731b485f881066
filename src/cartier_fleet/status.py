"""State of a fleet: how many jobs are done, running and set aside, and why; and what a home costs."""

from __future__ import annotations

from collections import Counter
from typing import Any

from cartier.blob_stores import BlobStore
from cartier.io.files import parse_json
from cartier_fleet.catalog import read_catalog

MAX_READ = 1000  # records of failed or running jobs, which are read one by one
LATEST = 100  # homes over which the speed of now is measured
LEAST_S = 1e-3


def status(store: BlobStore) -> dict[str, Any]:
    """Counts of a fleet as plain JSON values.

    Returns:
        ``done``, ``running``, ``waiting`` (to be tried again), ``failed`` with ``reasons`` and the ``set_aside``.
    """
    states = dict[str, set[str]]()
    for key in store.list("jobs/"):
        _, job, state = key.split("/")
        states.setdefault(job, set()).add(state.removesuffix(".json"))
    failed = sorted(job for job, known in states.items() if "failed" in known and "done" not in known)
    open_jobs = sorted(job for job, known in states.items() if not known & {"done", "failed"})
    aside = [_record(store, f"jobs/{job}/failed.json") for job in failed[:MAX_READ]]
    claims = [_record(store, f"jobs/{job}/claim.json") for job in open_jobs[:MAX_READ]]
    waiting = sum(bool(claim.get("waiting")) for claim in claims)
    return {
        "store": store.place,
        "done": sum("done" in known for known in states.values()),
        "running": len(open_jobs) - waiting,
        "waiting": waiting,
        "failed": len(failed),
        "reasons": dict(Counter(str(about.get("why")) for about in aside).most_common()),
        "set_aside": [
            {"name": about.get("name"), "why": about.get("why"), "path": about.get("path")} for about in aside
        ],
    }


def speed(store: BlobStore) -> dict[str, float]:
    """What the homes of the catalog cost, and how fast the latest of them were mapped, by all workers together.

    Returns:
        ``homes``, ``frames``, ``core_s_per_home``, ``frames_per_core_s`` and ``frames_per_s``; empty without homes.
    """
    rows = read_catalog(store, ("homes",))["homes"].select(["frames", "core_s", "wall_s", "mapped_at"]).to_pylist()
    if not rows:
        return {}
    frames, core_s = sum(row["frames"] for row in rows), sum(row["core_s"] for row in rows)
    latest = sorted(rows, key=lambda row: -row["mapped_at"])[:LATEST]
    span_s = latest[0]["mapped_at"] - min(row["mapped_at"] - row["wall_s"] for row in latest)
    return {
        "homes": len(rows), "frames": frames, "core_s_per_home": round(core_s / len(rows), 3),
        "frames_per_core_s": round(frames / max(core_s, LEAST_S), 1),
        "frames_per_s": round(sum(row["frames"] for row in latest) / max(span_s, LEAST_S), 1),
    }  # fmt: skip


def _record(store: BlobStore, key: str) -> dict[str, Any]:
    held = store.get(key)
    value = {} if held is None else parse_json(held.data, key)
    return value if isinstance(value, dict) else {}
