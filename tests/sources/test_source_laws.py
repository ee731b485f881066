"""The laws of sources over every source that runs here, and what each of them says of trouble."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.contracts import Source
from cartier.errors import BackendError, CartierError, InputError
from cartier.recordings.folder import save
from cartier.sources import open_source
from cartier.sources.common.framing import read_event
from cartier.sources.common.player import RecordingPlayer
from cartier.testing import check_source
from cartier.types import Frame
from cartier.types.streams import Event, Fault, PoseUpdate, Stamped
from synthetic import walk

EXAMPLE = Path(__file__).parents[2] / "examples" / "send_frames.py"
WALK = walk()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("walk") / "room"
    save(WALK, path)
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("rosbags", reason="needs cartier[ros]")
    from bags import write_bag

    path = tmp_path_factory.mktemp("walk") / "room.mcap"
    write_bag(WALK, path)
    return path


def sent(frames: list[Stamped], count: int = len(WALK)) -> None:
    """The frames are those of the walk, at most a millimetre of depth off."""
    assert len(frames) == count
    for each in frames:
        true = WALK[each.frame.index]
        np.testing.assert_allclose(each.frame.world_from_camera, true.world_from_camera, atol=1e-6)
        assert each.frame.depth_m is not None
        np.testing.assert_allclose(each.frame.depth_m, true.depth_m, atol=0.001)


def command(*words: object) -> str:
    return "exec:" + shlex.join([sys.executable, *map(str, words)])


def test_a_folder_is_played(folder: Path) -> None:
    sent(check_source(lambda: open_source(f"bag:{folder}@20")))


def test_a_bag_is_paired(bag: Path) -> None:
    sent(check_source(lambda: open_source(f"bag:{bag}@max")))
    sent(check_source(lambda: open_source(f"bag:{bag}@4"), most=5), 5)


def test_a_program_sends(folder: Path) -> None:
    sent(check_source(lambda: open_source(command(EXAMPLE, folder, 20))))


def test_a_frame_that_is_slow_to_read_is_told() -> None:
    class Slow:
        name, camera, truth, notes = WALK.name, WALK.camera, None, ()

        def __len__(self) -> int:
            return 2

        def __getitem__(self, index: int) -> Frame:
            time.sleep(1.2)
            return WALK[index]

        def fingerprint(self) -> str:
            return "slow"

    frames = check_source(lambda: RecordingPlayer(Slow(), 0))
    assert len(frames) == 2
    assert any(isinstance(event, Fault) and event.reason == "silent" for event in RecordingPlayer(Slow(), 0))


def test_a_robot_drives_in_the_dollhouse() -> None:
    make = lambda: open_source("dollhouse:studio@max", width=64, height=48, max_frames=6)  # noqa: E731
    assert len(check_source(make)) == 6


def test_a_slow_stream_says_that_it_is_silent(folder: Path) -> None:
    source = open_source(f"bag:{folder}@0.05")
    events = iter(source)
    assert isinstance(next(events), Stamped)
    second = next(events)
    source.close()
    assert isinstance(second, Fault)
    assert second.reason == "silent"


def grown(folder: Path, target: Path, steps: Callable[[str], None] = lambda _: None) -> None:
    """Upload a recording frame by frame: images first, then the line of the pose."""
    (target / "rgb").mkdir(parents=True)
    (target / "depth").mkdir()
    shutil.copy(folder / "recording.json", target)
    for number, line in enumerate((folder / "trajectory.txt").read_text().splitlines(keepends=True)[1:]):
        steps(line)
        for name in (f"rgb/{number:06d}.jpg", f"depth/{number:06d}.png"):
            shutil.copy(folder / name, target / name)
        with (target / "trajectory.txt").open("a") as out:
            out.write(line[:9])  # a line that is written in two pieces
            out.flush()
            out.write(line[9:])
        time.sleep(0.01)


def test_a_folder_grows(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "upload"
    target.mkdir()
    upload = threading.Thread(target=grown, args=(folder, target))
    upload.start()
    sent(check_source(lambda: open_source(f"folder:{target}", idle_s=1.2)))
    upload.join()


def test_an_image_may_arrive_after_its_line(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "upload"
    shutil.copytree(folder, target)
    held = (target / "rgb/000003.jpg").read_bytes()
    (target / "rgb/000003.jpg").write_bytes(held[: len(held) // 2])
    threading.Timer(0.5, (target / "rgb/000003.jpg").write_bytes, (held,)).start()
    sent(check_source(lambda: open_source(f"folder:{target}", idle_s=1.2)))


def test_an_empty_folder_says_what_it_waits_for(tmp_path: Path) -> None:
    source = open_source(f"folder:{tmp_path}")
    first = next(iter(source))
    source.close()
    assert isinstance(first, Fault)
    assert "recording.json is not there yet" in first.text


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("rtsp://camera.local/stream", "no 'rtsp' among the sources"),
        ("folder:/nowhere", "is no folder"),
        ("bag:/nowhere.mcap", "does not exist"),
        ("exec:", "needs what to listen to"),
        ("exec:'", "No closing quotation"),
        ("bag:.@-1", "does not exist"),
        ("dollhouse:atlantis", "atlantis"),
    ],
)
def test_what_cannot_be_listened_to_is_refused_in_a_line(spec: str, says: str) -> None:
    with pytest.raises(CartierError, match=says):
        open_source(spec)


def test_an_unknown_source_is_refused() -> None:
    with pytest.raises(BackendError, match="did you mean 'folder'"):
        open_source("foldr:x")


def program(body: str, tmp_path: Path) -> Source:
    """A program that writes what ``body`` says, with ``frame(stamp_ns, **changes)`` at hand."""
    script = tmp_path / "program.py"
    script.write_text(
        "import json, sys, time\nout = sys.stdout.buffer\n"
        "def frame(ns, **changes):\n"
        "    rgb = bytes(4 * 3 * 3)\n"
        "    head = dict(stamp_ns=ns, camera=[4, 3, 4, 4, 1.5, 1], pose=[0, 0, 0, 0, 0, 0, 1], rgb=36) | changes\n"
        "    out.write(json.dumps(head).encode() + b'\\n' + rgb)\n    out.flush()\n" + body
    )
    return open_source(command(script))


def events_of(source: Source) -> Iterator[Event]:
    try:
        yield from source
    finally:
        source.close()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"pose": [0, 0, 0, 0, 0, 0, 2]}, "not of length 1"),
        ({"pose": [0, 0, 0]}, "pose .* must be 7 finite numbers"),
        ({"camera": [4, 3, 4, 4, 1.5]}, "camera .* must be 6 finite numbers"),
        ({"camera": [8, 3, 4, 4, 1.5, 1]}, "raw rgb of 8x3 px has 72 bytes, got 36"),
        ({"stamp_ns": -1}, "stamp_ns must be whole nanoseconds"),
        ({"stamp_ns": 1.5}, "stamp_ns must be whole nanoseconds"),
        ({"rgb_format": "gif"}, "rgb_format is one of raw, jpeg, png"),
        ({"rgb_format": "jpeg"}, "is not a JPEG or PNG image"),
    ],
)
def test_a_wrong_frame_is_left_out_and_the_next_is_taken(changes: dict[str, Any], says: str, tmp_path: Path) -> None:
    source = program(f"frame(1, **json.loads({json.dumps(changes)!r}))\nframe(2)\n", tmp_path)
    fault, frame = list(events_of(source))
    assert isinstance(fault, Fault)
    assert fault.reason == "unreadable"
    assert re.search(says, fault.text)
    assert isinstance(frame, Stamped)
    assert frame.stamp_ns == 2


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("out.write(b'hello\\n')", "not valid JSON"),
        ("out.write(b'[1]\\n')", "must hold an object"),
        ("out.write(b'x' * 2_000_000)", "a line of more than 1048576 bytes"),
        ("frame(1, rgb=-1)", "rgb must be a number of bytes"),
        ("frame(1, rgb=10**12)", "rgb must be a number of bytes"),
    ],
)
def test_what_is_no_framing_ends_the_stream_with_a_line(body: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        list(events_of(program(body, tmp_path)))


def test_a_program_that_fails_says_so(tmp_path: Path) -> None:
    frame, ended = list(events_of(program("frame(1)\nsys.exit(3)", tmp_path)))
    assert isinstance(frame, Stamped)
    assert isinstance(ended, Fault)
    assert ended.text.endswith("ended with exit code 3")


def test_a_program_sends_pose_updates_and_faults(tmp_path: Path) -> None:
    body = 'frame(1)\nout.write(b\'{"poses": {"1": [1, 0, 0, 0, 0, 0, 1]}}\\n{"fault": "the lens is dirty"}\\n\')\n'
    body += "frame(1)\nframe(3)\n"
    _, update, fault, twice, last = list(events_of(program(body, tmp_path)))
    assert isinstance(update, PoseUpdate)
    assert update.poses[1][0, 3] == 1
    assert isinstance(fault, Fault)
    assert fault.text == "the lens is dirty"
    assert isinstance(twice, Fault)
    assert twice.reason == "late"
    assert isinstance(last, Stamped)
    assert last.frame.index == 2


def test_a_hanging_program_is_ended(tmp_path: Path) -> None:
    source = program("import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nframe(1)\ntime.sleep(60)", tmp_path)
    check_source(lambda: source, ends=False)


@pytest.mark.parametrize("fault", ["silent", "stamp", "index", "after close", "event"])
def test_the_laws_notice(fault: str) -> None:
    class Broken:
        name = "broken"

        def __init__(self) -> None:
            self.closed = False

        def close(self) -> None:
            self.closed = True

        def __iter__(self) -> Iterator[Any]:
            frame = WALK[0]
            if fault == "silent":
                time.sleep(1.7)
            yield Stamped(frame, 5)
            if fault == "event":
                yield "a frame"
            if fault == "stamp":
                yield Stamped(WALK[1], 5)
            if fault == "index":
                yield Stamped(WALK[2], 6)
            if fault == "after close":
                while True:
                    yield Stamped(WALK[1], 6)

    with pytest.raises(AssertionError):
        check_source(Broken, most=1 if fault == "after close" else 40)


def test_every_source_says_what_it_is() -> None:
    assert {"bag", "folder", "dollhouse", "exec", "ros2"} <= {b.name for b in plugins.backends("sources")}


@pytest.mark.parametrize("stamp", ["²", "-1", "1e9", "9" * 20, ""])
def test_stamps_of_corrections_are_whole(stamp: str) -> None:
    line = json.dumps({"poses": {stamp: [0, 0, 0, 0, 0, 0, 1]}}).encode()
    with pytest.raises(InputError, match="whole nanoseconds"):
        read_event(BytesIO(line + b"\n"), 0)


def test_a_reader_that_fails_ends_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ValueError("of nobody's making")

    monkeypatch.setattr("cartier.sources.exec.read_event", fails)
    with pytest.raises(InputError, match="the reader failed: ValueError: of nobody's making"):
        list(open_source(command("-c", "print()")))
