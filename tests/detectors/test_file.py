"""Detections of another program: every accepted form says the same, and every fault has its line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tiny_onnx import frame

from cartier import plugins
from cartier.detectors import rows
from cartier.errors import BackendError, CartierError, InputError

COCO = [
    {"image_id": 1, "category_id": 7, "bbox": [10, 20, 30, 10], "score": 0.85},
    {"image_id": 0, "category_id": 9, "bbox": [1, 2, 3, 4], "score": 0.9, "segmentation": {"counts": "x"}},
    {"image_id": 1, "category_id": 9, "bbox": [-2, 40, 10, 10.5], "score": 0.95},
    {"image_id": 1, "category_id": 9, "bbox": [5, 5, 5, 5], "score": 0.8},
]
CATEGORIES = [{"id": 7, "name": "coffee_maker"}, {"id": 9, "name": "mug"}]
OWN = [
    {"frame": 1, "label": "CoffeeMaker", "score": 0.85, "xyxy": [10, 20, 40, 30]},
    {"frame": 0, "label": "mug", "score": 0.9, "xyxy": [1, 2, 4, 6]},
    {"frame": 1, "label": "mug", "score": 0.95, "xyxy": [-2, 40, 8, 50.5]},
    {"frame": 1, "label": "mug", "score": 0.8, "xyxy": [5, 5, 10, 10]},
]
PER_FRAME = [
    {"frame": 1, "detections": [{k: v for k, v in OWN[i].items() if k != "frame"} for i in (0, 2, 3)]},
    {"frame": 0, "detections": [{"label": "mug", "score": 0.9, "xyxy": [1, 2, 4, 6]}]},
    {"frame": 5, "detections": []},
]


def lines(items: list[Any]) -> str:
    return "\n".join(map(json.dumps, items)) + "\n"


def make(path: Path, **options: Any) -> Any:
    return plugins.make("detectors", "file", path=path, **options)


def write(folder: Path, text: str, categories: Any = None) -> Path:
    path = folder / "eva.json"
    path.write_text(text, encoding="utf-8")
    if categories is not None:
        (folder / "eva.categories.json").write_text(json.dumps(categories))
    return path


FORMS = {
    "coco": (json.dumps(COCO), CATEGORIES),
    "coco, indented, annotations": ("\n " + json.dumps(COCO, indent=2) + "\n", {"categories": CATEGORIES, "info": {}}),
    "coco lines": (lines(COCO), CATEGORIES),
    "own lines": (lines(OWN), None),
    "own lines, blank ones between, BOM": ("\ufeff\n" + lines(OWN).replace("\n", "\r\n\r\n"), None),
    "own list": (json.dumps(OWN), None),
    "per frame": (lines(PER_FRAME), None),
}


@pytest.mark.parametrize("chunk", [1, 7, 2**20])
@pytest.mark.parametrize("form", FORMS)
def test_every_form_says_the_same(form: str, chunk: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "CHUNK", chunk)
    detector = make(write(tmp_path, *FORMS[form]))
    one = detector.detect(frame(1))
    assert one.labels == ("mug", "coffee maker", "mug")
    assert one.scores.tolist() == pytest.approx([0.95, 0.85, 0.8])  # best first
    assert one.boxes_xyxy.tolist()[:2] == [[0, 40, 8, 48], [10, 20, 40, 30]]
    assert detector.detect(frame(0)).boxes_xyxy.tolist() == [[1, 2, 4, 6]]
    assert len(detector.detect(frame(2))) == 0
    assert detector.name == "file eva.json (counts from 0.8)"
    assert detector.notes[0] == "eva.json: 4 of 4 detections score 0.512 or more"


def test_a_list_of_names_counts_from_one_and_says_so(tmp_path: Path) -> None:
    path = write(tmp_path, json.dumps([COCO[0] | {"category_id": 2}]), ["mug", "coffee_maker"])
    detector = make(path)
    assert detector.detect(frame(1)).labels == ("coffee maker",)
    assert "'mug', is taken for category 1" in detector.notes[1]


def test_image_ids_go_by_the_order_of_the_images(tmp_path: Path) -> None:
    images = [{"id": 900, "file_name": "f9.jpg"}, {"id": 17, "file_name": "f10.jpg", "width": 64, "height": 48}]
    named = tmp_path / "lvis.json"
    named.write_text(json.dumps({"images": images, "categories": CATEGORIES}))
    path = write(tmp_path, json.dumps([COCO[0] | {"image_id": 17}, COCO[1] | {"image_id": 900}]))
    detector = make(path, categories=named)
    assert [len(detector.detect(frame(i))) for i in (0, 1)] == [1, 1]
    assert "2 images" in detector.notes[1]
    with pytest.raises(InputError, match="lists 2 images, but the recording has a frame 2"):
        detector.detect(frame(2))
    with pytest.raises(InputError, match=r"image 1 is \(64, 48\) px .* the recording is \(48, 64\)"):
        detector.detect(frame(1, 48, 64))


def test_a_file_that_goes_beyond_the_recording_is_noted(tmp_path: Path) -> None:
    detector = make(write(tmp_path, lines([OWN[1], OWN[0] | {"frame": 139}])))
    assert len(detector.notes) == 1
    detector.detect(frame(0))
    assert "1 detections belong to frames after 0" in detector.notes[1]
    assert "(up to 139)" in detector.notes[1]
    detector.detect(frame(139))
    assert len(detector.notes) == 1


def test_the_threshold_is_the_users(tmp_path: Path) -> None:
    path = write(tmp_path, lines(OWN))
    low = make(write(tmp_path, lines([*OWN, OWN[0] | {"score": 0.1}])), threshold=0.0)
    assert len(low.detect(frame(1))) == 4 and len(make(path, threshold=1.0).detect(frame(1))) == 3
    for threshold in (-0.1, 1.1, float("nan")):
        with pytest.raises(BackendError, match="threshold must be from 0 to 1"):
            make(path, threshold=threshold)
    with pytest.raises(InputError, match=r"none of its 1 detections scores 0.64 or more \(the best has 0.1\): lower"):
        make(write(tmp_path, lines([OWN[0] | {"score": 0.1}])), threshold=1.0)


def test_slivers_are_dropped_with_their_labels(tmp_path: Path) -> None:
    sliver = OWN[0] | {"xyxy": [-5, 0, 0.5, 10], "score": 0.99}
    found = make(write(tmp_path, lines([sliver, OWN[0]]))).detect(frame(1))
    assert (found.labels, found.boxes_xyxy.tolist()) == (("coffee maker",), [[10, 20, 40, 30]])


@pytest.mark.parametrize("box", [[0, 0, 128, 96], [70, 0, 90, 10], [-7, 0, 10, 10], [0, 0, 10, 53]])
def test_boxes_of_images_of_another_size(box: list[float], tmp_path: Path) -> None:
    detector = make(write(tmp_path, lines([OWN[1], OWN[0] | {"xyxy": box}])))
    with pytest.raises(InputError, match=r"eva.json line 2: the box .* reaches out of frame 1, which is 64x48 px"):
        detector.detect(frame(1))


ROW = '{"frame": 0, "label": "a", "score": 0.9, "xyxy": [1, 2, 3, 4]}'
FAULTS = {
    "": "holds no detections",
    "[]": "holds no detections",
    "hello": "line 1: expected {, got h",
    "3": "line 1: expected {, got 3",
    f"[{ROW},\n[1]]": r"line 2: expected {, got \[",
    f"[{ROW},\n]": r"line 2: expected {, got \]",
    f"[{ROW}\n{ROW}]": "line 2: the list is not closed",
    f"[{ROW},\n": "line 2: expected {, got the end of the file",
    f"[{ROW}\n": "line 2: the list is not closed: is the file truncated",
    f"[{ROW}]\n[]": "line 2: something follows the list",
    f"{ROW}\n{ROW[:-4]}": "line 2: not valid JSON",
    f'{ROW}\n{{"frame": 0,\n "label": oops}}': "line 3: not valid JSON",
    f"{ROW}\n{ROW.replace('0.9', 'NaN')}": "line 2: .*NaN is no JSON number",
    f"{ROW}\n{ROW.replace('0.9', '9' * 5000)}": "line 2: ",
    '{"a":' * 100_000: "line 1: ",
    f'{ROW}\n{{"box": [1, 2, 3, 4]}}': "line 2: a detection must be COCO results .*image_id.* or .*frame",
    '{"images": [], "categories": []}': "these are annotations, not detections",
    ROW.replace('"frame": 0', '"frame": -1'): "frame must be a whole number from 0, got -1",
    ROW.replace('"frame": 0', '"frame": 0.5'): "frame must be a whole number from 0, got 0.5",
    ROW.replace('"frame": 0', '"frame": true'): "frame must be a whole number from 0, got True",
    ROW.replace('"a"', "null"): "'label' must be a name of 200 characters at most, got nothing",
    ROW.replace('"a"', '" _ "'): "'label' must be a name",
    ROW.replace('"a"', f'"{"x" * 201}"'): "'label' must be a name of 200 characters at most, got 'xxxxx+…'$",
    ROW.replace('"a"', "[" * 800 + "]" * 800): "'label' must be a name",
    ROW.replace("0", "1" * 4000, 1): "frame must be a whole number from 0, got 1111+…$",
    ROW.replace("0.9", "90"): "'score' must be a number from 0 to 1, got 90",
    ROW.replace("0.9", '"0.9"'): "'score' must be a number from 0 to 1, got '0.9'",
    ROW.replace("[1, 2, 3, 4]", "[1, 2, 3]"): "'xyxy' must be 4 numbers",
    ROW.replace("[1, 2, 3, 4]", '"1 2 3 4"'): "'xyxy' must be 4 numbers",
    ROW.replace("[1, 2, 3, 4]", "[1, 2, 3, 1e400]"): "'xyxy' must be 4 numbers",
    ROW.replace("[1, 2, 3, 4]", "[5, 2, 3, 4]"): "'xyxy' must be .* with x2 >= x1",
    '{"frame": 0, "detections": 3}': "'detections' must be a list, got 3",
    '{"frame": 0, "detections": [3]}': "a detection must be",
    json.dumps(COCO[0] | {"image_id": "f.jpg"}): "'image_id' must be a whole number, got 'f.jpg'",
    json.dumps(COCO[0]): "category_id 7 needs a name: put .* beside the file as NAME.categories.json",
}


@pytest.mark.parametrize("text", FAULTS, ids=range(len(FAULTS)))
def test_a_fault_has_its_line(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=FAULTS[text]) as caught:
        make(write(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert "eva.json" in str(caught.value)


@pytest.mark.parametrize(
    ("categories", "row", "match"),
    [
        (CATEGORIES, {"category_id": 8}, "eva.json line 1: there is no category 8 in .*eva.categories.json"),
        (["a", "b"], {"category_id": 0}, "there is no category 0"),
        (CATEGORIES, {"bbox": [10, 10, -5, 5]}, r"'bbox' must be \[x, y, width, height\]"),
        ({"categories": CATEGORIES, "images": [{"id": 3}]}, {}, "there is no image 1 in"),
        ({"categories": CATEGORIES, "images": [{"id": 3}, {"id": 3}]}, {}, '"images" entry 1: its id 3 comes twice'),
        ({"categories": CATEGORIES, "images": {}}, {}, '"images" must be a list'),
        (
            {"categories": CATEGORIES, "images": [{"id": 1, "file_name": "10.jpg"}, {"id": 2, "file_name": "9.jpg"}]},
            {},
            "must be in the order of the recording, but '9.jpg' comes too late",
        ),
        ([], {}, 'must hold "categories"'),
        ({"names": ["a"]}, {}, 'must hold "categories"'),
        ("chair", {}, 'must hold "categories"'),
        ([{"id": "7", "name": "x"}], {}, '"categories" entry 0: its id 7 is no whole number'),
        ([3], {}, '"categories" entry 0'),
        ([{"id": [7], "name": "x"}], {}, '"categories" entry 0: its id .7. is no whole number'),
        ([{"id": 7, "name": "x" * 201}], {}, "category 7 has no name of 200 characters at most"),
        ([{"id": 7, "name": ""}], {}, "category 7 has no name"),
        ([{"id": 7}], {}, "category 7 has no name"),
    ],
)  # fmt: skip
def test_categories_that_do_not_fit(categories: Any, row: dict[str, Any], match: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=match):
        make(write(tmp_path, json.dumps([COCO[0] | row]), categories))


def test_files_that_are_missing_large_or_no_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"nowhere\.jsonl is missing"):
        make(tmp_path / "nowhere.jsonl")
    with pytest.raises(InputError, match=r"nowhere\.json is missing"):
        make(write(tmp_path, lines(OWN)), categories=tmp_path / "nowhere.json")
    path = write(tmp_path, lines(OWN))
    path.write_bytes(b"\xff\xfe" + path.read_bytes())
    with pytest.raises(InputError, match="is not UTF-8 text"):
        make(path)
    monkeypatch.setattr(rows, "MAX_FILE_BYTES", 100)
    with pytest.raises(InputError, match="is larger than"):
        make(path)


def test_one_endless_record_is_refused_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "MAX_RECORD_CHARACTERS", 1000)
    monkeypatch.setattr(rows, "CHUNK", 100)
    with pytest.raises(InputError, match="one object of more than 1000 characters"):
        make(write(tmp_path, ROW[:-1] + ', "note": "' + "x" * 5000 + '"}'))


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_list_cut_anywhere_is_never_taken(data: st.DataObject, tmp_path: Path) -> None:
    whole = json.dumps(OWN, indent=1)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(CartierError):
        make(write(tmp_path, whole[:cut]))


@given(
    st.lists(
        st.tuples(st.integers(0, 4), st.sampled_from(["mug", "chair"]), st.integers(0, 10), st.integers(0, 60)),
        max_size=30,
    )
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_nothing_is_lost_or_mixed_up(tmp_path: Path, drawn: list[tuple[int, str, int, int]]) -> None:
    rows = [
        {"frame": f, "label": n, "score": s / 10, "xyxy": [x, 0, x + 4, 9]}
        for f, n, s, x in [*drawn, (0, "mug", 10, 0)]
    ]
    detector = make(write(tmp_path, lines(rows)), threshold=0.5)
    for index in range(5):
        found = detector.detect(frame(index))
        scores, lefts = (
            np.round(column.astype(float), 1).tolist() for column in (found.scores, found.boxes_xyxy[:, 0])
        )
        got = list(zip(found.labels, scores, lefts, strict=True))
        wanted = [
            (r["label"], r["score"], r["xyxy"][0])
            for r in rows
            if r["frame"] == index and r["score"] >= detector.score_model.zero_weight_score
        ]
        assert sorted(got) == sorted(wanted)
