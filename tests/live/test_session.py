"""Live sessions: a stream that is kept up with gives the home of its recording; kills, faults, early questions."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cartier
from cartier import Live, plugins
from cartier.errors import InputError
from cartier.io.files import read_npz
from cartier.io.spool import Spool
from cartier.recordings.folder import save
from cartier.sources import open_source
from cartier.types.streams import Event, Fault, PoseUpdate, Stamped
from synthetic import THINGS, TrueBoxes, box, walk

WALK = walk()


class Eyes:
    """The boxes that ground truth gives, found by colour, so that they are seen in frames without instances, too."""

    name = "ground truth (test), by colour"
    score_model = TrueBoxes.score_model
    pause_s = 0.0

    def __init__(self) -> None:
        self.colours = np.random.default_rng(0).integers(40, 255, (4, 3))

    def detect(self, frame: cartier.Frame) -> cartier.Detections:
        time.sleep(self.pause_s)
        boxes, labels = [], []
        for thing in THINGS:
            rows, cols = np.nonzero((np.abs(frame.rgb.astype(int) - self.colours[thing.id]) < 12).all(-1))
            if len(rows) >= 20:
                boxes.append((cols.min(), rows.min(), cols.max() + 1, rows.max() + 1))
                labels.append(thing.label)
        return cartier.Detections(
            frame.index, np.array(boxes, np.float32).reshape(-1, 4), np.ones(len(boxes), np.float32), tuple(labels)
        )


class Scripted:
    """A source that yields what a test says."""

    name, waits, recording, notes = "scripted", True, None, ()

    def __init__(self, events: Iterator[Event]) -> None:
        self.events, self.closed = events, False

    def __iter__(self) -> Iterator[Event]:
        for event in self.events:
            if self.closed:
                return
            yield event

    def close(self) -> None:
        self.closed = True


def frames(count: int = len(WALK)) -> Iterator[Stamped]:
    return (Stamped(WALK[number], number * 10**8) for number in range(count))


def files(home: cartier.Home, folder: Path) -> dict[str, bytes]:
    """The files of a home by name: photos, objects, floor plan, indices and all that growing needs."""
    home.save(folder)
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file() and ".lock" not in p.name
    }


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("walk") / "room"
    save(WALK, path)
    return path


@pytest.fixture(scope="module")
def offline(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of the home that ``map`` makes of the recording."""
    home = cartier.map_home(plugins.open_recording(recorded), Eyes())
    assert len(home.objects) == 3
    return files(home, tmp_path_factory.mktemp("offline") / "home")


@pytest.fixture(scope="module")
def whole() -> cartier.Home:
    """The home of all frames of the walk."""
    return cartier.map_home(WALK, Eyes(), every=1)


def mapped(spec: str, **options: Any) -> cartier.Home:
    live = Live(open_source(spec), Eyes(), **options)
    live.start()
    return live.wait()


@pytest.mark.parametrize("speed", ["max", "0.8"])
def test_a_folder_that_is_kept_up_with_gives_the_same_home(
    speed: str, recorded: Path, offline: dict[str, bytes], tmp_path: Path
) -> None:
    live = mapped(f"bag:{recorded}@{speed}")
    assert files(live, tmp_path / "live") == offline


