"""File formats that ``fuzz.py`` breaks: made as the tests make them, and read as the program does.

Another kind is one more entry of ``KINDS``: how a good one is written into a folder, and how it is read. The tests'
folders must be in ``sys.path``, as ``fuzz.py`` puts them there.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from exports import write_rtabmap_database
from fake_runs import SETTINGS, fake_rows
from fuzz_homes import read_home, read_loose_home, write_home, write_loose_home
from layouts import LAYOUTS, room
from tiny_onnx import CHANNELS, constant_net, frame, red_finder

import cartier_dollhouse
from cartier import plugins
from cartier.detectors import onnx
from cartier.detectors.vocabulary import read_vocabulary
from cartier.home import Home, correction_log
from cartier.home.corrected import apply
from cartier.io.files import read_json, read_npz
from cartier.mapping.detection_cache import cached
from cartier.recordings.hints import what_else
from cartier.types import Inventory
from cartier.understanding.cards import read_deck
from cartier_bench.queries import load_file
from cartier_bench.rows import check_rows, read_rows
from cartier_bench.summary import summarise
from cartier_bench.things import load_answers, load_items
from cartier_bench.thor.ai2thor import read_house
from cartier_dollhouse.scene import load_scene
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


def write_corrections(path: Path) -> None:
    home = path.parent / f"{path.name}-home"
    write_home(home)
    first, second = (obj.id for obj in Home.load(home).objects[:2])
    wishes: list[tuple[Any, Any, dict[str, Any]]] = [
        ("name", "home", {"name": "Ayo’s flat"}), ("name", first, {"name": "Ayo’s"}), ("confirm", first, {}),
        ("relabel", first, {"name": "box"}), ("add", "", {"name": "lamp", "to_xy": (1.0, 2.0)}), ("split", first, {}),
        ("move", first, {"to_xy": (1.0, 1.0)}), ("merge", first, {"other": second}), ("forget", first, {}),
        ("undo", "", {}),
    ]  # fmt: skip
    for what, about, more in wishes:
        Home.load(home).correct(what, about, **more)
    path.mkdir()
    (home / correction_log.LOG).rename(path / correction_log.LOG)


def read_corrections(path: Path) -> None:
    log, notes = correction_log.read_log(path)
    known = apply(log, (), (), None)
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


def write_database(path: Path) -> None:
    path.mkdir()
    write_rtabmap_database(room(), path / "home.db")


def write_archives(path: Path) -> None:
    """A recording as somebody downloads it."""
    path.mkdir()
    LAYOUTS["arcore-without-depth"](path / "scan")
    for kind in ("zip", "gztar"):
        shutil.make_archive(str(path / "packed"), kind, path / "scan")
    shutil.rmtree(path / "scan")


def read_archives(path: Path) -> None:
    """Only to say whether a recording is in it: as what is near a path that is none."""
    for file in (path, *path.glob("packed.*")):
        if file.exists() and not plugins.formats_of(file):
            what_else(file, plugins.formats_of)


def write_onnx(path: Path, layout: str) -> None:
    path.mkdir()
    red_finder(path / "m.onnx", layout)


def write_onnx_metadata(path: Path) -> None:
    """Without a sidecar."""
    path.mkdir()
    table, props = np.zeros((1, 300, 6)), {"names": "{0: 'mug', 1: 'bed'}", "task": "detect", "imgsz": "[32, 32]"}
    constant_net(path / "m.onnx", {"output0": table}, props=props)


def read_onnx(path: Path) -> None:
    sidecar = path / "m.json"
    onnx.make(path / "m.onnx", sidecar if sidecar.is_file() else None, threads=1).detect(frame())


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
    recording = room(frames=3)
    with cached(TrueBoxes(THINGS), path / "seen.jsonl", "a") as detect:
        for number in range(3):
            detect([recording[number]])


def write_arrays(path: Path) -> None:
    path.mkdir()
    cells = np.zeros(9, [("row", "<i4"), ("col", "<i4"), ("height_m", "<f2")])
    np.savez_compressed(path / "a.npz", cells=cells, frames=np.arange(9), names=np.array(["mug", "bed"]))


THING = {
    "id": "c",
    "home": "80001",
    "kind": "relation",
    "text": "the cup by the sink",
    "accept_ids": [3],
    "answer": None,
}
THINGS_MORE: tuple[dict[str, Any], ...] = (
    {}, {"id": "d", "kind": "list", "answer": ["cup", "bowl"], "maybe": ["pen"]},
    {"id": "e", "kind": "count", "answer": 2}
)  # fmt: skip
QUERY = {"id": "a", "type": "implicit", "target": "sofa", "accept": ["sofa", "arm chair"], "text": "My feet hurt."}
REPLY = {"query": "tired", "reply": '{"object": "bed"}', "objects": ["bed", "mug"]}
CARDS = "[chair]\nsynonyms = ['seat']\nuses = ['sit down', 'rest']\nbeside = ['table']\n\n[mug]\nuses = ['drink tea']\n"
HOUSE = {
    "rooms": [{"id": "room|1", "roomType": "Kitchen"}],
    "metadata": {"agent": {"horizon": 30, "position": {"x": 1}}},
}
SCENE = (Path(cartier_dollhouse.__file__).parent / "homes/family_flat.yaml").read_text(encoding="utf-8")

KINDS: dict[str, Kind] = {name: Kind(write, read_recording) for name, write in LAYOUTS.items()}
KINDS |= {
    f"onnx-{layout}": Kind(lambda p, layout=layout: write_onnx(p, layout), read_onnx, True) for layout in CHANNELS
}
KINDS |= {
    "onnx-metadata": Kind(write_onnx_metadata, read_onnx, True),
    "rtabmap-database": Kind(write_database, lambda p: read_recording(p / "home.db")),
    "archives": Kind(write_archives, read_archives),
    "detections-own": Kind(lambda p: write_detections(p, True), read_detections),
    "detections-coco": Kind(lambda p: write_detections(p, False), read_detections),
    "vocabulary": Kind(
        lambda p: write_text(p, names__txt="# names\nmug\tcup\tbeaker\nsofa\nCoffeeMachine\n"),
        lambda p: read_vocabulary(p / "names.txt"),
    ),
    "replies": Kind(
        lambda p: write_text(p, replies__jsonl=f"{json.dumps(REPLY)}\n{json.dumps(REPLY)}\n"),
        lambda p: plugins.make("reasoners", "replay", path=p / "replies.jsonl").select(
            "tired", Inventory.of(["bed", "mug"])
        ),
    ),
    "queries": Kind(
        lambda p: write_text(p, queries__jsonl=f"{json.dumps(QUERY)}\n{json.dumps(QUERY | {'id': 'b'})}\n"),
        lambda p: load_file(p / "queries.jsonl"),
    ),
    "things": Kind(
        lambda p: write_text(p, things__jsonl="".join(json.dumps(THING | more) + "\n" for more in THINGS_MORE)),
        lambda p: load_items(p / "things.jsonl"),
    ),
    "answers": Kind(
        lambda p: write_text(
            p, things__jsonl=f"{json.dumps(THING)}\n", answers__jsonl='{"id": "c", "status": "found", "xy": [1.0, 2.5]}'
        ),
        lambda p: load_answers(p / "answers.jsonl", load_items(p / "things.jsonl")),
    ),
    "cards": Kind(lambda p: write_text(p, cards__toml=CARDS), lambda p: read_deck(p / "cards.toml")),
    "dollhouse-home": Kind(lambda p: write_text(p, home__yaml=SCENE), lambda p: load_scene(p / "home.yaml")),
    "thor-house": Kind(lambda p: write_text(p, house__json=json.dumps(HOUSE)), lambda p: read_house(p / "house.json")),
    "bench-run": Kind(write_bench, read_bench),
    "resume": Kind(write_resume, read_resume),
    "arrays": Kind(write_arrays, lambda p: read_npz(p / "a.npz")),
    "corrections": Kind(write_corrections, read_corrections),
    "home": Kind(write_home, read_home),
    "home-loose": Kind(write_loose_home, read_loose_home),
    "home-loose-vlmaps": Kind(lambda p: write_loose_home(p, indexes=["object_depth", "vlmaps"]), read_loose_home),
}
