"""Overlay of object boxes on frames: whether the boxes in space fit what the camera saw."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cartier.contracts import Recording
from cartier.errors import InputError
from cartier.geometry import project
from cartier.home import Home
from cartier.io.images import write_image
from cartier.render.mapped_frames import as_mapped, first_frame_of
from cartier.types import Array, Frame, MapObject

if TYPE_CHECKING:
    from PIL import ImageDraw

Box = tuple[float, float, float, float]
"""left, top, right, bottom, in pixels"""
FRAMES, WIDTH = 6, 640  # shown at most, and pixels of each
NEAR_M = 0.1  # corners nearer to the camera are not drawn
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
EDGES = [(i, j) for i in range(8) for j in range(i) if np.abs(CORNERS[i] - CORNERS[j]).sum() == 1]
COLOURS = ((230, 60, 80), (60, 150, 230), (60, 180, 90), (235, 160, 40), (170, 90, 210), (40, 190, 190))


def draw_overlay(home: Home, recording: Recording, file: Path) -> None:
    """Write a PNG or JPEG: frames that show most of the confirmed objects, with the edges of their boxes.

    Raises InputError if the home was not mapped from the recording or keeps no detections, the suffix names no image
    format, or the file cannot be written.
    """
    from PIL import Image, ImageDraw

    first, shown = first_frame_of(home, recording), _objects_by_frame(home)
    recording = as_mapped(home, recording)
    here = {n: objs for n, objs in shown.items() if first <= n < first + len(recording)}
    frames = _most_telling(here)
    if not frames:
        raise InputError(f"{home.name} has no confirmed object in {recording.name}: there is no box to draw")
    pages = []
    for number in frames:
        frame = recording[number - first]
        page = Image.fromarray(frame.rgb)
        page = page.resize((WIDTH, round(WIDTH * page.height / page.width)))
        draw = ImageDraw.Draw(page)
        corners = {obj.id: _draw_box(draw, obj, frame, WIDTH / frame.camera.width) for obj in here[number]}
        named = [(obj, corner) for obj in here[number] if (corner := corners[obj.id]) is not None]
        for obj, text, xy, box in placed_names(draw, named):
            draw.rectangle(box, fill=_colour(obj))
            draw.text(xy, text, fill="white")
        pages.append(page)
    tall, columns = max(page.height for page in pages), 3 if len(pages) == 3 else min(2, len(pages))
    rows = len(pages) // columns  # a last one that is not full is left out
    sheet = Image.new("RGB", (columns * WIDTH, rows * tall), "white")
    for k, page in enumerate(pages):
        sheet.paste(page, (k % columns * WIDTH, k // columns * tall))
    write_image(sheet, file)


def _objects_by_frame(home: Home) -> dict[int, list[MapObject]]:
    """The confirmed objects that each frame's detections belong to."""
    log = home.detections()
    if log is None:
        raise InputError(f"{home.name} keeps no detections, so that no frame is known to show an object: map it again")
    of = {number: obj for obj in home.objects if obj.confirmed for number in (obj.id, *obj.aliases)}
    rows = {n: {of[i].id: of[i] for i in seen.objects.tolist() if i in of} for n, seen in log.looked().items()}
    return {n: list(objs.values()) for n, objs in rows.items() if objs}


def _most_telling(shown: dict[int, list[MapObject]]) -> list[int]:
    """Up to ``FRAMES`` frames, each with the most objects that none before it shows; later ones with most."""
    chosen, left = list[int](), {obj.id for objs in shown.values() for obj in objs}
    while len(chosen) < min(FRAMES, len(shown)):
        best = max(
            (n for n in shown if n not in chosen),
            key=lambda n: (len(left & {obj.id for obj in shown[n]}), len(shown[n]), -n),
        )
        chosen.append(best)
        left -= {obj.id for obj in shown[best]}
    return chosen


def _draw_box(draw: ImageDraw.ImageDraw, obj: MapObject, frame: Frame, scale: float) -> Array | None:
    """Draw the edges of a box; returns where the upper left end of what is ahead lies, None if nothing is."""
    low, high = np.array(obj.box_min), np.array(obj.box_max)
    uv, depth_m = project(low + CORNERS * (high - low), frame.camera, frame.world_from_camera)
    uv = uv * scale
    for i, j in EDGES:
        if min(depth_m[i], depth_m[j]) > NEAR_M:
            draw.line([*uv[i].tolist(), *uv[j].tolist()], fill=_colour(obj), width=2)
    ahead = uv[depth_m > NEAR_M]
    return ahead.min(0) if len(ahead) else None


def placed_names(
    draw: ImageDraw.ImageDraw, named: list[tuple[MapObject, Array]]
) -> list[tuple[MapObject, str, tuple[float, float], Box]]:
    """Name and size of each object, where to write it and the box it fills: at its corner, or below the texts that are
    there already; none is cut by the picture's sides."""
    placed = list[tuple[MapObject, str, tuple[float, float], Box]]()
    width, height = draw.im.size
    for obj, corner in sorted(named, key=lambda each: float(each[1][1])):
        sides = np.array(obj.box_max) - np.array(obj.box_min)
        text = f"{obj.id} {obj.label} " + "x".join(f"{side * 100:.0f}" for side in sides) + " cm"
        left, top, right, bottom = draw.textbbox((0, 0), text)
        x, y = np.clip(corner, (-left, -top), (max(0.0, width - 1 - right), height - 1 - bottom)).tolist()
        while under := [box for *_, box in placed if _overlap((x + left, y + top, x + right, y + bottom), box)]:
            y = max(box[3] for box in under) + 1 - top
        placed.append((obj, text, (x, y), (x + left, y + top, x + right, y + bottom)))
    return placed


def _overlap(one: Box, other: Box) -> bool:
    """Whether two boxes share any pixel."""
    return one[0] <= other[2] and other[0] <= one[2] and one[1] <= other[3] and other[1] <= one[3]


def _colour(obj: MapObject) -> tuple[int, int, int]:
    return COLOURS[obj.id % len(COLOURS)]
