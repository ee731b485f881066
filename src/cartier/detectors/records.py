"""The objects of a JSON list or of a JSON-lines file, one in memory at a time, each with the line that it begins on."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn, TextIO

from cartier.errors import InputError, brief
from cartier.io.files import check_file

MAX_FILE_BYTES = 2**30
MAX_RECORD_CHARACTERS = 2**24
CHUNK = 2**20
SPACE = re.compile(r"[ \t\r\n]*")


def records(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
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
