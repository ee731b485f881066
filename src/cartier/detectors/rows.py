"""Detections in files of other programs: read one by one and checked.

A file is a JSON list or JSON lines of COCO results, or of objects that name frame and label. One object is in memory at
a time, so that a file of 1 GiB can be read.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TextIO

from cartier.detectors.annotations import Annotations
from cartier.errors import InputError, brief
from cartier.io.files import check_file
from cartier.labels import MAX_NAME_CHARS, display_name

FORMS = 'COCO results {"image_id", "category_id", "bbox", "score"} or {"frame", "label", "score", "xyxy"}'
MAX_FRAME = 2**31
MAX_PIXEL = 1e6
MAX_FILE_BYTES = 2**30
MAX_RECORD_CHARACTERS = 2**24
CHUNK = 2**20
SPACE = re.compile(r"[ \t\r\n]*")


class Row(NamedTuple):
    line: int
    frame: int
    label: str
    score: float
    xyxy: tuple[float, float, float, float]


def rows(path: Path, annotations: Annotations | None) -> Iterator[Row]:
    """Every detection in the file; an InputError names the line of the first one that is wrong."""
    for line, record in _records(path):
        try:
            if "image_id" in record:
                yield _coco(line, record, annotations)
            elif "frame" in record and "detections" in record:
                yield from (_own(line, record["frame"], item) for item in _list(record["detections"]))
            elif "frame" in record:
                yield _own(line, record["frame"], record)
            elif "categories" in record:
                raise _Fault(
                    "these are annotations, not detections: name this file NAME.categories.json beside NAME.json"
                )
            else:
                raise _Fault(f"a detection must be {FORMS}")
        except _Fault as fault:
            raise InputError(f"{path} line {line}: {fault}") from None


class _Fault(Exception):
    """What is wrong with a row; the file and the line are added outside."""


def _coco(line: int, record: dict[str, Any], annotations: Annotations | None) -> Row:
    image, category = _whole(record, "image_id"), _whole(record, "category_id")
    if annotations is None:
        raise _Fault(
            f"category_id {_short(category)} needs a name: put the COCO or LVIS annotations (or a list of names) "
            "beside the file as NAME.categories.json, or give the option categories"
        )
    if category not in annotations.names:
        raise _Fault(f"there is no category {_short(category)} in {annotations.path}")
    frame = annotations.frames.get(image) if annotations.frames else image
    if frame is None:
        raise _Fault(f"there is no image {_short(image)} in {annotations.path}")
    x, y, width, height = _four(record, "bbox")
    if width < 0 or height < 0:
        raise _Fault(f"'bbox' must be [x, y, width, height], got {record['bbox']}: is it x1, y1, x2, y2?")
    return Row(line, _frame(frame), annotations.names[category], _score(record), (x, y, x + width, y + height))


def _own(line: int, frame: Any, item: Any) -> Row:
    if not isinstance(item, dict):
        raise _Fault(f"a detection must be {FORMS}")
    label = item.get("label")
    name = _name(label) if isinstance(label, str) and len(label) <= MAX_NAME_CHARS else ""
    if not name:
        raise _Fault(f"'label' must be a name of {MAX_NAME_CHARS} characters at most, got {_short(label)}")
    x1, y1, x2, y2 = _four(item, "xyxy")
    if x2 < x1 or y2 < y1:
        raise _Fault(f"'xyxy' must be [x1, y1, x2, y2] with x2 >= x1 and y2 >= y1, got {item['xyxy']}")
    return Row(line, _frame(frame), name, _score(item), (x1, y1, x2, y2))


@lru_cache(maxsize=4096)
def _name(label: str) -> str:
    return display_name(label)


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise _Fault(f"'detections' must be a list, got {_short(value)}")
    return value


def _whole(record: dict[str, Any], key: str) -> int:
    value = record.get(key)
    if type(value) is not int:
        raise _Fault(f"{key!r} must be a whole number, got {_short(value)}")
    return value


def _frame(value: Any) -> int:
    if type(value) is not int or not 0 <= value < MAX_FRAME:
        raise _Fault(f"the frame must be a whole number from 0, got {_short(value)}")
    return value


def _score(record: dict[str, Any]) -> float:
    value: Any = record.get("score")
    if type(value) not in (int, float) or not 0 <= value <= 1:
        raise _Fault(f"'score' must be a number from 0 to 1, got {_short(value)}")
    return float(value)


def _four(record: dict[str, Any], key: str) -> tuple[float, float, float, float]:
    value = record.get(key)
    if not isinstance(value, list) or len(value) != 4 or not all(map(_is_pixel, value)):
        raise _Fault(f"{key!r} must be 4 numbers in pixels, got {_short(value)}")
    a, b, c, d = map(float, value)
    return a, b, c, d


def _is_pixel(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= MAX_PIXEL


def _short(value: Any) -> str:
    quoted = brief(value, 60)
    return "nothing" if value is None else repr(quoted) if isinstance(value, str) else quoted


def _records(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """(line, object) of each element of a JSON list, or of each object of a JSON-lines file.

    Raises InputError with the line if the file is missing, larger than 1 GiB, damaged, or holds anything but objects.
    """
    check_file(path)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"{path} is larger than {MAX_FILE_BYTES // 2**30} GiB: drop the low scores or the masks")
        with path.open(encoding="utf-8-sig") as file:
            yield from _elements(_Text(path, file))
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error


def _elements(text: _Text) -> Iterator[tuple[int, dict[str, Any]]]:
    if text.peek() != "[":
        while text.peek():
            yield text.line, text.record()
        return
    text.step()
    while text.peek() != "]":
        yield text.line, text.record()
        if text.peek() == ",":
            text.step()
            text.expect("{")
        elif text.peek() != "]":
            text.fail("the list is not closed: is the file truncated?")
    text.step()
    if text.peek():
        text.fail("something follows the list")


class _Text:
    """A file's text and how far it has been read; a buffer holds the chunk in work."""

    def __init__(self, path: Path, file: TextIO) -> None:
        self.path, self.file = path, file
        self.buffer, self.at, self.line = "", 0, 1
        self.decoder = json.JSONDecoder(parse_constant=_refuse)

    def peek(self) -> str:
        """The next character that is no white space, or "" at the end."""
        while True:
            self._advance(_end_of_space(self.buffer, self.at))
            if self.at < len(self.buffer):
                return self.buffer[self.at]
            if not self._more():
                return ""

    def step(self) -> None:
        self._advance(self.at + 1)

    def expect(self, character: str) -> None:
        if self.peek() != character:
            self.fail(f"expected {character}, got {self.peek() or 'the end of the file: is it truncated?'}")

    def record(self) -> dict[str, Any]:
        """The object that begins here."""
        self.expect("{")
        while True:
            try:
                value, end = self.decoder.raw_decode(self.buffer, self.at)
                break
            except json.JSONDecodeError as error:
                if len(self.buffer) - self.at > MAX_RECORD_CHARACTERS:
                    self.fail(f"not valid JSON, or one object of more than {MAX_RECORD_CHARACTERS} characters")
                if not self._more():
                    self.line += self.buffer.count("\n", self.at, error.pos)
                    self.fail(f"not valid JSON ({error.msg})")
            except (ValueError, RecursionError) as error:
                self.fail(f"not a plain JSON object ({brief(error)})")
        self._advance(end)
        return dict(value)

    def fail(self, fault: str) -> NoReturn:
        raise InputError(f"{self.path} line {self.line}: {fault}")

    def _advance(self, to: int) -> None:
        self.line += self.buffer.count("\n", self.at, to)
        self.at = to

    def _more(self) -> bool:
        chunk = self.file.read(CHUNK)
        self.buffer, self.at = self.buffer[self.at :] + chunk, 0
        return bool(chunk)


def _end_of_space(text: str, at: int) -> int:
    found = SPACE.match(text, at)
    return found.end() if found else at


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no JSON number")
