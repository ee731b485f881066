"""The store of homes: two writers lose nothing, and a kill or a full disk at any moment leaves the old or the new."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import cartier
from cartier.errors import InputError
from cartier.home.correction_log import LOG
from cartier.home.store import MANIFEST, Store
from cartier.io.atomic import append_line, locked, replaced_folder, sweep_parts, write_file
from cartier.io.files import read_rows
from cartier.recordings import folder as own_format
from interrupted import KILLED, content, run
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk

DETECTOR = '"""True boxes."""\nfrom synthetic import THINGS, TrueBoxes\n\ndef make():\n    return TrueBoxes(THINGS)\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three parts of one walk, a detector, and the home of the first part."""
    folder, poses = tmp_path_factory.mktemp("made"), walk().poses
    for name, part in (("first", poses[:8]), ("second", poses[8:14]), ("third", poses[14:])):
        own_format.save(RoomRecording(part, THINGS, name=name), folder / name)
    (folder / "truth.py").write_text(DETECTOR)
    home = cartier.map_home(cartier.open_recording(folder / "first"), TrueBoxes(THINGS))
    home.save(folder / "home")
    return folder


def mapping(made: Path, recording: str, home: Path, *more: str) -> list[str]:
    command = [sys.executable, "-m", "cartier", "map", str(made / recording), "--detector", str(made / "truth.py")]
    return [*command, "-o", str(home), *more]


