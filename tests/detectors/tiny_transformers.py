"""Tiny transformers detectors of every family, with random weights."""

from __future__ import annotations

import json
import string
from collections.abc import Callable
from pathlib import Path
from typing import Any

NAMES = ["mug", "CoffeeMachine", "bed", "potted plant", "tv", "sofa"]
CLASSES = ["N/A", "person", "CoffeeMachine", "bed", "tv", "cup", "sofa", "book", "lamp", "box", "vase", "clock"]
"""What the closed-set models know; N/A is how DETR calls the numbers that COCO left out."""
SIDE = 64
SIZE = {"height": SIDE, "width": SIDE}
TEXT_LIMIT = 24
"""Tokens that the Grounding family's text encoder holds here: few, so that NAMES need several prompts."""

Built = tuple[Any, Any, Any]
"""A model, its image processor, and its tokenizer or None."""


def save(family: str, folder: Path) -> Path:
    """A tiny detector of a family as its own ``save_pretrained`` writes it."""
    import torch

    torch.manual_seed(3)
    folder.mkdir()
    model, images, tokenizer = FAMILIES[family](folder)
    for weights in model.parameters():  # as they are made, a network's answer hardly depends on what it is asked
        if weights.dim() > 1:
            torch.nn.init.normal_(weights, std=weights[0].numel() ** -0.5)
    for part in (model, images, tokenizer):
        if part is not None:
            part.save_pretrained(folder)
    return folder


def _clip_tokenizer(folder: Path, limit: int) -> Any:
    from transformers import CLIPTokenizer

    letters = [chr(code) for code in range(33, 127)]
    words = [*letters, *(letter + "</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    (folder / "vocab.json").write_text(json.dumps({word: number for number, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=limit)


def _bert_tokenizer(folder: Path, limit: int) -> Any:
    """Letters as word pieces, and the marks at the numbers that transformers' Grounding DINO has fixed."""
    from transformers import BertTokenizer

    words = [f"[unused{number}]" for number in range(1030)]
    words[0], words[100:104], words[1012], words[1029] = "[PAD]", ["[UNK]", "[CLS]", "[SEP]", "[MASK]"], ".", "?"
    pieces = [*string.ascii_lowercase, *("##" + letter for letter in string.ascii_lowercase), "mug", "bed", "-", "'"]
    words[200 : 200 + len(pieces)] = pieces
    (folder / "vocab.txt").write_text("\n".join(words))
    return BertTokenizer(str(folder / "vocab.txt"), model_max_length=limit)


def _text(limit: int, tokenizer: Any) -> dict[str, Any]:
    return {
        "vocab_size": len(tokenizer), "hidden_size": 32, "intermediate_size": 37, "num_hidden_layers": 2,
        "num_attention_heads": 4, "max_position_embeddings": limit, "bos_token_id": len(tokenizer) - 2,
        "eos_token_id": len(tokenizer) - 1, "pad_token_id": len(tokenizer) - 1,
    }  # fmt: skip


def _owl(version: str) -> Callable[[Path], Built]:
    def build(folder: Path) -> Built:
        import transformers as hf

        tokenizer = _clip_tokenizer(folder, 48)
        vision = {
            "hidden_size": 32, "intermediate_size": 37, "num_hidden_layers": 2, "num_attention_heads": 4,
            "image_size": SIDE, "patch_size": 16,
        }  # fmt: skip
        config = getattr(hf, f"{version}Config")(
            text_config=_text(48, tokenizer), vision_config=vision, projection_dim=32
        )
        images = getattr(hf, f"{version}ImageProcessorPil")(size=SIZE, crop_size=SIZE)
        return getattr(hf, f"{version}ForObjectDetection")(config), images, tokenizer

    return build


def _grounding(version: str) -> Callable[[Path], Built]:
    def build(folder: Path) -> Built:
        import transformers as hf

        tokenizer = _bert_tokenizer(folder, 512)
        swin = hf.SwinConfig(
            image_size=SIDE, embed_dim=12, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2], window_size=4,
            out_features=["stage2", "stage3", "stage4"],
        )  # fmt: skip
        text = {"model_type": "bert", "vocab_size": 1030, "hidden_size": 32, "num_hidden_layers": 2} | {
            "num_attention_heads": 4, "intermediate_size": 37, "max_position_embeddings": 128,
        }  # fmt: skip
        config = getattr(hf, f"{version}Config")(
            backbone_config=swin, text_config=text, d_model=32, encoder_layers=1, decoder_layers=2, encoder_ffn_dim=32,
            decoder_ffn_dim=32, encoder_attention_heads=4, decoder_attention_heads=4, num_queries=10,
            max_text_len=TEXT_LIMIT, num_feature_levels=4,
        )  # fmt: skip
        images = hf.GroundingDinoImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
        return getattr(hf, f"{version}ForObjectDetection")(config), images, tokenizer

    return build


def _omdet(folder: Path) -> Built:
    import transformers as hf

    tokenizer = _clip_tokenizer(folder, 40)
    swin = hf.SwinConfig(
        image_size=SIDE, embed_dim=12, depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2], window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )  # fmt: skip
    config = hf.OmDetTurboConfig(
        backbone_config=swin, text_config={"model_type": "clip_text_model", **_text(40, tokenizer), "hidden_size": 24},
        text_projection_in_dim=24, text_projection_out_dim=24, task_encoder_hidden_dim=24, class_embed_dim=24,
        class_distance_type="cosine", num_queries=10, encoder_hidden_dim=32, decoder_hidden_dim=32,
        vision_features_channels=[32, 32, 32], encoder_in_channels=[24, 48, 96], encoder_dim_feedforward=32,
        decoder_dim_feedforward=32, decoder_num_layers=2, decoder_num_heads=4, encoder_layers=1, image_size=SIDE,
        head_hidden_dim=32, apply_layernorm_after_vision_backbone=False,
    )  # fmt: skip
    return hf.OmDetTurboForObjectDetection(config), hf.DetrImageProcessorPil(size=SIZE), tokenizer


