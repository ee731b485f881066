"""The photograph detector that ships inside: NanoDet-Plus-m (RangiLyu, Apache-2.0), trained on COCO; see NOTICE and LICENSE."""

from __future__ import annotations

import hashlib
from pathlib import Path

from cartier.errors import InputError

MODEL = Path(__file__).parent / "nanodet-plus-m-416.onnx"
SIDECAR = MODEL.with_suffix(".json")
SHA256 = "184238fd351c371ba3cd9353985e0d508db60507ee683e37fe4d1f2e8f45b217"


def checked() -> tuple[Path, Path]:
    """The model and its sidecar. Raises InputError unless the model is the one that was shipped."""
    for file in (MODEL, SIDECAR):
        if not file.is_file():
            raise InputError(f"{file} is missing: install cartier again")
    found = hashlib.sha256(MODEL.read_bytes()).hexdigest()
    if found != SHA256:
        raise InputError(f"{MODEL} was changed: its sha256 is {found[:12]}…, not {SHA256[:12]}…; install cartier again")
    return MODEL, SIDECAR
