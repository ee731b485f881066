"""What a home keeps of a recording that it was mapped from, as JSON values."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from cartier.contracts import Recording, RecordingDefaults, optional
from cartier.mapping.poses.alignment import Alignment
from cartier.mapping.poses.pose_graph import Mended
from cartier.mapping.upright import Levelled


def recording_row(
    recording: Recording, looked: int | None, mended: Mended | None, aligned: Alignment | None
) -> dict[str, Any]:
    """Its name and content, in how many frames objects were looked for, how it was read, and how its poses changed."""
    row: dict[str, Any] = {
        "recording": recording.name, "sha256": recording.fingerprint(), "frames": len(recording),
        "looked": len(recording) if looked is None else looked,
    }  # fmt: skip
    if read_with := optional(recording, RecordingDefaults, "read_with"):  # so that it can be read again as it was
        plain = {name: np.asarray(value).tolist() for name, value in read_with.items()}
        row["read_with"] = json.loads(json.dumps(plain, default=str))
    levelled: Levelled | None = optional(recording, RecordingDefaults, "levelled")
    if levelled is not None and levelled.changes():
        row |= levelled.row()
    if mended is not None:
        row["mended"] = mended.rows()
    if aligned is not None:
        row["moved"] = aligned.row()
    return row
