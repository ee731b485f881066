"""A mapped home: its objects with their evidence, its rooms and floor plan, and the indices; kept by ``store.py``, never pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Instances, Searchable, SpatialIndex
from cartier.errors import InputError
from cartier.home import corrections
from cartier.home.corrections import Corrected
from cartier.home.detection_log import DetectionLog
from cartier.home.map_server import grid_from, pgm, yaml
from cartier.home.old_names import OLD_OBJECTS
from cartier.home.point_cloud import PointCloud, read_cloud
from cartier.home.repository import Store, blob_file, digest_of
from cartier.io.files import json_bytes, npz_bytes, parse_json, read_npz, typed
from cartier.spatial.relations import supports
from cartier.types import FREE, Answer, Camera, Inventory, MapObject, OccupancyGrid, Place, Room, Selection

Key = TypeVar("Key", int, str)
SCHEMA = 2
ANSWERS = "answers.jsonl"
TRIES = 5  # to read a home that others replace meanwhile
GROWTH, CLOUD, DETECTIONS = "growth", "cloud.npz", "detections.npz"
"""The folder of what growing needs and asking does not; the point cloud and what the detector reported lie there, too."""


@dataclass(frozen=True, eq=False)
class Home:
    """What ``map_home`` makes and ``ask`` reads; nobody changes it.

    ``objects`` are all of the map, confirmed and tentative. ``settings`` is all that made it, for provenance, and ``detector``
    names that. ``photos`` are the JPEGs of the frames that objects' views name. ``growth`` is the state that mapping goes on from.
    """

    name: str
    detector: str
    camera: Camera
    objects: tuple[MapObject, ...]
    indexes: Mapping[str, SpatialIndex]
    grid: OccupancyGrid | None
    start_xy: tuple[float, float]
    settings: Mapping[str, Any]
    rooms: tuple[Room, ...] = ()
    photos: Mapping[int, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    growth: Mapping[str, bytes] = field(default_factory=dict)
    store: Store | None = None
    """Where it was loaded from."""
    corrected: Corrected | None = None
    """What people put right in it: ``objects`` and ``rooms`` are with, those of ``corrected.mapped_…`` without."""

    @property
    def id(self) -> str:
        """The same for the same recordings, mapped with the same settings."""
        made_by = json.dumps(dict(self.settings), sort_keys=True)
        return hashlib.sha256(made_by.encode()).hexdigest()[:12]

    @property
    def scale_guessed(self) -> bool:
        """Whether its metres are none that anybody measured: whoever shows lengths says so."""
        return self.settings.get("scale_guessed") is True

    @property
    def names(self) -> list[str]:
        """The label of everything confirmed, and what people call it, each once, sorted."""
        return Inventory(self.objects).names

    def inventory(self, index: str | None = None, from_xy: Sequence[float] | None = None) -> Inventory:
        """What a reasoner gets to see: the objects; or the names of an index that has others, such as the paper's own.

        ``from_xy`` is where the robot stands (m), by default where the recording began.
        """
        names, at = self.index(index)[1].names(), tuple(self.start_xy if from_xy is None else from_xy)
        if set(names) <= set(self.names):
            return Inventory(self.objects, self.rooms, self.photo, at)
        return Inventory.of(names)

    def locate(self, chosen: Selection, index: str | None = None) -> Place | None:
        """Where what was chosen is, as an index says: the very object, else the one of its name; or the middle of a room."""
        if chosen.object is None:
            return None
        if chosen.room is not None:
            return self._middle(next(room for room in self.rooms if room.id == chosen.room))
        held = self.index(index)[1]
        obj = next((o for o in self.objects if o.id == chosen.object_id), None)
        if obj is None or not isinstance(held, Instances):
            return held.locate(chosen.object)
        return held.locate_object(obj)

    def _middle(self, room: Room) -> Place | None:
        """The point of a room's free floor that is farthest from all else."""
        if self.grid is None:
            return None
        from scipy.ndimage import distance_transform_edt

        free = np.zeros(np.add(self.grid.cells.shape, 2), bool)
        rows, cols = room.cells.T
        free[rows + 1, cols + 1] = self.grid.cells[rows, cols] == FREE
        open_m = np.asarray(distance_transform_edt(free))[1:-1, 1:-1]
        x, y = self.grid.centre(np.array(np.unravel_index(int(open_m.argmax()), open_m.shape))).tolist()
        views = [view for obj in self.objects if obj.room == room.id for view in obj.views]
        best = max(views, key=lambda view: view.size_px2, default=None)
        return Place(room.name, (x, y, 0.0), 1.0, best.frame if best else -1)

    def photo(self, object_id: int) -> bytes | None:
        """The JPEG of an object's best view, None for an unknown id or a photo that was not kept."""
        obj = next((o for o in self.objects if object_id == o.id or object_id in o.aliases), None)
        return self.photos.get(obj.views[0].frame) if obj is not None and obj.views else None

    def evidence(self, place: Place) -> npt.NDArray[np.uint8] | None:
        """The photo (H, W, 3) that shows a place. Raises InputError if it is damaged."""
        from cartier.io.images import decode_rgb  # Pillow, which asking a home need not load

        data = self.photos.get(place.frame)
        return None if data is None else decode_rgb(data, None, f"{self.name}'s photo of frame {place.frame}")

    def cloud(self) -> PointCloud | None:
        """The points that depth showed, as frames saw them; None without depth, or from an older cartier. Raises InputError if damaged."""
        data = self.growth.get(CLOUD)
        return None if data is None else read_cloud(data)

    def detections(self) -> DetectionLog | None:
        """What the detector reported in each frame that it looked at; None from an older cartier. Raises InputError if damaged."""
        if (data := self.growth.get(DETECTIONS)) is None:
            return None
        log = DetectionLog()
        log.restore(data)
        return log

    def index(self, name: str | None = None) -> tuple[str, SpatialIndex]:
        """An index by name, or the home's first one."""
        name = name or next(iter(self.indexes))
        if name not in self.indexes:
            known = [b.name for b in plugins.backends("indexes")]
            built = ", ".join(self.indexes)
            mend = f"map it again with --index {name}" if name in known else f"there are {', '.join(known)}"
            raise InputError(f"this home has no index {name!r} (it has {built}); {mend}")
        return name, self.indexes[name]

    def searchable(self, name: str | None = None) -> tuple[str, Searchable]:
        """An index that any words can be looked up in: the one named, or the home's first such."""
        for candidate in [name] if name else self.indexes:
            index = self.index(candidate)[1]
            if isinstance(index, Searchable):
                return str(candidate), index
        raise InputError(
            f"{f'index {name}' if name else 'no index of this home'} can be searched with any words; "
            "map it again with --index object_depth,object_viewpoint,vlmaps"
        )

    def to_dict(self) -> dict[str, Any]:
        """All that was found, as plain JSON values: what ``cartier show --json`` prints. ``on`` is what a thing stands on or in, where depth tells.

        What is not ``located`` has a box that covers where it may be: its ``size_m`` is that of the box.
        """
        standing = supports([obj for obj in self.objects if obj.confirmed]) if self.grid is not None else {}
        rows = []
        for obj in sorted(self.objects, key=lambda obj: (not obj.confirmed, obj.id)):
            on = standing.get(obj.id)
            row = {
                **asdict(obj),
                "located": obj.located,
                "size_m": [round(high - low, 3) for low, high in zip(obj.box_min, obj.box_max, strict=True)],
            }
            row["on"] = (
                None if on is None else {"id": on.object, "relation": on.kind, "probability": round(on.probability, 3)}
            )
            rows.append(row)
        area = self.grid.resolution_m**2 if self.grid else 0.0
        rooms = [
            {"id": r.id, "name": r.name, "kind": r.kind, "area_m2": round(len(r.cells) * area, 2)} for r in self.rooms
        ]
        about = {"home": self.name, "id": self.id, "detector": self.detector, "objects": rows, "rooms": rooms}
        return about | {
            "scale_guessed": self.scale_guessed,
            "notes": [*self.notes, *(self.corrected.notes if self.corrected else ())],
        }

    def correct(
        self,
        what: corrections.CorrectionKind,
        entity: int | str = "",
        *,
        name: str = "",
        to_xy: Sequence[float] = (),
        who: str = "somebody",
    ) -> tuple[Home, str]:
        """Put something right, as a line in the saved home's log: gives the home anew, and in words what was done.

        ``what`` is "name" (an object or a room, with ``name``), "forget" (an object), "move" (an object, its middle to ``to_xy``
        in metres, map frame) or "undo" (the latest correction that holds). ``thing`` is an object's id, ``room:ID``, a name, or a
        label that only one has. Raises InputError for a home that was not saved, a thing that is not there or not told apart.
        """
        if self.store is None or self.corrected is None:
            raise InputError(f"{self.name} was not loaded from a folder: save it, load it, and correct it then")
        entry = corrections.make(self.corrected, self.grid, what, str(entity), name, to_xy, who)
        self.store.append(corrections.LOG, corrections.line_of(entry))
        return Home.load(self.store.folder), corrections.in_words(entry, self.corrected.log)

    def remember(self, answer: Answer) -> None:
        """Append an answer to the saved home's ``answers.jsonl``. Raises InputError where that cannot be written."""
        if self.store is not None:
            self.store.append(ANSWERS, json.dumps(answer.to_dict(), ensure_ascii=False))

    def save(self, folder: str | Path) -> None:
        """Write the home whole or not at all; an older home in that place stays until the new one is complete."""
        camera, grid = self.camera, self.grid
        as_mapped = (
            self.corrected.mapped_objects if self.corrected else self.objects
        )  # the log is applied when it is loaded
        blobs = {"objects.json": json_bytes([asdict(obj) for obj in as_mapped])}
        for name, index in self.indexes.items():
            blobs |= {f"indexes/{name}/{part}": data for part, data in index.state().items()}
        blobs |= {f"{GROWTH}/{part}": data for part, data in self.growth.items()}
        blobs |= {f"photos/{frame:06d}.jpg": jpeg for frame, jpeg in self.photos.items()}
        if grid is not None:
            rooms = np.full(grid.cells.shape, -1, np.int16)
            for number, room in enumerate(self.rooms):
                rooms[tuple(room.cells.T)] = number
            blobs |= {"occupancy.pgm": pgm(grid), "occupancy.npz": npz_bytes(height_m=grid.height_m, rooms=rooms)}
        about = {
            "schema": SCHEMA, "id": self.id, "name": self.name, "detector": self.detector,
            "camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy], "indexes": list(self.indexes),
            "grid": None if grid is None else {"resolution_m": grid.resolution_m, "origin_xy": list(grid.origin_xy)},
            "rooms": [[r.id, r.name, r.kind] for r in (self.corrected.mapped_rooms if self.corrected else self.rooms)], "start_xy": list(self.start_xy),
            "settings": dict(self.settings), "notes": list(self.notes),
        }  # fmt: skip
        files = {}
        if grid is not None:  # for Nav2, which wants a name that stays
            files["occupancy.yaml"] = yaml(grid, blob_file("occupancy.pgm", digest_of(blobs["occupancy.pgm"])))
        if self.corrected and self.corrected.log and not (Path(folder) / corrections.LOG).exists():
            files[corrections.LOG] = "".join(f"{corrections.line_of(entry)}\n" for entry in self.corrected.log).encode()
        Store(folder).put(about, blobs, files)

    @classmethod
    def load(cls, folder: str | Path) -> Home:
        """Read a saved home, as it is now or as it was a moment ago, if somebody is just replacing it.

        Raises InputError for a folder that is none, was made by another cartier, or is damaged.
        """
        store = Store(folder)
        for attempt in range(TRIES):
            about = store.manifest()
            try:
                return cls._read(store, about)
            except InputError:
                if attempt + 1 == TRIES or store.manifest().get("sha256") == about.get("sha256"):
                    raise
        raise AssertionError("not reached")

    @classmethod
    def _read(cls, store: Store, about: Mapping[str, Any]) -> Home:
        folder = store.folder
        if about.get("schema") != SCHEMA:
            newer = isinstance(about.get("schema"), int) and about["schema"] > SCHEMA
            mend = "upgrade cartier" if newer else f"map its recording again: cartier map RECORDING -o {folder}"
            raise InputError(
                f"{folder} was made by {'a newer' if newer else 'an older'} cartier (schema {str(about.get('schema'))[:20]}, "
                f"this one reads {SCHEMA}): {mend}"
            )
        try:
            rows = parse_json(store.get("objects.json", about), "objects.json")
            objects = typed([_renamed(row) for row in rows], tuple[MapObject, ...])
            grid, rooms = _floor(store, about)
            log, faults = corrections.read_log(folder)
            corrected = corrections.apply(log, objects, rooms, grid)
            indexes = {name: _index(store, about, name) for name in about["indexes"]}
            for index in indexes.values():
                index.set_objects(corrected.objects)
            return cls(
                name=str(about["name"]),
                detector=str(about["detector"]),
                camera=Camera(*about["camera"]),
                objects=corrected.objects,
                indexes=indexes,
                grid=grid,
                start_xy=(float(about["start_xy"][0]), float(about["start_xy"][1])),
                settings={**about["settings"]},
                rooms=corrected.rooms,
                photos=_Blobs(store, about, "photos/", lambda name: int(name.partition(".")[0])),
                notes=tuple(about["notes"]),
                growth=_Blobs(store, about, f"{GROWTH}/", str),
                store=store,
                corrected=replace(corrected, notes=(*faults, *corrected.notes)),
            )
        except (KeyError, TypeError, ValueError, IndexError, OverflowError, InputError) as error:
            told = str(error) if str(folder) in str(error) else f"{folder} is damaged ({type(error).__name__}: {error})"
            raise InputError(told.replace("\n", " ")[:300]) from error


