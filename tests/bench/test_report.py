from __future__ import annotations

import csv
import io
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_runs import METHODS, SETTINGS, TYPES, fake_rows, row, write_run
from PIL import Image

from cartier.errors import InputError
from cartier_bench import page
from cartier_bench.queries import TYPES as REAL_TYPES
from cartier_bench.report import agreement, export_marking, write_report
from cartier_bench.rows import TITLES

FILES = {
    "report.md", "results.json", "tables.csv", "table.tex", "object_match.png", "distance.png", "failures.html",
    "results.jsonl", "settings.json", "failures",
}  # fmt: skip
HOSTILE = (
    "</script><script>alert(1)</script><img src=x onerror=alert(2)>&amp;\u2028 | `x` [l](http://e) $x^2$ "
    "\\input{x} __DATA__"
)


def photo(home: str, frame: int) -> np.ndarray[Any, np.dtype[np.uint8]] | None:
    return None if frame % 5 == 0 else np.full((90, 120, 3), frame, np.uint8)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def data_of(folder: Path) -> dict[str, Any]:
    """What the failures page holds, as a browser would read it."""
    found = re.search(
        r'<script type="application/json" id="data">(.*?)</script>', (folder / "failures.html").read_text("utf-8"), re.S
    )
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("runs") / "run", fake_rows())
    write_report(folder, photo)
    return folder


def test_the_methods_are_those_of_the_bench() -> None:
    from cartier_bench.methods import METHODS as ASKED

    assert set(TITLES) == set(ASKED) == set(METHODS)
    assert REAL_TYPES == TYPES


def test_everything_is_there_and_nothing_else(run: Path) -> None:
    assert {f.name for f in run.iterdir()} == FILES
    for name in ("object_match.png", "distance.png"):
        with Image.open(run / name) as image:
            assert image.format == "PNG" and min(image.size) > 500


def test_the_same_input_gives_the_same_bytes(run: Path, tmp_path: Path) -> None:
    again = write_run(tmp_path / "again", fake_rows()[::-1])
    write_report(again, photo)
    assert {k: v for k, v in contents(again).items() if k != "results.jsonl"} == {
        k: v for k, v in contents(run).items() if k != "results.jsonl"
    }


@pytest.mark.usefixtures("without_figures")
def test_a_report_that_is_written_again_is_the_same(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", fake_rows(1, 2))
    write_report(folder, photo)
    before = contents(folder)
    write_report(folder, photo)
    assert contents(folder) == before


def test_results_json_has_the_promised_keys(run: Path) -> None:
    summary = json.loads((run / "results.json").read_text("utf-8"))
    assert summary["seed"] == SETTINGS["seed"]
    assert summary["made_by"]["detector"] == "ground truth (dollhouse)"
    for method in METHODS:
        for kind in TYPES:
            x = summary["methods"][method][kind]
            assert {"n", "match", "distance_mean_m", "distance_median_m"} <= set(x)
            assert list(x["success"]) == ["0.25", "0.5", "1", "1.5", "2"]


def test_the_report_says_who_made_it_and_whose_the_papers_numbers_are(run: Path) -> None:
    text = (run / "report.md").read_text("utf-8")
    for word in (
        "detector | ground truth (dollhouse)",
        "embedded (cards and MiniLM)",
        "2026-11-21",
        "0123abc",
        "0.231",
    ):
        assert word in text
    assert "other scenes, other requests and another detector" in text
    assert "| CARTIER, ObjectDepth | " in text and "*1.09*" in text
    assert "Not complete" not in text
    for name in re.findall(r"\]\(([^)]+)\)", text):
        assert (run / name).is_file()


def test_a_ground_truth_of_seven_homes_is_one_detector(tmp_path: Path) -> None:
    rows = [row(home, "q", "object_depth", detector=f"ground truth (dollhouse {home})") for home in ("flat", "studio")]
    assert write_report(write_run(tmp_path / "run", rows))["made_by"]["detector"] == "ground truth (dollhouse)"
    rows[1]["detector"] = "onnx (FastestDet)"
    both = write_report(write_run(tmp_path / "run", rows))["made_by"]["detector"]
    assert both == "ground truth (dollhouse), onnx (FastestDet)", "what is mixed is said"


def test_every_markdown_table_is_square(run: Path) -> None:
    for block in re.findall(r"(?:^\|.*\n)+", (run / "report.md").read_text("utf-8"), re.M):
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}) == 1


def test_the_csv_holds_the_numbers_of_the_summary(run: Path) -> None:
    lines = list(csv.DictReader(io.StringIO((run / "tables.csv").read_text("utf-8"))))
    summary = json.loads((run / "results.json").read_text("utf-8"))["methods"]
    assert len(lines) == len(METHODS) * len(TYPES)
    for line in lines:
        x = summary[line["method"]][line["type"]]
        assert float(line["match"]) == x["match"]
        assert float(line["distance_mean_low_m"]) == x["distance_mean_ci"][0]
        assert float(line["success_1_m"]) == x["success"]["1"]


