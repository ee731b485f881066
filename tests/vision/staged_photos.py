"""Staged photographs: painted rectangles as objects of a home, with views whose boxes fit them."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cartier import plugins
from cartier.home import Home
from cartier.types import FREE, Camera, Detections, MapObject, OccupancyGrid, RobotModel, Room, View
from cartier.vision.look import Photographs, Surroundings
from flat import cells, obj

Box = tuple[float, float, float, float]
BOX: Box = (250.0, 180.0, 370.0, 300.0)
LIGHT, DARK = (235, 235, 230), (40, 40, 45)
ROOMS = (Room(0, "kitchen", "kitchen", cells()), Room(1, "bedroom", "bedroom", cells()))


def photo(*painted: tuple[Box, tuple[int, int, int]], number: str = "", mirrored: bool = False) -> bytes:
    """A JPEG of 640x480 px in which boxes are painted; ``number`` is written into the first, perhaps mirrored."""
    image = Image.new("RGB", (640, 480), (150, 148, 140))
    draw = ImageDraw.Draw(image)
    for box, rgb in painted:
        draw.rectangle(box, fill=rgb)
    if number:
        x1, y1, x2, y2 = (round(v) for v in painted[0][0])
        plate = Image.new("RGB", (x2 - x1, y2 - y1), painted[0][1])
        font = ImageFont.load_default(size=(y2 - y1) * 0.8)
        ImageDraw.Draw(plate).text(((x2 - x1) / 2, (y2 - y1) / 2), number, fill=(10, 10, 10), font=font, anchor="mm")
        image.paste(plate.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if mirrored else plate, (x1, y1))
    buffer = io.BytesIO()
    image.save(buffer, "JPEG", quality=95)
    return buffer.getvalue()


def seen(thing: MapObject, views: Sequence[tuple[int, Box, float]]) -> MapObject:
    """An object with views: frame, box and the heading in degrees from which it was seen, 2 m away."""
    made = []
    for frame, box, degrees in views:
        yaw, area = math.radians(degrees), (box[2] - box[0]) * (box[3] - box[1])
        camera = (thing.position[0] - 2 * math.cos(yaw), thing.position[1] - 2 * math.sin(yaw), 1.2)
        made.append(View(frame, box, 0.9, thing.label, area, camera, yaw, thing.position))
    return replace(thing, views=tuple(made))


def mug(
    number: int, views: Sequence[tuple[int, Box, float]], room: int = 0, label: str = "cup", **more: float
) -> MapObject:
    return seen(obj(number, label, (2.0 + number / 2, 2.0, 0.8), (0.3, 0.3, 0.3), room, **more), views)


def photographs(jpegs: Mapping[int, bytes], found: Mapping[int, Detections] | None = None) -> Photographs:
    return Photographs(jpegs, lambda: found or {})


def free_floor() -> OccupancyGrid:
    return OccupancyGrid(np.full((60, 80), FREE, np.int8), 0.1, (0.0, 0.0), np.zeros((60, 80), np.float16))


AROUND = Surroundings(free_floor(), (0.5, 0.5), RobotModel())


def painted_home(objects: Sequence[MapObject], jpegs: Mapping[int, bytes], folder: Path) -> Home:
    """A home of these objects and photographs, as it is loaded from a folder."""
    index = plugins.make("indexes", "object_depth")
    index.set_objects(tuple(objects))
    camera = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
    named = {"object_depth": index}
    roomless = tuple(replace(each, room=None) for each in objects)
    Home("painted", "by hand", camera, roomless, named, None, (0.5, 0.5), {}, photos=jpegs).save(folder)
    return Home.load(folder)
