"""Choice of a bag's topics for a recording: colour, depth and their CameraInfo, found by type, with notes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from cartier.errors import InputError, brief
from cartier.io.bounded_file import Index
from cartier.recordings.common.lens import Lens, off_centre_notes
from cartier_ros.bags.bag import COMPRESSED, IMAGE, Header, frame_name
from cartier_ros.bags.images import (
    COLOURS,
    GREY,
    INFO,
    encoding_of,
    is_depth,
    lens_of,
    size_of,
)

TRANSPORTS = ("/compressed", "/compressedDepth")
REGISTERED = ("align", "registered", "to_color", "to_rgb")
ASPECT_TOLERANCE = 0.02


class Messages(Protocol):
    """The messages of some topics: a bag, or what was heard of a stream so far."""

    @property
    def path(self) -> Path | str: ...
    def topics(self, *types: str) -> list[str]: ...
    def index(self, name: str) -> Index: ...
    def read(self, row: Index) -> bytes: ...
    def header(self, name: str, row: Index) -> Header: ...
    def decode(self, name: str, data: bytes) -> Any: ...


@dataclass(frozen=True, eq=False)
class Stream:
    """An image topic, as its first message shows it."""

    name: str
    index: Index
    frame: str
    encoding: str
    depth: bool
    width: int
    height: int

    @property
    def camera_name(self) -> str:
        """The topic without the transport: ``/camera/color/image_raw``."""
        return next((self.name.removesuffix(t) for t in TRANSPORTS if self.name.endswith(t)), self.name)

    @property
    def space(self) -> str:
        return self.camera_name.rpartition("/")[0]

    @property
    def rectified(self) -> bool:
        return "rect" in self.camera_name.rpartition("/")[2]


@dataclass(frozen=True, eq=False)
class Choice:
    """The streams of a recording and their lenses."""

    colour: Stream
    colour_lens: Lens
    depth: Stream | None
    depth_lens: Lens | None
    notes: Sequence[str]


def choose(bag: Messages, colour: str | None, depth: str | None, info: str | None) -> Choice:
    """The streams that were asked for, else those that fit best."""
    notes: list[str] = []
    streams = _streams(bag, {name.lstrip("/") for name in (colour, depth) if name is not None}, notes)
    infos = _infos(bag)
    depths = [s for s in streams if s.depth]
    colours = [s for s in streams if not s.depth and s.encoding not in GREY] or [s for s in streams if not s.depth]
    if colour is None and not colours:
        left_out = f" ({'; '.join(notes)})" if notes else ""
        raise InputError(f"{bag.path} holds depth but no colour images{left_out}")

    def colour_rank(s: Stream) -> tuple[Any, ...]:
        twin = any(d.frame == s.frame for d in depths)
        return (s.encoding not in COLOURS, _named(s, infos) is None, not twin, _transport(s), -len(s.index), s.name)

    seen = _pick(streams, colours, colour, colour_rank, "colour", notes)

    def depth_rank(s: Stream) -> tuple[Any, ...]:
        registered = any(word in s.name.lower() for word in REGISTERED)
        return (s.frame != seen.frame, not registered, _transport(s), -len(s.index), s.name)

    measured = _pick(streams, depths, depth, depth_rank, "depth", notes) if depths or depth else None
    colour_lens = _lens(bag, seen, infos, info, notes)
    depth_lens = None if measured is None else _depth_lens(measured, seen, infos, colour_lens, notes)
    return Choice(seen, colour_lens, measured, depth_lens, notes)


def _streams(bag: Messages, wanted: Collection[str], notes: list[str]) -> list[Stream]:
    """Every image topic that can be read; of the others, those that are wanted raise, the rest are noted."""
    found, faults = [], []
    for name in bag.topics(IMAGE, COMPRESSED):
        try:
            stream = _stream(bag, name)
        except InputError as error:
            if name.lstrip("/") in wanted:
                raise
            faults.append(error)
            continue
        found += [] if stream is None else [stream]
    if faults and not found:
        raise faults[0]
    if not found:
        raise InputError(f"{bag.path} holds no images: it has no message of type {IMAGE} or {COMPRESSED}")
    notes += [f"left out: {str(fault).removeprefix(f'{bag.path}: ')}" for fault in faults]
    return found


def _stream(bag: Messages, name: str) -> Stream | None:
    index = bag.index(name)
    if not len(index):
        return None
    first = next((row for row in index if not bag.header(name, row).empty_image), None)
    if first is None:
        raise InputError(f"{bag.path}: topic {name}: its images are empty (no pixels)")
    message = bag.decode(name, bag.read(first))
    encoding = encoding_of(message)
    frame = frame_name(str(message.header.frame_id), bag.path)
    depth = is_depth(message) and (encoding != "mono16" or "depth" in name)
    return Stream(name, index, frame, encoding, depth, *size_of(message, f"{bag.path}: topic {name}"))


def _pick(
    streams: Sequence[Stream],
    fitting: Sequence[Stream],
    wanted: str | None,
    rank: Callable[[Stream], tuple[Any, ...]],
    what: str,
    notes: list[str],
) -> Stream:
    if wanted is not None:
        found = next((s for s in streams if s.name.lstrip("/") == wanted.lstrip("/")), None)
        if found is None:
            names = brief(", ".join(s.name for s in streams), 300)
            raise InputError(f"there are no images on topic {wanted!r}; the image topics are {names}")
        if found.depth != (what == "depth"):
            raise InputError(f"topic {wanted!r} holds {'depth' if found.depth else 'colour'}, not {what}")
        return found
    best = min(fitting, key=rank)
    others = sorted({s.camera_name for s in fitting} - {best.camera_name})
    if others:
        notes.append(
            f"{what} taken from {best.name}; there are also {', '.join(others[:6])}: choose with --{what} TOPIC"
        )
    return best


def _transport(stream: Stream) -> bool:
    return stream.name != stream.camera_name


def _infos(bag: Messages) -> dict[str, Any]:
    """The first CameraInfo of each topic that has one."""
    found = {}
    for name in bag.topics(INFO):
        index = bag.index(name)
        if len(index):
            found[name] = bag.decode(name, bag.read(index[0]))
    return found


def _named(stream: Stream, infos: dict[str, Any]) -> str | None:
    """The CameraInfo beside a stream, else the only one of its frame."""
    beside = f"{stream.space}/camera_info"
    if beside in infos:
        return beside
    same = [name for name, info in infos.items() if str(info.header.frame_id).lstrip("/") == stream.frame]
    return same[0] if len(same) == 1 else None


def _lens(bag: Messages, stream: Stream, infos: dict[str, Any], wanted: str | None, notes: list[str]) -> Lens:
    name = wanted or _named(stream, infos)
    if name is None and len(infos) == 1:
        name = next(iter(infos))
        notes.append(f"intrinsics taken from {name}, the only CameraInfo there is; choose with --info TOPIC")
    if name is None or name not in infos:
        there = brief(", ".join(infos), 300) or "none"
        lack = f"topic {name!r} has no CameraInfo" if name else f"no CameraInfo belongs to {stream.name}"
        raise InputError(f"{bag.path}: {lack}; there are {there}: choose with --info TOPIC")
    lens, cut = _of_info(infos[name], stream, name, notes)
    notes += [] if cut else off_centre_notes(lens.camera)
    if lens.model != "pinhole":
        notes.append(f"lens distortion ({lens.model}) is taken out of the images")
    return lens


def _of_info(info: Any, stream: Stream, name: str, notes: list[str]) -> tuple[Lens, bool]:
    """The lens of a CameraInfo at the size of the stream's images, and whether these show a region of the sensor."""
    size = stream.width, stream.height
    described, cut = lens_of(info, stream.rectified, size, name)
    if cut:
        notes.append(cut)
    elif _size(described) != size:
        notes.append(f"{name} is of another resolution than {stream.name}; its intrinsics were scaled")
    elif (info.width, info.height) != size:
        notes.append(
            f"{name} says {info.width}x{info.height} px, but its intrinsics are those of {stream.name}'s "
            f"{size[0]}x{size[1]}"
        )
    return _scaled(described, stream, name), bool(cut)


