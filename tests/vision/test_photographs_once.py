"""Photographs leave once a question, whatever a server understands or answers; a made picture goes before them."""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

import cartier
from cartier.errors import ReasonerError
from cartier.llm import capabilities
from cartier.types import CandidateView, VisualQuestion
from cartier.vision.check import check_model
from cartier.vision.look import unanswered
from cartier.vision.made import DIGITS, READ

QUESTION = VisualQuestion("Is this cup clean or dirty?", "clean", ("clean", "dirty"))
SECRET = b"\xff\xd8 a photograph of the home"
PICTURES = [CandidateView(1, "cup", 4, (0.0, 0.0, 9.0, 9.0), 90.0, SECRET, SECRET, 9)]


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("cartier.llm.server.PAUSES_S", (0.001, 0.001))


class Face(BaseHTTPRequestHandler):
    """A server of a kind that the model's name says: which requests it refuses, and how."""

    heard: list[dict[str, Any]]

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers["content-length"])))
        self.heard.append(asked)
        status, body = self.reply(asked)
        data = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def reply(self, asked: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        kinds, content = asked["model"].split(","), asked["messages"][-1]["content"]
        form = (asked.get("response_format") or {}).get("type") or ("tool" if "tools" in asked else "text")
        parts = content if isinstance(content, list) else []
        urls, home = [part["image_url"] for part in parts if part["type"] == "image_url"], of_home([asked]) > 0
        refusals = {
            "500": True, "no-schema": form != "text", "only-tool": form != "tool",
            "no-effort": "reasoning_effort" in asked, "bare": any(isinstance(url, dict) for url in urls),
            "busy-at-home": home, "fails-at-home": home,
        }  # fmt: skip
        for kind in kinds:
            if refusals.get(kind):
                said = "reasoning_effort is unknown" if kind == "no-effort" else f"{kind} is not supported"
                status = {"500": 500, "fails-at-home": 500, "busy-at-home": 503}.get(kind, 400)
                return (200 if "inside" in kinds else status), {"error": {"message": said, "code": status}}
        answers = {f"picture_{k + 1}": self.answer(content) for k in range(len(urls) // 2)} or {"object": "chair"}
        said = "It is a nice picture." if "rambles" in kinds else json.dumps(answers)
        call = {"function": {"name": "go_to", "arguments": said}}
        message = {"content": None, "tool_calls": [call]} if form == "tool" else {"content": said}
        return 200, {"choices": [{"message": message, "finish_reason": "length" if "cut" in kinds else "stop"}]}

    def answer(self, content: list[dict[str, Any]]) -> dict[str, Any]:
        return {"answer": DIGITS[0] if READ.words in content[-1]["text"] else "dirty", "certainty": 0.9}

    def log_message(self, *given: Any) -> None:
        pass


@contextmanager
def serving() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    kind = type("OfKind", (Face,), {"heard": []})
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/v1", kind.heard  # type: ignore[attr-defined]
    finally:
        server.shutdown()
        server.server_close()


def of_home(heard: list[dict[str, Any]]) -> int:
    """In how many requests photographs of the home left."""
    return sum(base64.b64encode(SECRET).decode() in json.dumps(asked) for asked in heard)


KINDS = {
    "": "dirty", "no-schema": "dirty", "only-tool": "dirty", "no-effort": "dirty", "bare": "dirty",
    "bare,no-schema,no-effort": "dirty", "inside,bare,only-tool": "dirty", "500": None, "inside,500": None,
    "rambles": None, "cut": None, "busy-at-home": None, "fails-at-home": None,
}  # fmt: skip
NEVER = ("500", "inside,500")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("checked", [False, True])
def test_photographs_leave_once_a_question(kind: str, checked: bool) -> None:
    with serving() as (url, heard):
        if checked:
            try:
                capabilities.keep(check_model(url, kind))
                assert of_home(heard) == 0
            except ReasonerError:
                assert kind in NEVER
        seen = cartier.make("vision", "openai", model=kind, base_url=url)
        for _ in range(2):
            heard.clear()
            try:
                reply = seen.look(QUESTION, PICTURES)  # type: ignore[attr-defined]
            except ReasonerError as error:
                reply = unanswered(seen, PICTURES, error)  # type: ignore[arg-type]
            assert reply.answers[0].answer == KINDS[kind]
            assert of_home(heard) == reply.times_sent == (0 if kind in NEVER else 1)
        assert len(heard) == 1 or kind in NEVER, "the second question needs no made picture"
