"""cartier's own format: recording.json, rgb/000000.jpg, depth/000000.png (uint16 mm), trajectory.txt (TUM).

``recording.json`` needs schema, name and camera. ``depth`` and ``instances`` say whether these folders are read (by
default if they exist), ``simulator`` that truth.json is read, ``notes`` what was estimated. It names no files: the
layout is fixed, so nothing in it can lead out of the folder; links that do are noted. It may lie on object storage,
too, of which each frame's images are fetched when that frame is asked for. A simulator's recording also holds
``truth.json`` (the true objects with their boxes) and ``instances/000000.png`` (uint16 ids).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt

from cartier.blob_stores import open_store
from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.errors import InputError, brief, frame_number
from cartier.io import images
from cartier.io.atomic import replaced_folder, write_json
from cartier.io.files import MAX_JSON_BYTES, parse_json, read_json, text_of
from cartier.recordings.common.clock import one_run
from cartier.recordings.common.files import MAX_TABLE_BYTES, READERS
from cartier.recordings.common.places import MAX_FILE_BYTES, BlobFiles, Files, FolderFiles
from cartier.recordings.common.poses import lost, parse_trajectory, trajectory_line
from cartier.types import Array, Camera, Frame, TrueObject

SCHEMA = 1
HEAD, TRAJECTORY, TRUTH = "recording.json", "trajectory.txt", "truth.json"
MAX_LINE_CHARS = 1000
INTRINSICS = ("fx", "fy", "cx", "cy")


def matches(path: Path) -> bool:
    """Whether a folder holds a recording.json."""
    return (path / HEAD).is_file()


def open(path: str | Path) -> Recording:
    """Read a recording that ``save`` wrote, or another program in the same layout; also at ``s3://…``."""
    if "://" not in str(path):
        return Folder(FolderFiles(Path(path)))
    files = BlobFiles(open_store(str(path)))
    if HEAD not in files.names(""):
        raise InputError(
            f"{files.where(HEAD)} is missing: on object storage, cartier reads recordings in its own format, which "
            "'cartier convert RECORDING -o OUT' writes; fetch others to a folder first"
        )
    return Folder(files)


class Folder:
    """A recording in cartier's own format. Poses are read when it is opened, images when a frame is asked for."""

    readers = READERS

    def __init__(self, files: Files) -> None:
        self._place = files
        head = _Fields(_json(files, HEAD), files.where(HEAD))
        schema = head.get("schema", int)
        if schema != SCHEMA:
            raise InputError(
                f"{files.where(HEAD)} has schema {brief(schema, 20)}, this cartier reads {SCHEMA}: upgrade cartier"
            )
        self.name = head.line("name")
        self.camera = _camera(_Fields(head.get("camera", dict), files.where(HEAD)))
        self.notes: Sequence[str] = head.lines("notes") if "notes" in head.value else ()
        self.scale_guessed = head.value.get("scale_guessed") is True
        self._times_s, self._poses = parse_trajectory(
            text_of(files.read(TRAJECTORY, MAX_TABLE_BYTES), files.where(TRAJECTORY)), files.where(TRAJECTORY)
        )
        written = len(self._poses)
        self._numbers, left_out = _posed(self._times_s, self._poses, files.where(TRAJECTORY))
        self._times_s, self._poses = self._times_s[self._numbers], self._poses[self._numbers]
        self._poses.setflags(write=False)
        self._has_depth: bool = head.flag("depth", files.has("depth"))
        self._has_instances: bool = head.flag("instances", files.has("instances"))
        simulator = head.flag("simulator", False)  # truth.json alone makes no simulator: what is true must be said
        self.truth: Sequence[TrueObject] | None = _read_truth(files) if simulator else None
        self._images = {"rgb": ".jpg"}
        self._images |= {"depth": ".png"} if self._has_depth else {}
        self._images |= {"instances": ".png"} if self._has_instances else {}
        for kind, suffix in self._images.items():
            _check_count(files, kind, suffix, written)
        images = [_image(kind, i, suffix) for kind, suffix in self._images.items() for i in range(written)]
        self._files = [HEAD, TRAJECTORY, *([] if self.truth is None else [TRUTH]), *images]
        self.notes = [*self.notes, *left_out, *files.notes(self._files)]
        self._fingerprint: str | None = None

    def __len__(self) -> int:
        return len(self._poses)

    def __getitem__(self, index: int) -> Frame:
        i = frame_number(index, len(self), self.name)
        return Frame(
            index=i,
            time_s=float(self._times_s[i]),
            rgb=images.decode_rgb(*self._image_of("rgb", i)),
            depth_m=images.decode_depth(*self._image_of("depth", i)) if self._has_depth else None,
            world_from_camera=self._poses[i],
            camera=self.camera,
            instances=images.decode_instances(*self._image_of("instances", i)) if self._has_instances else None,
        )

    def fingerprint(self) -> str:
        if self._fingerprint is None:
            self._fingerprint = self._place.fingerprint("folder 1", self._files)
        return self._fingerprint

    def _image_of(self, kind: str, number: int) -> tuple[bytes, Camera, str]:
        name = _image(kind, int(self._numbers[number]), self._images[kind])
        return self._place.read(name, MAX_FILE_BYTES), self.camera, self._place.where(name)