def test_the_latex_table_is_square(run: Path) -> None:
    text = (run / "table.tex").read_text("utf-8")
    assert text.count("{") == text.count("}")
    body = [line for line in text.splitlines() if line.startswith(tuple(TITLES.values()))]
    assert len(body) == len(METHODS) and {line.count("&") for line in body} == {9}


def test_failures_have_their_words_and_photos(run: Path) -> None:
    data = data_of(run)
    rows = fake_rows()
    bad = [r for r in rows if not r["match"] or r["distance_m"] is None or r["distance_m"] > 1]
    assert len(data["failures"]) == len(bad)
    for failure in data["failures"]:
        case = data["cases"][failure["case"]]
        (mine,) = [
            r
            for r in bad
            if (r["home"], r["query_id"], r["method"]) == (case["home"], case["query"], failure["method"])
        ]
        assert (case["text"], case["target"], failure["object"]) == (mine["text"], mine["target"], mine["object"])
        assert (failure["photo"] is None) == (mine["frame"] is None or mine["frame"] % 5 == 0)
        if failure["photo"]:
            with Image.open(run / failure["photo"]) as image:
                assert abs(np.asarray(image).mean() - mine["frame"]) < 3
        assert [a[0] for a in case["answers"]] == list(METHODS)


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]


def tags(folder: Path) -> Tags:
    parser = Tags()
    parser.feed((folder / "failures.html").read_text("utf-8"))
    return parser


def test_hostile_words_stay_words(run: Path, tmp_path: Path) -> None:
    bad = {"match": False, "distance_m": 4.0, "distance_floor_m": 3.0}
    words = dict.fromkeys(("text", "target", "note", "detector", "reasoner", "status", "object"), HOSTILE) | {
        "status": HOSTILE[:40]
    }
    rows = [row(HOSTILE, HOSTILE, "object_depth", accept=[HOSTILE], **bad, **words)]
    folder = write_run(tmp_path / "run", rows, SETTINGS | {"note": HOSTILE, HOSTILE: "\ud800"})
    write_report(folder, photo)
    assert tags(folder).seen == tags(run).seen, "no tag comes from the data"
    data = data_of(folder)
    assert (data["cases"][0]["text"], data["failures"][0]["object"]) == (HOSTILE, HOSTILE)
    text = (folder / "report.md").read_text("utf-8")
    assert "<" not in text and not re.search(r"(?<!\\)(\]\(h|`x|\$x)", text)
    latex = (folder / "table.tex").read_text("utf-8")
    assert "\\input{" not in latex and "$x" not in latex.replace("\\$x", "")


def test_the_page_needs_nothing_from_elsewhere(run: Path) -> None:
    html = (run / "failures.html").read_text("utf-8")
    assert tags(run).links == [] and "://" not in html
    assert "default-src 'none'" in html and "unsafe" not in html
    script = (Path(page.__file__).parent / "failures.js").read_text("utf-8")
    assert not re.search(r"innerHTML|outerHTML|insertAdjacent|document\.write|eval\(", script)


