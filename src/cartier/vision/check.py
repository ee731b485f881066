"""Check of a model on a server: does it keep a schema, does it see, does it think, how fast is it."""

from __future__ import annotations

import datetime
import json
import random
import time
from collections.abc import Callable
from typing import Any, TypeVar

from cartier.errors import ReasonerError
from cartier.llm import capabilities
from cartier.llm.server import THINKING_OFF, NoReply, Server
from cartier.llm.structured_output import form_of
from cartier.types import CandidateView, VisualQuestion
from cartier.vision.made import DIGITS, READ, made
from cartier.vision.openai import VisionServer
from cartier.vision.views import MAX_PICTURES

Value = TypeVar("Value")
NAMES = ("chair", "bed", "sofa", "lamp")
"""What the check of the schema offers; only one of them is asked for."""
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
        sees = _timed(took, lambda: _answers(vision, READ, [made(d, k) for k, d in enumerate(digits)])) == digits
        flips = [True, False, bool(chance.getrandbits(1))]
        chance.shuffle(flips)
        shown = [made(digits[k], k, flip) for k, flip in enumerate(flips)]
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
        vision.bare_urls, server.leaves_out,
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
    try:
        return valid(server.complete([{"role": "user", "content": task}], schema, 64, valid))
    except NoReply:
        return False


def _answers(vision: VisionServer, question: VisualQuestion, pictures: list[CandidateView]) -> list[str | None]:
    return [answer.answer for answer in vision.look(question, pictures).answers]


def _timed(took: list[float], work: Callable[[], Value]) -> Value:
    begin = time.perf_counter()
    value = work()
    took.append(time.perf_counter() - begin)
    return value
