from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cartier_dollhouse as dollhouse
from cartier import cli
from cartier.home import Home
from cartier.recordings.folder import save
from synthetic import THINGS
from synthetic import small_walk as walk

DETECTOR = str(Path(__file__).parent / "slow_detector.py")
Run = Callable[..., tuple[int, str, str]]
CLOSET = """
name: closet
about: One small room.
start: [1.5, 1.2]
rooms:
  - {name: closet, kind: bedroom, box: [0.0, 0.0, 3.2, 2.8], floor: "planks:oak", walls: "paint:cream"}
windows:
  - {room: closet, side: north, at: 1.6, width: 1.2, sill: 1.0, height: 1.2}
things:
  - type: Bed
    at: [2.1, 2.1]
    face: east
    size: [1.25, 2.05, 0.85]
    colour: petrol
    things:
      - {type: Pillow, at: [0.0, 0.72], size: [0.6, 0.38, 0.14], colour: white}
  - {type: GarbageCan, at: [0.25, 0.25], face: north, size: [0.3, 0.3, 0.5]}
  - type: SideTable
    at: [0.25, 2.5]
    face: east
    size: [0.45, 0.4, 0.5]
    things:
      - {type: AlarmClock, at: [0.0, 0.0], colour: red}
  - {type: Fridge, at: [2.8, 0.37], face: north, size: [0.62, 0.66, 1.6], colour: mustard}
"""


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the command line in this process: (exit code, stdout, stderr)."""

    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["cartier", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
            raise SystemExit(0)
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), out, err

    return call


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "room"
    save(walk(), folder)
    return folder


@pytest.fixture(scope="module")
def home(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("homes") / "room"
    done = CliRunner().invoke(cli.app, ["map", str(recording), "--detector", DETECTOR, "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture
def closet(tmp_path: Path) -> Path:
    """A home of one small room for the simulator."""
    file = tmp_path / "closet.yaml"
    file.write_text(CLOSET)
    return file


def few_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator's camera has a quarter of its pixels, unless another is asked for."""
    monkeypatch.setattr(dollhouse, "make", partial(dollhouse.make, width=320, height=240))


def _env() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(Path(__file__).parent), "OMP_NUM_THREADS": "1"}


def test_map_show_ask_with_pictures(run: Run, recording: Path, tmp_path: Path) -> None:
    code, out, err = run("map", recording, "--detector", DETECTOR, "-o", tmp_path / "home", "--json")
    assert code == 0 and json.loads(out)["names"] == ["chair", "mug", "table"], err
    assert json.loads((tmp_path / "home" / "home.json").read_text())["name"] == "home", "after its folder"
    code, out, _ = run("show", tmp_path / "home", "--json", "--plot", tmp_path / "home.png")
    rows = json.loads(out)["objects"]
    assert (
        code == 0 and {row["label"] for row in rows} == {"chair", "mug", "table"} and all(row["views"] for row in rows)
    )
    code, out, _ = run("show", tmp_path / "home")
    assert code == 0 and "chair" in out and "ground truth (test)" in out
    code, out, _ = run(
        "ask", tmp_path / "home", "my feet hurt, let me sit down", "--json", "--plot", tmp_path / "sit.png"
    )
    answer = json.loads(out)
    assert code == 0 and answer["object"] == "chair" and answer["goal"]["path"] and answer["place"]["frame"] is not None
    assert set(answer) >= {
        "query",
        "status",
        "object",
        "reason",
        "question",
        "place",
        "goal",
        "candidates",
        "reasoner",
        "index",
        "home",
        "timing_ms",
    }
    for picture in ("home.png", "sit.png"):
        assert (tmp_path / picture).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert json.loads((tmp_path / "home" / "answers.jsonl").read_text())["object"] == "chair"
    assert not list(tmp_path.glob(".*")), "nothing half-done is left behind"


