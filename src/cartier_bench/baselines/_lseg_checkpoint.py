"""LSeg's public checkpoint: read without running code from it, checked against the network, with its text tower."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
import transformers

from cartier.errors import InputError
from cartier.models.hub import line_of
from cartier_bench.baselines.lseg_network import LSegNetwork, Shape

Tensors = dict[str, torch.Tensor]

TEXT = "clip_pretrained."
# The classifier, CLIP's own image tower, the unit that the coarsest fusion never calls, training counters.
UNUSED = re.compile(
    r"pretrained\.model\.(norm|head)\.|clip_pretrained\.(visual\.|logit_scale$)|scratch\.refinenet4\.resConfUnit1\."
    r"|.*\.num_batches_tracked$"
)
HEAD_WIDTH = 64  # of an attention head in every CLIP text tower of OpenAI's
CONVERT = (
    'if you trust the file, convert it where it loads: python -c "import torch, safetensors.torch as s; '
    "d = torch.load('FILE', 'cpu', weights_only=False)['state_dict']; "
    "s.save_file({k: v.clone() for k, v in d.items()}, 'FILE.safetensors')\""
)


class _Inert:
    """Stands in for what a checkpoint holds besides tensors (callbacks, settings): takes anything and does nothing."""

    def __init__(self, *args: object, **options: object) -> None: ...

    def __setstate__(self, state: object) -> None: ...


def read_tensors(path: Path) -> Tensors:
    """The parameters of a .safetensors file or a Lightning checkpoint, without the prefix ``net.``; runs no code."""
    if not path.is_file():
        raise InputError(f"LSeg checkpoint {path} does not exist")
    try:
        tensors = _safetensors(path) if path.suffix == ".safetensors" else _pickled(path)
    except Exception as error:  # torch's, pickle's and safetensors' errors share no base class
        raise InputError(f"{path} cannot be read ({line_of(error)}); {CONVERT}") from error
    if not isinstance(tensors, Mapping) or not all(isinstance(value, torch.Tensor) for value in tensors.values()):
        raise InputError(f"{path} holds no table of parameters (state_dict): is it LSeg's checkpoint?")
    named = {str(name).removeprefix("net."): value for name, value in tensors.items()}
    return {name: value for name, value in named.items() if not UNUSED.match(name)}


def _safetensors(path: Path) -> Any:
    from safetensors.torch import load_file

    return load_file(path)


def _pickled(path: Path) -> Any:
    others: list[Any] = [(_Inert, name) for name in torch.serialization.get_unsafe_globals_in_checkpoint(path)]
    with torch.serialization.safe_globals(others), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's remarks on old storage classes
        loaded = torch.load(path, "cpu", weights_only=True, mmap=True)
    return loaded.get("state_dict", loaded) if isinstance(loaded, Mapping) else loaded


def load_network(tensors: Tensors, where: str, shape: Shape) -> LSegNetwork:
    """The image side, in evaluation mode; InputError names what is missing, unknown or of another shape."""
    with torch.device("meta"):
        network = LSegNetwork(shape)
    own = {name: value for name, value in tensors.items() if not name.startswith(TEXT)}
    _fill(network, own, where)
    network.eval()
    return network


def load_text_tower(tensors: Tensors, where: str, end_token: int) -> Any:
    """CLIP's text side, stored under OpenAI's names, as a transformers.CLIPTextModelWithProjection."""
    own = {name.removeprefix(TEXT): value for name, value in tensors.items() if name.startswith(TEXT)}
    sizes = (
        "token_embedding.weight",
        "positional_embedding",
        "text_projection",
        "transformer.resblocks.0.mlp.c_fc.weight",
    )
    if absent := [name for name in sizes if name not in own or own[name].ndim != 2]:
        raise InputError(f"{where} holds no CLIP text tower: {TEXT}{absent[0]} is missing")
    vocabulary, width = own["token_embedding.weight"].shape
    layers = {name.split(".")[2] for name in own if name.startswith("transformer.resblocks.")}
    config = transformers.CLIPTextConfig(
        vocab_size=vocabulary,
        hidden_size=width,
        intermediate_size=len(own["transformer.resblocks.0.mlp.c_fc.weight"]),
        projection_dim=own["text_projection"].shape[1],
        num_hidden_layers=len(layers),
        num_attention_heads=max(1, width // HEAD_WIDTH),
        max_position_embeddings=len(own["positional_embedding"]),
        hidden_act="quick_gelu",
        bos_token_id=None,
        eos_token_id=end_token,
    )
    tower: Any = transformers.CLIPTextModelWithProjection(config)
    _fill(tower, dict(_translated(own)), f"{where}, CLIP text tower")
    return tower.eval()


def _translated(own: Mapping[str, torch.Tensor]) -> Iterable[tuple[str, torch.Tensor]]:
    """OpenAI's names and layouts to transformers'."""
    names = {
        "token_embedding.weight": "text_model.embeddings.token_embedding.weight",
        "positional_embedding": "text_model.embeddings.position_embedding.weight",
        "ln_final.weight": "text_model.final_layer_norm.weight",
        "ln_final.bias": "text_model.final_layer_norm.bias",
    }
    parts = {
        "attn.out_proj": "self_attn.out_proj",
        "ln_1": "layer_norm1",
        "ln_2": "layer_norm2",
        "mlp.c_fc": "mlp.fc1",
        "mlp.c_proj": "mlp.fc2",
    }
    for name, value in own.items():
        found = re.fullmatch(r"transformer\.resblocks\.(\d+)\.(.+?)[._](weight|bias)", name)
        if found is None:
            yield ("text_projection.weight", value.T) if name == "text_projection" else (names.get(name, name), value)
            continue
        number, part, kind = found.groups()
        layer = f"text_model.encoder.layers.{number}"
        if part == "attn.in_proj":
            for role, third in zip("qkv", value.chunk(3), strict=True):
                yield f"{layer}.self_attn.{role}_proj.{kind}", third
        else:
            yield f"{layer}.{parts.get(part, part)}.{kind}", value


def _fill(module: torch.nn.Module, tensors: Tensors, where: str) -> None:
    wanted = {name: value for name, value in module.state_dict().items() if not name.endswith("num_batches_tracked")}
    missing, unknown = sorted(wanted.keys() - tensors.keys()), sorted(tensors.keys() - wanted.keys())
    if missing or unknown:
        said = [f"lacks {_some(missing)}" if missing else "", f"has unknown {_some(unknown)}" if unknown else ""]
        raise InputError(f"{where} is not LSeg's published network: it {' and '.join(filter(None, said))}")
    for name, value in wanted.items():
        if tensors[name].shape != value.shape:
            raise InputError(
                f"{where} is not LSeg's published network: {name} is {tuple(tensors[name].shape)}, "
                f"not {tuple(value.shape)}"
            )
    copies = {
        name: value.to(torch.float32, copy=True) for name, value in tensors.items()
    }  # the file may change or vanish
    module.load_state_dict(copies, strict=False, assign=True)
    for owner in module.modules():
        if isinstance(owner, torch.nn.BatchNorm2d):
            owner.num_batches_tracked = None  # counts training steps; still on the meta device


def _some(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
