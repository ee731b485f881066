"""The detector on onnxruntime: one inference gives an image's boxes and its dense features."""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from cartier.errors import BackendError, InputError
from cartier.models.onnx_session import Session, shape_text
from cartier.types import Array, Frame
from cartier_dollhouse.network import DetectorModel, load

GREY = 114
STRIDE = 4  # input pixels per feature, both ways


@dataclass(frozen=True)
class Outputs:
    """What the network says of one image: its outputs by name, where the input is the image times ``scale`` in the top
    left corner, ``inner`` (w, h) input pixels large."""

    outputs: dict[str, Array]
    scale: float
    inner: tuple[int, int]


class Inference:
    """A model with its session. It keeps the latest image's outputs: a detector and an encoder share one inference."""

    def __init__(self, model: DetectorModel, session: Session) -> None:
        self.model, self._session = model, session
        self._latest: tuple[weakref.ref[npt.NDArray[np.uint8]], Outputs] | None = None

    def outputs(self, frame: Frame) -> Outputs:
        """Raises BackendError if the network fails on the frame's image."""
        if self._latest is not None and self._latest[0]() is frame.rgb:
            return self._latest[1]
        tensor, scale, inner = _tensor(frame.rgb, self.model.size)
        found = Outputs(self._session.run(tensor, f"frame {frame.index}"), scale, inner)
        self._latest = weakref.ref(frame.rgb), found
        return found

    def detections(self, frame: Frame) -> tuple[Array, Array, Array]:
        """Boxes (N, 4) xyxy in pixels of the frame, scores (N,) and classes (N,), with shapes and bounds checked."""
        found = self.outputs(frame)
        boxes, scores, classes = (found.outputs.get(name, np.empty(0)) for name in ("boxes", "scores", "classes"))
        if boxes.shape != (len(scores), 4) or scores.ndim != 1 or classes.shape != scores.shape:
            shapes = ", ".join(f"{name} {shape_text(value.shape)}" for name, value in found.outputs.items())
            raise BackendError(f"{self.model.path} must give boxes Nx4, scores N and classes N, but gives {shapes}")
        if not (np.isfinite(boxes).all() and np.isfinite(scores).all()):
            raise BackendError(f"{self.model.path} gives NaN or infinity for frame {frame.index}")
        if len(classes) and not (classes.min() >= 0 and classes.max() < len(self.model.names)):
            raise BackendError(f"{self.model.path} gives a class for frame {frame.index} that has no name")
        return boxes / found.scale, scores, classes

    def features(self, frame: Frame) -> Array:
        """(h, w, D) float32, which cover the image of the frame and nothing of the grey beside it."""
        latest = self.outputs(frame)
        found = latest.outputs.get("features", np.empty(0))
        width, height = self.model.size
        if found.shape != (1, len(self.model.words) - 1, height // STRIDE, width // STRIDE):
            wanted = f"features 1x{len(self.model.words) - 1}x{height // STRIDE}x{width // STRIDE}"
            raise BackendError(f"{self.model.path} must give {wanted}, but gives {shape_text(found.shape)}")
        if not np.isfinite(found).all():
            raise BackendError(f"{self.model.path} gives NaN or infinity for frame {frame.index}")
        columns, rows = (max(1, round(side / STRIDE)) for side in latest.inner)
        return np.ascontiguousarray(found[0, :, :rows, :columns].transpose(1, 2, 0))


def open_inference(folder: Path, provider: str = "cpu", threads: int | None = None) -> Inference:
    """The model in a folder, ready to run; equal arguments share one object.

    Raises InputError if a file is missing or was changed, BackendError if onnxruntime has no such provider.
    """
    model = load(folder)  # checks the files each time
    return _opened(model.path, model.sha256, (folder / "names.json").read_bytes(), provider, threads)


@lru_cache(maxsize=2)
def _opened(path: Path, sha256: str, names: bytes, provider: str, threads: int | None) -> Inference:
    model, session = load(path.parent), Session(path, provider, threads)
    if session.size not in (None, model.size):
        raise InputError(f"{path} takes images of {session.size}, but its names.json says {model.size}")
    return Inference(model, session)


def _tensor(
    rgb: npt.NDArray[np.uint8], size: tuple[int, int]
) -> tuple[npt.NDArray[np.float32], float, tuple[int, int]]:
    """An image (H, W, 3) top left in an input (1, 3, h, w) float32, 0 to 1, padded with grey; and its scale."""
    height, width = rgb.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    inner = max(1, round(width * scale)), max(1, round(height * scale))
    canvas = np.full((size[1], size[0], 3), GREY, np.uint8)
    small = Image.fromarray(rgb).resize(inner, Image.Resampling.BILINEAR) if inner != (width, height) else rgb
    canvas[: inner[1], : inner[0]] = np.asarray(small)
    return np.ascontiguousarray(canvas.transpose(2, 0, 1)[None]) * np.float32(1 / 255), scale, inner
