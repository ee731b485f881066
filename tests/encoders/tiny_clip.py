"""Tiny random CLIP and SigLIP models and CLIP's byte-level tokenizer, saved as folders; frames to look at."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers

from cartier.types import Camera, Frame

LETTERS = [chr(code) for code in range(33, 127)]
TOKENS = [*LETTERS, *(letter + "</w>" for letter in LETTERS), "<|startoftext|>", "<|endoftext|>"]
LIMIT = 16
TEXT = {
    "vocab_size": len(TOKENS),
    "hidden_size": 32,
    "intermediate_size": 48,
    "num_hidden_layers": 2,
    "num_attention_heads": 4,
    "max_position_embeddings": LIMIT,
    "bos_token_id": len(TOKENS) - 2,
    "eos_token_id": len(TOKENS) - 1,
    "pad_token_id": len(TOKENS) - 1,
}
VISION = {
    "hidden_size": 32,
    "intermediate_size": 48,
    "num_hidden_layers": 3,
    "num_attention_heads": 4,
    "image_size": 32,
    "patch_size": 8,
}


def save_tokenizer(folder: Path) -> None:
    """CLIP's tokenizer with one token per letter."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.json").write_text(json.dumps({token: number for number, token in enumerate(TOKENS)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    files = str(folder / "vocab.json"), str(folder / "merges.txt")
    transformers.CLIPTokenizer(*files, model_max_length=LIMIT).save_pretrained(folder)


def save_model(folder: Path, kind: str, **vision: Any) -> Path:
    """A random 'clip' or 'siglip' model whose weights are large enough for every part to matter."""
    torch.manual_seed(0)
    model: Any
    if kind == "clip":
        model = transformers.CLIPModel(
            transformers.CLIPConfig(text_config=TEXT, vision_config=VISION | vision, projection_dim=24)
        )
        processor: Any = transformers.CLIPImageProcessor(size={"shortest_edge": 32}, crop_size=32)
    else:
        model = transformers.SiglipModel(transformers.SiglipConfig(text_config=TEXT, vision_config=VISION | vision))
        processor = transformers.SiglipImageProcessor(size={"height": 32, "width": 32})
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    save_tokenizer(folder)
    return folder


def frame(width: int, height: int, seed: int = 0) -> Frame:
    """A frame of noise."""
    rgb = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return Frame(0, 0.0, rgb, None, np.eye(4), Camera(width, height, width, width, width / 2, height / 2))


def with_noise(seen: Frame, rows: slice, columns: slice) -> Frame:
    """The same frame with other noise in one part."""
    rgb = seen.rgb.copy()
    rgb[rows, columns] = np.random.default_rng(7).integers(0, 256, rgb[rows, columns].shape, dtype=np.uint8)
    return Frame(0, 0.0, rgb, None, np.eye(4), seen.camera)
