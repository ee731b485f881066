from __future__ import annotations

import contextlib
import os
import re
import sys
import types
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra 'detect' (torch) is not installed")
transformers = pytest.importorskip("transformers", reason="the extra 'detect' (transformers) is not installed")

import tiny_clip  # noqa: E402

from cartier import plugins  # noqa: E402
from cartier.encoders import torch_backend  # noqa: E402
from cartier.errors import BackendError, InputError  # noqa: E402
from cartier_bench.baselines.lseg import build  # noqa: E402
from cartier_bench.baselines.lseg_network import LSegNetwork, Shape  # noqa: E402

TINY = Shape(width=16, heads=2, mlp=24, depth=4, taps=(0, 1, 2, 3), grid=3, maps=(4, 6, 8, 10), fused=8, out=12)
TOLERANCE = {"rtol": 1e-3, "atol": 1e-5}
TEXT_WIDTH, TEXT_LAYERS = 64, 2
Sizes = dict[str, tuple[int, ...]]


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    import huggingface_hub

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)


def vit_names(shape: Shape) -> Sizes:
    """timm's vit_large_patch16_384 as of LSeg's release, by the shapes of ``shape``."""
    w, m = shape.width, shape.mlp
    names: Sizes = {
        "cls_token": (1, 1, w),
        "pos_embed": (1, shape.grid**2 + 1, w),
        "patch_embed.proj.weight": (w, 3, 16, 16),
        "patch_embed.proj.bias": (w,),
        "norm.weight": (w,),
        "norm.bias": (w,),
        "head.weight": (1000, w),
        "head.bias": (1000,),
    }
    for number in range(shape.depth):
        block: Sizes = {"attn.qkv": (3 * w, w), "attn.proj": (w, w), "mlp.fc1": (m, w), "mlp.fc2": (w, m)}
        block |= {"norm1": (w,), "norm2": (w,)}
        for part, size in block.items():
            names[f"blocks.{number}.{part}.weight"] = size
            names[f"blocks.{number}.{part}.bias"] = size[:1]
    return names


def decoder_names(shape: Shape) -> Sizes:
    """What DPT adds: reassembling, fusing, and LSeg's own head1."""
    w, f, maps = shape.width, shape.fused, shape.maps
    names: Sizes = {}
    for number, channels in enumerate(maps, 1):
        post = f"pretrained.act_postprocess{number}"
        names |= {f"{post}.0.project.0.weight": (w, 2 * w), f"{post}.0.project.0.bias": (w,)}
        names |= {f"{post}.3.weight": (channels, w, 1, 1), f"{post}.3.bias": (channels,)}
        if number != 3:
            kernel = {1: 4, 2: 2, 4: 3}[number]
            names |= {f"{post}.4.weight": (channels, channels, kernel, kernel), f"{post}.4.bias": (channels,)}
        names[f"scratch.layer{number}_rn.weight"] = (f, channels, 3, 3)
        net = f"scratch.refinenet{number}"
        names |= {f"{net}.out_conv.weight": (f, f, 1, 1), f"{net}.out_conv.bias": (f,)}
        for unit in (f"{net}.resConfUnit1", f"{net}.resConfUnit2"):
            for i in (1, 2):
                names[f"{unit}.conv{i}.weight"] = (f, f, 3, 3)
                names |= {f"{unit}.bn{i}.{n}": (f,) for n in ("weight", "bias", "running_mean", "running_var")}
                names[f"{unit}.bn{i}.num_batches_tracked"] = ()
    return names | {"scratch.head1.weight": (shape.out, f, 1, 1), "scratch.head1.bias": (shape.out,)}


def clip_names(out: int) -> Sizes:
    """OpenAI's CLIP: the text tower, and two of the many names of its eyes."""
    w = TEXT_WIDTH
    names: Sizes = {"visual.proj": (8, out), "visual.transformer.resblocks.0.ln_1.weight": (8,), "logit_scale": ()}
    names |= {"token_embedding.weight": (len(tiny_clip.TOKENS), w), "positional_embedding": (tiny_clip.LIMIT, w)}
    names |= {"ln_final.weight": (w,), "ln_final.bias": (w,), "text_projection": (w, out)}
    for number in range(TEXT_LAYERS):
        layer = f"transformer.resblocks.{number}"
        names |= {f"{layer}.attn.in_proj_weight": (3 * w, w), f"{layer}.attn.in_proj_bias": (3 * w,)}
        parts: Sizes = {"attn.out_proj": (w, w), "mlp.c_fc": (4 * w, w), "mlp.c_proj": (w, 4 * w)}
        for part, size in (parts | {"ln_1": (w,), "ln_2": (w,)}).items():
            names |= {f"{layer}.{part}.weight": size, f"{layer}.{part}.bias": size[:1]}
    return names


