"""Numbers that the frames of a recording have in the home that was mapped from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.errors import InputError
from cartier.home import Home
from cartier.mapping.poses.alignment import Alignment
from cartier.mapping.poses.motions import Reposed
from cartier.mapping.poses.pose_graph import Mended
from cartier.mapping.upright import Levelled, Upright


def first_frame_of(home: Home, recording: Recording) -> int:
    """The number that the recording's first frame has in the home. Raises InputError if it was not mapped from it."""
    first, sha256, rows = 0, recording.fingerprint(), home.settings.get("recordings", ())
    for row in rows:
        if row["sha256"] == sha256:
            return first
        first += int(row["frames"])
    here = _read_with(optional(recording, RecordingDefaults, "read_with"))
    named = [_read_with(row.get("read_with", {})) for row in rows if row["recording"] == recording.name]
    if not named:
        names = ", ".join(row["recording"] for row in rows)
        wrong = f"{home.name} was not mapped from {recording.name}, but from {names}"
        raise InputError(f"{wrong}: give that, or leave it out")
    if here in named:
        raise InputError(
            f"{home.name} was mapped from {recording.name}, but its files or its reader changed: map it again"
        )
    options = f"read with {' or '.join(named)}; here it is read with {here}"
    raise InputError(f"{home.name} was mapped from {recording.name} {options}")


def as_mapped(home: Home, recording: Recording) -> Recording:
    """The recording as the home was mapped from it: it may have been levelled, its poses corrected, or moved."""
    sha256 = recording.fingerprint()
    rows: list[Mapping[str, Any]] = [*home.settings.get("recordings", ()), {"sha256": sha256}]
    row = next(row for row in rows if row["sha256"] == sha256)
    if row.get("level"):
        recording = Upright(recording, Levelled.of_row(row))
    if row.get("mended"):
        recording = Reposed(recording, Mended.of_rows(row["mended"]).pose)
    return recording if row.get("moved") is None else Reposed(recording, Alignment.of_row(row["moved"]).pose)


def _read_with(options: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in sorted(options.items())) or "no options"
