"""Detection cache: the detections of finished frames in a file, so that a run that was killed need not repeat them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cartier.contracts import Detector, optional
from cartier.errors import InputError
from cartier.io.atomic import append_lines
from cartier.io.files import read_bytes
from cartier.types import Detections, Frame

MOST_BYTES = 1 << 30
Detect = Callable[[Sequence[Frame]], list[Detections]]


def detecting(detector: Detector) -> Detect:
    """The detector's ``detect_batch``, or that of the contract for one that has none."""
    detect: Detect = optional(detector, Detector, "detect_batch")
    return detect


def remembering(detect: Detect) -> Detect:
    """The same, but frames that it has seen are not detected again; those with masks are, since masks are large."""
    known: dict[int, Detections] = {}

    def again(frames: Sequence[Frame]) -> list[Detections]:
        new = [frame for frame in frames if frame.index not in known]
        found = {seen.frame: seen for seen in (detect(new) if new else [])}
        known.update({number: seen for number, seen in found.items() if seen.masks is None})
        return [found[frame.index] if frame.index in found else known[frame.index] for frame in frames]

    return again


@contextmanager
def cached(detector: Detector, file: Path | None, fingerprint: str) -> Iterator[Detect]:
    """``detector.detect_batch`` with a JSON-lines file, if one is named, from which it takes the frames that are done.

    ``fingerprint`` is the recording's; detections of another recording or another detector are not used.
    """
    if file is None:
        yield detecting(detector)
        return
    made_of = {
        "sha256": fingerprint,
        "detector": detector.name,
        "detector_sha256": optional(detector, Detector, "sha256"),
    }
    key = (json.dumps(made_of) + "\n").encode()
    known: dict[int, Detections] = {}
    lines = read_bytes(file, MOST_BYTES).splitlines(keepends=True) if file.exists() else []
    if not lines or lines[0] != key:
        _begin(file, key)
        lines = []
    good = len(key)
    for line in lines[1:]:
        try:
            found = _of_row(json.loads(line))
            known[found.frame] = found
            good += len(line)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError, InputError):
            break  # the line that a kill cut short
    os.truncate(file, good)

    def detect(frames: Sequence[Frame]) -> list[Detections]:
        new = [frame for frame in frames if frame.index not in known]
        found = {seen.frame: seen for seen in (detecting(detector)(new) if new else [])}
        kept = [seen for seen in found.values() if seen.masks is None]  # masks come from simulators: asked again
        if file.stat().st_size < MOST_BYTES // 2:  # what is beyond is detected again
            append_lines(file, [json.dumps(_row(seen)) for seen in kept])
        return [found[i] if i in found else known[i] for i in (frame.index for frame in frames)]

    yield detect


def _begin(file: Path, key: bytes) -> None:
    """In place: a line that a kill cuts short is another recording's, and nothing is left beside."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(key)
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror}") from error


def _row(found: Detections) -> dict[str, Any]:
    boxes, scores = found.boxes_xyxy.tolist(), found.scores.tolist()
    return {"frame": found.frame, "boxes_xyxy": boxes, "scores": scores, "labels": found.labels}


def _of_row(row: Any) -> Detections:
    return Detections(row["frame"], row["boxes_xyxy"], row["scores"], tuple(row["labels"]))
