"""The best boxes of a batch of images, chosen on the model's own device: one transfer brings all of them."""

from __future__ import annotations

from typing import Any

from cartier.detectors.boxes import MIN_SIDE_PX

CANDIDATES = 1000  # the best so many boxes of a frame enter the suppression of duplicates
SAME_NAME_IOU = 0.5  # of two boxes of one name that overlap by more, the weaker goes
ANY_NAME_IOU = 0.8  # and of two of any names: one object has one name


def to_pixels(boxes_cxcywh: Any, width: int, height: int, square: bool) -> Any:
    """Boxes xyxy (B, Q, 4) in pixels, clipped to the image, of shares of the image or of a ``square`` around it."""
    import torch

    centres, halves = boxes_cxcywh[..., :2], boxes_cxcywh[..., 2:] / 2
    sides = torch.tensor([width, height] * 2, device=boxes_cxcywh.device)
    scale = max(width, height) if square else sides
    boxes = torch.cat([centres - halves, centres + halves], dim=-1) * scale
    return torch.minimum(boxes.clamp(min=0), sides)


def best_first(scores: Any, usable: Any, boxes_xyxy: Any) -> tuple[Any, Any]:
    """Which boxes (B, N), best score first, and which are ``usable`` (B, Q) and no slivers; N is at least 1."""
    usable = usable & ((boxes_xyxy[..., 2:] - boxes_xyxy[..., :2]) >= MIN_SIDE_PX).all(dim=-1)
    most = min(CANDIDATES, max(1, int(usable.sum(dim=-1).max())))
    best = scores.where(usable, scores.new_tensor(-1.0)).sort(dim=-1, descending=True, stable=True)[1][:, :most]
    return best, usable.gather(1, best)


def without_duplicates(boxes_xyxy: Any, classes: Any, stays: Any) -> Any:
    """Which (B, N) survive greedy suppression, first within each name and then among all. Boxes come best first."""
    over = _overlaps(boxes_xyxy)
    stays = _greedy((over > SAME_NAME_IOU) & (classes[:, :, None] == classes[:, None]), stays)
    return _greedy(over > ANY_NAME_IOU, stays)


def _overlaps(boxes: Any) -> Any:
    """Intersection over union (B, N, N) of each box with those after it, else 0."""
    low, high = boxes[:, :, None], boxes[:, None]
    width = low[..., 2].minimum(high[..., 2]) - low[..., 0].maximum(high[..., 0])
    height = low[..., 3].minimum(high[..., 3]) - low[..., 1].maximum(high[..., 1])
    shared = width.clamp_(min=0) * height.clamp_(min=0)
    areas = (boxes[..., 2] - boxes[..., 0]) * (boxes[..., 3] - boxes[..., 1])
    union = areas[:, :, None] + areas[:, None] - shared
    return (shared / union.clamp_(min=1e-9)).triu_(1)


def _greedy(beats: Any, stays: Any) -> Any:
    """Which boxes stay (B, N) if each that stays removes those that it ``beats`` (B, N, N), all of them later ones.

    All are judged at once by what was found of those before, repeatedly until nothing changes: the first is right at
    once, and each round makes right at least the next whose judges are.
    """
    there = stays
    while True:
        judged = there & ~(beats & stays[:, :, None]).any(dim=1)
        if bool((judged == stays).all()):
            return stays
        stays = judged
