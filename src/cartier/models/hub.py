"""Models of transformers by hub id or folder: whether the hub can be reached, the device, and errors in one line."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import getproxies

from cartier.errors import BackendError

FETCH = "fetch it where there is a network (hf download NAME --local-dir FOLDER) and name that folder"
MAX_LINE_CHARS = 200


def offline() -> bool:
    """Whether the hub is switched off, or its host has no address here and no proxy would know one.

    Without a network the hub's library tries each file for half a minute.
    """
    from huggingface_hub import constants

    if constants.HF_HUB_OFFLINE:
        return True
    if getproxies():
        return False
    try:
        socket.getaddrinfo(urlsplit(constants.ENDPOINT).hostname, 443)
    except OSError:
        return True
    return False


def located(model: str) -> dict[str, Any]:
    """The arguments of every ``from_pretrained`` for a folder or a hub id, which may end in ``@revision``.

    Code that comes with a model never runs. ``local_files_only`` is there if the hub cannot be reached.
    """
    where: dict[str, Any] = {"pretrained_model_name_or_path": model, "trust_remote_code": False}
    if Path(model).is_dir():
        return where
    where["pretrained_model_name_or_path"], _, revision = model.partition("@")
    return where | ({"revision": revision} if revision else {}) | ({"local_files_only": True} if offline() else {})


def best_device(asked: str | None) -> str:
    """The device asked for, by default the first GPU or the CPU. Raises BackendError if torch has no such device."""
    import torch

    chosen = asked or ("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.empty(1, device=chosen)
    except (RuntimeError, AssertionError, NotImplementedError) as error:  # torch built without CUDA asserts
        raise BackendError(f"option device: torch cannot use {chosen!r} here ({line_of(error)})") from error
    return chosen


@contextmanager
def quiet() -> Iterator[None]:
    """Without transformers' own log and progress bars: what matters arrives as an exception."""
    from transformers.utils import logging

    level, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if bars:
            logging.enable_progress_bar()


def line_of(error: BaseException) -> str:
    """The first line of a library's error, of a readable length."""
    text = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
    return text if len(text) <= MAX_LINE_CHARS else text[: MAX_LINE_CHARS - 1] + "…"
