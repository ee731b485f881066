"""A mapped home: what was detected, where it is, the floor plan, and the evidence; one versioned folder, never pickle."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Glimpsing, Searchable, SpatialIndex
from cartier.errors import InputError
from cartier.files import npz_bytes, read_npz
from cartier.mapping.map_server import grid_from, pgm, yaml
from cartier.store import Store, blob_file, digest_of
from cartier.types import Answer, Camera, Detections, OccupancyGrid, Place

SCHEMA = 2
ANSWERS = "answers.jsonl"
TRIES = 5  # to read a home that others replace meanwhile


@dataclass(frozen=True, eq=False)
class DetectionLog:
    """Every detection of a recording as parallel arrays of N; ``label_ids`` index into ``labels``."""

    frames: npt.NDArray[np.int32]
    boxes_xyxy: npt.NDArray[np.float32]
    scores: npt.NDArray[np.float32]
    label_ids: npt.NDArray[np.int32]
    labels: tuple[str, ...]

    @classmethod
    def of(cls, detections: Sequence[Detections]) -> DetectionLog:
        """The log of the detections of many frames; masks are dropped."""
        labels = sorted({label for d in detections for label in d.labels})
        number = {label: i for i, label in enumerate(labels)}
        return cls(
            np.concatenate([np.full(len(d), d.frame, np.int32) for d in detections]),
            np.concatenate([d.boxes_xyxy for d in detections]),
            np.concatenate([d.scores for d in detections]),
            np.array([number[label] for d in detections for label in d.labels], np.int32),
            tuple(labels),
        )

    def followed_by(self, more: DetectionLog) -> DetectionLog:
        """Both, one after the other."""
        labels = tuple(sorted({*self.labels, *more.labels}))
        number = {label: i for i, label in enumerate(labels)}
        ids = [np.array([number[label] for label in log.labels], np.int32)[log.label_ids] for log in (self, more)]
        return DetectionLog(
            np.concatenate([self.frames, more.frames]),
            np.concatenate([self.boxes_xyxy, more.boxes_xyxy]),
            np.concatenate([self.scores, more.scores]),
            np.concatenate(ids),
            labels,
        )


@dataclass(eq=False)
class Home:
    """What ``map_home`` makes and ``ask`` reads. ``settings`` is all that made it, for provenance; ``detector`` names it."""

    name: str
    detector: str
    camera: Camera
    detections: DetectionLog
    indexes: Mapping[str, SpatialIndex]
    grid: OccupancyGrid | None
    start_xy: tuple[float, float]
    robot_radius_m: float
    settings: Mapping[str, Any]
    keyframes: Mapping[int, bytes] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    counts: Mapping[str, npt.NDArray[Any]] | None = None
    """What the grid was counted from, so that another recording can be added."""
    store: Store | None = None
    """Where it was loaded from."""

    @property
    def id(self) -> str:
        """The same for the same recording, mapped with the same settings."""
        made_by = json.dumps(dict(self.settings), sort_keys=True)
        return hashlib.sha256(made_by.encode()).hexdigest()[:12]

    @property
    def objects(self) -> list[str]:
        """The names of everything that an index can locate, each once, sorted: what a reasoner gets to see."""
        return sorted({name for index in self.indexes.values() for name in index.names()})

    @property
    def glimpsed(self) -> dict[str, float]:
        """The names of what was seen, but not well enough to be listed in ``objects``, sorted, each with its best score."""
        found: dict[str, float] = {}
        for index in (one for one in self.indexes.values() if isinstance(one, Glimpsing)):
            for name in index.glimpsed():
                place = index.glimpse(name)
                found[name] = max(found.get(name, 0.0), place.score if place else 0.0)
        return {name: found[name] for name in sorted(found.keys() - set(self.objects))}

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

    def keyframe(self, place: Place) -> npt.NDArray[np.uint8] | None:
        """The photo (H, W, 3) that is the evidence for a place."""
        from PIL import Image

        data = self.keyframes.get(place.frame)
        return None if data is None else np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def table(self, index: str | None = None) -> list[dict[str, Any]]:
        """One row per kind of object: its name, in how many frames it was seen, its best score, and its place or None."""
        spatial_index, log = self.index(index)[1], self.detections
        rows = []
        for label in self.objects:
            mine = log.label_ids == log.labels.index(label)
            place = spatial_index.locate(label)
            rows.append(
                {
                    "object": label,
                    "frames": len(np.unique(log.frames[mine])),
                    "best_score": float(log.scores[mine].max()),
                    "place": place.to_dict() if place else None,
                }
            )
        return sorted(rows, key=lambda row: -row["frames"])

    def remember(self, answer: Answer) -> None:
        """Append an answer to the saved home's ``answers.jsonl``. Raises InputError where that cannot be written."""
        if self.store is not None:
            self.store.append(ANSWERS, json.dumps(answer.to_dict(), ensure_ascii=False))

    def save(self, folder: str | Path) -> None:
        """Write the home whole or not at all; an older home in that place stays until the new one is complete."""
        log, camera, grid = self.detections, self.camera, self.grid
        blobs = {
            "detections.npz": npz_bytes(
                frames=log.frames, boxes_xyxy=log.boxes_xyxy, scores=log.scores, label_ids=log.label_ids
            )
        }
        for name, index in self.indexes.items():
            blobs |= {f"indexes/{name}/{part}": data for part, data in index.state().items()}
        blobs |= {_photo(frame): jpeg for frame, jpeg in self.keyframes.items()}
        if grid is not None:
            blobs |= {"occupancy.pgm": pgm(grid), "occupancy.npz": npz_bytes(height_m=grid.height_m)}
        if self.counts is not None:
            blobs["occupancy_counts.npz"] = npz_bytes(**self.counts)
        about = {
            "schema": SCHEMA, "id": self.id, "name": self.name, "detector": self.detector, "labels": list(log.labels),
            "camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy], "indexes": list(self.indexes),
            "grid": None if grid is None else {"resolution_m": grid.resolution_m, "origin_xy": list(grid.origin_xy)},
            "start_xy": list(self.start_xy), "robot_radius_m": self.robot_radius_m, "settings": dict(self.settings),
            "notes": list(self.notes),
        }  # fmt: skip
        files = {}
        if grid is not None:  # for Nav2, which wants a name that stays
            files["occupancy.yaml"] = yaml(grid, blob_file("occupancy.pgm", digest_of(blobs["occupancy.pgm"])))
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
                if attempt + 1 == TRIES or store.manifest()["sha256"] == about.get("sha256"):
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
            grid = None
            if about["grid"] is not None:
                x, y = about["grid"]["origin_xy"]
                height_m = read_npz(store.get("occupancy.npz", about), "occupancy.npz")["height_m"]
                image = store.get("occupancy.pgm", about)
                grid = grid_from(image, float(about["grid"]["resolution_m"]), (float(x), float(y)), height_m)
            photos = [name for name in about["blobs"] if name.startswith("photos/")]
            return cls(
                name=str(about["name"]),
                detector=str(about["detector"]),
                camera=Camera(*about["camera"]),
                detections=_log(store.get("detections.npz", about), tuple(map(str, about["labels"]))),
                indexes={name: _index(store, about, name) for name in about["indexes"]},
                grid=grid,
                start_xy=(float(about["start_xy"][0]), float(about["start_xy"][1])),
                robot_radius_m=float(about["robot_radius_m"]),
                settings=about["settings"],
                keyframes=_Photos(store, about, {int(Path(name).stem): name for name in photos}),
                notes=tuple(about["notes"]),
                counts=_counts(store, about),
                store=store,
            )
        except (KeyError, TypeError, ValueError, IndexError, InputError) as error:
            told = str(error) if str(folder) in str(error) else f"{folder} is damaged ({type(error).__name__}: {error})"
            raise InputError(told.replace("\n", " ")[:300]) from error


