"""Pictures of a candidate: the box enlarged, and its context with the box drawn, within a budget of image tokens.

Image tokens are counted as Qwen2-VL and Qwen2.5-VL do: one for each patch of 28 x 28 px that is begun. Other models
count 32 x 32 px (Qwen3-VL), which is less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from io import BytesIO

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFilter

from cartier.types import CandidateView, MapObject, View
from cartier.vision.views import apparent_px

PATCH_PX = 28
MAX_TOKENS = 1200
"""Of all pictures of one call."""
MIN_CROP_PX = 256
"""The shorter side of a crop, which is enlarged to it."""
MARGIN = 0.1
"""Around the box, as a share of its sides."""
LONGEST = 2.0
"""The ratio of a crop's sides: a longer box gets more margin on its short sides, so that the crop stays affordable."""
BOX_COLOUR = (255, 0, 255)
"""Magenta, which hardly any object has."""
BOX_PX = 3
JPEG_QUALITY = 90


def image_tokens(width: int, height: int) -> int:
    """How many tokens an image of this size (px) takes."""
    return math.ceil(width / PATCH_PX) * math.ceil(height / PATCH_PX)


def picture(
    obj: MapObject,
    view: View,
    photo: npt.NDArray[np.uint8],
    tokens: int,
    private_xyxy: Sequence[Sequence[float]] = (),
) -> CandidateView:
    """The picture of a view, within ``tokens``; people and screens at ``private_xyxy`` in the photo are blurred."""
    image = blurred(Image.fromarray(photo), private_xyxy)
    crop = _resized(image.crop(_crop_box(view.box_xyxy, image.size)), tokens // 2, MIN_CROP_PX)
    context = _context(image, view.box_xyxy, tokens - image_tokens(*crop.size))
    used = image_tokens(*crop.size) + image_tokens(*context.size)
    pixels = apparent_px(view, image.size)
    return CandidateView(
        obj.id, obj.label, view.frame, tuple(view.box_xyxy), pixels, _jpeg(crop), _jpeg(context), used,
        len(private_xyxy),
    )  # fmt: skip


def whole(frame: int, photo: npt.NDArray[np.uint8], tokens: int) -> CandidateView:
    """A picture of a whole photograph, twice and without a box: what a model sees that has no list."""
    image = Image.fromarray(photo)
    small = image.resize(_fitting(image.size, 1.0, tokens // 2), Image.Resampling.LANCZOS)
    jpeg, used = _jpeg(small), 2 * image_tokens(*small.size)
    box = (0.0, 0.0, float(image.width), float(image.height))
    return CandidateView(0, "photograph", frame, box, float(min(image.size)), jpeg, jpeg, used)


def blurred(image: Image.Image, boxes_xyxy: Sequence[Sequence[float]]) -> Image.Image:
    """A copy in which nothing inside of the boxes can be recognised: eight coarse cells a side, then smoothed."""
    image = image.copy()
    for x1, y1, x2, y2 in boxes_xyxy:
        left, top = max(0, math.floor(x1)), max(0, math.floor(y1))
        box = (left, top, min(image.width, math.ceil(x2)), min(image.height, math.ceil(y2)))
        if box[0] < box[2] and box[1] < box[3]:
            part = image.crop(box)
            coarse = part.resize((min(8, part.width), min(8, part.height)), Image.Resampling.BOX)
            part = coarse.resize(part.size, Image.Resampling.BILINEAR).filter(ImageFilter.GaussianBlur(3))
            image.paste(part, box)
    return image


def _crop_box(box_xyxy: Sequence[float], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """The box with its margin in whole pixels inside of the image, no longer than ``LONGEST`` where that fits."""
    x1, y1, x2, y2 = box_xyxy
    wide, high = (x2 - x1) * (1 + 2 * MARGIN), (y2 - y1) * (1 + 2 * MARGIN)
    wide, high = max(wide, high / LONGEST), max(high, wide / LONGEST)
    left, right = _span((x1 + x2) / 2, wide, size[0])
    top, bottom = _span((y1 + y2) / 2, high, size[1])
    return left, top, right, bottom


def _span(middle: float, length: float, most: int) -> tuple[int, int]:
    """A stretch of whole pixels around a middle, moved inside of 0 to ``most``."""
    whole = min(most, max(1, math.ceil(length)))
    start = min(max(0, round(middle - length / 2)), most - whole)
    return start, start + whole


def _resized(image: Image.Image, tokens: int, shortest_px: int) -> Image.Image:
    """The image, enlarged until its shorter side has ``shortest_px``, and no larger than the tokens allow."""
    scale = max(1.0, shortest_px / min(image.size))
    return image.resize(_fitting(image.size, scale, tokens), Image.Resampling.LANCZOS)


def _context(image: Image.Image, box_xyxy: Sequence[float], tokens: int) -> Image.Image:
    """The whole photograph with the box drawn around the object, reduced to the tokens."""
    width, height = _fitting(image.size, 1.0, tokens)
    sx, sy = width / image.width, height / image.height
    small = image.resize((width, height), Image.Resampling.LANCZOS)
    x1, y1, x2, y2 = box_xyxy
    outer = (x1 * sx - BOX_PX, y1 * sy - BOX_PX, x2 * sx + BOX_PX, y2 * sy + BOX_PX)
    left, top = max(0, round(outer[0])), max(0, round(outer[1]))
    right, bottom = min(width - 1, round(outer[2])), min(height - 1, round(outer[3]))
    ImageDraw.Draw(small).rectangle((left, top, max(left, right), max(top, bottom)), outline=BOX_COLOUR, width=BOX_PX)
    return small


def _fitting(size: tuple[int, int], scale: float, tokens: int) -> tuple[int, int]:
    """The size times the scale, made smaller until it takes no more than the tokens."""
    while True:
        width, height = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
        if image_tokens(width, height) <= max(1, tokens):
            return width, height
        scale *= 0.98


def _jpeg(image: Image.Image) -> bytes:
    buffer = BytesIO()
    image.save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)  # a thin coloured line survives
    return buffer.getvalue()
