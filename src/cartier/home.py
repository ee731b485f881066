"""A mapped home: what was detected, where it is, the floor plan, and the evidence; one versioned folder, never pickle."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Glimpsing, Reasoner, Searchable, SpatialIndex
from cartier.errors import InputError
from cartier.files import read_json, recover_folder, replaced_folder, write_json
from cartier.mapping.occupancy import load_map, save_map
from cartier.types import Answer, Camera, Detections, OccupancyGrid, Place

SCHEMA = 1
MARKER = "home.json"
COUNTS = "occupancy_counts.npz"


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
    folder: Path | None = None

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
        """Append an answer to the saved home's ``answers.jsonl``; a folder that is read-only stays as it is."""
        if self.folder is not None and os.access(self.folder, os.W_OK):
            with (self.folder / "answers.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(answer.to_dict(), ensure_ascii=False) + "\n")

    def ask(self, query: str, reasoner: Reasoner | None = None, **options: Any) -> Answer:
        """``pipeline.ask`` on this home; without a reasoner, the embedded one."""
        from cartier import pipeline

        return pipeline.ask(self, query, reasoner or plugins.make("reasoners", "embedded"), **options)

    def save(self, folder: str | Path) -> None:
        """Write the home all or nothing; an older home in that place stays whole until the new one is complete."""
        with replaced_folder(Path(folder), MARKER) as new:
            log = self.detections
            np.savez_compressed(
                new / "detections.npz",
                frames=log.frames, boxes_xyxy=log.boxes_xyxy, scores=log.scores, label_ids=log.label_ids,
            )  # fmt: skip
            for name, index in self.indexes.items():
                (new / "indexes" / name).mkdir(parents=True)
                index.save(new / "indexes" / name)
            if self.grid is not None:
                save_map(self.grid, new)
            if self.counts is not None:
                arrays: dict[str, Any] = dict(self.counts)
                np.savez_compressed(new / COUNTS, **arrays)
            (new / "keyframes").mkdir()
            for frame, jpeg in self.keyframes.items():
                (new / "keyframes" / f"{frame:06d}.jpg").write_bytes(jpeg)
            camera = self.camera
            write_json(
                new / MARKER,
                {
                    "schema": SCHEMA, "id": self.id, "name": self.name, "detector": self.detector, "labels": list(log.labels),
                    "camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
                    "indexes": list(self.indexes), "grid": self.grid is not None, "counts": self.counts is not None, "start_xy": list(self.start_xy),
                    "robot_radius_m": self.robot_radius_m, "settings": dict(self.settings), "notes": list(self.notes),
                },
            )  # fmt: skip
        self.folder = Path(folder)

    @classmethod
    def load(cls, folder: str | Path) -> Home:
        """Read a saved home. Raises InputError for a folder that is none, is newer than this cartier, or is damaged."""
        folder = Path(folder)
        recover_folder(folder)
        if not (folder / MARKER).is_file():
            raise InputError(
                f"{folder} is no mapped home (it holds no {MARKER}); make one with: cartier map RECORDING -o {folder}"
            )
        about = read_json(folder / MARKER)
        try:
            if about["schema"] > SCHEMA:
                raise InputError(
                    f"{folder} was made by a newer cartier (schema {about['schema']}, this one reads {SCHEMA}): upgrade cartier"
                )
            home = cls(
                name=str(about["name"]),
                detector=str(about["detector"]),
                camera=Camera(*about["camera"]),
                detections=_load_log(folder, tuple(map(str, about["labels"]))),
                indexes={name: _load_index(folder, name) for name in about["indexes"]},
                grid=load_map(folder) if about["grid"] else None,
                start_xy=(float(about["start_xy"][0]), float(about["start_xy"][1])),
                robot_radius_m=float(about["robot_radius_m"]),
                settings=about["settings"],
                keyframes=_Keyframes(folder / "keyframes"),
                notes=tuple(about["notes"]),
                counts=_load_counts(folder / COUNTS) if about.get("counts") else None,
                folder=folder,
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(
                f"{folder / MARKER} is damaged ({type(error).__name__}: {error}): map the recording again"
            ) from error
        return home


class _Keyframes(Mapping[int, bytes]):
    """Evidence photos of a saved home, read when looked at."""

    def __init__(self, folder: Path) -> None:
        self._files = {int(f.stem): f for f in folder.glob("*.jpg") if f.stem.isdecimal()}

    def __getitem__(self, frame: int) -> bytes:
        return self._files[frame].read_bytes()

    def __iter__(self) -> Any:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


def _load_counts(file: Path) -> dict[str, npt.NDArray[Any]]:
    from zipfile import BadZipFile

    try:
        with np.load(file, allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise InputError(f"{file} is missing or damaged ({error}): map the recording again") from error


def _load_index(folder: Path, name: str) -> SpatialIndex:
    if name not in [b.name for b in plugins.backends("indexes")]:
        raise InputError(f"{folder / MARKER} names an index {name!r} that is not installed")
    index: SpatialIndex = plugins.make("indexes", name)
    index.load(folder / "indexes" / name)
    return index


def _load_log(folder: Path, labels: tuple[str, ...]) -> DetectionLog:
    from zipfile import BadZipFile

    file = folder / "detections.npz"
    try:
        with np.load(file, allow_pickle=False) as arrays:
            log = DetectionLog(arrays["frames"], arrays["boxes_xyxy"], arrays["scores"], arrays["label_ids"], labels)
        n = len(log.frames)
        if log.boxes_xyxy.shape != (n, 4) or len(log.scores) != n or len(log.label_ids) != n:
            raise ValueError("arrays of different lengths")
        if n and not 0 <= int(log.label_ids.min()) <= int(log.label_ids.max()) < len(labels):
            raise ValueError("a label number without a label")
        return log
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise InputError(f"{file} is missing or damaged ({error}): map the recording again") from error
