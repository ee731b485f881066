"""Made photographs of a digit, in which nothing of a home is: what a server is tried out with."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cartier.types import CandidateView, MapObject, View, VisualQuestion
from cartier.vision.crops import MAX_TOKENS, picture
from cartier.vision.views import MAX_PICTURES

DIGITS = "2345679"
"""Digits that are no mirror images of themselves; 6 and 9 are told apart by their number in the picture."""
SIZE = (640, 480)
BOX = (240.0, 160.0, 400.0, 320.0)
READ = VisualQuestion("Which single digit is the number in the box?", "text", tuple(DIGITS))


def made(digit: str, number: int, mirrored: bool = False) -> CandidateView:
    """A made photograph with a digit on a light plate, as the picture of an object."""
    image = Image.new("RGB", SIZE, (150, 148, 140))
    plate = Image.new("RGB", (round(BOX[2] - BOX[0]), round(BOX[3] - BOX[1])), (240, 240, 235))
    middle = (plate.width / 2, plate.height / 2)
    font = ImageFont.load_default(size=plate.height * 0.8)
    ImageDraw.Draw(plate).text(middle, digit, fill=(10, 10, 10), font=font, anchor="mm")
    image.paste(plate.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if mirrored else plate, (round(BOX[0]), round(BOX[1])))
    here = (0.0, 0.0, 0.0)
    view = View(number, BOX, 1.0, "sign", 1.0, here, 0.0, None)
    return picture(
        MapObject.of_box(number, "sign", here, here, views=(view,)), view, np.asarray(image), MAX_TOKENS // MAX_PICTURES
    )
