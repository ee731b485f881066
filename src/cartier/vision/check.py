"""Check of a model on a server: does it keep a schema, does it see, does it think, how fast is it."""

from __future__ import annotations

import datetime
import json
import random
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cartier.errors import ReasonerError
from cartier.llm import capabilities
from cartier.llm.server import THINKING_OFF, Server
from cartier.llm.structured_output import form_of
from cartier.types import CandidateView, MapObject, View, VisualQuestion
from cartier.vision.crops import MAX_TOKENS, picture
from cartier.vision.openai import VisionServer
from cartier.vision.views import MAX_PICTURES

Value = TypeVar("Value")
NAMES = ("chair", "bed", "sofa", "lamp")
"""What the check of the schema offers; only one of them is asked for."""
DIGITS = "2345679"
"""Digits that are no mirror images of themselves; 6 and 9 are told apart by their number in the picture."""
SIZE = (640, 480)
BOX = (240.0, 160.0, 400.0, 320.0)
READ = VisualQuestion("Which single digit is the number in the box?", "text", tuple(DIGITS))
MIRRORED = VisualQuestion("Is the digit in the box mirrored?", "look", ("mirrored", "not mirrored"))


def check_model(base_url: str, model: str | None = None, timeout_s: float = 60.0) -> capabilities.Capabilities:
    """Ask a model a few made questions; nothing of a home is sent. Raises ReasonerError if it cannot be reached."""
    server = Server(model, base_url, None, timeout_s, 0.0, extra=THINKING_OFF)
    took: list[float] = []
    keeps = _timed(took, lambda: _keeps_schema(server))
    vision, chance = VisionServer(server), random.Random()
    sees: bool | None = None
    knows_mirrored: bool | None = None
    try:
        digits = chance.sample(DIGITS, MAX_PICTURES)
        sees = _timed(took, lambda: _answers(vision, READ, [_made(d, k) for k, d in enumerate(digits)])) == digits
        flips = [True, False, bool(chance.getrandbits(1))]
        chance.shuffle(flips)
        shown = [_made(digits[k], k, flip) for k, flip in enumerate(flips)]
        wanted = [MIRRORED.choices[0 if flip else 1] for flip in flips]
        knows_mirrored = _timed(took, lambda: _answers(vision, MIRRORED, shown)) == wanted
    except ReasonerError:
        if sees is not None:
            raise
    seconds = sorted(took)[len(took) // 2]
    return capabilities.Capabilities(
        server.where, server.model, form_of(server.server, server.model), keeps, sees, knows_mirrored,
        "on" if server.thought else "off", round(seconds, 3),
        round(server.tokens / max(sum(took), 1e-3), 1), datetime.date.today().isoformat(),
    )  # fmt: skip


def _keeps_schema(server: Server) -> bool:
    """Whether a reply is one of the offered names, and nothing else."""
    schema: dict[str, Any] = {
        "type": "object", "properties": {"object": {"type": "string", "enum": list(NAMES)}},
        "required": ["object"], "additionalProperties": False,
    }  # fmt: skip

    def valid(reply: str) -> bool:
        try:
            row = json.loads(reply)
        except (ValueError, RecursionError):
            return False
        return isinstance(row, dict) and set(row) == {"object"} and row["object"] in NAMES

    task = f'Choose what somebody sits on. Reply with JSON, {{"object": NAME}}, NAME being one of {", ".join(NAMES)}.'
    return valid(server.complete([{"role": "user", "content": task}], schema, 64, valid))


def _answers(vision: VisionServer, question: VisualQuestion, pictures: list[CandidateView]) -> list[str | None]:
    return [answer.answer for answer in vision.look(question, pictures).answers]


def _made(digit: str, number: int, mirrored: bool = False) -> CandidateView:
    """A made photograph with a digit on a light plate, as the picture of an object."""
    image = Image.new("RGB", SIZE, (150, 148, 140))
    plate = Image.new("RGB", (round(BOX[2] - BOX[0]), round(BOX[3] - BOX[1])), (240, 240, 235))
    middle = (plate.width / 2, plate.height / 2)
    font = ImageFont.load_default(size=plate.height * 0.8)
    ImageDraw.Draw(plate).text(middle, digit, fill=(10, 10, 10), font=font, anchor="mm")
    image.paste(plate.transpose(Image.Transpose.FLIP_LEFT_RIGHT) if mirrored else plate, (round(BOX[0]), round(BOX[1])))
    here = (0.0, 0.0, 0.0)
    view = View(number, BOX, 1.0, "sign", 1.0, here, 0.0, None)
    sign = MapObject(
        number, "sign", (("sign", 1.0),), here, here, here, 1.0, True, 1, 1, 0.0, 0.0, 0.0, (view,)
    )  # fmt: skip
    return picture(sign, view, np.asarray(image), MAX_TOKENS // MAX_PICTURES)


def _timed(took: list[float], work: Callable[[], Value]) -> Value:
    begin = time.perf_counter()
    value = work()
    took.append(time.perf_counter() - begin)
    return value
