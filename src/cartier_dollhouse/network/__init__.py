"""Embedded dollhouse detector: the network's files, checked (built by tools/train_dollhouse_detector.py)."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartier.errors import InputError
from cartier.io.files import read_json
from cartier.models import read_shipped
from cartier.types import Array, DetectorScoreModel

FOLDER = Path(__file__).parent
WIDTH = 384  # of the text encoder's vectors
MODEL, WORDS, NAMES = "detector.onnx", "words.npy", "names.json"


@dataclass(frozen=True, eq=False)
class DetectorModel:
    """The file of the network, what it was made to know, and how to read it.

    ``size`` is the input's (w, h) in pixels; ``names`` are the classes in the network's order, ``around`` the words for
    background; ``score_model`` says what its detections are worth; ``trained`` names its training data. ``words`` (1 +
    D, 384) holds the mean of the names' vectors, and the D directions in which the network's features say how another
    text vector differs from it.
    """

    path: Path
    sha256: str
    size: tuple[int, int]
    names: tuple[str, ...]
    around: tuple[str, ...]
    score_model: DetectorScoreModel
    trained: str
    words: Array

    def project(self, vectors: Array) -> Array:
        """Unit vectors (n, D) float32 of text vectors (n, 384), to be compared with the network's features."""
        shifted = (np.asarray(vectors, np.float32) - self.words[0]) @ self.words[1:].T
        projected: Array = shifted / np.maximum(np.linalg.norm(shifted, axis=1, keepdims=True), 1e-12)
        return projected


def load(folder: Path = FOLDER) -> DetectorModel:
    """The model in a folder, by default the one that ships inside.

    Raises InputError if a file is missing or damaged, or if the network is not the one that its names were written for.
    """
    path, beside = folder / MODEL, folder / NAMES
    for file in (path, folder / WORDS, beside):
        if not file.is_file():
            raise InputError(f"{file} is missing: install cartier again")
    head = read_json(beside)
    try:
        width, height = (int(side) for side in head["size"])
        names, around = (tuple(str(name) for name in head[key]) for key in ("names", "around"))
        digests = {file: str(head["sha256"][file]) for file in (MODEL, WORDS)}
        score_model, trained = DetectorScoreModel.from_dict(head["score_model"]), str(head["trained"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{beside} is damaged ({type(error).__name__}: {error}): install cartier again") from error
    if not (0 < width <= 4096 and 0 < height <= 4096 and names and around):
        raise InputError(f"{beside} is damaged (a size or the names): install cartier again")
    read_shipped(path, digests[MODEL])
    words = _words(folder / WORDS, read_shipped(folder / WORDS, digests[WORDS]))
    return DetectorModel(path, digests[MODEL], (width, height), names, around, score_model, trained, words)


def _words(path: Path, data: bytes) -> Array:
    try:
        words: Array = np.load(io.BytesIO(data), allow_pickle=False)
    except ValueError as error:
        raise InputError(f"{path} is damaged ({error}): install cartier again") from error
    if words.ndim != 2 or len(words) < 2 or words.shape[1] != WIDTH or not np.isfinite(words).all():
        raise InputError(f"{path} is damaged: it must hold rows of {WIDTH} numbers; install cartier again")
    return words