def test_any_words_are_found_in_a_home_with_vlmaps(run: Run, recording: Path, home: Path, tmp_path: Path) -> None:
    folder, picture = tmp_path / "home", tmp_path / "find.png"
    code, _, err = run("map", recording, "--detector", DETECTOR, "-o", folder, "--index", "object_depth,vlmaps")
    assert code == 0, err
    code, out, _ = run("show", folder, "--find", "somewhere to sit", "--plot", picture, "--json")
    found = json.loads(out)
    assert code == 0 and found["index"] == "vlmaps" and "from the detector's labels" in found["encoder"]
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    _, out, _ = run("ask", folder, "let me sit down", "--json", "--index", "vlmaps")
    answer = json.loads(out)
    assert answer["object"] == "chair" and answer["encoder"] == found["encoder"]
    apart = [a - b for a, b in zip(answer["place"]["position"], found["place"]["position"], strict=True)]
    assert max(map(abs, apart)) < 1, "the words lead to the chair too"
    code, _, err = run("show", home, "--find", "somewhere to sit", "--plot", picture)
    assert code == 1 and "map it again with --index" in err and len(err.splitlines()) == 1
    code, _, err = run("show", folder, "--find", "tea " * 300, "--plot", picture)
    assert code == 0 and "only their beginning was read" in err


def test_ask_says_it_for_people(run: Run, home: Path) -> None:
    code, out, err = run("ask", home, "my feet hurt, let me sit down")
    assert code == 0 and out.startswith("found: chair") and "goal" in out and "ground truth (test)" in out
    assert "embedded reasoner answers" in out and not err


def test_ask_can_stand_elsewhere_and_look_elsewhere(run: Run, home: Path) -> None:
    _, out, _ = run("ask", home, "bring me to the mug", "--json", "--from", "3,1", "--index", "object_viewpoint")
    answer = json.loads(out)
    assert answer["index"] == "object_viewpoint" and answer["goal"]["path"][0] == pytest.approx([3, 1], abs=0.06)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("ask", "HOME", ""), "say what you need"),
        (("ask", "HOME", "\x07\x00\x1b"), "say what you need"),
        (("ask", "HOME", "a " * 500_000), "long"),
        (("ask", "HOME", "chair", "--index", "vlmap"), "no index 'vlmap'"),
        (("ask", "HOME", "chair", "--reasoner", "opneai"), "did you mean 'openai'"),
        (("ask", "HOME", "chair", "--from", "here"), "--from needs 2 finite numbers"),
        (("ask", "HOME", "chair", "--plot", "x.nonsense"), "cannot draw to x.nonsense"),
        (("ask", "nowhere", "chair"), "no mapped home"),
        (("show", "RECORDING"), "no mapped home"),
        (("map", "nowhere", "--detector", DETECTOR, "-o", "x"), "does not exist"),
        (("map", "HOME", "--detector", DETECTOR, "-o", "x"), "no recording that cartier knows"),
        (("map", "RECORDING", "--detector", "eva", "-o", "x"), "no 'eva' among the detectors"),
        (("map", "RECORDING", "--detector", "gone.onnx", "-o", "x"), "gone.onnx"),
        (
            ("map", "RECORDING", "--detector", DETECTOR, "-o", "x", "--index", "object_dept"),
            "did you mean 'object_depth'",
        ),
        (("map", "RECORDING", "--detector", DETECTOR, "-o", "x", "--up", "1,2"), "--up needs 3 finite numbers"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    run: Run,
    home: Path,
    recording: Path,
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*({"HOME": home, "RECORDING": recording}.get(w, w) for w in words))
    line = err.strip().splitlines()[-1]
    assert code == 1 and not out and line.startswith("cartier: ") and message in line, err
    assert not list(tmp_path.iterdir())


def test_zero_detections_leave_no_home(run: Run, recording: Path, tmp_path: Path) -> None:
    blind = tmp_path / "blind.py"
    blind.write_text(
        '"""Sees nothing."""\nimport numpy as np\nfrom cartier.types import Detections\n'
        "class Blind:\n    name = 'blind'\n    min_views = 1\n    def detect(self, frame):\n"
        "        return Detections(frame.index, np.zeros((0, 4)), np.zeros(0), ())\ndef make():\n    return Blind()\n"
    )
    code, _, err = run("map", recording, "--detector", blind, "-o", tmp_path / "home")
    assert code == 1 and "found nothing in the 20 frames" in err
    assert not (tmp_path / "home").exists()


