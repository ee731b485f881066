"""A stand-in for a vision model that really sees: it answers from the decoded pixels, over HTTP in the OpenAI form.

It finds the drawn box by its colour and measures what is inside: the colour, how bright it is, the largest digit,
whether the digit is mirrored. A wrong crop, a lost box, another order or a request without images changes its answers.
The model's name chooses a fault: ``sees`` has none.
"""

from __future__ import annotations

import base64
import io
import json
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cartier.vision import made

RGB = {
    "black": (20, 20, 20), "grey": (128, 128, 128), "white": (240, 240, 240), "red": (200, 30, 30),
    "orange": (230, 130, 30), "yellow": (230, 220, 50), "green": (40, 150, 50), "blue": (40, 70, 200),
    "purple": (120, 50, 150), "pink": (240, 150, 190), "brown": (110, 70, 40),
}  # fmt: skip
BRIGHT = 120  # mean brightness of what is on, clean, open or full in the tests' pictures
SIDE = 40


def drawn_box(rgb: np.ndarray) -> tuple[int, int, int, int] | None:
    """The inside of the magenta box in a photograph, or None without one."""
    red, green, blue = (rgb[..., k].astype(int) for k in range(3))
    rows, cols = np.nonzero((red > 190) & (green < 90) & (blue > 190))
    if len(rows) < 40:
        return None
    return int(cols.min()) + 4, int(rows.min()) + 4, int(cols.max()) - 3, int(rows.max()) - 3


def central(image: np.ndarray, share: float) -> np.ndarray:
    """The middle of an image, so much of each side."""
    out = [round(side * (1 - share) / 2) for side in image.shape[:2]]
    return image[out[0] : image.shape[0] - out[0], out[1] : image.shape[1] - out[1]]


def colour_of(part: np.ndarray) -> str:
    mean = np.median(part.reshape(-1, 3), axis=0)
    return min(RGB, key=lambda name: float(np.square(np.array(RGB[name]) - mean).sum()))


@cache
def digit_template(digit: int) -> np.ndarray:
    image = Image.new("L", (200, 200), 255)
    ImageDraw.Draw(image).text((40, 10), str(digit), fill=0, font=ImageFont.load_default(size=150))
    return normalised(np.asarray(image))


