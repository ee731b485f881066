"""Backend specifications of the command line: ``FILE.onnx``, ``transformers:MODEL``, ``ground_truth:misses=0.3``."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from cartier import plugins
from cartier.contracts import Detector, Reasoner, Recording, Robot
from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.llm.client import server_asked, without_credentials
from cartier.mapping.domain import DOLLHOUSE, is_from_world
from cartier.reasoners.auto import configured
from cartier.types import CandidateView, Frame, Goal, RobotModel, VisualQuestion
from cartier.vision.permission import Look

DETECTOR = "embedded"
"""The default detector for recordings of the dollhouse, the demo and the benchmark."""
PHOTOS = "photos"
"""The default detector for all other recordings."""


def detector_for(recording: Recording) -> tuple[str, str]:
    """The default detector for a recording, and why; it is never ground truth."""
    if is_from_world(recording, DOLLHOUSE):
        return DETECTOR, "since this is a recording of the dollhouse, whose objects it knows"
    return PHOTOS, "which knows household objects in photographs"


def own_detector(own: Any, chosen: str | None, threshold: float | None) -> Detector | None:
    """The detector of a recording or stream that brings its detections, with another threshold if one is given.

    Raises InputError if another detector was chosen as well, BackendError for an impossible threshold.
    """
    if own is None:
        return None
    if chosen is not None:
        raise InputError(f"--detections takes the place of a detector: leave out --detector {brief(chosen, 60)}")
    counting: Detector = replace(own, score_model=own.score_model.with_threshold(threshold))
    return counting


def detector(spec: str, recording: Recording, **options: Any) -> Detector:
    """A detector for a recording; options that are None are left to the detector.

    ``spec`` is FILE.onnx, detections in FILE.json or FILE.jsonl, NAME, NAME:MODEL, ./mine.py, or ``ground_truth``,
    with the errors that it shall make: ``ground_truth:misses=0.3,jitter=0.05,seed=1``. Raises InputError or
    BackendError.
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


def look(
    when: str,
    spec: str = "openai",
    consent: Callable[[VisualQuestion, Sequence[CandidateView]], bool] | None = None,
    blur: bool = False,
    **options: Any,
) -> Look | None:
    """Who may look at photographs, by ``--look`` and ``--vision`` (NAME or NAME:MODEL); None for "never".

    Options that are None, or that the vision model has not, are left out. Raises InputError for another word.
    """
    if when not in ("never", "ask", "auto"):
        raise InputError(f"--look is never, ask or auto, got {brief(when, 40)!r}")
    if when == "never":
        return None
    name = spec.partition(":")[0]
    given = {key: value for key, value in options.items() if value is not None and plugins.takes("vision", name, key)}
    vision_model = plugins.make_from_spec("vision", spec, **given)
    chosen: Literal["ask", "auto"] = "ask" if when == "ask" else "auto"
    return Look(vision_model, chosen, blur=blur) if consent is None else Look(vision_model, chosen, consent, blur)


def model_asked(spec: str, model: str | None = None, base_url: str | None = None) -> tuple[str, str] | None:
    """Which language model a reasoner would ask: (server's URL, model), with an empty URL in this process; or None.

    Nothing is loaded or sent. Raises InputError for a reasoner that is not one of cartier's own.
    """
    name, _, given = spec.partition(":")
    model = model or given or None
    if name not in ("auto", "openai", "local", "embedded", "replay"):
        raise InputError(f"it is unknown what the reasoner {brief(name, 60)} sends: it is not one of cartier's own")
    if name == "auto":
        name = configured(model, base_url) or "embedded"
    if name == "openai":
        server, asked = server_asked(model, base_url)
        return without_credentials(server), asked
    return ("", model or os.environ.get("CARTIER_MODEL") or "a GGUF file") if name == "local" else None


def robot(spec: str, home: Home, model: RobotModel) -> Robot:
    """A robot by NAME or NAME:PATH; one that drives in a simulated home gets its name (or PATH) and radius."""
    name, _, where = spec.partition(":")
    told = {"home": where or home.name, "radius_m": model.radius_m}
    return plugins.make("robots", name, **(told if plugins.takes("robots", name, "home") else {}))


def camera_at_goals(spec: str, home: Home, model: RobotModel) -> Callable[[Goal], Frame] | None:
    """What the camera of a robot shows at a goal that it drove to, by the robot's NAME or NAME:PATH.

    None for a robot whose camera cartier does not reach; so far only the simulated one's is.
    """
    name, _, where = spec.partition(":")
    if name != "dollhouse":
        return None
    world: Any = plugins.make("worlds", name)
    driven = where or home.name
    while driven.startswith(f"{name} "):
        driven = driven.removeprefix(f"{name} ")
    scene = world.scene(driven)
    return lambda goal: world.frame_at(scene, goal, eye_m=model.camera_height_m)


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
