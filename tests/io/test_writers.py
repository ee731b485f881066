"""Writers: what was said to be written is on the disk, whatever byte the disk is full at; what failed left nothing."""

from __future__ import annotations

import errno
import os
import resource
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cartier.errors import InputError
from cartier.io import atomic
from cartier.io.atomic import append_line, append_lines, create_file, opened_log, replaced_file, write_file
from cartier.io.spool import Spool, SpoolWriter

OLD = b'{"a": 1}\n'


@contextmanager
def full_at(size: int) -> Iterator[None]:
    """No file may grow beyond so many bytes: of a write that would, the system takes a part, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def pushed(path: Path) -> None:
    with replaced_file(path) as beside, beside.open("wb") as file:
        file.write(b"new content\n")


WRITERS: dict[str, tuple[Callable[[Path], None], bytes]] = {
    "append": (lambda path: append_line(path, '{"b": "two"}'), OLD + b'{"b": "two"}\n'),
    "append two": (lambda path: append_lines(path, ["3", "4"]), OLD + b"3\n4\n"),
    "write": (lambda path: write_file(path, b"new content\n"), b"new content\n"),
    "push": (pushed, b"new content\n"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_full_at_any_byte_all_or_nothing(tmp_path: Path, name: str) -> None:
    write, new = WRITERS[name]
    file, refused = tmp_path / "log.jsonl", 0
    for size in range(len(new) + 2):
        file.write_bytes(OLD)
        try:
            with full_at(size):
                write(file)
            assert file.read_bytes() == new and size >= len(new)
        except InputError as error:
            refused += 1
            assert file.read_bytes() == OLD and "cannot be written" in str(error)
        assert [path.name for path in tmp_path.iterdir()] == ["log.jsonl"]
    assert refused == len(new)


@pytest.mark.parametrize("name", WRITERS)
def test_a_failing_sync_is_no_success(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    def fails(handle: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    file = tmp_path / "log.jsonl"
    file.write_bytes(OLD)
    monkeypatch.setattr(atomic.os, "fsync", fails)
    with pytest.raises(InputError, match="cannot be written: Input/output error"):
        WRITERS[name][0](file)
    assert file.read_bytes() == OLD
    assert not create_file(file, b"other")


def test_a_spool_keeps_whole_records(tmp_path: Path) -> None:
    path = tmp_path / "home.spool"
    writer = SpoolWriter(path, {"name": "walk"})
    size = path.stat().st_size
    for limit in range(size, size + 60):
        try:
            with full_at(limit):
                writer.ended("a home")
            break
        except InputError:
            assert path.stat().st_size == size
    writer.ended("a home")
    writer.close()
    assert limit > size + 20
    assert len(Spool(path).places) == 3 and Spool(path).end == path.stat().st_size


def test_a_replaced_log_gets_the_line(tmp_path: Path) -> None:
    """One that waits for the lock of a log that is replaced meanwhile writes into the new one."""
    log = tmp_path / "log.jsonl"
    log.write_bytes(OLD)
    with opened_log(log):
        waiting = threading.Thread(target=append_line, args=(log, "2"))
        waiting.start()
        waiting.join(0.05)
        assert waiting.is_alive()
        write_file(log, b"1\n")
    waiting.join()
    assert log.read_bytes() == b"1\n2\n"


def test_lines_of_many_threads_all_stay(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    threads = [threading.Thread(target=append_line, args=(log, str(number))) for number in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(map(int, log.read_text().split())) == list(range(12))
