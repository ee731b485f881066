"""Embedded photograph detector: NanoDet-Plus-m-1.5x at two sizes and DEIMv2 femto, trained on COCO; see NOTICE."""

from __future__ import annotations

from pathlib import Path

from cartier.errors import InputError
from cartier.models import read_shipped

FOLDER = Path(__file__).parent
SCORES = FOLDER / "scores.json"
"""What the fused scores are worth: a ``DetectorScoreModel``."""
SHA256 = {
    "nanodet-plus-m-1.5x.onnx": "5b4ea5e1ece8514004d35c9a5407c16e1b800665830293c757e6672d7a17cd60",
    "deimv2-femto.onnx": "0f623daf3740034228c1686a7c1e70c1cb99bb66b3735eaf9134dd0c4f7fdefb",
}
MEMBERS = (
    ("nanodet-plus-m-1.5x.onnx", "nanodet-plus-m-1.5x-416.json"),
    ("nanodet-plus-m-1.5x.onnx", "nanodet-plus-m-1.5x-640.json"),
    ("deimv2-femto.onnx", "deimv2-femto-416.json"),
)
"""Networks and their sidecars, which hold the sizes of the images that they get."""


def checked() -> list[tuple[Path, Path]]:
    """The networks with their sidecars. Raises InputError unless the networks are those that were shipped."""
    for name, sha256 in SHA256.items():
        read_shipped(FOLDER / name, sha256)
    for name in (SCORES.name, *(sidecar for _, sidecar in MEMBERS)):
        if not (FOLDER / name).is_file():
            raise InputError(f"{FOLDER / name} is missing: install cartier again")
    return [(FOLDER / network, FOLDER / sidecar) for network, sidecar in MEMBERS]
