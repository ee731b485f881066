"""A recording of image files with a pose each: what the readers of folder formats share.

A reader gives a ``Source``: the files of each frame, the lens that took them, and the poses in the source's own world,
camera axes already optical. This module moves depth of another size or lens to the colour camera's pixels, reduces
images that are too large for a map, levels the world, and turns the images of a camera that was held sideways.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from cartier.errors import MAX_FAR_M, InputError, frame_number
from cartier.io.images import check_depth, read_depth, read_grey8, read_rgb
from cartier.mapping import gravity
from cartier.mapping.upright import turned_camera, turned_image
from cartier.recordings.common.clock import one_run
from cartier.recordings.common.edges import Registration
from cartier.recordings.common.files import READERS, content_hash, link_notes
from cartier.recordings.common.lens import Lens, off_centre_notes, resampled
from cartier.recordings.common.poses import lost
from cartier.types import Array, Camera, Frame, TrueObject

MAX_SIDE = 1300  # px; larger images are reduced by a whole factor: no map needs a phone's 12 megapixels
MAX_ASPECT_ERROR = 0.02  # between the shapes of depth and colour images
CONFIDENCE_FRAMES = 5
Depths = npt.NDArray[np.float32]
Colours = npt.NDArray[np.uint8]


def png_depth(path: Path, per_metre: float = 1000.0) -> Depths:
    """(h, w) float32 metres of a 16-bit PNG of any size, in units of 1/per_metre m."""
    return read_depth(path, None, per_metre)


@dataclass(frozen=True)
class View:
    """The files of one frame. ``depth`` may be smaller than ``colour``; ``confidence`` has the size of ``depth``."""

    time_s: float
    colour: Path
    lens: Lens
    depth: Path | None = None
    confidence: Path | None = None


@dataclass(frozen=True, eq=False)
class Source:
    """What a reader found in the files below ``root``.

    ``settings`` names the reader, its version and its own options; ``files`` are hashed with them for the fingerprint.
    """

    root: Path
    settings: str
    views: Sequence[View]
    world_from_camera: Array
    """(N, 4, 4) in the source's own world, camera axes optical."""
    files: Sequence[str]
    notes: Sequence[str]
    read_depth: Callable[[Path], Depths] = png_depth
    """(h, w) float32 metres, NaN for no reading. ``readers`` threads may call it and ``read_colour`` at once."""
    read_colour: Callable[[View], Colours] | None = None
    name: str = ""
    """By default the root's."""
    depth_lens: Lens | None = None
    """The depth camera's, if it is not the colour camera's at the depth's own size."""
    min_confidence: int = 0
    known_up: tuple[float, float, float] | None = None
    """The source's up, if its makers document it."""
    handheld: bool = True
    """Whether images may have to be turned upright."""
    scale_guessed: bool = False
    """Whether nobody measured the metres."""
    clocked: bool = True
    """Whether ``time_s`` is of one clock, in the order in which the images were taken."""
    registration: Registration | None = None
    """How depth that is published raw is moved onto the colour images, if it is; ``views`` have their lens."""
    readers: int = READERS
    """A video is read by one thread, in order."""


