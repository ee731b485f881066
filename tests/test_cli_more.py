"""The command line around the straight line: conversations, robots, growing, converting, the doctor, the bench."""

from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cartier import cli
from cartier.pipeline import map_home
from cartier.recordings.folder import save
from synthetic import THINGS, RoomRecording, TrueBoxes, walk

Run = Callable[..., tuple[int, str, str]]
HERE = Path(__file__).parent
EYES = str(HERE / "slow_detector.py")
WORLD = str(HERE / "evaluation" / "room_world.py")


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the command line in this process: (exit code, stdout, stderr); ``typed`` is what a person types."""
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL", "CARTIER_MODEL"):
        monkeypatch.delenv(name, raising=False)

    def call(*words: object, typed: str = "") -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["cartier", *map(str, words)])
        monkeypatch.setattr(sys, "stdin", io.StringIO(typed))
        with pytest.raises(SystemExit) as ended:
            cli.main()
            raise SystemExit(0)
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return call


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("homes") / "room"
    map_home(walk(), TrueBoxes(THINGS)).save(folder)
    return folder


def test_without_words_a_conversation_begins_and_an_empty_line_ends_it(run: Run, home: Path) -> None:
    code, out, err = run("ask", home, "--json", typed="bring me to the chair\n\x00\nand now the mug\n\nnever heard\n")
    answers = [json.loads(line) for line in out.splitlines()]
    assert code == 0 and [answer["object"] for answer in answers] == ["chair", "mug"]
    begin, before = answers[1]["goal"]["path"][0], answers[0]["goal"]
    assert begin == pytest.approx([before["x"], before["y"]], abs=1e-4), "it goes on from there"
    assert "empty" in err, "a line of nothing is told, and the conversation goes on"


def test_a_goal_leaves_only_with_go(run: Run, home: Path) -> None:
    _, out, err = run("ask", home, "bring me to the chair")
    assert "send_goal" not in out + err
    code, _, err = run("ask", home, "bring me to the chair", "--go", "print")
    assert code == 0 and "ros2 action send_goal /navigate_to_pose" in err
    code, _, err = run("ask", home, "bring me to the chair", "--go", "teleporter")
    assert code == 1 and "no 'teleporter' among the robots" in err


@pytest.mark.parametrize(
    "wrong",
    [
        ("--from", "nan,nan"),
        ("--from", "inf,0"),
        ("--from", "1"),
        ("--radius", "-1"),
        ("--radius", "nan"),
        ("--camera-height", "nan"),
    ],
)
def test_a_start_or_robot_that_there_is_not_is_refused_before_anything_is_sent(
    run: Run, home: Path, wrong: tuple[str, str]
) -> None:
    server = ("--reasoner", "openai", "--model", "m", "--base-url", "http://127.0.0.1:9/v1")  # where nobody listens
    for words in (["bring me to the chair"], []):
        code, out, err = run("ask", home, *words, *wrong, *server, "--go", "print", typed="bring me to the chair\n")
        assert code == 1 and not out and err.startswith("cartier: ") and err.count("\n") == 1, err
        assert any(word in err for word in ("--from", "radius", "height")), err


def test_a_second_recording_is_added(run: Run, tmp_path: Path) -> None:
    poses = walk().poses
    for name, part in (("one", poses[:12]), ("two", poses[12:])):
        save(RoomRecording(part, THINGS, name=name), tmp_path / name)
    assert run("map", tmp_path / "one", "--detector", EYES, "-o", tmp_path / "home")[0] == 0
    code, out, err = run("map", tmp_path / "two", "--detector", EYES, "-o", tmp_path / "home", "--append", "--json")
    assert code == 0 and json.loads(out)["names"] == ["chair", "mug", "table"], err
    code, out, err = run("map", tmp_path / "two", "--detector", EYES, "-o", tmp_path / "home", "--append", "--json")
    assert code == 0 and json.loads(out)["names"] == ["chair", "mug", "table"], err


def test_convert_and_doctor(run: Run, tmp_path: Path) -> None:
    save(walk(), tmp_path / "sound")
    assert run("convert", tmp_path / "sound", "-o", tmp_path / "copy")[0] == 0
    poses = [np.loadtxt(tmp_path / name / "trajectory.txt") for name in ("copy", "sound")]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-9)
    code, _, err = run("convert", tmp_path / "sound", "-o", tmp_path / "copy")
    assert code == 1 and "exists" in err
    save(walk(), tmp_path / "inverted")
    rows = np.loadtxt(tmp_path / "inverted" / "trajectory.txt")
    turned = Rotation.from_quat(rows[:, 4:]).inv()
    rows[:, 1:] = np.hstack([-turned.apply(rows[:, 1:4]), turned.as_quat()])
    np.savetxt(tmp_path / "inverted" / "trajectory.txt", rows)
    code, out, _ = run("doctor", tmp_path / "inverted", "--json", "--plot", tmp_path / "doctor.png")
    told = json.loads(out)
    assert code == 1 and not told["ok"] and "inverted_poses" in [fault["fault"] for fault in told["faults"]]
    assert (tmp_path / "doctor.png").read_bytes()[:4] == b"\x89PNG"
    code, _, err = run("doctor", tmp_path / "inverted", "--fix")
    assert code == 1 and "-o OUT" in err
    assert run("doctor", tmp_path / "inverted", "--fix", "-o", tmp_path / "mended")[0] == 0
    assert (tmp_path / "mended" / "trajectory.txt").is_file()


def test_the_doctor_names_the_damaged_files_of_a_home(run: Run, home: Path, tmp_path: Path) -> None:
    code, out, _ = run("doctor", home)
    assert code == 0 and "room: sound" in out
    assert json.loads(run("doctor", home, "--json")[1]) == {"ok": True, "faults": []}
    shutil.copytree(home, tmp_path / "h")
    files = sorted(path for path in (tmp_path / "h").rglob("*") if path.is_file())
    for file in files:
        whole = file.read_bytes()
        for damage in (whole[:-1] + bytes([whole[-1] ^ 4]), whole[: len(whole) // 2], b"", None):
            file.unlink()
            if damage is not None:
                file.write_bytes(damage)
            code, out, err = run("doctor", tmp_path / "h", "--json")
            if file.name == "home.json" and damage is None:
                assert code == 1 and "is no recording" in err and err.count("\n") == 1
            else:
                faults = json.loads(out)["faults"]
                assert code == 1 and [fault["fault"] for fault in faults] == ["damaged_file"]
                assert str(file) in faults[0]["evidence"] and faults[0]["mend"]
            file.write_bytes(whole)
    files[1].unlink()
    files[2].write_bytes(b"")
    code, out, _ = run("doctor", tmp_path / "h")
    assert code == 1 and "h: 2 faults" in out and str(files[1]) in out and str(files[2]) in out
    for option in (["--fix", "-o", tmp_path / "mended"], ["--plot", tmp_path / "x.png"]):
        code, _, err = run("doctor", home, *option)
        assert code == 1 and "for recordings" in err and not (tmp_path / str(option[-1])).exists()


def test_the_bench_leaves_a_report(run: Run, tmp_path: Path) -> None:
    mine = tmp_path / "mine.jsonl"
    row = {
        "id": "sit",
        "type": "implicit",
        "target": "chair",
        "accept": ["chair"],
        "text": "my feet hurt, let me sit down",
    }
    mine.write_text(json.dumps(row) + "\n")
    words = ("bench", "-o", tmp_path / "run", "--world", WORLD, "--homes", "south,east", "--queries", mine)
    words = (*words, "--detector", "ground_truth")
    code, out, err = run(*words, "--methods", "object_depth,nlmap,true_object", "--json")
    assert code == 0, err
    summary = json.loads(out)["methods"]
    assert set(summary) == {"object_depth", "nlmap", "true_object"} and summary["true_object"]["implicit"]["match"] == 1
    for name in (
        "report.md",
        "results.jsonl",
        "results.json",
        "tables.csv",
        "table.tex",
        "object_match.png",
        "failures.html",
    ):
        assert (tmp_path / "run" / name).stat().st_size > 0
    told = (
        "--detector",
        "ground_truth",
        "--detector",
        "ground_truth:misses=0.2,seed=1",
        "--methods",
        "object_depth",
        "--json",
    )
    code, out, err = run(*words[:2], tmp_path / "both", *words[3:], *told)
    assert code == 0, err
    beside = tmp_path / "both" / "with-ground_truth_misses_0_2_seed_1"
    assert "Side by side" in (tmp_path / "both" / "report.md").read_text() and (beside / "report.md").is_file()
    assert json.loads(out) == json.loads((tmp_path / "both" / "results.json").read_text())
    assert run(*words[:2], tmp_path / "both", *words[3:], *told)[0] == 0, "it goes on in both folders"
    mine.write_text(json.dumps(row) + "\n{\n")
    code, _, err = run(*words)
    assert code == 1 and "line 2" in err and len(err.strip().splitlines()) == 1
