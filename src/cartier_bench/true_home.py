"""Ground truth of a dollhouse home: where each object is, what it stands on, its colour, and its pixels in a walk."""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from cartier import plugins
from cartier.contracts import World
from cartier.errors import InputError
from cartier.geometry import box_distance
from cartier.io.atomic import write_json
from cartier.io.files import read_json
from cartier.labels import display_name
from cartier.types import Inventory, MapObject, Room, View
from cartier_bench.maps import file_name
from cartier_dollhouse import Dollhouse
from cartier_dollhouse.contacts import Contacts
from cartier_dollhouse.model import Scene, Thing

SHOWN_PX = 400  # in some frame of a walk, of what one may ask for
VERSION = 2  # of what is kept of a home
_TABLE = tomllib.loads((Path(__file__).parent / "thing_texts" / "colours.toml").read_text("utf-8"))
COLOURS: dict[str, list[str]] = _TABLE["tints"]
"""What people call the colours of the dollhouse's materials."""
_OF_MATERIAL = {material: colour for colour, materials in COLOURS.items() for material in materials}


@dataclass(frozen=True, eq=False)
class TrueHome:
    """A home's truth; ids are the simulator's, ``room`` of an object the number of its room in ``rooms``, (name, kind)
    each.

    ``holder`` has what an object stands on or in, ``covered`` (object, what is above it); ``pixels`` are those of its
    best view.
    """

    name: str
    objects: tuple[MapObject, ...]
    rooms: tuple[tuple[str, str], ...]
    start_xy: tuple[float, float]
    holder: Mapping[int, tuple[int, str]]
    covered: frozenset[tuple[int, int]]
    pixels: Mapping[int, int]

    @property
    def shown(self) -> set[int]:
        """The ids of what one may ask for."""
        return {i for i, pixels in self.pixels.items() if pixels >= SHOWN_PX}


def true_home(
    world: World, name: str, seed: int, keep: Path, progress: Callable[[str, int, int], None] | None = None
) -> TrueHome:
    """The truth of a home; what takes long to find (a whole walk is rendered) is kept in the folder ``keep``.

    Raises InputError for a world that has no such truth.
    """
    if not isinstance(world, Dollhouse):
        raise InputError(
            f"requests can be made only where all is known of a home, in the dollhouse, not in {world.name}"
        )
    scene, file = world.scene(name), keep / f"truth-{file_name(name)}-{seed}-{VERSION}.json"
    objects = true_objects(scene)
    kept = read_json(file) if file.exists() else None
    if kept is None or kept["things"] != [[o.id, o.label, *map(float, o.position)] for o in objects]:
        contacts = Contacts(scene)
        kept = {
            "things": [[o.id, o.label, *map(float, o.position)] for o in objects],
            "holder": [[obj, *by] for obj, by in contacts.holder.items()],
            "covered": sorted(contacts.covered),
            "pixels": _pixels(world, name, seed, progress),
        }
        write_json(file, kept)
    return TrueHome(
        name, tuple(objects), tuple((room.name, room.kind) for room in scene.rooms), scene.start_xy,
        {int(obj): (int(by), str(how)) for obj, by, how in kept["holder"]},
        frozenset((int(obj), int(above)) for obj, above in kept["covered"]),
        {o.id: int(kept["pixels"][o.id]) if o.id < len(kept["pixels"]) else 0 for o in objects},
    )  # fmt: skip


def true_objects(scene: Scene) -> list[MapObject]:
    """A scene's objects as a perfect map would have them; ``room`` is the number of the room."""
    rooms = np.array([room.box for room in scene.rooms])
    found = []
    for obj in scene.things:
        box = obj.truth()
        low, high, name = box.box_min, box.box_max, display_name(box.label)
        room = int(box_distance(np.add(low, high)[:2] / 2, rooms[:, :2], rooms[:, 2:]).argmin())
        known = {"n_detected": 1, "n_observable": 1, "colours": _colours(obj), "room": room}
        found.append(MapObject.of_box(obj.id, name, low, high, **known))
    return found


def _colours(obj: Thing) -> tuple[tuple[str, float], ...]:
    """The colours of an object's materials with their shares of its surface, the largest first; unknown ones left
    out."""
    areas: dict[str, float] = defaultdict(float)
    for part in obj.shape.parts:
        a, b, c = part.vertices[part.faces].astype(np.float64).transpose(1, 0, 2)
        kind, _, tint = part.material.partition(":")
        colour = _OF_MATERIAL.get(tint or _TABLE["kinds"].get(kind, kind), "")
        areas[colour] += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    total = sum(areas.values())
    shares = sorted(((colour, round(area / total, 3)) for colour, area in areas.items() if colour), key=lambda c: -c[1])
    return tuple(shares)


def _pixels(world: Dollhouse, name: str, seed: int, progress: Callable[[str, int, int], None] | None) -> Sequence[int]:
    """In how many pixels each object is seen at best, by its id."""
    recording, pixels = world.explore(name, seed=seed), np.zeros(max(t.id for t in world.objects(name)) + 1, np.int64)
    for number in range(len(recording)):
        instances = recording[number].instances
        assert instances is not None
        pixels = np.maximum(pixels, np.bincount(instances.ravel(), minlength=len(pixels)))
        if progress:
            progress(name, number + 1, len(recording))
    return [int(n) for n in pixels]


@cache
def scene_of(name: str) -> Scene:
    """A home of the dollhouse, built in or generated."""
    world = plugins.make("worlds", "dollhouse")
    assert isinstance(world, Dollhouse)
    return world.scene(name)


@cache
def perfect_map(name: str) -> Inventory:
    """A home as a perfect map would have it; each object was seen from the middle of its room."""
    of = scene_of(name)
    middles = [np.add(room.box[:2], room.box[2:]) / 2 for room in of.rooms]
    objects = tuple(_seen(obj, middles[obj.room or 0]) for obj in true_objects(of))
    kinds = [display_name(room.kind) for room in of.rooms]
    rooms = tuple(
        Room(i, kind if kinds.count(kind) == 1 else f"{kind} {kinds[:i].count(kind) + 1}", kind,
             np.zeros((0, 2), np.int32))
        for i, kind in enumerate(kinds)
    )  # fmt: skip
    return Inventory(objects, rooms, from_xy=of.start_xy)


def _seen(obj: MapObject, camera_xy: np.ndarray) -> MapObject:
    x, y = map(float, camera_xy)
    basic = {"light wood": "brown", "cream": "white", "dark grey": "grey", "rust": "red", "beige": "brown"}
    colours = dict[str, float]()
    for colour, share in obj.colours:
        colours[basic.get(colour, colour)] = colours.get(basic.get(colour, colour), 0.0) + share
    view = View(0, (0.0, 0.0, 9.0, 9.0), 0.9, obj.label, 81.0, (x, y, 1.5), 0.0, obj.position)
    return replace(obj, views=(view,), colours=tuple(colours.items()))
