"""Homes that ``fuzz.py`` breaks: as a bad disk would, and, with checksums made anew, as who means harm would."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path
from typing import Any

from layouts import room

from cartier import pipeline
from cartier.errors import InputError
from cartier.exports import export
from cartier.home import Home
from cartier.home.store import NAME, Store
from cartier.io.files import json_bytes, parse_json, read_bytes
from cartier.llm.inventory_listing import described
from cartier.mapping.mapper import Mapper
from cartier.render.sheet import draw_sheet
from cartier.serving import page
from cartier.serving.homes import Homes
from cartier.serving.operations import Operations
from cartier.types import Inventory, Selection
from hostile import write_signed
from synthetic import THINGS, TrueBoxes

MOST = 20  # objects of a home that are looked at one by one


class First:
    """A reasoner that takes the first object, so that a home is read without a model."""

    name = "first"

    def select(self, query: str, inventory: Inventory, dialogue: object = ()) -> Selection:
        return Selection("found", inventory.names[0]) if inventory.names else Selection("not_found")

    def propose(self, query: str) -> list[str]:
        return []


class Nothing(First):
    """A reasoner to which nothing serves, so that the home says what its detector knows."""

    name = "nothing"

    def select(self, query: str, inventory: Inventory, dialogue: object = ()) -> Selection:
        return Selection("not_found")


def write_home(path: Path, **options: Any) -> None:
    home = pipeline.map_home(room(frames=12), TrueBoxes(THINGS), **options)
    home.save(path)
    saved = Home.load(path)
    saved.remember(pipeline.ask(saved, "I would love to sit down", First()))


def read_home(path: Path) -> None:
    """All that is done with a home: ask and remember, show, find, serve, export, and map on."""
    home = Home.load(path)
    printed(home.to_dict())
    home.cloud()
    if (log := home.detections()) is not None:
        log.looked()
    for index in home.indexes:
        answer = pipeline.ask(home, "I would love to sit down", First(), index=index)
        printed(answer.to_dict())
        if answer.place is not None:
            home.evidence(answer.place)
        home.remember(answer)
        if index == "vlmaps":
            home.searchable(index)[1].similarity("something soft")
    printed(pipeline.ask(home, "Where is the trombone?", Nothing()).to_dict())
    described(home.inventory(), "Where is the trombone?")
    refused = [line for line in (serve(home, path), draw(home, path), grow(home)) if line]
    if refused:
        raise InputError(refused[0])


def serve(home: Home, path: Path) -> str:
    """What is served of a home: every object, its photo and the page. Returns the first refusal."""
    operations, told = Operations(Homes([path]), First()), []
    printed(operations.list_rooms())
    printed(operations.list_objects(tentative=True))
    for obj in home.objects[:MOST]:
        for operation in (operations.describe, operations.look_at, operations.goal_for):
            try:
                result = operation(str(obj.id))
                printed(result[0] if isinstance(result, tuple) else result)
            except InputError as error:
                told.append(str(error))
    try:
        page.one_file(home)
    except InputError as error:
        told.append(str(error))
    return told[0] if told else ""


def draw(home: Home, path: Path) -> str:
    """What is written of a home for people and other programs. Returns a refusal."""
    try:
        for suffix in (".json", ".csv", ".geojson", ".glb", ".ply"):
            export(home, path.with_suffix(suffix))
        draw_sheet(home, path.with_suffix(".png"))
    except InputError as error:
        return str(error)
    return ""


def grow(home: Home) -> str:
    """Map one more frame. Returns a refusal."""
    try:
        mapper = Mapper(TrueBoxes(THINGS), onto=home)
        mapper.add(room(frames=13)[12])
        mapper.home()
    except InputError as error:
        return str(error)
    return ""


def printed(value: Any) -> None:
    """As programs and people get it: JSON without NaN, in UTF-8."""
    io.TextIOWrapper(io.BytesIO(), encoding="utf-8").write(json.dumps(value, ensure_ascii=False, allow_nan=False))


def write_loose_home(path: Path, **options: Any) -> None:
    """The parts of a home without their checksums, each field of the manifest in a file of its own."""
    write_home(path / "whole", **options)
    store = Store(path / "whole")
    about = store.manifest()
    for name in about.pop("blobs"):
        (path / "blobs" / name).parent.mkdir(parents=True, exist_ok=True)
        (path / "blobs" / name).write_bytes(store.get(name, about | {"blobs": store.manifest()["blobs"]}))
    for field in about.keys() - {"schema", "id", "sha256"}:
        folder = path / ("settings" if field == "settings" else "about")  # broken as often as all other fields
        folder.mkdir(exist_ok=True)
        (folder / f"{field}.json").write_bytes(json_bytes(about[field]))
    shutil.rmtree(path / "whole")


def read_loose_home(path: Path) -> None:
    """Sign the parts as they are, and read that home."""
    about: dict[str, Any] = {"schema": 2}
    for file in (*path.glob("about/*.json"), *path.glob("settings/*.json")):
        about[file.stem] = parse_json(read_bytes(file, 1 << 28), file)
    names = [
        file.relative_to(path / "blobs").as_posix()
        for file in sorted(path.rglob("*"))
        if (path / "blobs") in file.parents
    ]
    blobs = {
        name: read_bytes(path / "blobs" / name, 1 << 28)
        for name in names
        if NAME.fullmatch(name) and (path / "blobs" / name).is_file()
    }
    signed = path.with_suffix(".signed")
    try:
        write_signed(signed, about, blobs)
    except (RecursionError, ValueError) as error:
        raise InputError("nothing that could be signed") from error
    read_home(signed)