def test_two_that_append_at_once_both_stay(made: Path, tmp_path: Path) -> None:
    assert run(["map", made / "first", "--detector", made / "truth.py", "-o", tmp_path / "h"], tmp_path)[0] == 0
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    both = [
        subprocess.Popen(mapping(made, name, tmp_path / "h", "--append"), env=env, stderr=subprocess.PIPE, text=True)
        for name in ("second", "third")
    ]
    told = [process.communicate(timeout=120)[1] for process in both]
    assert [process.returncode for process in both] == [0, 0], told
    added = cartier.Home.load(tmp_path / "h").settings["recordings"]
    assert {row["recording"] for row in added} == {"first", "second", "third"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["h"]


def test_who_reads_while_somebody_writes_gets_one_home_or_the_other(made: Path, tmp_path: Path) -> None:
    homes = [cartier.map_home(cartier.open_recording(made / name), TrueBoxes(THINGS)) for name in ("first", "second")]
    homes[0].save(tmp_path / "h")
    done, ids = threading.Event(), {home.id for home in homes}

    def write() -> None:
        for turn in range(24):
            homes[turn % 2].save(tmp_path / "h")
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    read = []
    while not done.is_set():
        read.append(cartier.Home.load(tmp_path / "h").id)
    writer.join()
    assert len(read) > 5 and set(read) <= ids


def test_answers_outlive_growing_and_mapping_again(made: Path, tmp_path: Path) -> None:
    for recording, more in (("first", []), ("second", ["--append"]), ("third", [])):
        command = ["map", made / recording, "--detector", made / "truth.py", "-o", tmp_path / "h", *more]
        assert run(command, tmp_path)[0] == 0
        assert run(["ask", tmp_path / "h", "I want to sit down"], tmp_path)[0] == 0
    assert len(read_rows(tmp_path / "h" / "answers.jsonl", ("query",))) == 3


def test_a_failed_append_leaves_the_home_that_it_began_from_as_it_was(made: Path) -> None:
    home = cartier.Home.load(made / "home")
    before = {name: home.index()[1].locate(name) for name in home.names}

    class Fails(TrueBoxes):
        def detect(self, frame: cartier.Frame) -> cartier.Detections:
            if frame.index == 3:
                raise InputError("the disk is gone")
            return super().detect(frame)

    with pytest.raises(InputError, match="the disk is gone"):
        cartier.map_home(cartier.open_recording(made / "second"), Fails(THINGS), onto=home)
    assert {name: home.index()[1].locate(name) for name in home.names} == before


@pytest.mark.parametrize(
    ("kind", "error"),
    [("map", False), ("append", True), ("convert", False)],
    ids=["map killed", "append, disk full", "convert killed"],
)
def test_interrupted_anywhere_old_or_new_is_left_and_a_second_run_gives_the_same(
    made: Path, tmp_path: Path, kind: str, error: bool
) -> None:
    """A slice of ``benchmarks/interruptions.py``, which takes every event of every command."""
    target, more = tmp_path / "w" / "h", ["--append"] if kind == "append" else []
    command: list[object] = ["map", made / "second", "--detector", made / "truth.py", "-o", target, *more]
    if kind == "convert":
        command = ["convert", made / "first", "-o", target]
    target.parent.mkdir()

    def prepared() -> None:
        for path in target.parent.iterdir():
            subprocess.run(["rm", "-rf", path], check=True)
        if kind == "append":
            subprocess.run(["cp", "-r", made / "home", target], check=True)

    def opened() -> object:
        try:
            if kind == "convert":
                return cartier.open_recording(target).fingerprint() if target.exists() else None
            home = cartier.Home.load(target)
            return home.id, home.objects, [home.index()[1].locate(name) for name in home.names]
        except InputError:
            assert not target.exists()
            return None

    prepared()
    old = opened()
    code, events, told = run(command, target.parent)
    assert code == 0, told
    new, whole = opened(), content(target)
    for nth in (2, events // 2, events - 1):
        prepared()
        code, _, told = run(command, target.parent, nth, error)
        if error:
            assert code == 0 or (code == 1 and told.count("cartier: ") == 1), (nth, told)
        else:
            assert code == KILLED
        left = opened()
        assert left in (old, new), f"half at event {nth} of {events}"
        code, _, told = run(command, target.parent)
        assert code == 0 or (left == new and "exists" in told), (nth, told)
        assert content(target) == whole


def test_done_is_said_of_what_is_on_the_disk(made: Path, tmp_path: Path) -> None:
    """A slice of ``benchmarks/interruptions.py``, which fills the disk at every byte of every command."""
    home, log = tmp_path / "w" / "h", tmp_path / "w" / "h" / LOG
    cartier.Home.load(made / "home").save(home)
    before = len(cartier.Home.load(home).objects)
    for full_at in (40, 200):
        code, _, told = run(["forget", home, "0"], tmp_path, full_at=full_at)
        assert code == 1 and told.count("cannot be written") == 1
        assert len(cartier.Home.load(home).objects) == before and not log.read_bytes()
    assert run(["forget", home, "0"], tmp_path, full_at=2000)[0] == 0
    assert len(cartier.Home.load(home).objects) == before - 1


def test_a_link_for_answers_is_not_followed_and_the_answer_is_still_printed(made: Path, tmp_path: Path) -> None:
    cartier.Home.load(made / "home").save(tmp_path / "h")
    victim = tmp_path / "victim.txt"
    victim.write_text("precious")
    for trap in ("link", "folder"):
        log = tmp_path / "h" / "answers.jsonl"
        log.unlink(missing_ok=True)
        log.symlink_to(victim) if trap == "link" else log.mkdir()
        asked = subprocess.run(
            [sys.executable, "-m", "cartier", "ask", tmp_path / "h", "go to the chair", "--json"],
            capture_output=True, text=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        assert asked.returncode == 0 and json.loads(asked.stdout)["object"] == "chair"
        assert "was not saved" in asked.stderr and "Traceback" not in asked.stderr
    assert victim.read_text() == "precious"


def test_names_in_a_manifest_lead_nowhere(made: Path, tmp_path: Path) -> None:
    cartier.Home.load(made / "home").save(tmp_path / "h")
    file = tmp_path / "h" / MANIFEST
    about = json.loads(file.read_text())
    for trap in ("../victim.npz", "/etc/passwd", "a//b.npz", "..", "photos/../../x.jpg"):
        file.write_text(json.dumps(about | {"blobs": about["blobs"] | {trap: "0" * 64}}))
        with pytest.raises(InputError, match="damaged"):
            Store(tmp_path / "h").manifest()


def test_only_what_is_ours_is_ever_deleted(made: Path, tmp_path: Path) -> None:
    """A stranger's files beside a home and in it look like ours, and stay."""
    cartier.Home.load(made / "home").save(tmp_path / "h")
    strangers = [tmp_path / "h" / "notes-0123456789ab.txt", tmp_path / "h" / "photos" / "mine.jpg"]
    folders = [tmp_path / ".h.old", tmp_path / ".h-abc.old", tmp_path / ".h-abc.new"]
    for path in [*strangers, *(folder / "thesis.txt" for folder in folders)]:
        path.parent.mkdir(exist_ok=True)
        path.write_text("precious")
    cartier.map_home(cartier.open_recording(made / "second"), TrueBoxes(THINGS)).save(tmp_path / "h")
    with replaced_folder(tmp_path / "other", "marker") as new:
        write_file(new / "marker", b"")
    assert all(path.read_text() == "precious" for path in [*strangers, *(f / "thesis.txt" for f in folders)])
    assert Store(tmp_path / "h").faults() == []


def test_a_replacement_that_was_killed_between_its_renames_is_finished_by_the_next(tmp_path: Path) -> None:
    old, half, whole = tmp_path / ".x-1.old", tmp_path / ".x-2.new", tmp_path / ".x-3.new"
    for folder, name in ((old, "marker"), (half, ".cartier-temporary"), (whole, "marker")):
        folder.mkdir()
        (folder / name).write_text("")
    with pytest.raises(KeyboardInterrupt), replaced_folder(tmp_path / "x", "marker"):
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


def test_what_a_killed_write_left_is_swept_and_nothing_else(tmp_path: Path) -> None:
    for name in (
        ".settings.json-0123abcd.part",
        ".settings.json-mine.part",
        ".other.json-0123abcd.part",
        "settings.json",
    ):
        (tmp_path / name).write_text("")
    sweep_parts(tmp_path / "settings.json")
    left = {".settings.json-mine.part", ".other.json-0123abcd.part", "settings.json"}
    assert {path.name for path in tmp_path.iterdir()} == left
    sweep_parts(tmp_path / "none" / "settings.json")


def test_a_lock_is_one_at_a_time_and_says_who_has_it(tmp_path: Path) -> None:
    code = "import sys, time; from pathlib import Path; from cartier.io.atomic import locked\n"
    code += "with locked(Path(sys.argv[1])):\n    print('mine', flush=True)\n    time.sleep(60)"
    env = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    other = subprocess.Popen([sys.executable, "-c", code, tmp_path / "h"], stdout=subprocess.PIPE, env=env)
    assert other.stdout is not None and other.stdout.readline() == b"mine\n"
    told: list[str] = []
    with pytest.raises(InputError, match=r"another cartier is writing .*h: try again"), locked(tmp_path / "h"):
        raise AssertionError("two have it")
    with pytest.raises(InputError), locked(tmp_path / "h", 0.2, told.append):
        raise AssertionError("two have it")
    assert len(told) == 1 and "waiting" in told[0]
    other.kill()
    other.wait()
    with locked(tmp_path / "h", 5), locked(tmp_path / "h"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_line_cut_short_by_a_kill_is_ended_or_taken_off(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    append_line(log, '{"a": 1}')
    with log.open("a") as file:
        file.write('{"a": 2')
    assert read_rows(log, ("a",)) == [{"a": 1}]
    assert log.read_text() == '{"a": 1}\n'
    with log.open("a") as file:
        file.write('{"a": 2')
    append_line(log, '{"a": 3}')
    assert log.read_text().splitlines() == ['{"a": 1}', '{"a": 2', '{"a": 3}']
