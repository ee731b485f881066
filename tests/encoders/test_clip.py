from __future__ import annotations

import json
import shutil
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

KINDS = ("clip", "siglip")
TOLERANCE = {"rtol": 1e-4, "atol": 1e-5}


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    import huggingface_hub

    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    return {kind: tiny_clip.save_model(root / f"tiny-{kind}", kind) for kind in KINDS}


def encoder(folder: Path, **options: Any) -> Any:
    return plugins.make("encoders", "clip", model=str(folder), device="cpu", **options)


def normalised(rgb: np.ndarray, folder: Path) -> Any:
    processor = transformers.AutoImageProcessor.from_pretrained(folder)
    values = (rgb / 255 - np.array(processor.image_mean)) / np.array(processor.image_std)
    return torch.tensor(values.transpose(2, 0, 1)[None], dtype=torch.float32)


def test_clip_patches_are_what_the_stock_model_gives_when_its_last_attention_is_the_identity(
    folders: dict[str, Path],
) -> None:
    seen = tiny_clip.frame(32, 32)
    stock = transformers.CLIPModel.from_pretrained(folders["clip"], attn_implementation="eager").eval()
    attention = stock.vision_model.encoder.layers[-1].self_attn
    itself = torch.full((1, 1, 17, 17), float("-inf")).masked_fill(torch.eye(17, dtype=torch.bool), 0.0)
    caught = []

    def blind(module: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[tuple[Any, ...], dict[str, Any]]:
        kwargs["attention_mask"] = itself
        return args, kwargs

    attention.register_forward_pre_hook(blind, with_kwargs=True)
    attention.register_forward_hook(lambda module, args, output: caught.append(output[0]))
    with torch.no_grad():
        stock.vision_model(pixel_values=normalised(seen.rgb, folders["clip"]))
        wanted = stock.visual_projection(stock.vision_model.post_layernorm(caught[0][0, 1:]))
    np.testing.assert_allclose(encoder(folders["clip"]).image(seen), wanted.numpy().reshape(4, 4, 24), **TOLERANCE)


def test_siglip_patches_take_the_value_path_of_the_pooling_head(folders: dict[str, Path]) -> None:
    seen = tiny_clip.frame(32, 32)
    stock = transformers.SiglipModel.from_pretrained(folders["siglip"]).eval()
    head = stock.vision_model.head
    with torch.no_grad():
        patches = stock.vision_model(pixel_values=normalised(seen.rgb, folders["siglip"])).last_hidden_state[0]
        weight, bias = head.attention.in_proj_weight[64:], head.attention.in_proj_bias[64:]
        values = head.attention.out_proj(patches @ weight.T + bias)
        wanted = values + head.mlp(head.layernorm(values))
    np.testing.assert_allclose(encoder(folders["siglip"]).image(seen), wanted.numpy().reshape(4, 4, 32), **TOLERANCE)


def test_a_siglip_image_of_one_patch_is_the_image_itself(tmp_path: Path) -> None:
    folder = tiny_clip.save_model(tmp_path / "one", "siglip", image_size=8)
    seen = tiny_clip.frame(8, 8)
    stock = transformers.SiglipModel.from_pretrained(folder).eval()
    with torch.no_grad():
        whole = stock.vision_model(pixel_values=normalised(seen.rgb, folder)).pooler_output
    np.testing.assert_allclose(encoder(folder).image(seen)[0], whole.numpy(), **TOLERANCE)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("size", "cells"), [((32, 32), (4, 4)), ((160, 120), (4, 5)), ((48, 96), (8, 4)), ((900, 3), (4, 16))]
)
def test_any_frame_gives_whole_patches_at_nearly_its_aspect(
    folders: dict[str, Path], kind: str, size: tuple[int, int], cells: tuple[int, int]
) -> None:
    made = encoder(folders[kind])
    features = made.image(tiny_clip.frame(*size))
    assert features.shape[:2] == cells
    assert features.dtype == np.float32 and features.flags.c_contiguous and np.isfinite(features).all()
    assert features.shape[2] == made.text(["a mug"]).shape[1]


def test_a_larger_input_gives_more_patches(folders: dict[str, Path]) -> None:
    assert encoder(folders["clip"], short_side_px=64).image(tiny_clip.frame(64, 64)).shape == (8, 8, 24)


@pytest.mark.parametrize("kind", KINDS)
def test_without_attention_each_cell_sees_its_own_part_of_the_frame(folders: dict[str, Path], kind: str) -> None:
    made = encoder(folders[kind])
    layers = made._network.vision_model.encoder.layers
    with torch.no_grad():
        for layer in layers[: len(layers) - (kind == "clip")]:  # CLIP's last is the value path itself
            layer.self_attn.out_proj.weight.zero_()
    before = tiny_clip.frame(48, 32)
    after = tiny_clip.with_noise(before, slice(8, 16), slice(24, 48))  # row 1, columns 3 to 5
    changed = np.abs(made.image(before) - made.image(after)).max(axis=2) > 1e-5
    assert changed[1, 3:].all()
    changed[1, 3:] = False
    assert not changed.any()


