"""A model by hub id or folder, loaded with care: safetensors only, no code from outside, every fault in one line."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cartier.errors import BackendError, InputError, brief
from cartier.io.files import sha256_of
from cartier.models.hub import FETCH, line_of, located, quiet

HASHED = (".safetensors", ".json", ".txt")  # weights, configuration, tokenizer


@dataclass(frozen=True)
class Source:
    """Where a model comes from: a folder here, or a hub id with an optional revision after ``@``."""

    name: str
    """What outputs call it: the hub id as given, or the folder's own name."""
    where: dict[str, Any]
    """What every ``from_pretrained`` is given."""
    config: Any


@dataclass(frozen=True)
class Loaded:
    """A model on its device, what makes its inputs, and the sha256 of its files. ``tokenizer`` is None without text."""

    source: Source
    model: Any
    images: Any
    tokenizer: Any
    sha256: str


def find(model: str | Path, types: Collection[str]) -> Source:
    """The configuration of a model whose type is one of ``types``; InputError if there is none, or of another type."""
    from transformers import AutoConfig

    folder = Path(model).is_dir()
    if isinstance(model, Path) and not folder:
        raise InputError(f"{model} is no folder of a model")
    if folder and not (Path(model) / "config.json").is_file():
        raise InputError(f"{Path(model)} holds no config.json: it is no folder that transformers saved a model in")
    where = located(str(model))
    try:
        config = AutoConfig.from_pretrained(**where)
    except Exception as error:  # the hub's, JSON's and transformers' errors share no base class
        if folder:
            raise InputError(f"{model}: its config.json cannot be read ({line_of(error)})") from error
        cut_off = "local_files_only" in where
        why = f"there is no way to the hub: {FETCH}" if cut_off else f"the hub does not give it out ({line_of(error)})"
        raise InputError(
            f"{str(model)!r:.120} is neither a folder here nor a model that is downloaded already, and {why}"
        ) from error
    if config.model_type not in types:
        raise InputError(
            f"{model} is no detector that cartier runs: its type is {brief(config.model_type, 40)}, and those that run "
            f"are {', '.join(types)}"
        )
    if not folder:  # every file from one commit; and without "main" transformers never asks the hub to convert pickles
        where["revision"] = _folder(where).name
    return Source(Path(model).resolve().name if folder else str(model), where, config)


def load(source: Source, device: str, zero_shot: bool) -> Loaded:
    """The model in float32 on its device. Raises InputError if files are missing, damaged, or lack trained weights."""
    import torch
    from transformers import (
        AutoImageProcessor,
        AutoModelForObjectDetection,
        AutoModelForZeroShotObjectDetection,
        AutoTokenizer,
    )

    kind: Any = AutoModelForZeroShotObjectDetection if zero_shot else AutoModelForObjectDetection
    tokens: Any = AutoTokenizer
    safe = {"use_safetensors": True, "dtype": torch.float32}
    checks = {"output_loading_info": True, "ignore_mismatched_sizes": True}  # misfits are reported below
    try:
        with quiet():
            model, info = kind.from_pretrained(**source.where, config=source.config, **safe, **checks)
            images = AutoImageProcessor.from_pretrained(**source.where, backend="pil")  # torchvision is never needed
            tokenizer = tokens.from_pretrained(**source.where) if zero_shot else None
    except ImportError as error:
        raise BackendError(f"{source.name} needs a package that is not installed: {line_of(error)}") from error
    except Exception as error:  # safetensors', torch's and transformers' errors share no base class
        raise InputError(f"{source.name} cannot be loaded: {line_of(error)}") from error
    _check_whole(source, model, info, tokenizer)
    return Loaded(source, _moved(model.eval(), device), images, tokenizer, _sha256(source))


def _check_whole(source: Source, model: Any, info: Any, tokenizer: Any) -> None:
    """InputError where transformers would fill what is missing at random or with nothing, and go on."""
    trained = {name for name, _ in model.named_parameters()}
    lacking = sorted(trained & {*info["missing_keys"], *(key for key, *_ in info["mismatched_keys"])})
    if lacking:
        raise InputError(
            f"{source.name}: its weights lack {len(lacking)} of the {len(trained)} parameters of a detector of type "
            f"{source.config.model_type} (such as {lacking[0]})"
        )
    if tokenizer is not None:
        known = source.config.text_config.vocab_size
        if not known / 2 < len(tokenizer) <= known:
            raise InputError(
                f"{source.name}: its tokenizer has {len(tokenizer)} tokens, but its text encoder {known}: is a file of "
                "the tokenizer missing?"
            )


def _moved(model: Any, device: str) -> Any:
    try:
        return model.to(device)
    except RuntimeError as error:
        raise BackendError(f"the model does not fit on {device} ({line_of(error)})") from error


def _folder(where: dict[str, Any]) -> Path:
    """The folder that holds a model's files; for one of the hub its snapshot, which is called by its commit."""
    from transformers.utils import cached_file

    name = where["pretrained_model_name_or_path"]
    if Path(name).is_dir():
        return Path(name)
    return Path(str(cached_file(name, "config.json", revision=where.get("revision")))).parent


def _sha256(source: Source) -> str:
    files = _folder(source.where).iterdir()
    return sha256_of(*sorted(file for file in files if file.suffix in HASHED and file.is_file()))


def with_names(sha256: str, names: Collection[str]) -> str:
    """The sha256 of a model together with the names that it is asked for."""
    return hashlib.sha256("\n".join((sha256, *names)).encode()).hexdigest()
