"""What ``fuzz.py`` breaks: every kind of file that the program reads, made as the tests make it, and read as the program does.

Another kind is one more entry of ``KINDS``: how a good one is written into a folder, and how it is read. The tests' folders
must be in ``sys.path``, as ``fuzz.py`` puts them there.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fake_runs import SETTINGS, fake_rows
from layouts import LAYOUTS, room
from tiny_onnx import CHANNELS, frame, red_finder

from cartier import corrections, pipeline, plugins
from cartier.detectors import onnx
from cartier.detectors._vocabulary import read_vocabulary
from cartier.evaluation._rows import check_rows, read_rows
from cartier.evaluation.queries import load_file
from cartier.evaluation.summary import summarise
from cartier.files import read_json, read_npz
from cartier.home import Home
from cartier.mapping.detection_cache import remembering
from cartier.reasoners._cards import read_deck
from cartier.types import Selection
from cartier.worlds.ai2thor import _house
from cartier.worlds.dollhouse.scene import load_scene
from synthetic import THINGS, TrueBoxes


@dataclass(frozen=True)
class Kind:
    """``write`` makes a good one in a folder that it may create; ``read`` reads all of it and raises what it raises."""

    write: Callable[[Path], object]
    read: Callable[[Path], object]
    starts_threads: bool = False


def read_recording(path: Path) -> None:
    recording = plugins.open_recording(path)
    recording.fingerprint()
    for number in range(min(len(recording), 30)):  # a frame that a file names a thousand times is read a thousand times
        recording[number]


class First:
    """A reasoner that takes the first object, so that a home is read without a model."""

    name = "first"

    def select(self, query: str, objects: Sequence[str], dialogue: object = ()) -> Selection:
        return Selection("found", objects[0]) if objects else Selection("absent")

    def propose(self, query: str) -> list[str]:
        return []


def write_home(path: Path, **options: object) -> None:
    pipeline.map_home(room(frames=12), TrueBoxes(THINGS), **options).save(path)  # type: ignore[arg-type]


def read_home(path: Path) -> None:
    home = Home.load(path)
    for index in home.indexes:
        home.table(index)
        answer = pipeline.ask(home, "I would love to sit down", First(), index=index)
        json.dumps(answer.to_dict(), allow_nan=False)
        if answer.place is not None:
            home.keyframe(answer.place)


def write_corrections(path: Path) -> None:
    home = path.parent / f"{path.name}-home"
    write_home(home)
    for what, about in (("name", {"name": "Ayo’s"}), ("move", {"to_xy": (1.0, 1.0)}), ("forget", {}), ("undo", {})):
        Home.load(home).correct(what, Home.load(home).objects[0].id if what != "undo" else "", **about)  # type: ignore[arg-type]
    path.mkdir()
    (home / corrections.LOG).rename(path / corrections.LOG)


def read_corrections(path: Path) -> None:
    log, notes = corrections.read_log(path)
    known = corrections.apply(log, (), (), None)
    json.dumps([*notes, *known.notes], ensure_ascii=False).encode()


def write_detections(path: Path, own: bool) -> None:
    path.mkdir()
    rows = [{"frame": i, "label": "mug", "score": 0.9, "xyxy": [1, 2 + i, 30.5, 40]} for i in range(4)]
    coco = [{"image_id": 7 + i, "category_id": 9, "bbox": [1, 2, 30.5, 9 + i], "score": 0.9} for i in range(4)]
    text = "\n".join(map(json.dumps, rows)) if own else json.dumps(coco)
    (path / f"eva.json{'l' if own else ''}").write_text(text)
    images = [{"id": 7 + i, "file_name": f"{i}.jpg", "width": 64, "height": 48} for i in range(4)]
    about = {"categories": [{"id": 9, "name": "mug"}, {"id": 7, "name": "coffee_maker"}], "images": images}
    (path / "eva.categories.json").write_text(json.dumps(about))


def read_detections(path: Path) -> None:
    file = next(path.glob("eva.json*"), path / "eva.json")
    detector = plugins.make("detectors", "file", path=file)
    for number in range(4):
        detector.detect(frame(number))


def write_onnx(path: Path, layout: str) -> None:
    path.mkdir()
    red_finder(path / "m.onnx", layout)


def read_onnx(path: Path) -> None:
    onnx.make(path / "m.onnx", path / "m.json", threads=1).detect(frame())


def write_text(path: Path, **files: str) -> None:
    path.mkdir()
    for name, text in files.items():
        (path / name.replace("__", ".")).write_text(text, encoding="utf-8")


def write_bench(path: Path) -> None:
    rows = "".join(json.dumps(row) + "\n" for row in fake_rows(homes=1, targets=2))
    write_text(path, settings__json=json.dumps(SETTINGS), results__jsonl=rows)


def read_bench(path: Path) -> None:
    read_json(path / "settings.json")
    summarise(check_rows(read_rows(path / "results.jsonl")), resamples=100)


def write_resume(path: Path) -> None:
    path.mkdir()
    read_resume(path)


def read_resume(path: Path) -> None:
    settings = {"sha256": "a", "detector": "b", "detector_sha256": "c"}
    recording = room(frames=3)
    with remembering(TrueBoxes(THINGS), path / "seen.jsonl", settings) as detect:
        for number in range(3):
            detect(recording[number])


def write_arrays(path: Path) -> None:
    path.mkdir()
    cells = np.zeros(9, [("row", "<i4"), ("col", "<i4"), ("height_m", "<f2")])
    np.savez_compressed(path / "a.npz", cells=cells, frames=np.arange(9), names=np.array(["mug", "bed"]))


QUERY = {"id": "a", "type": "implicit", "target": "sofa", "accept": ["sofa", "arm chair"], "text": "My feet hurt."}
REPLY = {"query": "tired", "reply": '{"object": "bed"}', "objects": ["bed", "mug"]}
CARDS = "[chair]\nsynonyms = ['seat']\nuses = ['sit down', 'rest']\nbeside = ['table']\n\n[mug]\nuses = ['drink tea']\n"
HOUSE = {
    "rooms": [{"id": "room|1", "roomType": "Kitchen"}],
    "metadata": {"agent": {"horizon": 30, "position": {"x": 1}}},
}
SCENE = (Path(pipeline.__file__).parent / "worlds/dollhouse/homes/family_flat.yaml").read_text(encoding="utf-8")

KINDS: dict[str, Kind] = {name: Kind(write, read_recording) for name, write in LAYOUTS.items()}
KINDS |= {
    f"onnx-{layout}": Kind(lambda p, layout=layout: write_onnx(p, layout), read_onnx, True) for layout in CHANNELS
}
KINDS |= {
    "detections-own": Kind(lambda p: write_detections(p, True), read_detections),
    "detections-coco": Kind(lambda p: write_detections(p, False), read_detections),
    "vocabulary": Kind(
        lambda p: write_text(p, names__txt="# names\nmug\tcup\tbeaker\nsofa\nCoffeeMachine\n"),
        lambda p: read_vocabulary(p / "names.txt"),
    ),
    "replies": Kind(
        lambda p: write_text(p, replies__jsonl=f"{json.dumps(REPLY)}\n{json.dumps(REPLY)}\n"),
        lambda p: plugins.make("reasoners", "replay", path=p / "replies.jsonl").select("tired", ["bed", "mug"]),
    ),
    "queries": Kind(
        lambda p: write_text(p, queries__jsonl=f"{json.dumps(QUERY)}\n{json.dumps(QUERY | {'id': 'b'})}\n"),
        lambda p: load_file(p / "queries.jsonl"),
    ),
    "cards": Kind(lambda p: write_text(p, cards__toml=CARDS), lambda p: read_deck(p / "cards.toml")),
    "dollhouse-home": Kind(lambda p: write_text(p, home__yaml=SCENE), lambda p: load_scene(p / "home.yaml")),
    "thor-house": Kind(lambda p: write_text(p, house__json=json.dumps(HOUSE)), lambda p: _house(p / "house.json")),
    "bench-run": Kind(write_bench, read_bench),
    "resume": Kind(write_resume, read_resume),
    "arrays": Kind(write_arrays, lambda p: read_npz(p / "a.npz")),
    "corrections": Kind(write_corrections, read_corrections),
    "home": Kind(write_home, read_home),
    "home-vlmaps": Kind(lambda p: write_home(p, indexes=["object_depth", "vlmaps"]), read_home),
}