@pytest.mark.parametrize("kind", KINDS)
def test_texts_are_the_models_own_in_any_batch(
    folders: dict[str, Path], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = encoder(folders[kind])
    texts = ["a mug", "", "the sofa", "x", "Ein Stuhl"]
    together = made.text(texts)
    assert together.dtype == np.float32
    np.testing.assert_allclose(together, np.concatenate([made.text([text]) for text in texts]), **TOLERANCE)
    monkeypatch.setattr(torch_backend, "BATCH", 2)
    np.testing.assert_allclose(made.text(texts), together, **TOLERANCE)
    assert made.text([]).shape == (0, together.shape[1])
    stock = transformers.AutoModel.from_pretrained(folders[kind]).eval()
    tokens = transformers.AutoTokenizer.from_pretrained(folders[kind])(
        texts,
        padding="max_length" if kind == "siglip" else True,
        truncation=True,
        max_length=tiny_clip.LIMIT,
        return_tensors="pt",
    )
    with torch.no_grad():
        wanted = stock.get_text_features(input_ids=tokens["input_ids"])
    np.testing.assert_allclose(together, getattr(wanted, "pooler_output", wanted).numpy(), **TOLERANCE)


@pytest.mark.parametrize("kind", KINDS)
def test_a_long_text_is_cut_and_that_is_said_once(folders: dict[str, Path], kind: str) -> None:
    made = encoder(folders[kind])
    fits = "a" * (tiny_clip.LIMIT - 2)
    made.text([fits])
    assert list(made.notes) == []
    cut = made.text(["short", fits + "bcd"])[1]
    np.testing.assert_allclose(made.text([fits + "xyz"])[0], cut, **TOLERANCE)
    (note,) = made.notes
    assert note == f"texts longer than 16 tokens are cut there: '{fits}bcd'… has 19"


@pytest.mark.parametrize("kind", KINDS)
def test_half_precision_gives_nearly_the_same(
    folders: dict[str, Path], kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, seen = encoder(folders[kind]), tiny_clip.frame(48, 32)
    monkeypatch.setattr(torch_backend, "pick_device", lambda asked: (torch.device("cpu"), torch.float16))  # as on a GPU
    half = encoder(folders[kind])
    for one, other in ((half.image(seen), whole.image(seen)), (half.text(["a mug"]), whole.text(["a mug"]))):
        assert one.dtype == np.float32
        assert 0 < np.abs(one - other).max() < 0.02 * np.abs(other).max()


def test_names_say_the_model_and_no_path_of_this_machine(folders: dict[str, Path]) -> None:
    assert encoder(folders["clip"]).name == "clip (tiny-clip, short side 32 px)"


def refused(match: str, folder: Path | str, **options: Any) -> None:
    with pytest.raises((InputError, BackendError), match=match) as caught:
        plugins.make("encoders", "clip", **({"model": str(folder), "device": "cpu"} | options))
    assert "\n" not in str(caught.value)


def test_what_is_no_model_of_ours_is_one_clear_line(folders: dict[str, Path], tmp_path: Path) -> None:
    refused("config of 'nobody/nothing' cannot be loaded.*neither a folder here nor", "nobody/nothing")
    refused("config of '../a/b/c' cannot be loaded", "../a/b/c")
    refused("cannot be loaded .this folder", tmp_path)
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "vit"}))
    refused("is a 'vit' model, not one of clip, siglip", tmp_path)
    (tmp_path / "config.json").write_text("{")
    refused("cannot be loaded", tmp_path)
    (tmp_path / "config.json").write_text(
        json.dumps({"model_type": "mine", "auto_map": {"AutoConfig": "code.MyConfig"}})
    )
    (tmp_path / "code.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    refused("cannot be loaded", tmp_path)
    assert not (tmp_path / "ran").exists()
    refused("torch cannot use 'toaster'", folders["clip"], device="toaster")
    refused("short_side_px must be 8 .one patch. to 2048, got 4", folders["clip"], short_side_px=4)


def test_weights_that_lack_a_tower_or_are_damaged_are_refused(folders: dict[str, Path], tmp_path: Path) -> None:
    from safetensors.torch import load_file, save_file

    folder = shutil.copytree(folders["clip"], tmp_path / "m")
    weights = folder / "model.safetensors"
    whole = load_file(weights)
    save_file({k: v for k, v in whole.items() if not k.startswith("text_")}, weights, metadata={"format": "pt"})
    refused("has no text tower: text_model.* more are missing", folder)
    save_file({k: v for k, v in whole.items() if k != "visual_projection.weight"}, weights, metadata={"format": "pt"})
    refused("has not all weights: visual_projection", folder)
    weights.write_bytes(weights.read_bytes()[:2000])
    refused("weights of .* cannot be loaded .this folder", folder)
    weights.unlink()
    torch.save(whole, folder / "pytorch_model.bin")
    refused("weights of .* cannot be loaded .this folder.*safetensors", folder)


def test_a_missing_tokenizer_or_its_package_is_one_clear_line(folders: dict[str, Path], tmp_path: Path) -> None:
    folder = shutil.copytree(folders["siglip"], tmp_path / "m")
    for file in ("tokenizer.json", "vocab.json", "merges.txt"):
        (folder / file).unlink()
    refused("tokenizer has . tokens, but the text tower 190: is a file of the tokenizer missing", folder)
    described = folder / "tokenizer_config.json"
    described.write_text(json.dumps(json.loads(described.read_text()) | {"tokenizer_class": "SiglipTokenizer"}))
    refused("tokenizer of", folder)


def test_a_tokenizer_of_another_model_is_refused(
    folders: dict[str, Path],
) -> None:
    made = encoder(folders["clip"])
    made._text.vocabulary = 100
    with pytest.raises(InputError, match="the tokenizer gives token 189, but the text tower knows 100"):
        made.text(["a mug"])
