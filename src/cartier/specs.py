"""What people write on a command line, turned into backends: ``FILE.onnx``, ``transformers:MODEL``, ``ground_truth:misses=0.3``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cartier import plugins
from cartier.contracts import Detector, Reasoner, Recording, Robot
from cartier.errors import InputError
from cartier.home import Home
from cartier.mapper import is_of
from cartier.types import RobotModel

DETECTOR = "embedded"
"""The detector of the demo and the bench by default: the one that ships inside. ``ground_truth`` shows what a perfect one would do."""

PHOTOS = "photos"
"""The detector of anything else by default."""


def detector_for(recording: Recording) -> tuple[str, str]:
    """The detector for a recording whose owner names none, and why that one. It is never ground truth."""
    if is_of(recording, "dollhouse"):
        return DETECTOR, "since this is a recording of the dollhouse, whose things it knows"
    return PHOTOS, "which knows household things in photographs"


def detector(spec: str, recording: Recording, **options: Any) -> Detector:
    """A detector for a recording; options that are None are left to the detector.

    ``spec`` is FILE.onnx, detections in FILE.json or FILE.jsonl, NAME, NAME:MODEL, ./mine.py, or ``ground_truth``, which may
    be told what to get wrong: ``ground_truth:misses=0.3,jitter=0.05,seed=1``. Raises InputError or BackendError.
    """
    given = {name: value for name, value in options.items() if value is not None}
    name, _, rest = spec.partition(":")
    if name == "ground_truth":
        given |= _numbers(rest, spec) | {"truth": recording.truth, "source": recording.name}
        return plugins.make("detectors", name, **given)
    suffix = Path(spec).suffix.lower()
    if suffix == ".onnx":
        return plugins.make("detectors", "onnx", model=spec, **given)
    if suffix in (".json", ".jsonl"):
        return plugins.make("detectors", "file", path=spec, **given)
    return plugins.make_from_spec("detectors", spec, **given)


def reasoner(spec: str, **options: Any) -> Reasoner:
    """A reasoner by NAME or NAME:MODEL; options that are None are left to it."""
    given = {name: value for name, value in options.items() if value is not None}
    return plugins.make_from_spec("reasoners", spec, **given)


def robot(spec: str, home: Home, model: RobotModel) -> Robot:
    """A robot by NAME; one that drives in a simulated home is told which and how wide it is, or NAME:PATH says it."""
    name, _, where = spec.partition(":")
    told = {"home": where or home.name, "radius_m": model.radius_m}
    return plugins.make("robots", name, **(told if plugins.takes("robots", name, "home") else {}))


def _numbers(text: str, spec: str) -> dict[str, Any]:
    try:
        pairs = [pair.split("=") for pair in text.split(",")] if text else []
        return {
            name.strip(): int(value) if name.strip() in ("seed", "min_pixels") else float(value)
            for name, value in pairs
        }
    except ValueError:
        raise InputError(
            f"{spec!r}: after the colon come options as in ground_truth:misses=0.3,jitter=0.05,seed=1"
        ) from None
