"""LSeg: dense features at half resolution from its public checkpoint (demo_e200.ckpt or a safetensors copy), and text.

Li et al. 2022, "Language-driven Semantic Segmentation": ViT-L/16, a DPT decoder, CLIP's ViT-B/32 text space of 512
dimensions. The published code slides 480 px crops over an image whose long side is 520 px; here the whole image goes
through once, its long side near 520 px and both sides multiples of 32 px (the coarsest map is 1/32), with interpolated
position embeddings, and the features are taken before the last enlargement x2: 640x480 gives 192 x 256 x 512.
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
    from cartier_bench.baselines.lseg_network import LSegNetwork, Shape

EXTRA = "detect"
TOKENIZER = "openai/clip-vit-base-patch32"
LONG_SIDE_PX = 520
MAX_LONG_SIDE_PX = 2048
MEAN_STD = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


def make(model: str, tokenizer: str = TOKENIZER, device: str | None = None, long_side_px: int = LONG_SIDE_PX) -> LSeg:
    """LSeg from its public checkpoint, the file ``model``: download it from the authors (isl-org/lang-seg) first.

    ``tokenizer``: hub id or folder with CLIP's tokenizer. ``device``: a torch device, by default the GPU if there is
    one (half precision there). Raises InputError for a file that is missing, damaged or another network's.
    """
    import torch  # noqa: F401  (a missing package is named before a large file is read)

    from cartier_bench.baselines.lseg_network import Shape

    return build(Path(model), Shape(), tokenizer, device, long_side_px)


def build(checkpoint: Path, shape: Shape, tokenizer: str, device: str | None, long_side_px: int) -> LSeg:
    """``make`` for any size of network."""
    import transformers

    from cartier.encoders.torch_backend import TextTower, from_hub, pick_device
    from cartier_bench.baselines._lseg_checkpoint import load_network, load_text_tower, read_tensors

    step = 2 * shape.patch
    if not step <= long_side_px <= MAX_LONG_SIDE_PX:
        raise InputError(f"long_side_px must be {step} to {MAX_LONG_SIDE_PX}, got {long_side_px}")
    place = pick_device(device)
    tensors = read_tensors(checkpoint)
    network = load_network(tensors, str(checkpoint), shape).to(*place)
    tokens: Any = from_hub(transformers.AutoTokenizer.from_pretrained, tokenizer, "tokenizer")
    tower: Any = load_text_tower(tensors, str(checkpoint), tokens.eos_token_id)
    if tower.config.projection_dim != shape.out:
        raise InputError(
            f"{checkpoint}: its texts have {tower.config.projection_dim} dimensions, its images {shape.out}"
        )
    tower.to(*place)
    text = TextTower(
        embed=lambda **inputs: tower(**inputs).text_embeds,
        tokenizer=tokens,
        limit=tower.config.max_position_embeddings,
        vocabulary=tower.config.vocab_size,
        width=tower.config.projection_dim,
        padding="longest",
        device=place[0],
    )
    return LSeg(f"lseg ({checkpoint.stem}, long side {long_side_px} px)", network, text, place, long_side_px, step)


class LSeg:
    """An Encoder: features as the network gives them, not normalised."""

    text_only = False

    def __init__(
        self,
        name: str,
        network: LSegNetwork,
        text: TextTower,
        place: tuple[torch.device, torch.dtype],
        long_side_px: int,
        step_px: int,
    ) -> None:
        self.name = name
        self._network, self._text, self._place = network, text, place
        self._long_px, self._step_px = long_side_px, step_px
        self.notes: Sequence[str] = text.notes

    def image(self, frame: Frame) -> Array:
        """(h, w, 512) float32 at half the network's resolution; cell (i, j) covers rows [i H/h, (i+1) H/h).

        The network enlarges with its corners aligned, so a cell may lie up to half an input pixel off that place.
        """
        import torch

        from cartier.encoders.torch_backend import to_array, to_pixels

        size = (self._fitted(frame.camera.width, frame), self._fitted(frame.camera.height, frame))
        with torch.inference_mode():
            return to_array(self._network(to_pixels(frame.rgb, size, *MEAN_STD, self._place)))

    def text(self, texts: Sequence[str]) -> Array:
        """(n, 512) float32. A text longer than CLIP's 77 tokens is cut, which ``notes`` then says."""
        return self._text.encode(texts)

    def _fitted(self, side_px: int, frame: Frame) -> int:
        steps = side_px * self._long_px / max(frame.camera.width, frame.camera.height) / self._step_px
        return max(1, round(steps)) * self._step_px
