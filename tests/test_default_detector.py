"""Default detector of a recording, and the message about a wrong one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cartier import plugins, specs
from cartier.cli import app
from cartier.errors import CartierError
from cartier.home import Home
from cartier.mapping.domain import domain_warning, is_from_world
from cartier.pipeline import ask, map_home
from cartier.reasoners.embedded import make
from cartier.recordings.folder import save
from cartier.types import Camera, Frame
from cartier.understanding.cards import read_deck
from cartier.understanding.out_of_vocabulary import out_of_vocabulary_mention
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk


class Dollhouse(TrueBoxes):
    name = "a dollhouse detector (test)"
    world = "dollhouse"
    knows = ("chair", "mug", "table")


def named(name: str, truth: bool = True) -> Any:
    recording = walk()
    recording.name = name
    return recording if truth else Untrue(recording.poses, recording.objects, name=name)


class Pictures(list[Frame]):
    """Frames as a recording without truth."""

    name, truth, notes = "flat", None, ()

    @property
    def camera(self) -> Camera:
        return self[0].camera


class Untrue(RoomRecording):
    truth = None  # type: ignore[assignment]


def test_the_dollhouses_recordings_get_its_detector_and_all_others_the_photographs() -> None:
    assert specs.detector_for(named("dollhouse studio"))[0] == "embedded"
    for name, truth in (
        ("ai2thor FloorPlan1", True),
        ("kitchen", False),
        ("dollhouse studio", False),
        ("dollhouses", True),
    ):
        spec, why = specs.detector_for(named(name, truth))
        assert spec == "photos" and "photographs" in why
    assert is_from_world(
        plugins.make("worlds", "dollhouse", width=64, height=48).explore("studio", max_frames=2), "dollhouse"
    )


def test_map_says_which_detector_it_takes(tmp_path: Path) -> None:
    """An exported home of the dollhouse stays one; photographs of noise hold nothing, which is said with the detector's
    name."""
    explored = plugins.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=4)
    save(explored, tmp_path / "rec")
    run = CliRunner().invoke(app, ["map", str(tmp_path / "rec"), "-o", str(tmp_path / "home")])
    assert "detector: embedded, since this is a recording of the dollhouse" in run.stderr
    assert "of 4 frames to process, in about" in run.stderr and "WRONG DETECTOR" not in run.stderr
    head = tmp_path / "rec/recording.json"
    head.write_text(json.dumps(json.loads(head.read_text()) | {"name": "my flat", "simulator": False}))
    run = CliRunner().invoke(app, ["map", str(tmp_path / "rec"), "-o", str(tmp_path / "home")])
    assert "detector: photos, which knows household objects in photographs; --detector takes another" in run.stderr


def test_a_wrong_choice_is_told_by_map_and_show_and_ask(tmp_path: Path) -> None:
    flat = named("my flat", truth=False)
    detector = Dollhouse(THINGS)
    told = domain_warning(detector, flat)
    assert told is not None and told.startswith(
        "WRONG DETECTOR: a dollhouse detector (test) knows only rendered pictures"
    )
    assert domain_warning(detector, named("dollhouse 7")) is None and domain_warning(TrueBoxes(THINGS), flat) is None
    map_home(flat, detector).save(tmp_path / "home")
    home = Home.load(tmp_path / "home")
    assert home.notes[0] == told and told in ask(home, "I would love to sit down").notes
    shown = CliRunner().invoke(app, ["show", str(tmp_path / "home")])
    assert "note: WRONG DETECTOR" in shown.stdout
    grown = map_home(RoomRecording(flat.poses[::-1], flat.objects, name="dollhouse 7"), detector, onto=home)
    assert grown.notes.count(told) == 1, "what one recording was mapped with stays told"
    right = map_home(named("dollhouse 7"), detector)
    assert not any("WRONG" in note for note in (*right.notes, *ask(right, "I would love to sit down").notes))


def test_a_photograph_detector_is_told_of_the_dollhouses_own(tmp_path: Path) -> None:
    doll, flat = named("dollhouse studio"), named("my flat", truth=False)
    photos = plugins.make("detectors", "photos", threads=1)
    told = domain_warning(photos, doll)
    assert told is not None and "\n" not in told and told.startswith("WRONG DETECTOR: photos NanoDet-Plus-m")
    assert "the dollhouse has a detector of its own, which fits; map again without --detector" in told
    assert domain_warning(photos, flat) is None and domain_warning(photos, named("ai2thor FloorPlan1")) is None
    assert domain_warning(plugins.make("detectors", "embedded", threads=1), doll) is None
    assert domain_warning(specs.detector("ground_truth", doll), doll) is None, "it was made for any simulator"
    (tmp_path / "a.jsonl").write_text('{"frame": 0, "label": "cup", "score": 0.9, "xyxy": [0, 0, 5, 5]}\n')
    assert domain_warning(specs.detector(str(tmp_path / "a.jsonl"), doll), doll) is None, "nobody knows what made it"


@pytest.mark.parametrize(
    ("query", "names", "expected"),
    [
        ("Bring me to the coffee machine", ("cup", "chair"), "coffee machine"),
        ("Take me to the sofa", ("couch", "chair"), None),
        ("I can hardly keep my eyes open", ("cup", "chair"), None),
        ("Where is the toaster?", ("toaster",), None),
        ("I don't want the toaster", ("cup",), None),
        ("I want a coffee from the coffee machine", ("cup", "chair"), "coffee machine"),
        ("I want a coffee from the coffee machine", ("coffee machine",), None),
        ("I want a coffee", ("cup",), "coffee"),
        ("switch on the lamp", ("cup",), "lamp"),
        ("Please switch the lamp off", ("cup",), "lamp"),
        ("and then switch off the radio", ("cup",), "radio"),
        ("Where is the switch of the lamp?", ("lamp",), "switch"),
    ],
)
def test_what_a_detector_has_no_name_for(query: str, names: tuple[str, ...], expected: str | None) -> None:
    assert out_of_vocabulary_mention(query, names, read_deck()) == expected


def test_ask_says_that_the_detector_has_no_name_for_what_was_asked(tmp_path: Path) -> None:
    home = map_home(named("dollhouse 7"), Dollhouse(THINGS))
    line = (
        "a dollhouse detector (test), which mapped this home, knows only 3 names, and coffee machine is not among them"
    )
    assert line in ask(home, "Bring me to the coffee machine").notes
    assert line not in ask(home, "Bring me to the chair").notes
    (tmp_path / "mine.toml").write_text('[theremin]\nuses = ["eerie music"]\n')
    mine = make(cards=tmp_path / "mine.toml")
    assert any("and theremin is not" in note for note in ask(home, "Bring me to the theremin", mine).notes)
    assert line not in ask(home, "Bring me to the coffee machine", mine).notes
    unknown = map_home(named("dollhouse 7"), TrueBoxes(THINGS))
    assert not any("knows only" in note for note in ask(unknown, "Bring me to the coffee machine").notes)


def test_detectors_tell_their_names() -> None:
    photos, embedded = (plugins.make("detectors", name, threads=1) for name in ("photos", "embedded"))
    assert len(photos.knows) == 51 and "cup" in photos.knows
    assert len(embedded.knows) == 125 and embedded.world == "dollhouse"
    assert np.all([isinstance(name, str) for name in (*photos.knows, *embedded.knows)])


def test_rendered_pictures_are_told_by_themselves() -> None:
    """A camera's noise gives every part of a picture colours of its own; a shader paints flat."""
    photos = plugins.make("detectors", "photos", threads=1)
    rng = np.random.default_rng(0)
    camera = Camera(640, 480, 500, 500, 320, 240)
    ramp = np.linspace(20, 230, 640, dtype=np.float32)[None, :, None] * np.array([1.0, 0.8, 0.6], np.float32)
    shaded = np.broadcast_to(ramp, (480, 640, 3)).astype(np.uint8)
    noisy = np.clip(shaded + rng.normal(0, 6, shaded.shape), 0, 255).astype(np.uint8)

    def recording(rgb: np.ndarray, sized: Camera = camera) -> Any:
        return Pictures([Frame(i, i / 30, rgb, None, np.eye(4), sized) for i in range(3)])

    embedded = plugins.make("detectors", "embedded", threads=1)
    assert domain_warning(embedded, recording(shaded)) is None, "they may be of its world: topics do not say it"
    assert domain_warning(embedded, recording(noisy)) is not None
    told = domain_warning(photos, recording(shaded))
    assert told is not None and "\n" not in told and "look rendered" in told
    assert domain_warning(photos, recording(noisy)) is None
    small = Camera(160, 120, 125, 125, 80, 60)
    assert domain_warning(photos, recording(shaded[::4, ::4], small)) is None, "too few pixels to say"
    assert domain_warning(TrueBoxes(THINGS), recording(shaded)) is None, "nobody knows what it was made for"


@pytest.mark.parametrize("wrong", [[], ["--index", "nonsense"]])
def test_map_refuses_before_the_work(wrong: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a folder that is not ours nor an index that is missing waits for the recording to be read."""
    monkeypatch.setattr(plugins, "open_recording", lambda *_, **__: pytest.fail("the recording was opened"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/letters.txt").touch()
    output = tmp_path / ("home" if wrong else "mine")
    run = CliRunner().invoke(app, ["map", str(tmp_path), "-o", str(output), *wrong])
    assert isinstance(run.exception, CartierError), run.exception
    assert "no 'nonsense' among the indexes" in str(run.exception) if wrong else "is not ours" in str(run.exception)
