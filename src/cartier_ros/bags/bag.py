"""A whole bag: its files as one, its topics by name, its messages decoded with the types that rosbags knows."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cartier.errors import InputError, brief
from cartier.io.bounded_file import MAX_BLOCK, MAX_TOPICS, WHOLE, Index, Storage, Topic, check_count, index_part
from cartier.io.files import read_text
from cartier.io.strict_yaml import YamlFault, read_yaml
from cartier.recordings.common.files import link_notes, names_in
from cartier.recordings.common.sqlite import SqliteFile
from cartier_ros.bags.bag1 import Bag1
from cartier_ros.bags.mcap import Mcap
from cartier_ros.messages import DEFINITIONS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

METADATA = "metadata.yaml"
MAX_METADATA = 4 << 20
MAX_NAME = 256  # of a topic or a frame
PAUSE_NS = 10 * 10**9  # between two recordings, and never between the parts of one
MOST_LATE_NS = 10**7  # messages of one topic may be written in another order than they came, but not by more
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


class Sqlite:
    """A .db3 file, opened read-only."""

    def __init__(self, path: Path) -> None:
        self._path = path
        kinds = ("TABLE", "INDEX", "UNIQUE INDEX")
        self._file = SqliteFile(path, "ROS 2 bag", ("topics", "messages"), kinds, MAX_BLOCK)
        rows = self._file.ask(f"SELECT id, name, type, serialization_format FROM topics LIMIT {MAX_TOPICS + 1}")
        check_count(len(rows), path)
        self.topics: Sequence[Topic] = [
            Topic(str(name), str(kind), str(form), key) for key, name, kind, form in rows if isinstance(key, int)
        ]

    def index(self, topic: Topic) -> Index:
        rows = self._file.ask("SELECT timestamp, id FROM messages WHERE topic_id = ? ORDER BY timestamp, id", topic.key)
        if not rows:
            return np.empty((0, 3), np.int64)
        if not all(isinstance(value, int) for row in rows for value in row):
            raise InputError(f"{self._path} is damaged: a message of {topic.name} has no time or number")
        return index_part([time_ns for time_ns, _ in rows], 0, [number for _, number in rows])

    def read(self, chunk: int, offset: int, limit: int = WHOLE) -> bytes:
        return self._file.blob("messages", "data", offset, None if limit == WHOLE else limit)


READERS: dict[str, Callable[[Path], Storage]] = {".bag": Bag1, ".mcap": Mcap, ".db3": Sqlite}


class Header(NamedTuple):
    """A message's own time stamp and coordinate frame, and whether it is an image without pixels or bytes."""

    stamp_ns: int
    frame: str
    empty_image: bool


def files_of(path: Path) -> list[Path]:
    """The files that a bag consists of, by name, their numbers as numbers; none if it is no bag."""
    if path.is_file():
        return [path] if path.suffix in READERS else []
    if not path.is_dir():
        return []
    names = (name for name in names_in(path) if name.endswith(tuple(READERS)) and name[0] != ".")
    return [
        path / name for name in sorted(names, key=lambda name: (re.sub(r"\d+", lambda n: n[0].zfill(20), name), name))
    ]


