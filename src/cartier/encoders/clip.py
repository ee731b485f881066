"""CLIP or SigLIP through transformers, by hub id or local folder: patch features by the value path, and text.

Dense features (MaskCLIP: Zhou et al. 2022, "Extract Free Dense Labels from CLIP"): what a patch would give if the last
attention looked at nothing but that patch. For CLIP that is the last block's value and output projections, without the
residual and the MLP, then the post-layernorm and the visual projection. SigLIP's last attention is its pooling head,
which is applied to each patch alone. Needs no training and no other weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cartier.errors import InputError
from cartier.types import Array, Frame

if TYPE_CHECKING:
    import torch

    from cartier.encoders.torch_backend import TextTower

EXTRA = "detect"
MODEL = "openai/clip-vit-large-patch14"
MAX_SHORT_SIDE_PX = 2048
MAX_ASPECT = 4  # a longer image is squeezed to this: attention grows with the square of the patches


def make(model: str = MODEL, device: str | None = None, short_side_px: int | None = None) -> Clip:
    """A CLIP or SigLIP model with safetensors weights, by folder or by hub id (``id@revision`` for one revision).

    ``short_side_px``: the image's short side at the model's input, its own resolution by default; larger gives more
    patches. ``device``: a torch device, by default the GPU if there is one (half precision there). Raises InputError
    for a model that is not there, is of another kind, or lacks a tower.
    """
    import torch  # noqa: F401  (a missing package is named before anything is fetched)
    import transformers

    from cartier.encoders.torch_backend import from_hub, pick_device

    place = pick_device(device)
    config: Any = from_hub(transformers.AutoConfig.from_pretrained, model, "config")
    classes: dict[str, Any] = {"clip": transformers.CLIPModel, "siglip": transformers.SiglipModel}
    if config.model_type not in classes:
        raise InputError(
            f"{model!r} is a {config.model_type!r} model, not one of {', '.join(classes)} with an image and a text "
            "tower"
        )
    _check_side(short_side_px, config.vision_config.patch_size)
    network: Any
    network, info = from_hub(
        classes[config.model_type].from_pretrained,
        model,
        "weights",
        use_safetensors=True,
        dtype=place[1],
        output_loading_info=True,
    )
    if missing := sorted(info["missing_keys"]):
        tower = "no text tower" if all(name.startswith("text_") for name in missing) else "not all weights"
        raise InputError(f"{model!r} has {tower}: {missing[0]} and {len(missing) - 1} more are missing")
    processor = from_hub(transformers.AutoImageProcessor.from_pretrained, model, "image processor")
    tokenizer = from_hub(transformers.AutoTokenizer.from_pretrained, model, "tokenizer")
    return Clip(model, network.eval().to(place[0]), processor, tokenizer, place, short_side_px)


class Clip:
    """An Encoder: features as the model gives them, not normalised."""

    text_only = False

    def __init__(
        self,
        model: str,
        network: Any,
        processor: Any,
        tokenizer: Any,
        place: tuple[torch.device, torch.dtype],
        short_side_px: int | None,
    ) -> None:
        vision = network.config.vision_config
        self._network, self._place = network, place
        self._mean_std = (processor.image_mean, processor.image_std)
        self._patch: int = vision.patch_size
        self._short_px: int = short_side_px or vision.image_size
        self._siglip: bool = network.config.model_type == "siglip"
        if self._siglip and not hasattr(network.vision_model, "head"):
            raise InputError(
                f"{model!r} has no attention-pooling head, so its patches are not in the space of its texts"
            )
        self._text = _text_tower(network, tokenizer, self._siglip, place[0])
        self.notes: Sequence[str] = self._text.notes
        short_name = Path(model).resolve().name if Path(model).is_dir() else model
        self.name = f"clip ({short_name}, short side {self._short_px} px)"

    def image(self, frame: Frame) -> Array:
        """(h, w, D) float32: one feature per patch; cell (i, j) covers rows [i H/h, (i+1) H/h) and columns likewise.

        The image is resized to whole patches at nearly its own aspect, and the position embeddings are interpolated.
        """
        import torch

        from cartier.encoders.torch_backend import to_array, to_pixels

        columns, rows = (self._patches(side, frame) for side in (frame.camera.width, frame.camera.height))
        size = (columns * self._patch, rows * self._patch)
        with torch.inference_mode():
            pixels = to_pixels(frame.rgb, size, *self._mean_std, self._place)
            features = self._siglip_patches(pixels) if self._siglip else self._clip_patches(pixels)
            return to_array(features.reshape(rows, columns, -1))

    def text(self, texts: Sequence[str]) -> Array:
        """(n, D) float32. A text longer than the model's token limit is cut, which ``notes`` then says."""
        return self._text.encode(texts)

    def _patches(self, side_px: int, frame: Frame) -> int:
        scale = self._short_px / min(frame.camera.width, frame.camera.height)
        return max(1, round(min(side_px * scale, MAX_ASPECT * self._short_px) / self._patch))

    def _clip_patches(self, pixels: torch.Tensor) -> torch.Tensor:
        vision = self._network.vision_model
        seen = vision(pixels, output_hidden_states=True, interpolate_pos_encoding=True)
        last = vision.encoder.layers[-1]
        into_last = last.layer_norm1(seen.hidden_states[-2][:, 1:])  # without the class token
        values = last.self_attn.out_proj(last.self_attn.v_proj(into_last))
        features: torch.Tensor = self._network.visual_projection(vision.post_layernorm(values))
        return features

    def _siglip_patches(self, pixels: torch.Tensor) -> torch.Tensor:
        vision = self._network.vision_model
        seen = vision(pixels, interpolate_pos_encoding=True).last_hidden_state
        features: torch.Tensor = vision.head(seen.transpose(0, 1))  # a batch of patches: each attends to itself alone
        return features


def _text_tower(network: Any, tokenizer: Any, siglip: bool, device: torch.device) -> TextTower:
    from cartier.encoders.torch_backend import TextTower

    config = network.config.text_config

    def embed(**tokens: torch.Tensor) -> torch.Tensor:
        if siglip:
            tokens.pop("attention_mask", None)  # it was trained to look at the padding too
        features: Any = network.get_text_features(**tokens)
        pooled: torch.Tensor = getattr(features, "pooler_output", features)  # transformers 5 wraps it
        return pooled

    return TextTower(
        embed=embed,
        tokenizer=tokenizer,
        limit=config.max_position_embeddings,
        vocabulary=config.vocab_size,
        width=config.projection_size if siglip else network.config.projection_dim,
        padding="max_length" if siglip else "longest",
        device=device,
    )


def _check_side(short_side_px: int | None, patch: int) -> None:
    if short_side_px is not None and not patch <= short_side_px <= MAX_SHORT_SIDE_PX:
        raise InputError(f"short_side_px must be {patch} (one patch) to {MAX_SHORT_SIDE_PX}, got {short_side_px}")