def published(shape: Shape) -> Sizes:
    """Every parameter of the public checkpoint with its shape."""
    names = {f"pretrained.model.{name}": size for name, size in vit_names(shape).items()} | decoder_names(shape)
    names |= {f"clip_pretrained.{name}": size for name, size in clip_names(shape.out).items()}
    return {f"net.{name}": size for name, size in names.items()}


def random_weights(shape: Shape = TINY) -> dict[str, Any]:
    chance = torch.Generator().manual_seed(0)
    weights = {}
    for name, size in published(shape).items():
        value = torch.randn(size, generator=chance) * 0.3
        if name.endswith("num_batches_tracked"):
            value = torch.tensor(7)
        elif name.endswith("running_var") or re.search(r"(norm\d?|ln_\w+|bn\d)\.weight$", name):
            value = 1 + 0.3 * value.abs()
        weights[name] = value
    return weights


@pytest.fixture(scope="module")
def tokenizer(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("tokenizer")
    tiny_clip.save_tokenizer(folder)
    return str(folder)


Make = Callable[..., Any]


@pytest.fixture
def make(tmp_path: Path, tokenizer: str) -> Make:
    def made(weights: Any = None, long_side_px: int = 96, name: str = "tiny.ckpt", shape: Shape = TINY) -> Any:
        torch.save({"state_dict": random_weights() if weights is None else weights}, tmp_path / name)
        return build(tmp_path / name, shape, tokenizer, "cpu", long_side_px)

    return made


def test_the_networks_names_and_shapes_are_the_published_ones() -> None:
    with torch.device("meta"):
        network = LSegNetwork(Shape())
    ours = {f"net.{name}": tuple(value.shape) for name, value in network.state_dict().items()}
    theirs = {name: size for name, size in published(Shape()).items() if "clip_pretrained" not in name}
    unused = {
        name
        for name in theirs
        if re.match(r"net\.(pretrained\.model\.(norm|head)|scratch\.refinenet4\.resConfUnit1)\.", name)
    }
    assert ours == {name: size for name, size in theirs.items() if name not in unused}
    assert sum(np.prod(size) for name, size in ours.items()) == pytest.approx(325e6, rel=0.1)


def as_dpt(weights: dict[str, Any]) -> dict[str, Any]:
    """LSeg's names as those of transformers' DPT."""
    out = {}
    for name, value in weights.items():
        name = name.removeprefix("net.")
        for pattern, new in (
            (r"pretrained\.model\.cls_token", "dpt.embeddings.cls_token"),
            (r"pretrained\.model\.pos_embed", "dpt.embeddings.position_embeddings"),
            (r"pretrained\.model\.patch_embed\.proj", "dpt.embeddings.patch_embeddings.projection"),
            (r"pretrained\.model\.blocks\.(\d+)", r"dpt.encoder.layer.\1"),
            (r"\.attn\.proj", ".attention.output.dense"),
            (r"\.norm1\.", ".layernorm_before."),
            (r"\.norm2\.", ".layernorm_after."),
            (r"\.mlp\.fc1", ".intermediate.dense"),
            (r"\.mlp\.fc2", ".output.dense"),
            (
                r"pretrained\.act_postprocess(\d)\.0\.project\.0",
                lambda m: f"neck.reassemble_stage.readout_projects.{int(m[1]) - 1}.0",
            ),
            (
                r"pretrained\.act_postprocess(\d)\.3",
                lambda m: f"neck.reassemble_stage.layers.{int(m[1]) - 1}.projection",
            ),
            (r"pretrained\.act_postprocess(\d)\.4", lambda m: f"neck.reassemble_stage.layers.{int(m[1]) - 1}.resize"),
            (r"scratch\.layer(\d)_rn", lambda m: f"neck.convs.{int(m[1]) - 1}"),
            (r"scratch\.refinenet(\d)", lambda m: f"neck.fusion_stage.layers.{4 - int(m[1])}"),
            (r"\.out_conv\.", ".projection."),
            (r"\.resConfUnit(\d)\.conv(\d)", r".residual_layer\1.convolution\2"),
            (r"\.resConfUnit(\d)\.bn(\d)", r".residual_layer\1.batch_norm\2"),
        ):
            name = re.sub(pattern, new, name)
        if ".attn.qkv." in name:
            for role, third in zip(("query", "key", "value"), value.chunk(3), strict=True):
                out[name.replace(".attn.qkv.", f".attention.attention.{role}.")] = third
        else:
            out[name] = value
    return out


def test_features_equal_those_of_transformers_own_dpt(make: Make) -> None:
    weights, seen = random_weights(), tiny_clip.frame(128, 64)
    config = transformers.DPTConfig(
        hidden_size=TINY.width, num_hidden_layers=TINY.depth, num_attention_heads=TINY.heads,
        intermediate_size=TINY.mlp, image_size=48, patch_size=16, layer_norm_eps=1e-6, readout_type="project",
        backbone_out_indices=list(TINY.taps), neck_hidden_sizes=list(TINY.maps), fusion_hidden_size=TINY.fused,
        use_batch_norm_in_fusion_residual=True,
    )  # fmt: skip
    peer = transformers.DPTForDepthEstimation(config).eval()
    translated = as_dpt(weights)
    ours = {name: value for name, value in translated.items() if name in peer.state_dict()}
    left = [name for name in peer.state_dict() if name not in ours]
    assert all(name.startswith(("head.", "dpt.layernorm.", "dpt.pooler")) for name in left), left
    peer.load_state_dict(ours, strict=False)
    pixels = torch.tensor(seen.rgb.transpose(2, 0, 1)[None] / 127.5 - 1, dtype=torch.float32)
    with torch.no_grad():
        maps = peer.dpt(pixels, output_hidden_states=True).hidden_states[1:]
        fused = peer.neck(list(maps), 4, 8)[-1][0]
        head = weights["net.scratch.head1.weight"][:, :, 0, 0]
        wanted = torch.einsum("of,fhw->hwo", head, fused) + weights["net.scratch.head1.bias"]
    features = make(weights, long_side_px=128).image(seen)
    assert features.shape == (32, 64, 12)
    np.testing.assert_allclose(features, wanted.numpy(), rtol=1e-4, atol=1e-5 * float(wanted.abs().max()))


def test_texts_equal_openais_arithmetic(make: Make, tokenizer: str) -> None:
    weights = {name.removeprefix("net.clip_pretrained."): value for name, value in random_weights().items()}
    ids = transformers.AutoTokenizer.from_pretrained(tokenizer)("a mug", return_tensors="pt")["input_ids"]
    values = weights["token_embedding.weight"][ids] + weights["positional_embedding"][: ids.shape[1]]
    later = torch.triu(torch.full((ids.shape[1],) * 2, float("-inf")), 1)
    norm = torch.nn.functional.layer_norm
    with torch.no_grad():
        for number in range(TEXT_LAYERS):
            own = {n.removeprefix(f"transformer.resblocks.{number}."): v for n, v in weights.items()}
            attention = torch.nn.MultiheadAttention(TEXT_WIDTH, 1, batch_first=True)
            attention.load_state_dict({n: own[f"attn.{n}"] for n in attention.state_dict()})
            x = norm(values, (TEXT_WIDTH,), own["ln_1.weight"], own["ln_1.bias"])
            values = values + attention(x, x, x, attn_mask=later, need_weights=False)[0]
            x = norm(values, (TEXT_WIDTH,), own["ln_2.weight"], own["ln_2.bias"])
            x = x @ own["mlp.c_fc.weight"].T + own["mlp.c_fc.bias"]
            values = values + (x * torch.sigmoid(1.702 * x)) @ own["mlp.c_proj.weight"].T + own["mlp.c_proj.bias"]
        end = norm(values[0, -1], (TEXT_WIDTH,), weights["ln_final.weight"], weights["ln_final.bias"])
        wanted = end @ weights["text_projection"]
    made = make()
    np.testing.assert_allclose(made.text(["a mug"])[0], wanted.numpy(), **TOLERANCE)
    np.testing.assert_allclose(made.text(["a longer text", "a mug"])[1], wanted.numpy(), **TOLERANCE)


def test_a_vga_frame_gives_half_of_512_by_384(make: Make) -> None:
    made = make(long_side_px=520)
    features = made.image(tiny_clip.frame(640, 480))
    assert features.shape == (192, 256, 12)
    assert features.dtype == np.float32 and features.flags.c_contiguous and np.isfinite(features).all()
    assert made.name == "lseg (tiny, long side 520 px)"
    assert made.image(tiny_clip.frame(30, 400)).shape == (256, 16, 12)


def test_without_attention_a_far_change_is_not_seen(make: Make) -> None:
    weights = random_weights()
    for name in weights:
        if name.endswith(("attn.proj.weight", "attn.proj.bias")) and "pretrained.model" in name:
            weights[name] = torch.zeros_like(weights[name])
    made = make(weights, long_side_px=1024)
    before = tiny_clip.frame(1024, 32)
    change = np.abs(made.image(before) - made.image(tiny_clip.with_noise(before, slice(None), slice(0, 512)))).max(
        axis=2
    )
    assert (change[:, :256] > 1e-4).all(axis=0).mean() > 0.95
    assert change[:, 256 + 128 :].max() < 1e-5  # eight cells of the coarsest map away


def same(one: Any, other: Any) -> None:
    seen = tiny_clip.frame(96, 64)
    np.testing.assert_array_equal(one.image(seen), other.image(seen))
    np.testing.assert_array_equal(one.text(["a mug"]), other.text(["a mug"]))


def test_a_lightning_checkpoint_loads_without_lightning_and_equals_its_safetensors_copy(
    make: Make, tmp_path: Path, tokenizer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from safetensors.torch import save_file

    weights = random_weights()
    lightning = types.ModuleType("a_lightning")
    callback = type("ModelCheckpoint", (), {"__module__": lightning.__name__})
    lightning.ModelCheckpoint = callback  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, lightning.__name__, lightning)
    state = {"callbacks": {callback: {"best": 0.4}}, "hyper_parameters": Namespace(backbone="clip_vitl16_384")}
    torch.save(
        {"epoch": 200, "optimizer_states": [{"lr": callback()}], "state_dict": weights} | state, tmp_path / "l.ckpt"
    )
    monkeypatch.delitem(sys.modules, lightning.__name__)
    loaded = build(tmp_path / "l.ckpt", TINY, tokenizer, "cpu", 96)
    same(loaded, make(weights))
    save_file(weights, tmp_path / "l.safetensors")
    same(loaded, build(tmp_path / "l.safetensors", TINY, tokenizer, "cpu", 96))
    same(loaded, make({name.removeprefix("net."): value for name, value in weights.items()}))
    (tmp_path / "l.ckpt").write_bytes(b"")  # nothing is read from the file later
    assert np.isfinite(loaded.image(tiny_clip.frame(96, 64))).all()


def test_half_precision_weights_are_computed_with_in_full(make: Make) -> None:
    halves = {name: value.half() if value.is_floating_point() else value for name, value in random_weights().items()}
    again = {name: value.float() if value.is_floating_point() else value for name, value in halves.items()}
    same(make(halves, name="half.ckpt"), make(again))


def test_half_precision_gives_nearly_the_same(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, seen = make(), tiny_clip.frame(96, 64)
    monkeypatch.setattr(torch_backend, "pick_device", lambda asked: (torch.device("cpu"), torch.float16))  # as on a GPU
    half = make()
    for one, other in ((half.image(seen), whole.image(seen)), (half.text(["a mug"]), whole.text(["a mug"]))):
        assert one.dtype == np.float32
        assert 0 < np.abs(one - other).max() < 0.02 * np.abs(other).max()


class Hostile:
    """Writes a file when a pickle of it is loaded."""

    def __init__(self, call: Any, *arguments: str) -> None:
        self.call, self.arguments = call, arguments

    def __reduce__(self) -> Any:
        return self.call, self.arguments


def test_nothing_in_a_checkpoint_runs(make: Make, tmp_path: Path, tokenizer: str) -> None:
    mark = tmp_path / "ran"
    for call, text in ((os.system, f"touch {mark}"), (exec, f"open({str(mark)!r}, 'w')")):
        torch.save({"state_dict": random_weights(), "extra": Hostile(call, text)}, tmp_path / "h.ckpt")
        with contextlib.suppress(InputError):
            same(build(tmp_path / "h.ckpt", TINY, tokenizer, "cpu", 96), make())
        assert not mark.exists()
    torch.save({"state_dict": random_weights() | {"net.scratch.head1.bias": Hostile(exec, "1")}}, tmp_path / "h.ckpt")
    with pytest.raises(InputError, match="no table of parameters"):
        build(tmp_path / "h.ckpt", TINY, tokenizer, "cpu", 96)


def without(name: str) -> dict[str, Any]:
    return {key: value for key, value in random_weights().items() if not key.startswith(name)}


@pytest.mark.parametrize(
    ("weights", "match"),
    [
        (lambda: without("net.scratch.head1.bias"), 
            "tiny.ckpt is not LSeg's published network: it lacks scratch.head1.bias$"),
        (lambda: without("net.pretrained.model.blocks.3"), 
            r"lacks pretrained\.model\.blocks\.3\.attn\.proj\.bias and 11 more$"),
        (lambda: random_weights() | {"net.auxlayer.weight": torch.ones(2)}, r"it has unknown auxlayer\.weight$"),
        (
            lambda: without("net.scratch.head1.bias") | {"net.head2.bias": torch.ones(2)},
            r"it lacks scratch\.head1\.bias and has unknown head2\.bias$",
        ),
        (lambda: random_weights() | {"net.scratch.head1.bias": torch.ones(7)}, r"head1\.bias is \(7,\), not \(12,\)$"),
        (lambda: without("net.clip_pretrained."), 
            r"holds no CLIP text tower: clip_pretrained\.token_embedding\.weight"),
        (lambda: without("net.clip_pretrained.transformer.resblocks.1.ln_1.bias"),
            "CLIP text tower .*lacks .*layer_norm1.bias$"),
        (lambda: random_weights() | {"net.clip_pretrained.text_projection": torch.ones(64, 9)},
            "9 dimensions, its images 12$"),
        (lambda: [1, 2], "no table of parameters"),
        (dict, "lacks"),
    ],
)  # fmt: skip
def test_another_networks_parameters_are_one_clear_line(make: Make, weights: Callable[[], Any], match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        make(weights())
    assert "\n" not in str(caught.value)


def test_what_is_no_checkpoint_is_one_clear_line(make: Make, tmp_path: Path) -> None:
    def refused(match: str, name: str, **options: Any) -> None:
        with pytest.raises((InputError, BackendError), match=match) as caught:
            plugins.make("encoders", "lseg", model=str(tmp_path / name), **({"device": "cpu"} | options))
        assert "\n" not in str(caught.value)

    refused("nowhere.ckpt does not exist", "nowhere.ckpt")
    for name in ("rubbish.ckpt", "rubbish.safetensors"):
        (tmp_path / name).write_bytes(b"\x80rubbish" * 50)
        refused("cannot be read .*if you trust the file, convert it", name)
    refused("long_side_px must be 32 to 2048, got 4000", "rubbish.ckpt", long_side_px=4000)
    refused("torch cannot use 'toaster'", "rubbish.ckpt", device="toaster")
    make()  # a small network where the published one is due
    refused(r"is not LSeg's published network: it lacks pretrained\.model\.blocks\.10", "tiny.ckpt")
    with pytest.raises(InputError, match="tokenizer of 'nobody/nothing' cannot be loaded"):
        build(tmp_path / "tiny.ckpt", TINY, "nobody/nothing", "cpu", 96)


def test_a_long_text_is_cut_and_said(make: Make) -> None:
    made = make()
    made.text(["b" * 40])
    assert list(made.notes) == [f"texts longer than 16 tokens are cut there: '{'b' * 40}'… has 42"]
    np.testing.assert_allclose(made.text(["b" * 40]), made.text(["b" * 15]), **TOLERANCE)
    assert made.text([]).shape == (0, 12)
