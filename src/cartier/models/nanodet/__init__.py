"""Embedded photograph detector: NanoDet-Plus-m (RangiLyu, Apache-2.0), trained on COCO; see NOTICE and LICENSE."""

from __future__ import annotations

from pathlib import Path

from cartier.errors import InputError
from cartier.models import read_shipped

MODEL = Path(__file__).parent / "nanodet-plus-m-416.onnx"
SIDECAR = MODEL.with_suffix(".json")
SHA256 = "184238fd351c371ba3cd9353985e0d508db60507ee683e37fe4d1f2e8f45b217"


def checked() -> tuple[Path, Path]:
    """The model and its sidecar. Raises InputError unless the model is the one that was shipped."""
    read_shipped(MODEL, SHA256)
    if not SIDECAR.is_file():
        raise InputError(f"{SIDECAR} is missing: install cartier again")
    return MODEL, SIDECAR