def read_head(root: Path) -> tuple[str, Camera, bool]:
    """The name and camera that a ``recording.json`` gives, and whether there is depth. Raises InputError without."""
    head = _Fields(read_json(root / HEAD), str(root / HEAD))
    camera = _camera(_Fields(head.get("camera", dict), str(root / HEAD)))
    return head.line("name"), camera, head.flag("depth", (root / "depth").is_dir())


def image_files(root: Path, number: int) -> tuple[Path, Path]:
    """The colour and the depth image of a frame."""
    return root / _image("rgb", number, ".jpg"), root / _image("depth", number, ".png")


def save(recording: Recording, folder: str | Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Write any recording in cartier's own format, one frame in memory at a time, all or nothing.

    Poses, instances and truth come back exactly, depth to a millimetre (up to 65.534 m), colour as JPEG of quality 95.
    ``progress(done, total)`` is called after each frame. Raises InputError if ``folder`` exists and is not empty.
    """
    folder = Path(folder)
    if not len(recording):
        raise InputError(f"{recording.name} holds no frame, so there is nothing to save")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder} exists: choose another folder, or delete it yourself")
    try:
        with replaced_folder(folder, HEAD) as temporary:
            _write(recording, temporary, progress)
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror or error})") from error


def _write(recording: Recording, root: Path, progress: Callable[[int, int], None] | None) -> None:
    kinds: list[str] = []
    with (root / TRAJECTORY).open("w", encoding="utf-8") as trajectory:
        trajectory.write("# t x y z qx qy qz qw: seconds, metres, map from camera (x right, y down, z forward)\n")
        for i in range(len(recording)):
            frame = recording[i]
            images = {"rgb": frame.rgb, "depth": frame.depth_m, "instances": frame.instances}
            there = [kind for kind, image in images.items() if image is not None]
            if i == 0:
                kinds = there
                for kind in kinds:
                    (root / kind).mkdir()
            if there != kinds:
                raise InputError(
                    f"{recording.name}: frame 0 has {' + '.join(kinds)}, but frame {i} {' + '.join(there)}"
                )
            if frame.camera != recording.camera:
                raise InputError(f"{recording.name}: frame {i} has another camera than the recording")
            _write_frame(frame, i, root, trajectory)
            if progress is not None:
                progress(i + 1, len(recording))
    _write_head(recording, kinds, root)


def _write_head(recording: Recording, kinds: Sequence[str], root: Path) -> None:
    if recording.truth is not None:
        write_json(root / TRUTH, {"objects": [_truth_item(item) for item in recording.truth]})
    camera = recording.camera
    head = {
        "schema": SCHEMA,
        "name": recording.name,
        "camera": {"width": int(camera.width), "height": int(camera.height)}
        | {field: float(getattr(camera, field)) for field in INTRINSICS},
        "depth": "depth" in kinds,
        "instances": "instances" in kinds,
        "simulator": recording.truth is not None,
        "notes": list(recording.notes),
    }
    if optional(recording, RecordingDefaults, "scale_guessed"):
        head["scale_guessed"] = True
    write_json(root / HEAD, head)


def _write_frame(frame: Frame, number: int, root: Path, trajectory: TextIO) -> None:
    images.write_rgb(root / _image("rgb", number, ".jpg"), frame.rgb)
    if frame.depth_m is not None:
        images.write_depth(root / _image("depth", number, ".png"), frame.depth_m)
    if frame.instances is not None:
        images.write_instances(root / _image("instances", number, ".png"), frame.instances)
    trajectory.write(trajectory_line(frame.time_s, frame.world_from_camera))


def _truth_item(item: TrueObject) -> dict[str, Any]:
    corners = {"box_min": [float(v) for v in item.box_min], "box_max": [float(v) for v in item.box_max]}
    return {"id": int(item.id), "label": item.label, **corners}


def _image(kind: str, number: int, suffix: str) -> str:
    return f"{kind}/{number:06d}{suffix}"


def _posed(times_s: Array, poses: Array, where: str) -> tuple[npt.NDArray[np.intp], list[str]]:
    """The numbers of the images of one run that have a pose, and notes. Raises InputError if there are none."""
    numbers = np.flatnonzero(~lost(poses))
    if not len(numbers):
        raise InputError(f"{where}: every pose is NaN: tracking was lost")
    left = len(poses) - len(numbers)
    notes = [f"{left} images left out: they have no pose (tracking was lost)"] if left else []
    keep, says = one_run(times_s[numbers], poses[numbers])
    return numbers[keep], [*notes, *says]


def _check_count(files: Files, folder: str, suffix: str, poses: int) -> None:
    """Refuse a folder of images that are not as many as there are poses."""
    there = {name for name in files.names(folder) if name.endswith(suffix) and not name.startswith(".")}
    wanted = {f"{i:06d}{suffix}" for i in range(poses)}
    if there != wanted:
        odd = min(there ^ wanted)
        trouble = f"{odd} is missing" if odd in wanted else f"{odd} has no pose"
        raise InputError(
            f"{files.where(folder)} holds {len(there)} images but {TRAJECTORY} holds {poses} poses: {trouble}"
        )


class _Fields:
    """A JSON object that says which field is missing or of the wrong type."""

    def __init__(self, value: Any, path: str) -> None:
        if not isinstance(value, dict):
            raise InputError(f"{path} must hold a JSON object, got {type(value).__name__}")
        self.value, self.path = value, path

    def get(self, field: str, kind: type) -> Any:
        value = self.value.get(field)
        if type(value) is not kind:
            raise InputError(f"{self.path}: field {field!r} must be of type {kind.__name__}, got {brief(value, 40)!r}")
        return value

    def flag(self, field: str, default: bool) -> bool:
        return bool(self.get(field, bool)) if field in self.value else default

    def number(self, field: str) -> float:
        value: Any = self.value.get(field)
        if type(value) not in (int, float) or not abs(value) <= sys.float_info.max:
            raise InputError(f"{self.path}: field {field!r} must be a finite number, got {brief(value, 40)!r}")
        return float(value)

    def line(self, field: str) -> str:
        value = self.get(field, str)
        if len(value) > MAX_LINE_CHARS or not value.isprintable():
            raise InputError(f"{self.path}: field {field!r} must be one line of {MAX_LINE_CHARS} characters at most")
        return str(value)

    def lines(self, field: str) -> list[str]:
        return [_Fields({field: value}, self.path).line(field) for value in self.get(field, list)]

    def corner(self, field: str) -> tuple[float, ...]:
        values = self.get(field, list)
        if len(values) != 3:
            raise InputError(f"{self.path}: field {field!r} must be 3 numbers, got {len(values)}")
        return tuple(_Fields({field: value}, self.path).number(field) for value in values)


def _camera(fields: _Fields) -> Camera:
    width, height = fields.get("width", int), fields.get("height", int)
    try:
        return Camera(width, height, *(fields.number(field) for field in INTRINSICS))
    except InputError as error:
        raise InputError(f"{fields.path}: {error}") from error


def _json(files: Files, name: str) -> Any:
    return parse_json(files.read(name, MAX_JSON_BYTES), files.where(name))


def _read_truth(files: Files) -> list[TrueObject]:
    path = files.where(TRUTH)
    items = (_Fields(item, path) for item in _Fields(_json(files, TRUTH), path).get("objects", list))
    return [
        TrueObject(item.get("id", int), item.line("label"), item.corner("box_min"), item.corner("box_max"))
        for item in items
    ]