class PosedImages:
    """A recording over a Source. Poses are read when it is opened, images when a frame is asked for."""

    truth: Sequence[TrueObject] | None = None

    def __init__(self, source: Source, up: Sequence[float] | None, floor_m: float | None) -> None:
        source = _usable(source)
        links = link_notes(source.root, source.files)
        self.name, self.readers = source.name or source.root.resolve().name, source.readers
        self.scale_guessed = source.scale_guessed
        self._source, self._settings = source, f"{source.settings} up={up} floor_m={floor_m}"
        first = source.views[0].lens.camera
        self._factor = -(-max(first.width, first.height) // MAX_SIDE)
        self._upright_camera = _reduced(first, self._factor)
        poses = np.asarray(source.world_from_camera, dtype=np.float64)
        far = np.abs(poses[:, :3, 3]).max(axis=1)
        if far.max() > MAX_FAR_M:
            raise InputError(
                f"{source.root}: {source.views[int(far.argmax())].colour.name} was taken {far.max():.3g} m from the "
                "origin by its pose, which is no home: are the units metres?"
            )
        self._check_confidence()
        depth = self._depth if any(view.depth for view in source.views) else None
        levelling = gravity.level(poses, self._upright_camera, depth, up, floor_m, source.known_up)
        self.level_from_world = levelling.level_from_world  # the doctor checks the poses as they were given
        poses = levelling.level_from_world @ poses
        check_floor(poses, floor_m)
        self._turns = levelling.turns if source.handheld else 0
        self.camera, old_from_new = turned_camera(self._upright_camera, self._turns)
        self._poses = poses @ old_from_new
        self._poses.setflags(write=False)
        notes = [*source.notes, *links, *off_centre_notes(first), *levelling.notes]
        if self._factor > 1:
            notes.append(f"images of {first.width}x{first.height} px reduced by {self._factor}")
        if self._turns:
            notes.append(f"images turned by {90 * self._turns} degrees, so that up is up")
        if any(view.lens != source.views[0].lens for view in source.views):
            notes.append("the images' own intrinsics differ; all were resampled to those of the first")
        self.notes: Sequence[str] = notes

    def __len__(self) -> int:
        return len(self._source.views)

    def __getitem__(self, index: int) -> Frame:
        i = frame_number(index, len(self), self.name)
        depth_m = self._depth(i)
        return Frame(
            index=i,
            time_s=self._source.views[i].time_s,
            rgb=turned_image(self._colour(i), self._turns),
            depth_m=None if depth_m is None else turned_image(depth_m, self._turns),
            world_from_camera=self._poses[i],
            camera=self.camera,
        )

    def fingerprint(self) -> str:
        return self._fingerprint

    @cached_property
    def _fingerprint(self) -> str:
        return content_hash(self._settings, self._source.root, self._source.files)

    def _check_confidence(self) -> None:
        """Raises InputError where all depth of some frames is dropped for its confidence."""
        source, dropped = self._source, 0
        if not source.min_confidence:
            return
        for i in np.unique(np.linspace(0, len(self) - 1, CONFIDENCE_FRAMES).round().astype(int)).tolist():
            view, depth_m = source.views[i], self._depth(i)
            if depth_m is None or view.depth is None or np.isfinite(depth_m).any():
                return
            dropped += bool(np.isfinite(source.read_depth(view.depth)).any())
        if dropped:
            raise InputError(
                f"{source.root}: all depth is below --confidence {source.min_confidence} in the {dropped} frames "
                "checked: give a lower one, 0 for all depth"
            )

    def _colour(self, i: int) -> Colours:
        view, read = self._source.views[i], self._source.read_colour
        rgb = read_rgb(view.colour, view.lens.camera) if read is None else read(view)
        lens = replace(view.lens, camera=_reduced(view.lens.camera, self._factor))
        return np.asarray(resampled(_shrunk(rgb, self._factor), lens, self._upright_camera, 0), dtype=np.uint8)

    def _depth(self, i: int) -> Depths | None:
        view = self._source.views[i]
        if view.depth is None:
            return None
        depth_m = self._source.read_depth(view.depth)
        check_depth(depth_m, str(view.depth))
        height, width = depth_m.shape
        lens = self._source.depth_lens or view.lens
        if (lens.camera.width, lens.camera.height) != (width, height):
            if abs(width / height / (lens.camera.width / lens.camera.height) - 1) > MAX_ASPECT_ERROR:
                raise InputError(
                    f"{view.depth} is {width}x{height} px, which is not the shape of the colour images "
                    f"({lens.camera.width}x{lens.camera.height})"
                )
            lens = lens.scaled(width, height)
        if view.confidence is not None:
            confidence = read_grey8(view.confidence, (width, height))
            depth_m = np.where(confidence < self._source.min_confidence, np.float32(np.nan), depth_m)
        depth_m = np.asarray(resampled(depth_m, lens, self._upright_camera, np.nan), dtype=np.float32)
        moved = self._source.registration
        return depth_m if moved is None else np.asarray(moved.register(depth_m), np.float32)


def _usable(source: Source) -> Source:
    """The source's frames of one run that have a pose. Raises InputError if there are none."""
    poses = np.asarray(source.world_from_camera, dtype=np.float64).reshape(-1, 4, 4)
    keep = ~lost(poses)
    notes = [f"{(~keep).sum()} images left out: they have no pose (tracking was lost)"] if not keep.all() else []
    if not keep.any():
        raise InputError(f"{source.root}: no image can be used: {'; '.join(notes) or 'none has a pose'}")
    if source.clocked:
        at = np.flatnonzero(keep)
        of_run, says = one_run(np.array([source.views[i].time_s for i in at.tolist()]), poses[at])
        keep[at], notes = of_run, notes + says
    views = [view for view, kept in zip(source.views, keep, strict=True) if kept]
    return replace(source, views=views, world_from_camera=poses[keep], notes=[*notes, *source.notes])


def check_confidence(confidence: int, highest: int) -> None:
    """Raises InputError for a least confidence of depth that the format does not have."""
    if not 0 <= confidence <= highest:
        raise InputError(f"--confidence {confidence}: this format's depth has confidences of 0 to {highest}")


def check_floor(level_from_camera: npt.NDArray[np.float64], floor_m: float | None) -> None:
    """Raises InputError if the user's floor, z = 0 of levelled poses (N, 4, 4), lies above every camera."""
    highest_m = float(level_from_camera[:, 2, 3].max())
    if floor_m is not None and highest_m <= 0:
        raise InputError(
            f"--floor {floor_m:g} lies above every camera: the highest is at {floor_m + highest_m:.2f} m along up in "
            "the recording's own world"
        )


def _reduced(camera: Camera, factor: int) -> Camera:
    """The camera of ``_shrunk`` images: whole blocks only."""
    if factor == 1:
        return camera
    centre = ((c + 0.5) / factor - 0.5 for c in (camera.cx, camera.cy))
    return Camera(camera.width // factor, camera.height // factor, camera.fx / factor, camera.fy / factor, *centre)


def _shrunk(rgb: Colours, factor: int) -> Colours:
    """Means of blocks of ``factor`` x ``factor`` pixels."""
    if factor == 1:
        return rgb
    height, width = (side // factor * factor for side in rgb.shape[:2])
    return np.asarray(Image.fromarray(rgb).reduce(factor, box=(0, 0, width, height)))