def _labels() -> dict[str, Any]:
    return {"num_labels": len(CLASSES), "id2label": dict(enumerate(CLASSES))}


def _detr(folder: Path) -> Built:
    import transformers as hf

    resnet = hf.ResNetConfig(
        embedding_size=8, hidden_sizes=[8, 8, 16, 16], depths=[1, 1, 1, 1], out_features=["stage4"]
    )
    config = hf.DetrConfig(
        backbone_config=resnet, use_timm_backbone=False, d_model=32, encoder_layers=1, decoder_layers=1,
        encoder_ffn_dim=32, decoder_ffn_dim=32, encoder_attention_heads=4, decoder_attention_heads=4, num_queries=10,
        **_labels(),
    )  # fmt: skip
    images = hf.DetrImageProcessorPil(size={"shortest_edge": 64, "longest_edge": 96})
    return hf.DetrForObjectDetection(config), images, None


def _rt_detr(version: str) -> Callable[[Path], Built]:
    def build(folder: Path) -> Built:
        import transformers as hf

        if version == "DFine":
            backbone: Any = hf.HGNetV2Config(
                stem_channels=[3, 8, 8], stage_in_channels=[8, 8, 16, 16], stage_mid_channels=[8, 8, 8, 8],
                stage_out_channels=[8, 16, 16, 16], stage_num_blocks=[1] * 4, stage_numb_of_layers=[1] * 4,
                stage_downsample=[False, True, True, True], stage_light_block=[False] * 4, stage_kernel_size=[3] * 4,
                out_features=["stage2", "stage3", "stage4"], embedding_size=8, hidden_sizes=[8, 16, 16, 16],
            )  # fmt: skip
        else:
            backbone = hf.RTDetrResNetConfig(
                embedding_size=8, hidden_sizes=[8, 16, 16, 16], depths=[1] * 4, layer_type="basic",
                out_features=["stage2", "stage3", "stage4"],
            )  # fmt: skip
        config = getattr(hf, f"{version}Config")(
            backbone_config=backbone, encoder_in_channels=[16] * 3, encoder_hidden_dim=32, d_model=32, encoder_layers=1,
            decoder_layers=2, encoder_ffn_dim=32, decoder_ffn_dim=32, encoder_attention_heads=4, num_queries=10,
            decoder_attention_heads=4, decoder_in_channels=[32] * 3, **_labels(),
        )  # fmt: skip
        return getattr(hf, f"{version}ForObjectDetection")(config), hf.RTDetrImageProcessorPil(size=SIZE), None

    return build


def _yolos(folder: Path) -> Built:
    import transformers as hf

    config = hf.YolosConfig(
        hidden_size=32, num_hidden_layers=2, num_attention_heads=2, intermediate_size=37, image_size=[SIDE, SIDE],
        patch_size=16, num_detection_tokens=10, **_labels(),
    )  # fmt: skip
    return hf.YolosForObjectDetection(config), hf.YolosImageProcessorPil(size=SIZE), None


FAMILIES: dict[str, Callable[[Path], Built]] = {
    "owlv2": _owl("Owlv2"),
    "owlvit": _owl("OwlViT"),
    "grounding-dino": _grounding("GroundingDino"),
    "mm-grounding-dino": _grounding("MMGroundingDino"),
    "omdet-turbo": _omdet,
    "detr": _detr,
    "yolos": _yolos,
    "rt_detr": _rt_detr("RTDetr"),
    "rt_detr_v2": _rt_detr("RTDetrV2"),
    "d_fine": _rt_detr("DFine"),
}
ZERO_SHOT = tuple(FAMILIES)[:5]