def _depth_lens(stream: Stream, colour: Stream, infos: dict[str, Any], colour_lens: Lens, notes: list[str]) -> Lens:
    """The depth camera's own lens; the colour camera's where the depth is registered to it or nothing else is known."""
    name = _named(stream, infos)
    same = _size(colour_lens) == (stream.width, stream.height)
    if name is None or (stream.frame == colour.frame and (same or name == _named(colour, infos))):
        return colour_lens if same else _fit(colour_lens, stream)
    return _of_info(infos[name], stream, name, notes)[0]


def _size(lens: Lens) -> tuple[int, int]:
    return lens.camera.width, lens.camera.height


def _scaled(lens: Lens, stream: Stream, name: str) -> Lens:
    """The lens at the stream's size, which must be of the same shape."""
    width, height = _size(lens)
    if (width, height) == (stream.width, stream.height):
        return lens
    if abs(stream.width / width / (stream.height / height) - 1) > ASPECT_TOLERANCE:
        raise InputError(
            f"{name} is for images of {width}x{height} px, but those of {stream.name} have "
            f"{stream.width}x{stream.height}"
        )
    return lens.scaled(stream.width, stream.height)


def _fit(lens: Lens, stream: Stream) -> Lens:
    return _scaled(lens, stream, "the colour camera's CameraInfo")
