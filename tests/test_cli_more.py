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
from cartier.home import Home
from cartier.llm.prompts import prompt_named
from cartier.pipeline import map_home
from cartier.recordings.folder import save
from synthetic import THINGS, RoomRecording, TrueBoxes
from synthetic import small_walk as walk

Run = Callable[..., tuple[int, str, str]]
HERE = Path(__file__).parent
DETECTOR = str(HERE / "slow_detector.py")
WORLD = str(HERE / "bench" / "room_world.py")


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


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps of the rooms, which every bench here shares."""
    return tmp_path_factory.mktemp("maps")


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
    code, _, err = run("ask", home, "bring me to the fridge", "--go", "print")
    assert code == 4 and "robot: nothing was sent: " in err
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
    assert run("map", tmp_path / "one", "--detector", DETECTOR, "-o", tmp_path / "home")[0] == 0
    code, out, err = run("map", tmp_path / "two", "--detector", DETECTOR, "-o", tmp_path / "home", "--append", "--json")
    assert code == 0 and json.loads(out)["names"] == ["chair", "mug", "table"], err
    code, out, err = run("map", tmp_path / "two", "--detector", DETECTOR, "-o", tmp_path / "home", "--append", "--json")
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
    assert run("doctor", tmp_path / "inverted", "--fix", "-o", tmp_path / "repaired")[0] == 0
    assert (tmp_path / "repaired" / "trajectory.txt").is_file()


def test_the_doctor_names_the_damaged_files_of_a_home(run: Run, home: Path, tmp_path: Path) -> None:
    code, out, _ = run("doctor", home)
    assert code == 0 and "room: sound" in out
    assert json.loads(run("doctor", home, "--json")[1]) == {"ok": True, "faults": []}
    shutil.copytree(home, tmp_path / "h")
    files = sorted(p for p in (tmp_path / "h").rglob("*") if p.is_file() and p.name != "answers.jsonl")
    assert len(files) > 5, "each damage is done to some file"
    for number, file in enumerate(files):
        whole = file.read_bytes()
        damages = (whole[:-1] + bytes([whole[-1] ^ 4]), whole[: len(whole) // 2], b"", None)
        for damage in damages if file.name == "home.json" else damages[number % 4 :][:1]:
            file.unlink()
            if damage is not None:
                file.write_bytes(damage)
            code, out, err = run("doctor", tmp_path / "h", "--json")
            if file.name == "home.json" and damage is None:
                assert code == 1 and "is no recording" in err and err.count("\n") == 1
            else:
                faults = json.loads(out)["faults"]
                assert code == 1 and [fault["fault"] for fault in faults] == ["damaged_file"]
                assert str(file) in faults[0]["evidence"] and faults[0]["repair"]
            file.write_bytes(whole)
    files[1].unlink()
    files[2].write_bytes(b"")
    code, out, _ = run("doctor", tmp_path / "h")
    assert code == 1 and "h: 2 faults" in out and str(files[1]) in out and str(files[2]) in out
    for option in (["--fix", "-o", tmp_path / "repaired"], ["--plot", tmp_path / "x.png"]):
        code, _, err = run("doctor", home, *option)
        assert code == 1 and "for recordings" in err and not (tmp_path / str(option[-1])).exists()


def test_the_bench_leaves_a_report(run: Run, maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = tmp_path / "mine.jsonl"
    row = {
        "id": "sit",
        "type": "implicit",
        "target": "chair",
        "accept": ["chair"],
        "text": "my feet hurt, let me sit down",
    }
    mine.write_text(json.dumps(row) + "\n")
    words = ("bench", "paper", "-o", tmp_path / "run", "--world", WORLD, "--homes", "south,east", "--queries", mine)
    words = (*words, "--maps", maps, "--detector", "ground_truth")
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
    for name in ("distance_png", "match_png"):  # drawn once above
        monkeypatch.setattr(f"cartier_bench.report.{name}", lambda summary, who: b"")
    told = (
        "--detector",
        "ground_truth",
        "--detector",
        "ground_truth:misses=0.2,seed=1",
        "--methods",
        "object_depth",
        "--json",
    )
    code, out, err = run(*words[:3], tmp_path / "both", *words[4:], *told)
    assert code == 0, err
    beside = tmp_path / "both" / "with-ground_truth_misses_0_2_seed_1"
    assert "Side by side" in (tmp_path / "both" / "report.md").read_text() and (beside / "report.md").is_file()
    assert json.loads(out) == json.loads((tmp_path / "both" / "results.json").read_text())
    assert run(*words[:3], tmp_path / "both", *words[4:], *told)[0] == 0, "it goes on in both folders"
    mine.write_text(json.dumps(row) + "\n{\n")
    code, _, err = run(*words)
    assert code == 1 and "line 2" in err and len(err.strip().splitlines()) == 1


def test_prompts_are_written_and_what_a_batch_brings_back_is_scored(run: Run, maps: Path, tmp_path: Path) -> None:
    """Two rounds, as NLMap chooses among what it proposed; whoever answers sees the prompts alone."""
    rows = [("sit", "chair", "let me sit"), ("drink", "mug", "something hot to hold")]
    lines = [
        {"id": key, "type": "implicit", "target": name, "accept": [name], "text": text} for key, name, text in rows
    ]
    (tmp_path / "own.jsonl").write_text("\n".join(map(json.dumps, lines)))
    options = ("--world", WORLD, "--homes", "north", "--queries", tmp_path / "own.jsonl", "--detector", "ground_truth")
    options = (*options, "--maps", maps, "--methods", "object_depth,nlmap,true_object", "-o", tmp_path / "run")
    prompts, back = tmp_path / "prompts.jsonl", tmp_path / "back.jsonl"
    for count, replies in ((4, ()), (2, ("--replies", back)), (0, ("--replies", back))):
        code, out, err = run("bench", "paper", *options, "--write-prompts", prompts, "--model", "reader", *replies)
        asked = [json.loads(line) for line in prompts.read_text(encoding="utf-8").splitlines()]
        assert code == 0 and len(asked) == count and f"{count} prompts in {prompts}; nothing was sent" in out, err
        with back.open("a", encoding="utf-8") as file:
            for line in asked:
                assert (line["method"], line["url"], line["body"]["model"]) == (
                    "POST",
                    "/v1/chat/completions",
                    "reader",
                )
                said = line["body"]["messages"][-1]["content"]
                name = "chair" if "sit" in said else "mug"
                is_choice = "response_format" in line["body"]
                content = json.dumps({"status": "found", "object": name}) if is_choice else f"{name}, throne"
                message = {"role": "assistant", "content": content}
                body = {"choices": [{"message": message, "finish_reason": "stop"}]}
                answer = {"custom_id": line["custom_id"], "response": {"status_code": 200, "body": body}, "error": None}
                file.write(json.dumps(answer) + "\n")
    code, out, err = run("bench", "paper", *options, "--replies", back, "--json")
    methods = json.loads(out)["methods"]
    assert code == 0 and {name: methods[name]["implicit"]["match"] for name in methods} == dict.fromkeys(methods, 1), (
        err
    )
    back.write_text("\n".join(back.read_text().splitlines()[1:]))
    code, out, err = run("bench", "paper", *options[:-1], tmp_path / "again", "--replies", back)
    assert code == 1 and "holds no reply to “let me sit”" in err and err.count("\n") == 1


def test_prompts_of_the_things_are_written_turn_by_turn(run: Run, maps: Path, tmp_path: Path) -> None:
    """A follow-up is written when the turn before it has its reply."""
    item = {
        "id": "f",
        "home": "north",
        "kind": "nothing",
        "turns": ["let me sit", "no"],
        "accept_ids": [],
        "answer": None,
    }
    (tmp_path / "own.jsonl").write_text(json.dumps(item))
    options = ("--world", WORLD, "--queries", tmp_path / "own.jsonl", "--detector", "ground_truth")
    options = (*options, "--maps", maps)
    prompts, back = tmp_path / "prompts.jsonl", tmp_path / "back.jsonl"
    for turns in (1, 3, 0):  # messages after the rules
        replies = ("--replies", back) if back.exists() else ()
        code, _, err = run("bench", "things", *options, "-o", tmp_path / "run", "--write-prompts", prompts, *replies)

        asked = [json.loads(line) for line in prompts.read_text(encoding="utf-8").splitlines()]
        assert code == 0 and [len(line["body"]["messages"]) - 1 for line in asked] == [turns] * bool(turns), err
        for line in asked:
            reply = {
                "status": "not_found",
                "object": "nothing",
                "reason": "",
                "question": "",
                "text": "",
                "answer": None,
                "next": [],
            }
            body = {"choices": [{"message": {"content": json.dumps(reply)}}]}
            with back.open("a", encoding="utf-8") as file:
                file.write(
                    json.dumps({"custom_id": line["custom_id"], "response": {"status_code": 200, "body": body}}) + "\n"
                )
    code, out, err = run("bench", "things", *options, "-o", tmp_path / "scored", "--replies", back, "--json")
    assert code == 0 and "replay" in out, err


def test_show_prompt_prints_what_would_be_sent_and_sends_nothing(run: Run, home: Path) -> None:
    code, out, err = run("ask", home, "let me sit", "--show-prompt")
    assert (code, out) == (0, "nothing leaves this machine\n"), err
    server = ("--base-url", "http://me:secret@127.0.0.1:9/v1", "--model", "m", "--from", "1,1")  # where nobody listens
    for reasoner in ("auto", "openai"):
        code, out, err = run("ask", home, "let me sit", "--show-prompt", "--json", "--reasoner", reasoner, *server)
        shown = json.loads(out)
        assert code == 0 and shown["to"] == "http://127.0.0.1:9/v1/chat/completions" and "secret" not in out + err
        expected = prompt_named("rich").request("let me sit", Home.load(home).inventory(from_xy=(1.0, 1.0))).body("m")
        assert shown["body"] == expected
    code, out, err = run("ask", home, "let me sit", "--show-prompt", *server)
    assert code == 0 and "this is sent to http://127.0.0.1:9/v1/chat/completions and nowhere else" in out
    assert all(message["content"] in out for message in expected["messages"]) and '"json_schema"' in out
    code, out, err = run("ask", home, "let me sit", "--show-prompt", "--reasoner", "local", "--model", "x.gguf")
    assert (
        code == 0 and out.startswith("nothing leaves this machine\nmodel x.gguf") and "<words>let me sit</words>" in out
    )
    for reasoner in ("embedded", "replay"):
        code, out, err = run("ask", home, "let me sit", "--show-prompt", "--reasoner", reasoner, "--json")
        assert code == 0 and json.loads(out) == {"to": None, "through": None, "body": None}
    for words in ((), ("\x00",), ("let me sit", "--reasoner", "./mine.py"), ("let me sit", "--base-url", "file:///x")):
        code, out, err = run("ask", home, *words, "--show-prompt", "--reasoner", "openai", *words[1:])
        assert code == 1 and not out and err.startswith("cartier: ") and err.count("\n") == 1, err
    assert not (home / "answers.jsonl").exists() or "let me sit" not in (home / "answers.jsonl").read_text()


def test_the_bench_asks_for_particular_things_and_scores_anybodys_answers(run: Run, maps: Path, tmp_path: Path) -> None:
    mug = next(obj for obj in THINGS if obj.label.lower() == "mug")
    rows = [
        {
            "id": "m",
            "home": "south",
            "kind": "relation",
            "text": "go to the mug",
            "accept_ids": [mug.id],
            "answer": None,
        },
        {
            "id": "n",
            "home": "south",
            "kind": "count",
            "text": "how many mugs are there?",
            "accept_ids": [mug.id],
            "answer": 1,
        },
    ]
    mine, theirs = tmp_path / "mine.jsonl", tmp_path / "theirs.jsonl"
    mine.write_text("".join(json.dumps(row) + "\n" for row in rows))
    words = ("--world", WORLD, "--queries", mine, "--detector", "ground_truth", "--maps", maps)
    code, out, err = run("bench", "things", "-o", tmp_path / "run", *words)
    assert code == 0 and "| **find the particular thing** | 1 | 100 |" in out, err
    assert [json.loads(line) for line in (tmp_path / "run" / "requests.jsonl").read_text().splitlines()] == rows
    theirs.write_text(json.dumps({"id": "n", "status": "answered", "answer": 1}))
    code, out, err = run("bench", "things", "-o", tmp_path / "scored", *words, "--answers", theirs, "--json")
    told = json.loads(out)["made from the truth"]
    assert code == 0 and [told[kind]["theirs.jsonl, answers"]["right"] for kind in ("relation", "count")] == [0, 1], err
    code, _, err = run("bench", "things", "-o", tmp_path / "none", "--queries", tmp_path / "none.jsonl")
    assert code == 1 and "is missing" in err and not (tmp_path / "none").exists(), err


@pytest.mark.parametrize(
    ("old", "told"),
    [
        (("-o", "none", "--suite", "things"), "cartier bench things -o RUN"),
        (("--suite=look", "-o", "none"), "cartier bench look -o RUN"),
        (("-o", "none"), "cartier bench paper -o RUN"),
        (("--suite", "objects", "-o", "none"), "there is no suite 'objects'"),
    ],
)
def test_old_spelling_of_bench_is_told(run: Run, old: tuple[str, ...], told: str) -> None:
    code, out, err = run("bench", *old)
    assert code == 1 and not out and told in err and err.count("\n") == 1
    assert not Path("none").exists()


def test_a_rerun_file_without_the_package_names_the_extra(
    run: Run, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "cartier.render.rerun_file", raising=False)
    monkeypatch.setitem(sys.modules, "rerun", None)
    code, _, err = run("show", home, "--rrd", tmp_path / "a.rrd")
    assert code == 1 and err.startswith("cartier: --rrd needs the package 'rerun-sdk': pip install ") and "[viz]" in err
    assert not list(tmp_path.glob("*.rrd"))
    code, _, err = run("show", home, "--recording", tmp_path)
    assert code == 1 and err.startswith("cartier: --recording adds frames to --rrd FILE and --overlay FILE")