class Bag:
    """A .bag, .mcap or .db3 file, or a ROS 2 bag's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = files_of(path)
        metadata = [METADATA] if (path / METADATA).exists() else []
        self.notes = link_notes(path, metadata + [file.name for file in self.files]) if path.is_dir() else []
        self._packed, listed = _check_metadata(path, self.files) if path.is_dir() else (False, set())
        self._loose = any(file.name not in listed for file in self.files)
        kinds = sorted({file.suffix for file in self.files})
        if len(kinds) != 1:
            there = (
                f"it holds {', '.join(kinds)} files" if kinds else "it is no .bag, .mcap or .db3 file or folder of them"
            )
            raise InputError(f"{path} is not one bag: {there}")
        self._storages = [READERS[file.suffix](file) for file in self.files]
        self._topics: dict[str, list[tuple[int, Topic]]] = {}
        for number, storage in enumerate(self._storages):
            for topic in storage.topics:
                checked_name(topic.name, path)
                self._topics.setdefault(topic.name, []).append((number, topic))
        if len(self._topics) > MAX_TOPICS:
            raise InputError(f"{path} has {len(self._topics)} topics; cartier reads bags of up to {MAX_TOPICS}")

    def topics(self, *types: str) -> list[str]:
        """The names of the topics of some types, sorted."""
        return sorted(name for name, parts in self._topics.items() if parts[0][1].type in types)

    def all_topics(self) -> list[str]:
        """The names of all topics, sorted."""
        return sorted(self._topics)

    def type_of(self, name: str) -> str:
        return self._topics[name][0][1].type if name in self._topics else ""

    def index(self, name: str) -> Index:
        """(N, 4): log time in ns, file, chunk and offset of a topic's messages, by log time; ``read`` takes a row."""
        kind, parts = self.type_of(name), []
        for number, topic in self._topics[name]:
            if topic.type != kind:
                kinds = f"{brief(kind, 60)} and {brief(topic.type, 60)}"
                raise InputError(f"{self.path}: topic {name} has two types, {kinds}")
            part = self._storages[number].index(topic)
            parts.append(np.insert(part, 1, number, axis=1))
        index = np.concatenate(parts)
        return np.asarray(index[np.argsort(index[:, 0], kind="stable")])

    @cached_property
    def logged(self) -> bool:
        """Whether the log times of images and transforms grow as they were written."""
        for name in self.topics(IMAGE, COMPRESSED, *TRANSFORMS):
            try:
                index = self.index(name)
            except InputError:  # whoever reads the topic is told
                continue
            written = index[np.argsort(_places(index), kind="stable")]
            steps_ns = np.diff(written[:, 0])[np.diff(written[:, 1]) == 0]
            if (steps_ns < -MOST_LATE_NS).any():
                return False
        return True

    def order(self, index: Index) -> Index:
        """(N,) numbers that grow as messages were recorded: their log times, or their places if these go back."""
        return index[:, 0] if self.logged else _places(index)

    def pauses(self, index: Index) -> list[int]:
        """Orders between the messages of a topic at which another recording begins.

        It is another file, after a pause, and no metadata binds the two.
        """
        order = self.order(index)
        other = (np.diff(index[:, 1]) != 0) & (np.diff(index[:, 0]) > PAUSE_NS) & self._loose
        return [int(order[i] + (order[i + 1] - order[i]) // 2) for i in np.flatnonzero(other)]

    def read(self, row: Index, limit: int = WHOLE) -> bytes:
        """The bytes of the message of one index row, or about the first ``limit`` of them."""
        _, number, chunk, offset = (int(value) for value in row)
        if self._packed:
            return _unpacked(self._storages[number].read(chunk, offset), self.path)
        return self._storages[number].read(chunk, offset, limit)

    def header(self, name: str, row: Index) -> Header:
        """The header that a message begins with, and whether an image comes after it; the rest is not read."""
        data = self.read(row, 16 + 2 * MAX_NAME)
        return header_of(data, self.type_of(name), self.encoding(name), f"{self.path}: a message of {name}")

    def decode(self, name: str, data: bytes) -> Any:
        """A message as an object with the fields of its type."""
        kind, encoding = self.type_of(name), self.encoding(name)
        if encoding not in ("cdr", "ros1"):
            raise InputError(
                f"{self.path}: topic {name} is encoded as {brief(encoding, 40)!r}; cartier reads cdr and ros1"
            )
        return decoded(data, kind, encoding, f"{self.path}: a message of {name}")

    def encoding(self, name: str) -> str:
        return self._topics[name][0][1].encoding


def _places(index: Index) -> Index:
    """(N,) numbers that grow with a message's place: its file, its chunk and its offset."""
    return np.asarray((index[:, 1] << 54) + (np.maximum(index[:, 2], 0) << 28) + index[:, 3])


def decoded(data: bytes, kind: str, encoding: str, where: str) -> Any:
    """A message of type ``kind``, encoded as ``cdr`` or ``ros1``. Raises InputError for a damaged one."""
    from rosbags.serde import SerdeError

    types = _types(encoding)
    try:
        return types.deserialize_ros1(data, kind) if encoding == "ros1" else types.deserialize_cdr(data, kind)
    except (SerdeError, UnicodeDecodeError, struct.error, ValueError, AssertionError) as error:
        raise InputError(f"{where} is damaged ({brief(error)})") from error


def header_of(data: bytes, kind: str, encoding: str, where: str) -> Header:
    """The header that a message begins with, and whether an image comes after it; the rest is not read."""
    ros1 = encoding == "ros1"
    try:
        order = "<" if ros1 or data[1] & 1 else ">"
        seconds, nanoseconds, length = struct.unpack_from(f"{order}{'I' if ros1 else 'i'}II", data, 4)
    except (struct.error, IndexError) as error:
        raise InputError(f"{where} is too short to have a header") from error
    if length > MAX_NAME:
        raise InputError(f"{where} has a frame_id of {length} bytes")
    frame = data[16 : 16 + length].rstrip(b"\0").decode("utf-8", "replace")
    empty = _no_image(data, 16 + length, order, ros1, kind)
    return Header(seconds * 10**9 + nanoseconds, frame_name(frame, where), empty)


def _no_image(data: bytes, at: int, order: str, ros1: bool, kind: str) -> bool:
    """Whether the image whose header ends at ``at`` has no height, no width or no bytes; False for a damaged one."""

    def word(at: int) -> int | None:
        return struct.unpack_from(f"{order}I", data, at)[0] if at + 4 <= len(data) else None

    at += 0 if ros1 else -at % 4  # CDR's numbers lie at multiples of their size, ROS 1's follow at once
    if kind == IMAGE:
        return 0 in (word(at), word(at + 4))
    if kind != COMPRESSED:
        return False
    at += 4 + (word(at) or 0)  # the format's name
    return word(at + (0 if ros1 else -at % 4)) == 0


def checked_name(name: str, path: Path | str) -> str:
    """The name of a topic or a frame, or an InputError if it is none that a robot would use."""
    if len(name) > MAX_NAME or not name.isprintable():
        raise InputError(f"{path} is damaged: {brief(name, 40)!r} is no name of a topic or a frame")
    return name


def frame_name(name: str, path: Path | str) -> str:
    """A frame's name without the slash of ROS 1."""
    return checked_name(name, path).lstrip("/")


@cache
def _types(encoding: str) -> Typestore:
    """The standard message types; those in the bag are not read, since a bag could define them as it likes."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_JAZZY)
    for name in TRANSFORMS:
        if name not in store.fielddefs:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    for name, definition in DEFINITIONS.items() if encoding != "ros1" else ():
        store.register(get_types_from_msg(definition, name))
    return store


def _check_metadata(folder: Path, files: Sequence[Path]) -> tuple[bool, set[str]]:
    """Whether each message is compressed, and the files of the bag; an InputError if metadata.yaml asks for others."""
    if not (folder / METADATA).exists():
        return False, set()
    try:
        value, _ = read_yaml(read_text(folder / METADATA, MAX_METADATA))
        information = value["rosbag2_bagfile_information"]
        mode, form = (brief(information.get(f"compression_{what}", "")) for what in ("mode", "format"))
        names = [Path(str(name)).name for name in information.get("relative_file_paths", ())]
    except YamlFault as fault:
        raise InputError(f"{folder / METADATA} line {fault.line}: {fault}") from fault
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{folder / METADATA} is damaged or describes no bag") from error
    mode = mode.lower()
    if mode == "file":
        raise InputError(
            f"{folder} holds compressed files: unpack them with 'zstd -d', or write it anew with 'ros2 bag convert'"
        )
    missing = sorted(set(names) - {file.name for file in files})
    if missing:
        raise InputError(f"{folder / brief(missing[0])} is missing, but {METADATA} names it")
    if mode == "message" and form != "zstd":
        raise InputError(f"{folder}: messages are compressed with {form!r}; cartier reads zstd")
    return mode == "message", set(names)


def _unpacked(data: bytes, path: Path) -> bytes:
    from backports.zstd import ZstdDecompressor, ZstdError

    try:
        plain = bytes(ZstdDecompressor().decompress(data, MAX_BLOCK))
    except (ZstdError, EOFError) as error:
        raise InputError(f"{path} is damaged: a message cannot be decompressed ({brief(error)})") from error
    if len(plain) == MAX_BLOCK:
        raise InputError(f"{path} is damaged: a message claims more than {MAX_BLOCK} bytes")
    return plain
