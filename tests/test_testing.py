"""Conformance checks: each names the broken rule, and our backends without a test of laws pass them."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier import plugins, testing
from cartier.contracts import Detector
from cartier.errors import InputError
from cartier.types import Detections, DetectorScoreModel, Frame, Goal, Inventory, Place, Selection
from synthetic import THINGS, RoomRecording, TrueBoxes, walk

EXAMPLE = Path(__file__).parents[1] / "examples" / "red_things.py"
FRAMES = [walk()[number] for number in range(0, 20, 4)]


def of_ours(name: str) -> Callable[[], Detector]:
    recording = testing._sample()
    options: dict[str, Any] = {
        "ground_truth": {"truth": recording.truth},
        "disturbed": {"truth": recording.truth, "misses": 0.3, "jitter": 0.1, "confusion": 0.2},
    }.get(name, {})
    return lambda: plugins.make("detectors", {"disturbed": "ground_truth"}.get(name, name), **options)


@pytest.mark.parametrize("name", ["embedded", "ground_truth", "disturbed", str(EXAMPLE)])
def test_detectors_obey(name: str) -> None:
    testing.check_detector(of_ours(name))


def test_the_example_of_a_reader_obeys_and_reads_what_was_written(tmp_path: Path) -> None:
    reader, recording = EXAMPLE.with_name("arrays.py"), walk()
    plugins._load("recordings", str(reader)).write(recording, tmp_path / "arrays")
    testing.check_recording(lambda: plugins.open_recording(tmp_path / "arrays", str(reader)))
    read = plugins.open_recording(tmp_path / "arrays", str(reader))
    for number in (0, len(recording) - 1):
        frame, written = read[number], recording[number]
        np.testing.assert_array_equal(frame.rgb, written.rgb)
        np.testing.assert_array_equal(frame.depth_m, written.depth_m)
        np.testing.assert_array_equal(frame.world_from_camera, written.world_from_camera)
    (tmp_path / "arrays" / "rgb.npy").write_bytes(b"")
    with pytest.raises(InputError, match="holds an array that cannot be read"):
        plugins.open_recording(tmp_path / "arrays", str(reader))


@pytest.mark.parametrize("options", [{"name": "print"}, {"name": "dollhouse", "home": "studio"}])
def test_robots_obey(options: dict[str, str]) -> None:
    testing.check_robot(lambda: plugins.make("robots", **options))  # type: ignore[call-overload]


def test_indexes_obey_on_the_built_in_walk() -> None:
    testing.check_index(lambda: plugins.make("indexes", "object_depth"))


def test_no_test_library_is_imported() -> None:
    code = "import sys, cartier, cartier.testing; assert not {'pytest', 'hypothesis'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": ":".join(sys.path)})


class Detects(TrueBoxes):
    """A detector in whose findings one thing is changed."""

    def __init__(self, change: Callable[[Detections], object]) -> None:
        super().__init__(THINGS)
        self.change = change

    def detect(self, frame: Frame) -> Any:
        return self.change(super().detect(frame))


def stateful() -> Callable[[Detections], Detections]:
    seen: list[int] = []

    def change(found: Detections) -> Detections:
        seen.append(found.frame)
        return found if len(seen) < 3 else found.keep(np.arange(len(found)) > 0)

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda: lambda d: None, "must return Detections"),
        (lambda: lambda d: replace(d, frame=7), "are of frame 7"),
        (lambda: lambda d: replace(d, boxes_xyxy=d.boxes_xyxy + 500), "out of the image"),
        (lambda: lambda d: replace(d, scores=d.scores * 80), "from 0 to 1"),
        (lambda: lambda d: replace(d, labels=tuple(f"{name}_A" for name in d.labels)), "no display name"),
        (lambda: lambda d: replace(d, masks=np.zeros((len(d), 3, 3), bool)), "mask is of another size"),
        (stateful, "asked in another order"),
    ],
)
def test_a_detector_that_breaks_a_law_is_told_which(change: Callable[[], Any], told: str) -> None:
    testing.check_detector(lambda: Detects(lambda found: found), FRAMES)
    with pytest.raises(AssertionError, match=told):
        testing.check_detector(lambda: Detects(change()), FRAMES)


@pytest.mark.parametrize(
    ("attribute", "value"),
    [("name", ""), ("name", "a\nb"), ("notes", "one"), ("sha256", "x"),
     ("score_model", DetectorScoreModel(zero_weight_score=0.6)), ("score_model", 0.5),
     ("batch", 0), ("detect_batch", lambda frames: [TrueBoxes(THINGS).detect(f) for f in reversed(frames)]),
     ("detect_batch", lambda frames: [TrueBoxes(THINGS).detect(f).keep(np.zeros(0, int)) for f in frames])],
)  # fmt: skip
def test_what_a_detector_says_of_itself_is_checked(attribute: str, value: object) -> None:
    detector = TrueBoxes(THINGS)
    setattr(detector, attribute, value)
    with pytest.raises(AssertionError, match=attribute):
        testing.check_detector(lambda: detector, FRAMES)


class Encodes:
    """An encoder with one fault."""

    name, text_only = "test", False

    def __init__(self, fault: str) -> None:
        self.fault = fault
        self.text_only = fault == "takes images"

    def image(self, frame: Frame) -> Any:
        return np.ones(
            (3, 4, 7 if self.fault == "dimensions" else 8), np.float64 if self.fault == "float32" else np.float32
        )

    def text(self, texts: Sequence[str]) -> Any:
        rows = [np.cos(np.arange(8, dtype=np.float32) * len(text)) for text in texts]
        if self.fault == "different texts":
            rows = [np.ones(8, np.float32)] * len(texts)
        if self.fault == "NaN":
            rows[0] = rows[0] * np.float32("nan")
        if self.fault == "beside it":
            rows = [row - np.mean(rows, axis=0) for row in rows]
        return np.array(rows)


@pytest.mark.parametrize("fault", ["dimensions", "float32", "different texts", "NaN", "beside it", "takes images"])
def test_an_encoder_that_breaks_a_law_is_told_which(fault: str) -> None:
    testing.check_encoder(lambda: Encodes(""))
    told = {"takes images": "must refuse an image"}.get(fault, fault)
    with pytest.raises(AssertionError, match=told):
        testing.check_encoder(lambda: Encodes(fault))


class Index:
    """A spatial index with one fault, over one that has none."""

    def __init__(self, fault: str) -> None:
        self.fault, self.inner, self.state_given = fault, plugins.make("indexes", "object_depth"), {"a.json": b"{}"}

    def set_objects(self, objects: Any) -> None:
        self.inner.set_objects(objects)

    def names(self) -> list[str]:
        names = self.inner.names()
        return {"sorted": names[::-1], "confirmed objects": [*names, "zebra"]}.get(self.fault, names)

    def locate(self, name: str) -> Place | None:
        place = self.inner.locate(name)
        if self.fault == "unicorn":
            return place or replace(self.inner.locate("mug"), label=name)
        if self.fault == "locate" and name == "mug":
            return None
        return replace(place, label="thing") if place and self.fault == "the place of" else place

    def state(self) -> Any:
        return {"a.json": "{}"} if self.fault == "bytes" else self.state_given

    def restore(self, state: Any) -> None:
        if state["a.json"] != b"{}" and self.fault != "damaged":
            raise InputError("damaged")

    def __deepcopy__(self, memo: object) -> Index:
        if self.fault == "deepcopy":
            return self
        copied = Index(self.fault)
        copied.inner = type(self.inner)()
        copied.inner.__dict__ = {key: dict(value) for key, value in self.inner.__dict__.items()}
        return copied


@pytest.mark.parametrize(
    "fault", ["sorted", "confirmed objects", "unicorn", "locate", "the place of", "bytes", "damaged", "deepcopy"]
)
def test_an_index_that_breaks_a_law_is_told_which(fault: str) -> None:
    everything = [walk()[number] for number in range(20)]
    testing.check_index(lambda: Index(""), everything, TrueBoxes(THINGS))
    with pytest.raises(AssertionError, match=fault):
        testing.check_index(lambda: Index(fault), everything, TrueBoxes(THINGS))


class Reasons:
    """A reasoner with one fault."""

    name = "test"

    def __init__(self, fault: str) -> None:
        self.fault = fault

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        if not inventory.names or (not query.strip("\0\x1b \n\t") and self.fault != "no request"):
            return (
                Selection("found", "bed")
                if self.fault == "where nothing is"
                else Selection("not_found", reason="nothing")
            )
        if self.fault == "without a question":
            return Selection("clarify", reason="unclear")
        chosen = "helicopter" if self.fault == "not in the list" else inventory.names[0]
        candidates = (("helicopter", 1.0),) if self.fault == "candidates" else ()
        return Selection("found", chosen, "" if self.fault == "no reason" else "it serves", candidates=candidates)

    def propose(self, query: str) -> list[str]:
        return {"different names": ["a", "a"], "plain names": [" a\n"]}.get(self.fault, ["bed"])


@pytest.mark.parametrize(
    "fault",
    ["not in the list", "candidates", "no reason", "without a question", "where nothing is", "no request",
     "different names", "plain names"],
)  # fmt: skip
def test_a_reasoner_that_breaks_a_law_is_told_which(fault: str) -> None:
    testing.check_reasoner(lambda: Reasons(""))
    with pytest.raises(AssertionError, match=fault):
        testing.check_reasoner(lambda: Reasons(fault))


class Recorded(RoomRecording):
    """A recording with one fault."""

    fault, readers = "", 2

    def __getitem__(self, index: int) -> Frame:
        if self.fault == "IndexError":
            index = index % len(self.poses) if abs(index) < 1000 else 0
        frame = super().__getitem__(index)
        assert frame.depth_m is not None
        if self.fault == "says that it is":
            return replace(frame, index=0)
        if self.fault == "float32":
            return replace(frame, depth_m=frame.depth_m.astype(np.float64))
        if self.fault == "another order":
            self.calls = getattr(self, "calls", 0) + 1
            return replace(frame, time_s=float(self.calls))
        if self.fault == "2 threads" and threading.current_thread() is not threading.main_thread():
            return replace(frame, rgb=frame.rgb[::-1])
        return frame

    def fingerprint(self) -> str:
        return (
            "abc"
            if self.fault == "sha256"
            else str(id(self)).rjust(64, "0")
            if self.fault == "opened again"
            else super().fingerprint()
        )


@pytest.mark.parametrize(
    "fault",
    ["IndexError", "says that it is", "float32", "another order", "sha256", "opened again", "2 threads"],
)
def test_a_recording_that_breaks_a_law_is_told_which(fault: str) -> None:
    testing.check_recording(lambda: Recorded(walk().poses, THINGS))
    broken = [Recorded(walk().poses, THINGS) for _ in range(2)]
    for recording in broken:
        recording.fault = fault
    with pytest.raises(AssertionError, match=fault):
        testing.check_recording(iter(broken).__next__)


class Sends:
    def __init__(self, told: str) -> None:
        self.name, self.told = "test", told

    def go_to(self, goal: Goal) -> str:
        return self.told


def test_a_robot_says_one_line() -> None:
    testing.check_robot(lambda: Sends("off it goes"))
    for told in ("", "two\nlines"):
        with pytest.raises(AssertionError, match="one line"):
            testing.check_robot(lambda told=told: Sends(told))  # type: ignore[misc]


class Simulates:
    """A world of one room with one fault."""

    name = "test"

    def __init__(self, fault: str) -> None:
        self.fault = fault

    def homes(self) -> list[str]:
        return ["room", "room"] if self.fault == "each once" else ["room"]

    def explore(self, home: str, **options: Any) -> RoomRecording:
        return RoomRecording(walk().poses, self.objects(home, self.fault == "truth"))

    def objects(self, home: str, fewer: bool = False) -> Any:
        if home != "room" and self.fault != "unknown home":
            raise InputError(f"there is no {home}")
        return THINGS[:1] if fewer else THINGS

    def free(self, home: str, xy: Sequence[float]) -> bool:
        return self.fault != "no robot" and (max(map(abs, xy)) < 10 or self.fault == "far outside")


@pytest.mark.parametrize("fault", ["each once", "truth", "unknown home", "no robot", "far outside"])
def test_a_world_that_breaks_a_law_is_told_which(fault: str) -> None:
    testing.check_world(lambda: Simulates(""))
    with pytest.raises(AssertionError, match=fault):
        testing.check_world(lambda: Simulates(fault))
