"""What the encoders on torch share: a device, a frame as a tensor, a model from a folder or the hub, faults in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import torch
import transformers
from PIL import Image

from cartier.errors import BackendError, InputError
from cartier.models import hub

Loaded = TypeVar("Loaded")


def pick_device(asked: str | None) -> tuple[torch.device, torch.dtype]:
    """The device asked for, else the GPU, else the CPU; and the precision to compute in there: half on a GPU."""
    try:
        device = torch.device(asked or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:  # torch built without CUDA asserts
        raise BackendError(f"torch cannot use the device {asked!r} here: {first_line(error)}") from error
    return device, torch.float32 if device.type == "cpu" else torch.float16


def to_pixels(
    rgb: npt.NDArray[np.uint8],
    size_wh: tuple[int, int],
    mean: Sequence[float],
    std: Sequence[float],
    like: tuple[torch.device, torch.dtype],
) -> torch.Tensor:
    """The whole image (H, W, 3) at another size, never cropped, as (1, 3, h, w): (value / 255 - mean) / std."""
    image = Image.fromarray(rgb).resize(size_wh, Image.Resampling.BICUBIC)
    values = (np.asarray(image, np.float32) / 255 - np.asarray(mean, np.float32)) / np.asarray(std, np.float32)
    return torch.from_numpy(np.ascontiguousarray(values.transpose(2, 0, 1)[None])).to(*like)


def to_array(values: torch.Tensor) -> npt.NDArray[np.float32]:
    """A tensor of any device and precision as a C-contiguous float32 array."""
    return np.ascontiguousarray(values.to("cpu", torch.float32).numpy())


def from_hub(load: Callable[..., Loaded], model: str, what: str, **options: Any) -> Loaded:
    """What ``load`` (a ``from_pretrained``) makes of a folder or a hub id, which may end in ``@revision``.

    Code that comes with a model never runs. Raises InputError, one line, where there is no such model or it does not load.
    """
    folder = Path(model).is_dir()
    name, _, revision = (model, "", "") if folder else model.partition("@")
    where: dict[str, Any] = {"revision": revision} if revision else {}
    if cut_off := not folder and hub.offline():
        where["local_files_only"] = True
    with _quiet():
        try:
            return load(name, trust_remote_code=False, **where, **options)
        except ImportError as error:
            raise BackendError(f"the {what} of {model!r} needs another package: {first_line(error)}") from error
        except Exception as error:  # transformers, huggingface_hub and safetensors share no base class
            if cut_off:
                gone = "it is neither a folder here nor downloaded already, and there is no way to the hub"
                raise InputError(f"the {what} of {model!r} cannot be loaded: {gone}: {hub.FETCH}") from error
            place = "this folder" if folder else "neither a folder here nor the hub has it, or it is damaged"
            raise InputError(f"the {what} of {model!r} cannot be loaded ({place}): {first_line(error)}") from error


def first_line(error: BaseException) -> str:
    """The first line of what a library says, at most 300 characters."""
    return (str(error).strip().split("\n")[0] or type(error).__name__)[:300]


@contextmanager
def _quiet() -> Iterator[None]:
    """Hold transformers' own log and progress bars back: what matters arrives as an exception."""
    log: Any = transformers.utils.logging
    level, bars = log.get_verbosity(), log.is_progress_bar_enabled()
    log.set_verbosity_error()
    log.disable_progress_bar()
    try:
        yield
    finally:
        log.set_verbosity(level)
        if bars:
            log.enable_progress_bar()