def test_list_names_every_kind_and_backend(run: Run) -> None:
    code, out, _ = run("list")
    assert code == 0 and "object_viewpoint" in out and "sevenscenes" in out and "cartier[llm]" in out
    rows = json.loads(run("list", "--json")[1])
    assert {"kind": "indexes", "name": "object_depth"}.items() <= next(
        r for r in rows if r["name"] == "object_depth"
    ).items()


def test_the_demo_leaves_answers_pictures_and_a_home_that_can_be_asked(
    run: Run, closet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few_pixels(monkeypatch)
    code, out, err = run("demo", "--home", closet, "-o", tmp_path / "demo")
    assert code == 0, err
    told = json.loads((tmp_path / "demo" / "answers.json").read_text())
    assert (
        told["detector"].startswith("embedded dollhouse detector")
        and "embedded dollhouse detector" in out
        and "kinds of object in this home" in out
    )
    assert len(told["answers"]) >= 2
    for answer in told["answers"]:
        assert answer["status"] == "found" and answer["goal"] and answer["arrived"]
        for name in (answer["picture"], answer["arrival"]):
            assert (tmp_path / "demo" / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert run("ask", tmp_path / "demo" / "home", "something to sit on")[0] == 0
    code, _, err = run("demo", "--home", "castle", "-o", tmp_path / "other")
    assert code == 1 and "castle" in err and not (tmp_path / "other").exists()


def test_record_saves_what_map_reads_with_ground_truth(
    run: Run, closet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few_pixels(monkeypatch)
    code, _, err = run("record", "dollhouse", "-o", tmp_path / "r")
    assert code == 1 and "which home?" in err
    code, _, err = run("record", "dollhouse:nowhere", "-o", tmp_path / "r")
    assert code == 1 and "nowhere" in err and not (tmp_path / "r").exists()
    code, out, err = run("record", f"dollhouse:{closet}", "-o", tmp_path / "r")
    assert code == 0 and "frames of dollhouse" in out, err
    code, out, err = run("map", tmp_path / "r", "--detector", "ground_truth", "-o", tmp_path / "home", "--json")
    assert code == 0 and len(json.loads(out)["names"]) > 5, err
    assert Home.load(tmp_path / "home").detector.startswith("ground truth (dollhouse")


def test_kill_leaves_the_old_home_whole_and_the_next_run_finishes(
    recording: Path, home: Path, tmp_path: Path, run: Run
) -> None:
    """Killed amid the frames, once some of their detections are noted; a kill at each moment: tests/home/test_store."""
    detector, target = tmp_path / "slow.py", tmp_path / "home"
    detector.write_text(Path(DETECTOR).read_text().replace("pause_s: float = 0.0", "pause_s: float = 0.2"))
    shutil.copytree(home, target)
    before = {f: f.read_bytes() for f in target.rglob("*") if f.is_file()}
    words = ["map", recording, "--detector", detector, "-o", target]
    process = subprocess.Popen(
        [sys.executable, "-m", "cartier", *words], env=_env(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    noted, give_up = tmp_path / ".home.unfinished.jsonl", time.monotonic() + 60
    while not (noted.is_file() and noted.read_bytes().count(b"\n") > 3) and time.monotonic() < give_up:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL and noted.is_file()
    assert Home.load(target) and {f: f.read_bytes() for f in target.rglob("*") if f.is_file()} == before
    detector.write_text(Path(DETECTOR).read_text())
    code, _, err = run(*words)
    assert code == 0, err
    assert Home.load(target).names == sorted(t.label for t in THINGS)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["home", "slow.py"]


@pytest.mark.parametrize("encoding", ["cp437", "latin-1", "ascii"])
def test_any_code_page_prints(encoding: str, monkeypatch: pytest.MonkeyPatch) -> None:
    page = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", page)
    monkeypatch.setattr(sys, "argv", ["cartier", "list"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    page.flush()
    assert not ended.value.code and b"dollhouse" in page.buffer.getvalue()  # type: ignore[attr-defined]
