"""Made-up results of a run, for the tests of its summary and report: numbers of no meaning, in the rows' true form."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

METHODS = {  # how often it names the right thing, and how far off its places are (m)
    "object_depth": (0.9, 0.2),
    "object_depth_paper": (0.9, 0.2),
    "object_viewpoint": (0.9, 1.1),
    "vlmaps": (0.9, 0.6),
    "nlmap": (0.6, 0.6),
    "vlmaps_query": (0.25, 1.0),
    "random": (0.04, 0.2),
    "nearest_name": (0.5, 0.2),
    "llm_without_list": (0.5, 0.2),
    "true_object": (1.0, 0.2),
}
TYPES = ("explicit", "implicit", "conversational")
NAMES = ("sofa", "kettle", "floor lamp", "bed", "book", "toaster")
SETTINGS = {
    "queries": "paper", "homes": ["studio", "flat"], "methods": list(METHODS), "seed": 7, "nlmap_threshold": 0.231,
    "date": "2026-11-21", "commit": "0123abc", "maps": {"world": "dollhouse", "detector": "ground truth"},
    "versions": {"cartier": "0.1.0", "numpy": "2.3"},
}  # fmt: skip


def row(home: str, query: str, method: str, **changes: Any) -> dict[str, Any]:
    """A right answer at 0.1 m, with the changes."""
    right = {
        "home": home, "query_id": query, "type": "implicit", "method": method, "status": "found", "object": "sofa",
        "match": True, "distance_m": 0.1, "distance_floor_m": 0.05, "goal_reachable": True, "seconds": 0.01,
        "llm_calls": 1, "tokens": 200, "detector": "ground truth (dollhouse)", "encoder": "ground truth (dollhouse)",
        "reasoner": "embedded", "text": "My feet hurt.", "target": "sofa", "accept": ["sofa", "bed"],
        "position": [1.0, 2.0, 0.4], "frame": 3, "note": "people sit on it",
    }  # fmt: skip
    assert set(changes) <= set(right)
    return right | changes


def fake_rows(
    homes: int = 3, targets: int = 8, seed: int = 0, methods: tuple[str, ...] = tuple(METHODS)
) -> list[dict[str, Any]]:
    rng = np.random.default_rng(seed)
    rows = []
    for target in range(targets):
        for hard, kind in enumerate(TYPES):
            for home in rng.permutation(homes)[: rng.integers(1, homes + 1)]:
                for method in methods:
                    rate, off = METHODS[method]
                    right = bool(rng.random() < rate * (1 - 0.08 * hard))
                    placed = right or rng.random() < 0.8
                    distance = float(rng.gamma(2, off / 2) + (0 if right else rng.uniform(0.5, 4)))
                    name = NAMES[target % len(NAMES)]
                    other = NAMES[(target + 1 + rng.integers(len(NAMES) - 1)) % len(NAMES)]
                    yardstick = method in ("random", "nearest_name", "true_object")
                    rows.append(
                        row(
                            f"home {home}",
                            f"{target}-{kind}",
                            method,
                            type=kind,
                            target=name,
                            accept=[name],
                            text=f"Words of request {target}, {kind}: " + "and so on and so forth " * (3 * hard + 1),
                            status="found" if placed else "not_found",
                            object=(name if right else other) if placed else None,
                            match=right,
                            distance_m=round(distance, 4) if placed else None,
                            distance_floor_m=round(0.8 * distance, 4) if placed else None,
                            goal_reachable=bool(rng.random() < 0.97) if placed else None,
                            position=[1.0, round(distance, 3), 0.5] if placed else None,
                            frame=int(rng.integers(40)) if placed else None,
                            llm_calls=0 if yardstick else 1,
                            tokens=0 if yardstick else int(rng.integers(200, 400)),
                            seconds=round(float(rng.gamma(2, 0.01)), 4),
                            reasoner=method if yardstick else "embedded (cards and MiniLM)",
                        )
                    )
    return rows


def write_run(folder: Path, rows: list[dict[str, Any]], settings: dict[str, Any] | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "settings.json").write_text(json.dumps(SETTINGS if settings is None else settings))
    (folder / "results.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    return folder
