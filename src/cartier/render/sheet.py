"""Contact sheet of evidence: one small photo for each object of a home, to find false positives at a glance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cartier.home import Home
from cartier.home.photos import photo_of
from cartier.io.images import write_image
from cartier.types import View

if TYPE_CHECKING:
    from PIL import Image

SIDE, CAPTION, GAP, COLUMNS = 132, 30, 8, 10  # pixels, and tiles in a row
AROUND = 0.35  # margin around the box in box sizes
LEAST_PX = 24  # and in pixels on top
UNLIKELY = 0.05  # less probable objects are counted, not shown: photographs have dozens of them
BOX, CONFIRMED, TENTATIVE = (209, 73, 91), (30, 30, 30), (150, 110, 20)


def draw_sheet(home: Home, file: Path) -> None:
    """Write a PNG or JPEG: the best view of each confirmed object by room and name, then of each tentative one.

    Raises InputError if the suffix names no image format, or the file cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    sure = [obj for obj in home.objects if obj.confirmed and obj.views]
    rooms = {room.id: number for number, room in enumerate(home.rooms)}
    sure.sort(key=lambda obj: (rooms.get(obj.room if obj.room is not None else -1, len(rooms)), obj.label, obj.id))
    rest = sorted((o for o in home.objects if not o.confirmed and o.views), key=lambda obj: -obj.probability)
    shown = [obj for obj in rest if obj.probability >= UNLIKELY]
    less = f", {len(rest) - len(shown)} of them below {UNLIKELY:.0%} and not shown" if len(shown) < len(rest) else ""
    groups = [
        (f"{home.name}: {len(sure)} confirmed objects (detector: {home.detector})", sure),
        (f"{len(rest)} tentative{less}", shown),
    ]
    tall = sum(CAPTION + -(-len(objs) // COLUMNS) * (SIDE + CAPTION + GAP) for _, objs in groups if objs) + 2 * GAP
    page = Image.new("RGB", (COLUMNS * (SIDE + GAP) + GAP, tall), "white")
    draw, small, large = ImageDraw.Draw(page), ImageFont.load_default(11), ImageFont.load_default(15)
    y = GAP
    for title, objs in groups:
        if not objs:
            continue
        draw.text((GAP, y), title, fill=CONFIRMED, font=large)
        y += CAPTION
        for number, obj in enumerate(objs):
            row, column = divmod(number, COLUMNS)
            left, top = GAP + column * (SIDE + GAP), y + row * (SIDE + CAPTION + GAP)
            page.paste(_tile(home, obj.views[0]), (left, top))
            colour = CONFIRMED if obj.confirmed else TENTATIVE
            draw.text((left, top + SIDE + 1), _cut(f"{obj.id} {obj.label}", draw, small), fill=colour, font=small)
            line = f"{obj.probability:.0%}, {obj.n_detected} of {obj.n_observable}"
            draw.text((left, top + SIDE + 14), line, fill=colour, font=small)
        y += -(-len(objs) // COLUMNS) * (SIDE + CAPTION + GAP)
    write_image(page, file)


def _tile(home: Home, view: View) -> Image.Image:
    """A square photo of a view with its box."""
    from PIL import Image, ImageDraw

    rgb = photo_of(home, view.frame)
    if rgb is None:
        return Image.new("RGB", (SIDE, SIDE), (230, 230, 230))
    photo = Image.fromarray(rgb)
    x1, y1, x2, y2 = view.box_xyxy
    half = max(x2 - x1, y2 - y1) * (0.5 + AROUND) + LEAST_PX
    middle_x, middle_y = (x1 + x2) / 2, (y1 + y2) / 2
    crop = (middle_x - half, middle_y - half, middle_x + half, middle_y + half)
    shown = photo.transform(
        (SIDE, SIDE), Image.Transform.EXTENT, crop, Image.Resampling.BILINEAR, fillcolor=(230, 230, 230)
    )
    scale = SIDE / (2 * half)
    corners = [(x1 - crop[0]) * scale, (y1 - crop[1]) * scale, (x2 - crop[0]) * scale, (y2 - crop[1]) * scale]
    ImageDraw.Draw(shown).rectangle(corners, outline=BOX, width=2)
    return shown


def _cut(text: str, draw: object, font: object) -> str:
    """A name cut to the width of a tile."""
    while len(text) > 3 and draw.textlength(text, font=font) > SIDE:  # type: ignore[attr-defined]
        text = text[:-2].rstrip() + "…"
    return text