class _Photos(Mapping[int, bytes]):
    """Evidence photos of a saved home, read when looked at."""

    def __init__(self, store: Store, about: Mapping[str, Any], names: Mapping[int, str]) -> None:
        self._store, self._about, self._names = store, about, names

    def __getitem__(self, frame: int) -> bytes:
        return self._store.get(self._names[frame], self._about)

    def __iter__(self) -> Any:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _photo(frame: int) -> str:
    return f"photos/{frame:06d}.jpg"


def _counts(store: Store, about: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]] | None:
    name = "occupancy_counts.npz"
    return read_npz(store.get(name, about), name) if name in about["blobs"] else None


def _index(store: Store, about: Mapping[str, Any], name: str) -> SpatialIndex:
    if name not in [b.name for b in plugins.backends("indexes")]:
        raise InputError(f"{store.folder} names an index {str(name)[:60]!r} that is not installed")
    begin = f"indexes/{name}/"
    index = plugins.make("indexes", name)
    index.restore({part[len(begin) :]: store.get(part, about) for part in about["blobs"] if part.startswith(begin)})
    return index


def _log(data: bytes, labels: tuple[str, ...]) -> DetectionLog:
    arrays = read_npz(data, "detections.npz")
    log = DetectionLog(arrays["frames"], arrays["boxes_xyxy"], arrays["scores"], arrays["label_ids"], labels)
    n = len(log.frames)
    if log.boxes_xyxy.shape != (n, 4) or len(log.scores) != n or len(log.label_ids) != n:
        raise ValueError("arrays of different lengths")
    if n and not 0 <= int(log.label_ids.min()) <= int(log.label_ids.max()) < len(labels):
        raise ValueError("a label number without a label")
    return log
