"""onnxruntime session: an ONNX model of one image, with checked inputs, outputs as arrays and one-line errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime

from cartier.errors import BackendError, InputError, brief
from cartier.io.files import check_file
from cartier.types import Array

Size = tuple[int, int]
"""(w, h) in pixels."""
MAX_SIDE_PX = 8192
MAX_BYTES = 2**31  # protobuf's own limit: larger models keep their weights in files beside them
TARGET_SIZES = "orig_target_sizes"  # D-FINE's and RT-DETR's second input: the (w, h) that boxes shall be given in
FLOATS = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
INTEGERS = {"tensor(int64)": np.int64, "tensor(int32)": np.int32, "tensor(float)": np.float32}
NO_MODEL = ("Protobuf parsing failed", "No graph was found", "does not have a graph")
FATAL = 4  # onnxruntime's own log stays quiet: what it says arrives as an exception


class Session:
    """An ONNX model that takes one image.

    ``size`` is the (w, h) that the file fixes, or None where it leaves them open; ``outputs`` are all output names;
    ``metadata`` is what its exporter wrote into it.
    """

    def __init__(self, path: Path, provider: str, threads: int | None) -> None:
        self.path = path
        self._session = _open(path, provider, threads)
        inputs = {node.name: node for node in self._session.get_inputs()}
        self._targets = inputs.pop(TARGET_SIZES, None)
        image = next(iter(inputs.values()), None)
        if image is None or len(inputs) != 1 or not _takes_an_image(image):
            listed = brief(", ".join(_describe(node) for node in self._session.get_inputs()) or "none", 200)
            raise InputError(f"{path} must have one input of float images 1x3xHxW, but its inputs are {listed}")
        if self._targets is not None and self._targets.type not in INTEGERS:
            raise InputError(f"{path}: the input {TARGET_SIZES} must hold numbers, but it is {self._targets.type}")
        self._image = image
        height, width = image.shape[2:]
        self.size: Size | None = (width, height) if isinstance(width, int) and isinstance(height, int) else None
        if self.size is not None and not all(0 < side <= MAX_SIDE_PX for side in self.size):
            raise InputError(
                f"{path} takes images of {width}x{height} px; cartier makes them 1 to {MAX_SIDE_PX} px a side"
            )
        self.metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        self.outputs: tuple[str, ...] = tuple(node.name for node in self._session.get_outputs())

    def run(self, tensor: npt.NDArray[np.float32], what: str) -> dict[str, Array]:
        """All outputs by name for one image (1, 3, h, w); what is no array of numbers comes out empty.

        ``what`` tells a BackendError which image failed.
        """
        feed: dict[str, Array] = {self._image.name: tensor.astype(FLOATS[self._image.type], copy=False)}
        if self._targets is not None:
            feed[TARGET_SIZES] = np.array([tensor.shape[:1:-1]], INTEGERS[self._targets.type])
        try:
            values = self._session.run(None, feed)
        except Exception as error:  # onnxruntime's errors share no base class
            raise BackendError(f"{self.path} failed on {what}: {_reason(error)}") from error
        return {
            name: value if isinstance(value, np.ndarray) and value.dtype.kind in "iuf" else np.empty(0)
            for name, value in zip(self.outputs, values, strict=True)
        }

    def describe(self, outputs: Mapping[str, Array]) -> str:
        """The input and the outputs with their shapes, for messages."""
        shapes = ", ".join(f"{name} {shape_text(value.shape)}" for name, value in outputs.items())
        return brief(f"input {_describe(self._image)}; outputs {shapes or ', '.join(self.outputs)}", 200)


def shape_text(shape: tuple[Any, ...]) -> str:
    """A shape as people write it: 1x84x8400; a number that is free is N."""
    return "x".join("N" if number is None else str(number) for number in shape) or "scalar"


def _takes_an_image(node: Any) -> bool:
    if node.type not in FLOATS or len(node.shape) != 4:
        return False
    batch, channels = (number if isinstance(number, int) else None for number in node.shape[:2])
    return batch in (1, None) and channels in (3, None)


def _describe(node: Any) -> str:
    return f"{node.name} {shape_text(tuple(node.shape))} {node.type}"


def _open(path: Path, provider: str, threads: int | None) -> onnxruntime.InferenceSession:
    if not path.exists():
        raise InputError(f"ONNX model {path} does not exist")
    check_file(path, MAX_BYTES)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = FATAL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # threads that spin take others' time
    if threads is not None:
        options.intra_op_num_threads = threads
    wanted = _provider(provider)
    try:
        session = onnxruntime.InferenceSession(path, options, providers=[wanted])
    except Exception as error:  # onnxruntime's errors share no base class
        raise InputError(f"{path} cannot be loaded: {_reason(error)}") from error
    if wanted not in session.get_providers():  # onnxruntime falls back to the CPU without a word
        raise BackendError(f"onnxruntime could not start {wanted} for {path}: is its driver installed?")
    return session


def _provider(name: str) -> str:
    available = onnxruntime.get_available_providers()
    for provider in available:
        if provider.lower() in (name.lower(), f"{name.lower()}executionprovider"):
            return str(provider)
    raise BackendError(f"onnxruntime has no provider {name!r} here; there are {', '.join(available)}")


def _reason(error: Exception) -> str:
    """The first line of what onnxruntime says, without its codes and the path, which ours names already."""
    text = str(error).strip().split("\n")[0].split(" : ", 3)[-1]
    if any(sign in text for sign in NO_MODEL):
        return "it is no ONNX model, or it is truncated"
    return re.sub(r"^Load model from .*? failed:", "", brief(text, 200)) or type(error).__name__