def test_a_bag_that_is_kept_up_with_gives_the_same_home(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs cartier[ros]")
    from bags import write_bag

    write_bag(WALK, tmp_path / "walk.mcap")
    offline = cartier.map_home(plugins.open_recording(tmp_path / "walk.mcap"), Eyes())
    live = mapped(f"bag:{tmp_path / 'walk.mcap'}@0.8")
    assert files(live, tmp_path / "live") == files(offline, tmp_path / "offline")


def test_the_spool_is_the_recording_afterwards(recorded: Path, tmp_path: Path) -> None:
    home = mapped(f"bag:{recorded}@max", spool=tmp_path / "home.spool", every=1)
    spool = plugins.open_recording(tmp_path / "home.spool")
    assert len(spool) == len(WALK)
    again = cartier.map_home(spool, Eyes(), every=1)
    assert again.names == home.names
    for mine, theirs in zip(again.objects, home.objects, strict=True):
        np.testing.assert_allclose(mine.position, theirs.position, atol=0.01)


def test_what_the_source_says_is_counted(tmp_path: Path) -> None:
    def events() -> Iterator[Event]:
        yield from frames(10)
        yield Fault("no_pose", "no transforms", 3)
        yield Fault("silent", "nothing")
        yield PoseUpdate({0: WALK[0].world_from_camera}, "/mapPath")
        yield from list(frames(16))[10:]

    live = Live(Scripted(events()), Eyes(), spool=tmp_path / "a.spool")
    live.start()
    home = live.wait()
    state = live.state()
    assert (state.phase, state.frames_in, state.measured, state.pose_updates) == ("ended", 16, 16, 1)
    assert state.dropped == {"no_pose": 3}
    assert state.looked == state.keyframes > 5
    assert state.delay_p50_s is not None
    assert "3 frames left out: no_pose" in home.notes
    assert "no_pose 3" in state.line()
    json.dumps(state.to_dict())
    live.saved()
    assert not list(Spool(tmp_path / "a.spool").updates()), "nothing moved"
    assert home.settings["recordings"][0]["frames"] == 16


def test_what_a_slow_detector_has_no_time_for_is_looked_at_in_the_end(recorded: Path, tmp_path: Path) -> None:
    eyes, spool = Eyes(), tmp_path / "home.spool"
    eyes.pause_s = 0.15
    live = Live(open_source(f"bag:{recorded}@2"), eyes, every=1, spool=spool)
    live.start()
    while live.running():
        time.sleep(0.05)
    before, in_time = live.home(), live.state()
    assert in_time.postponed > 0 and f"{in_time.postponed} put off to the end" in in_time.line()
    assert in_time.looked + in_time.postponed == in_time.keyframes
    steps: list[tuple[int, int]] = []
    eyes.pause_s = 0.0
    home, state = live.wait(lambda done, total: steps.append((done, total))), live.state()
    live.saved()
    assert state.looked == state.keyframes and state.dropped.get("busy", 0) + state.thinned + state.looked == len(WALK)
    assert [done for done, _ in steps] == list(range(1, steps[-1][1] + 1)) and len({total for _, total in steps}) == 1
    ids = {o.label: o.id for o in before.objects if o.confirmed}
    assert {o.label: o.id for o in home.objects if o.label in ids} == ids
    kept = plugins.open_recording(spool)
    times_s = [kept[number].time_s for number in range(len(kept))]
    assert len(kept) == state.keyframes and times_s == sorted(times_s), "the recording is in the order of its frames"
    offline = cartier.map_home(kept, Eyes(), every=1)
    told = [sorted((o.label, o.n_detected, o.last_seen_s) for o in each.objects) for each in (home, offline)]
    assert told[0] == told[1], "ids are those of before, and may be in another order"


def test_depth_of_frames_between_keyframes_stays_in_the_floor_plan(recorded: Path) -> None:
    eyes = Eyes()
    eyes.pause_s = 0.6
    live = Live(open_source(f"bag:{recorded}@2"), eyes, every=2)
    live.start()
    home = live.wait()
    state, keys = live.state(), read_npz(home.growth["frames.npz"])["keys"]
    assert state.postponed > 0 and len(keys) == state.measured > state.looked


class Waits:
    """A source that sends some frames and then waits for the test."""

    def __init__(self, count: int) -> None:
        self.count, self.go = count, False

    def __iter__(self) -> Iterator[Event]:
        yield from frames(self.count)
        while not self.go:
            time.sleep(0.01)
            yield Fault("silent", "the test waits")


def _knows(live: Live, label: str) -> bool:
    """Whether the latest snapshot has such an object."""
    return live.state().as_of_s is not None and any(o.confirmed and o.label == label for o in live.home().objects)


def test_answers_say_as_of_when_and_not_seen_yet() -> None:
    waits = Waits(6)
    source = Scripted(iter(waits))
    live = Live(source, Eyes(), every=1)
    with pytest.raises(InputError, match="nothing was mapped yet"):
        live.ask("where is the chair?")
    live.start()
    end = time.monotonic() + 20
    while not _knows(live, "table") and time.monotonic() < end:
        time.sleep(0.02)
    missing = live.ask("is there a piano?")
    assert missing.as_of is not None
    assert 0 < missing.as_of.floor_seen < 0.9
    assert missing.as_of.not_seen_yet
    assert missing.selection.text.startswith("Not seen yet: I have looked at")
    assert missing.notes[0].startswith("as of ")
    assert missing.to_dict()["as_of"]["not_seen_yet"] is True
    there = live.ask("is there a table?")
    assert there.as_of is not None
    assert not there.as_of.not_seen_yet
    waits.go = True
    live.stop()


def test_a_detector_that_fails_ends_the_session() -> None:
    class Fails(Eyes):
        def detect(self, frame: cartier.Frame) -> cartier.Detections:
            raise InputError("the model is broken")

    live = Live(Scripted(frames()), Fails())
    live.start()
    with pytest.raises(InputError, match="the model is broken"):
        live.wait()
    assert live.state().phase == "failed"


def test_keyframes_are_recorded_before_detection(tmp_path: Path) -> None:
    spool, kept = tmp_path / "a.spool", list[int]()

    class Counts(Eyes):
        def detect(self, frame: cartier.Frame) -> cartier.Detections:
            kept.append(len(Spool(spool).keyframes()))
            raise InputError("cut off")

    live = Live(Scripted(frames(6)), Counts(), spool=spool, every=1)
    live.start()
    with pytest.raises(InputError, match="cut off"):
        live.wait()
    assert kept[0] >= 1 and not Spool(spool).seen
    count = len(Spool(spool).keyframes())
    live = Live(Scripted(iter(())), Eyes(), spool=spool, every=1)
    live.start()
    assert live.state().resumed == count
    live.wait()
    assert len(Spool(spool).seen) == count


def test_a_source_that_does_not_end_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cartier.live.session.CLOSE_S", 0.1)
    never = threading.Event()

    def events() -> Iterator[Event]:
        yield from frames(6)
        never.wait(60)

    live = Live(Scripted(events()), Eyes(), every=1)
    live.start()
    while live.state().looked < 6:
        time.sleep(0.01)
    assert live.stop().names
    assert "does not end" in live.state().message
    never.set()


def test_the_detector_of_a_cut_off_session_must_stay(tmp_path: Path) -> None:
    live = Live(Scripted(frames(5)), Eyes(), spool=tmp_path / "a.spool")
    live.start()
    live.wait()  # and it is not saved
    other = Eyes()
    other.name = "another"
    with pytest.raises(InputError, match="was begun with the detector ground truth"):
        Live(Scripted(frames(5)), other, spool=tmp_path / "a.spool")


RUN = """
import sys, time
from pathlib import Path
sys.path[:0] = {paths!r}
from test_session import Eyes
from cartier import Live
from cartier.sources import open_source
folder, home = Path(sys.argv[1]), Path(sys.argv[2])
live = Live(open_source(f"bag:{{folder}}@0.9"), Eyes(), spool=home.with_suffix(".spool"), every=1)
live.start()
while True:
    state = live.state()  # a keyframe that is counted is on the disk
    print(state.looked, state.keyframes, flush=True)
    time.sleep(0.01)
"""


@pytest.mark.parametrize("after", [1, 6])
def test_a_killed_session_goes_on(after: int, recorded: Path, whole: cartier.Home, tmp_path: Path) -> None:
    script = tmp_path / "run.py"
    script.write_text(RUN.format(paths=[str(Path(__file__).parent), str(Path(__file__).parents[1])]))
    spool = tmp_path / "home.spool"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, script, recorded, tmp_path / "home"], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            looked, counted = map(int, line.split())
            if looked >= after:
                process.send_signal(signal.SIGKILL)
                break
    kept = len(plugins.open_recording(spool))
    assert kept >= counted
    live = Live(Scripted(list(frames())[i] for i in range(kept, len(WALK))), Eyes(), spool=spool, every=1)  # type: ignore[arg-type]
    live.start()
    home = live.wait()
    live.saved()
    assert live.state().resumed == kept
    assert [row["frames"] for row in home.settings["recordings"]] == [kept, len(WALK) - kept]
    assert home.names == whole.names
    for mine, theirs in zip(home.objects, whole.objects, strict=True):
        np.testing.assert_allclose(mine.position, theirs.position, atol=0.02)
    assert Spool(spool).ended
    assert not Spool(spool).unsaved()


def test_a_home_grows_live(tmp_path: Path) -> None:
    first = cartier.map_home(WALK, Eyes())
    first.save(tmp_path / "home")
    base = cartier.Home.load(tmp_path / "home")
    more = walk((*THINGS, box(4, "lamp", (4.2, 3.2, 0), (4.5, 3.5, 1.2))))
    events = (Stamped(more[number], number) for number in range(len(more)))
    live = Live(Scripted(events), Eyes(), onto=base)
    assert live.home() is base
    live.start()
    home = live.wait()
    assert [row["recording"] for row in home.settings["recordings"]] == ["synthetic room", "scripted"]
    assert {obj.id for obj in base.objects} <= {obj.id for obj in home.objects}