def normalised(grey: np.ndarray) -> np.ndarray:
    """The dark figure on light ground, cut out and scaled to a square of 0 and 1; empty if there is none."""
    dark = grey < 110
    rows, cols = np.nonzero(dark)
    if len(rows) < 30:
        return np.zeros((SIDE, SIDE))
    part = dark[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    return np.asarray(Image.fromarray(part.astype(np.uint8) * 255).resize((SIDE, SIDE))) / 255.0


def digit_of(part: np.ndarray) -> tuple[str, bool]:
    """The digit that the pixels show, and whether it is mirrored."""
    seen, best = normalised(part.mean(axis=2)), ("", False, 0.0)
    for digit in (2, 3, 4, 5, 6, 7, 9):  # these are no mirror images of themselves
        template = digit_template(digit)
        for mirrored in (False, True):
            shape = template[:, ::-1] if mirrored else template
            alike = float(np.minimum(seen, shape).sum() / max(np.maximum(seen, shape).sum(), 1))
            best = max(best, (str(digit), mirrored, alike), key=lambda each: each[2])
    return best[0], best[1]


def look_at(crop: np.ndarray, context: np.ndarray, words: str, choices: list[str]) -> dict[str, Any]:
    """The answer about a picture, from its pixels alone; "cannot tell" where crop and context show different things."""
    box = drawn_box(context)
    if box is None:
        return {"answer": "cannot tell", "certainty": 0}
    x1, y1, x2, y2 = box
    inside = context[y1:y2, x1:x2]
    core, middle = central(inside, 0.5), central(crop, 0.5 / 1.2)  # a crop has a margin of a tenth
    if not core.size or np.abs(middle.mean((0, 1)) - core.mean((0, 1))).max() > 60:
        return {"answer": "cannot tell", "certainty": 0}  # the crop shows something else than the box
    if "mirror" in words:
        return {"answer": "mirrored" if digit_of(crop)[1] else "not mirrored", "certainty": 0.95}
    if "number" in words or "digit" in words or "written" in words:
        return {"answer": digit_of(crop)[0] or "cannot tell", "certainty": 0.95}
    if words.startswith("What is this"):  # a red box or a blue one: things that are known by their colour
        fits = [choice for choice in choices if colour_of(core) in choice.split()]
        return {"answer": (fits or choices[-1:])[0], "certainty": 0.95}
    named = [colour for colour in RGB if "really" in words and colour in words.split()]
    if named:  # "Is this really a red box?": things that are known by their colour
        return {"answer": choices[0] if colour_of(core) == named[0] else choices[1], "certainty": 0.95}
    if "colour" in words:
        return {"answer": colour_of(core), "certainty": 0.95}
    if len(choices) == 2:
        bright = float(core.mean()) > BRIGHT
        return {"answer": choices[0] if bright else choices[1], "certainty": 0.9}
    return {"answer": "cannot tell", "certainty": 0}


def complete(asked: dict[str, Any]) -> dict[str, Any]:
    """What the pixels and the words of a request answer."""
    content = asked["messages"][-1]["content"]
    parts = content if isinstance(content, list) else []
    images = [decoded(part["image_url"]) for part in parts if part["type"] == "image_url"]
    words = next((part["text"] for part in parts if part["type"] == "text"), "")
    texts = [k for k, part in enumerate(parts) if part["type"] == "text"]
    if texts != [len(parts) - 1] or not images:
        raise ValueError("images come before the text, which is one")
    question = re.search(r"<question>(.*?)</question>", words, re.S)
    form = asked["response_format"]["json_schema"]["schema"]["properties"]
    answers = {}
    for k, (key, one) in enumerate(form.items()):
        choices = [c for c in one["properties"]["answer"].get("enum", []) if c != "cannot tell"]
        answers[key] = look_at(images[2 * k], images[2 * k + 1], question.group(1) if question else words, choices)
    return answers


def decoded(url: Any) -> np.ndarray:
    link = url["url"] if isinstance(url, dict) else url
    head, _, data = link.partition(",")
    assert head == "data:image/jpeg;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data, validate=True)), formats=["JPEG"]).convert("RGB"))


class Handler(BaseHTTPRequestHandler):
    requests: ClassVar[list[dict[str, Any]]]
    tries: ClassVar[list[dict[str, Any]]]
    spoken: ClassVar[dict[str, str]]

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        tries = made.READ.words in json.dumps(asked["messages"][-1]["content"])  # a made picture, before the first look
        (self.tries if tries else self.requests).append(asked)
        self.answer(*self.reply(asked))

    def reply(self, asked: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        fault, parts = asked["model"], asked["messages"][-1]["content"]
        images = [part for part in parts if isinstance(part, dict) and part.get("type") == "image_url"]
        if fault == "refuses-images" and images:
            return 400, {"error": {"message": "this model does not support images"}}
        if fault == "string-only" and any(isinstance(part["image_url"], dict) for part in images):
            return 400, {"error": {"message": "image_url must be a string"}}
        if fault == "no-thinking-switch" and ("chat_template_kwargs" in asked or "reasoning_effort" in asked):
            named = next(name for name in ("chat_template_kwargs", "reasoning_effort") if name in asked)
            return 400, {"error": {"message": f"Unrecognized request argument supplied: {named}"}}
        if fault == "detail" and "reasoning_effort" in asked:  # as FastAPI says it
            return 422, {"detail": "Unexpected fields in the request: {'reasoning_effort'}"}
        if fault == "no-schema" and asked.get("response_format", {}).get("type") == "json_schema":
            return 400, {"error": {"message": "response_format json_schema is not supported"}}
        if fault == "endless":
            return 200, message("", reasoning_content="Let me look at it again. " * 200)
        if fault == "hangs":
            time.sleep(30)
        if fault in self.spoken:
            return 200, message(self.spoken[fault])
        if "response_format" not in asked or asked["response_format"]["type"] != "json_schema":
            return 200, message("I see a nice picture.")
        if fault == "blind" and images:  # the image is dropped on the way: the model guesses
            form = asked["response_format"]["json_schema"]["schema"]["properties"]
            guess = {k: one["properties"]["answer"].get("enum", ["7"])[0] for k, one in form.items()}
            return 200, message(json.dumps({k: {"answer": v, "certainty": 0.9} for k, v in guess.items()}))
        if fault == "ignores-grammar":
            return 200, message("The first picture shows a very nice object. It is clean, I think.")
        text = json.dumps(complete(asked) if images else text_answer(asked))
        return 200, message("", reasoning_content=text) if fault == "reasoning-field" else message(text)

    def answer(self, status: int, body: dict[str, Any]) -> None:
        data = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args: Any) -> None:
        pass


def text_answer(asked: dict[str, Any]) -> dict[str, Any]:
    """A value of the schema of a request without pictures: the first choice of each member.

    A comparison (LLM-Match) gets 5 if the words of the answer have the true one among them, and otherwise 1.
    """
    said = asked["messages"][-1]["content"]
    if found := re.search(r"<truth>(.*)</truth>\s*<answer>(.*)</answer>", said, re.S):
        true, given = (" ".join(part.lower().split()) for part in found.groups())
        return {"score": 5 if re.search(rf"\b{re.escape(true)}\b", given) else 1}
    form = asked["response_format"]["json_schema"]["schema"]["properties"]
    return {key: one.get("enum", ["x"])[0] for key, one in form.items()}


def message(content: str, **more: str) -> dict[str, Any]:
    choice = {"message": {"role": "assistant", "content": content, **more}, "finish_reason": "stop"}
    return {"choices": [choice], "usage": {"total_tokens": 900}}


@contextmanager
def serving(spoken: dict[str, str] | None = None) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """The server's URL, and the requests that it has had, without those about made pictures.

    ``spoken``: fixed replies by the model's name.
    """
    kind = type("Seeing", (Handler,), {"requests": [], "tries": [], "spoken": spoken or {}})
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/v1", kind.requests  # type: ignore[attr-defined]
    finally:
        server.shutdown()
        server.server_close()
