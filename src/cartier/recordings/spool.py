"""The spool of a live session (HOME.spool): its keyframes as a recording, with their last corrected poses."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cartier.contracts import Recording
from cartier.errors import InputError, brief, frame_number
from cartier.io.spool import MAGIC, SUFFIX, Spool
from cartier.recordings.common.files import READERS, content_hash
from cartier.types import Camera, Detections, Frame, TrueObject

MAX_NOTES, MAX_NOTE = 20, 300  # of the source, and their length


def matches(path: Path) -> bool:
    """Whether a file is a spool."""
    if path.suffix != SUFFIX or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def open(path: str | Path) -> Recording:
    """Read a spool, without what a kill left of its last record."""
    return SpoolRecording(Spool(Path(path)))


class SpoolRecording:
    """Obeys the Recording contract; a keyframe is read when it is asked for."""

    truth: Sequence[TrueObject] | None = None
    readers = READERS

    def __init__(self, spool: Spool) -> None:
        self._spool, self._places = spool, spool.in_time()
        if not self._places:
            raise InputError(f"{spool.path} holds no keyframe yet")
        begun = spool.begin()
        self.name = str(begun.get("name") or spool.path.stem)
        self.camera: Camera = spool.keyframe(self._places[0], 0).frame.camera
        updates = len(list(spool.updates()))
        notes = begun.get("notes")
        self.notes: Sequence[str] = [
            *(brief(str(note), MAX_NOTE) for note in (notes if isinstance(notes, list) else ())[:MAX_NOTES]),
            f"the {len(self._places)} keyframes of a live session; frames between them were not kept",
            *([f"{spool.damaged} damaged records left out"] if spool.damaged else []),
            *([f"the poses are those after {updates} corrections"] if updates else []),
        ]
        self._fingerprint: str | None = None

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: int) -> Frame:
        i = frame_number(index, len(self), self.name)
        return self._spool.keyframe(self._places[i], i).frame

    def detections(self, index: int) -> Detections:
        """What the live session's detector found in a frame. Raises InputError if it did not come to it."""
        found = self._spool.keyframe(self._places[frame_number(index, len(self), self.name)], index).detections
        if found is None:
            raise InputError(f"{self._spool.path}: the session was cut off before keyframe {index} was looked at")
        return found

    def fingerprint(self) -> str:
        if self._fingerprint is None:
            self._fingerprint = content_hash("spool 1", self._spool.path.parent, [self._spool.path.name])
        return self._fingerprint