class _Blobs(Mapping[Key, bytes]):
    """Blobs of a saved home whose names begin alike, read when asked for."""

    def __init__(self, store: Store, about: Mapping[str, Any], begin: str, key: Callable[[str], Key]) -> None:
        self._store, self._about = store, about
        self._names: dict[Key, str] = {
            key(name[len(begin) :]): name for name in about["blobs"] if name.startswith(begin)
        }

    def __getitem__(self, key: Key) -> bytes:
        return self._store.get(self._names[key], self._about)

    def __iter__(self) -> Iterator[Key]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _renamed(row: Any) -> Any:
    """A row of objects.json with today's field names: cartier 0.1.0 called two of them otherwise."""
    return {OLD_OBJECTS.get(name, name): value for name, value in row.items()} if isinstance(row, dict) else row


def _floor(store: Store, about: Mapping[str, Any]) -> tuple[OccupancyGrid | None, tuple[Room, ...]]:
    if about["grid"] is None:
        return None, ()
    x, y = about["grid"]["origin_xy"]
    arrays = read_npz(store.get("occupancy.npz", about), where="occupancy.npz")
    image = store.get("occupancy.pgm", about)
    grid = grid_from(image, float(about["grid"]["resolution_m"]), (float(x), float(y)), arrays["height_m"])
    rooms = tuple(
        Room(int(number), str(name), str(kind), np.argwhere(arrays["rooms"] == place).astype(np.int32))
        for place, (number, name, kind) in enumerate(about["rooms"])
    )
    return grid, rooms


def _index(store: Store, about: Mapping[str, Any], name: str) -> SpatialIndex:
    if name not in [b.name for b in plugins.backends("indexes")]:
        raise InputError(f"{store.folder} names an index {str(name)[:60]!r} that is not installed")
    index = plugins.make("indexes", name)
    index.restore(dict(_Blobs(store, about, f"indexes/{name}/", str)))
    return index