@pytest.mark.usefixtures("without_figures")
def test_photos_and_failures_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "MAX_PHOTOS", 3)
    monkeypatch.setattr(page, "MAX_LISTED", 8)
    rows = [row("h", f"q{n:02}", "random", match=False, distance_m=2.0, frame=1 + n // 2) for n in range(10)]
    folder = write_run(tmp_path / "run", rows)
    write_report(folder, lambda home, frame: np.zeros((2000, 3000, 3), np.uint8))
    data = data_of(folder)
    assert len(data["failures"]) == 8 and "first 8 of 10" in data["left_out"]
    assert len({f["photo"] for f in data["failures"]} - {None}) == 3
    assert {f.name for f in (folder / "failures").iterdir()} == {"photos.json", "0001.jpg", "0002.jpg", "0003.jpg"}
    with Image.open(folder / "failures" / "0001.jpg") as image:
        assert max(image.size) <= page.PHOTO_SIDE_PX
    write_report(folder)
    assert [f.name for f in (folder / "failures").iterdir()] == ["photos.json"], "old photos of a report are gone"


def test_a_run_with_methods_and_types_missing(tmp_path: Path) -> None:
    rows = [
        row("h", "a", "nlmap"),
        row("h", "b", "nlmap"),
        row("h", "a", "my_method", distance_m=None, object=None, match=False),
    ]
    folder = write_run(tmp_path / "run", rows, {})
    summary = write_report(folder)
    assert summary["methods"]["my_method"]["implicit"]["distance_mean_m"] is None
    text = (folder / "report.md").read_text("utf-8")
    assert "**Not complete:** my method answered 1 of 2 implicit pairs" in text
    assert "ObjectDepth minus the other" not in text
    assert len(data_of(folder)["failures"]) == 1


def test_a_run_without_a_failure(tmp_path: Path) -> None:
    write_report(write_run(tmp_path / "run", [row("h", "a", "true_object")]), photo)
    assert data_of(tmp_path / "run")["failures"] == []


FAULTS = [
    ("", "holds no answer yet"),
    ('{"home": "h"\n', "line 1: not valid JSON"),
    (json.dumps(row("h", "q", "nlmap")) + "\n[1]\n", "line 2: the line"),
    (json.dumps(row("h", "q", "nlmap")) + "\n\n" + json.dumps(row("h", "q", "nlmap", distance_m=float("nan"))),
        "line 3: not valid JSON (NaN"),
    (json.dumps(row("h", "q", "nlmap"))[:-9], "line 1: not valid JSON"),
    ("\xff", "line 1: not valid JSON"),
    ("[" * 100_000, "line 1: not valid JSON"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "fault"), FAULTS, ids=[fault for _, fault in FAULTS])
def test_broken_results_are_named_in_one_line_and_leave_no_report(tmp_path: Path, text: str, fault: str) -> None:
    folder = write_run(tmp_path / "run", [])
    (folder / "results.jsonl").write_text(text, "utf-8")
    with pytest.raises(InputError) as caught:
        write_report(folder)
    assert fault in str(caught.value) and "\n" not in str(caught.value)
    assert {f.name for f in folder.iterdir()} == {"results.jsonl", "settings.json"}


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"settings.json is missing"):
        write_report(tmp_path)
    folder = write_run(tmp_path / "run", fake_rows(1, 1), SETTINGS | {"seed": "x"})
    with pytest.raises(InputError, match="seed must be a whole number"):
        write_report(folder)


@pytest.mark.usefixtures("without_figures")
def test_a_fault_while_drawing_leaves_the_old_report_whole(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", fake_rows(1, 2))
    write_report(folder, photo)
    before = contents(folder)

    def broken(home: str, frame: int) -> None:
        raise InputError("the home is gone")

    with pytest.raises(InputError, match="the home is gone"):
        write_report(folder, broken)
    assert contents(folder) == before


def mark(file: Path, decide: Any, delimiter: str = ",") -> None:
    """What a person does in a spreadsheet."""
    lines = list(csv.DictReader(io.StringIO(file.read_text("utf-8-sig"))))
    buffer = io.StringIO()
    out = csv.DictWriter(buffer, list(lines[0]), delimiter=delimiter)
    out.writeheader()
    out.writerows(line | {"served": decide(n, line)} for n, line in enumerate(lines))
    file.write_text(buffer.getvalue(), "utf-8-sig")


def verdicts(rows: list[dict[str, Any]]) -> dict[tuple[str, str, str], bool]:
    return {(r["home"], r["text"], r["object"]): r["match"] for r in rows if r["object"] is not None}


def test_marking_is_blind_and_asks_once(tmp_path: Path) -> None:
    rows = fake_rows()
    rows = [r | {"match": r["object"] in r["accept"]} for r in rows]
    count = export_marking(rows, tmp_path / "marks.csv")
    lines = list(csv.DictReader(io.StringIO((tmp_path / "marks.csv").read_text("utf-8-sig"))))
    assert count == len(lines) == len(verdicts(rows))
    assert set(lines[0]) == {"key", "home", "type", "request", "robot_went_to", "served"}
    assert {line["served"] for line in lines} == {""}
    assert agreement(rows, tmp_path / "marks.csv") == {"n": 0, "agree": None, "kappa": None, "unmarked": count}


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_a_person_who_agrees_and_one_who_does_not(tmp_path: Path, delimiter: str) -> None:
    rows = [r | {"match": r["object"] in r["accept"]} for r in fake_rows()]
    truth, file = verdicts(rows), tmp_path / "marks.csv"

    def same(n: int, line: dict[str, str]) -> str:
        return "Yes" if truth[line["home"], line["request"], line["robot_went_to"]] else "no "

    count = export_marking(rows, file)
    mark(file, same, delimiter)
    assert agreement(rows, file) == {"n": count, "agree": 1, "kappa": 1, "unmarked": 0}
    export_marking(rows, file)
    mark(file, lambda n, line: "no" if same(n, line) == "Yes" else "yes", delimiter)
    opposite = agreement(rows, file)
    assert opposite["agree"] == 0 and opposite["kappa"] < 0
    export_marking(rows, file)
    mark(file, lambda n, line: "yes" if n % 2 else "", delimiter)
    half = agreement(rows, file)
    assert (half["n"], half["unmarked"], half["kappa"]) == (count // 2, count - count // 2, 0), (
        "yes to all agrees by chance"
    )


def test_words_that_a_spreadsheet_would_run(tmp_path: Path) -> None:
    rows = [row("=home", "q", "nlmap", text="=HYPERLINK(1)", object="@x")]
    export_marking(rows, tmp_path / "marks.csv")
    (line,) = csv.DictReader(io.StringIO((tmp_path / "marks.csv").read_text("utf-8-sig")))
    assert not any(str(cell).startswith(("=", "@", "+", "-")) for cell in line.values())
    mark(tmp_path / "marks.csv", lambda n, line: "yes")
    assert agreement(rows, tmp_path / "marks.csv")["agree"] == 1


def test_broken_markings(tmp_path: Path) -> None:
    rows, file = fake_rows(1, 3), tmp_path / "marks.csv"
    rows = [r | {"match": r["object"] in r["accept"]} for r in rows]
    export_marking(rows, file)
    mark(file, lambda n, line: "perhaps" if n == 1 else "")
    with pytest.raises(InputError, match="line 3: 'perhaps' in the column served; write yes or no"):
        agreement(rows, file)
    export_marking(rows, file)
    text = file.read_text("utf-8-sig")
    for broken, fault in [
        (text + text.splitlines()[1], "was marked on a line before"),
        (text + "answer-0,,,,,yes", "is no answer of this run"),
        ("a,b\n1,2\n", "has no columns key and served"),
        ("", "has no columns key and served"),
    ]:
        file.write_text(broken, "utf-8")
        with pytest.raises(InputError, match=fault):
            agreement(rows, file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        agreement(rows, file)
    with pytest.raises(InputError, match="is missing"):
        agreement(rows, tmp_path / "none.csv")
    with pytest.raises(InputError, match="right in one row and wrong in another"):
        export_marking([row("h", "q", "nlmap"), row("h", "q", "random", match=False)], file)


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of the tables alone: drawing takes most of a report's time."""
    for name in ("distance_png", "match_png"):
        monkeypatch.setattr(f"cartier_bench.report.{name}", lambda summary, who: b"")


@pytest.mark.usefixtures("without_figures")
def test_every_table_says_whether_the_objects_come_from_pixels(run: Path, tmp_path: Path) -> None:
    seen = [row | {"detector": "embedded dollhouse detector (counts from 0.3)"} for row in fake_rows()]
    folder, truth = write_run(tmp_path / "run", seen), tmp_path / "truth"
    shutil.copytree(run, truth)
    for objects_from, other, summary in (
        ("from pixels", "ground truth", write_report(folder)),
        ("ground truth", "from pixels", write_report(truth, photo)),
    ):
        of = folder if objects_from == "from pixels" else truth
        assert summary["objects_from"] == objects_from
        tables = re.findall(r"(?:^\|.*\n)+", (of / "report.md").read_text("utf-8"), re.M)
        assert len(tables) > 8
        assert all(
            f"({objects_from})" in table and f"({other})" not in table for table in tables[1:]
        )  # the first is the head
        assert f"Objects: {objects_from}." in (of / "table.tex").read_text("utf-8")
        lines = csv.DictReader(io.StringIO((of / "tables.csv").read_text("utf-8")))
        assert {line["objects"] for line in lines} == {objects_from}


@pytest.mark.usefixtures("without_figures")
def test_runs_stand_side_by_side(run: Path, tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", [row | {"detector": "onnx | (mine)"} for row in fake_rows(seed=1)])
    write_report(folder, beside=[run])
    text = (folder / "report.md").read_text("utf-8")
    table = "\n".join(
        line for line in text.split("## Side by side")[1].split("\n## ")[0].splitlines() if line.startswith("|")
    )
    mine, theirs = (json.loads((f / "results.json").read_text("utf-8"))["methods"] for f in (folder, run))
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert lines[0][2:4] == ["match (from pixels)", "match (ground truth)"]
    assert len(lines) == 2 + len(METHODS) * len(TYPES)
    a, b = mine["object_depth"]["explicit"], theirs["object_depth"]["explicit"]
    assert lines[2][:4] == [
        "CARTIER, ObjectDepth",
        "explicit",
        f"{100 * a['match']:.0f} %",
        f"{100 * b['match']:.0f} %",
    ]
    assert lines[2][6:] == [f"{a['distance_mean_m']:.2f}", f"{b['distance_mean_m']:.2f}"]
    assert text.count("\\| (mine)") >= 2, "words from outside stay in their cell"
    twin = write_run(tmp_path / "twin", fake_rows(seed=2))
    write_report(twin, beside=[run])
    assert "match (ground truth, run)" in (twin / "report.md").read_text("utf-8")
    assert "Side by side" not in (run / "report.md").read_text("utf-8")
