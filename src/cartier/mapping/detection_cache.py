"""What a detector has seen, kept in a file, so that a mapping that was killed does not detect twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cartier.contracts import Detector
from cartier.errors import InputError
from cartier.files import check_file
from cartier.types import Detections, Frame


@contextmanager
def remembering(detector: Detector, file: Path, settings: dict[str, Any]) -> Iterator[Callable[[Frame], Detections]]:
    """``detector.detect`` that keeps its boxes in a JSON-lines file and takes finished frames from there."""
    key = json.dumps({name: settings[name] for name in ("sha256", "detector", "detector_sha256")})
    known: dict[int, Detections] = {}
    if file.exists():
        check_file(file)
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines() if file.is_file() else []
    if lines and lines[0] == key:
        for line in lines[1:]:
            try:
                found = _of_row(json.loads(line))
                known[found.frame] = found
            except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError, InputError):
                break  # the line that a kill cut short
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8") as out:

        def write(found: Detections) -> None:
            out.write(json.dumps(_row(found)) + "\n")

        def detect(frame: Frame) -> Detections:
            if frame.index in known:
                return known[frame.index]
            found = detector.detect(frame)
            if found.masks is None:  # masks come from simulators, where asking again costs nothing
                write(found)
                out.flush()
            return found

        out.write(key + "\n")
        for found in known.values():
            write(found)
        out.flush()
        yield detect


def _row(found: Detections) -> dict[str, Any]:
    row = {"frame": found.frame, "boxes_xyxy": found.boxes_xyxy.tolist(), "scores": found.scores.tolist()}
    return row | {"labels": found.labels, "glimpsed": None if found.glimpsed is None else _row(found.glimpsed)}


def _of_row(row: Any) -> Detections:
    glimpsed = None if row.get("glimpsed") is None else _of_row(row["glimpsed"])
    return Detections(row["frame"], row["boxes_xyxy"], row["scores"], tuple(row["labels"]), glimpsed=glimpsed)
