"""Fuzz test of language-model servers: a server on this machine answers with broken bodies; does one become a goal?

python benchmarks/fuzz_bodies.py [--cases 2000] [--first 0]

A third of the bodies are whole replies in some form of a server's, a third are cut off, a third are broken in a drawn
place, in their JSON or in their bytes. The openai reasoner or the openai vision model gets each over HTTP. It prints
the outcomes, and each body that was a traceback, was a goal though cut off, or was another reply than its plain form;
then it exits 1.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections import Counter
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from random import Random
from typing import Any

from command_line import Parser, run_script

from cartier import plugins
from cartier.errors import CartierError
from cartier.types import Selection
from cartier.vision.made import READ

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from llm import bodies
from llm.test_bodies import LISTED, LOOKS, PICTURES, QUESTION, REPLIES

MADE = json.dumps(bodies.completion({"content": '{"picture_1": {"answer": "2", "certainty": 1}}'})).encode()
KINDS = ("whole", "cut off", "broken")
STRANGE: list[Any] = [
    None, True, -1, 1e400, 10**40, "", "bed", "\ud83d", "null", [], {}, [[]], {"": {}}, ["bed"], {"text": "bed"},
    {"type": "text"}, {"type": ["text"], "text": "tv"}, "<think>", "}", '{"object":', {"object": {"object": "bed"}},
]  # fmt: skip


def body_of(seed: int) -> tuple[str, str, bytes]:
    """The kind of a case, the reply that it began with, and the body to send."""
    rng = Random(seed)
    kind, reply = KINDS[seed % 3], rng.choice([*REPLIES, LOOKS])
    if kind == "cut off":
        return kind, reply, json.dumps(bodies.cut_of(reply, rng)).encode()
    body = bodies.body_of(reply, rng)
    if kind == "broken" and rng.random() < 0.8:
        for _ in range(rng.randrange(1, 4)):
            body = broken(body, rng)
    data = json.dumps(body).encode()
    if kind == "broken" and rng.random() < 0.3:
        at = rng.randrange(len(data))
        data = data[:at] + rng.choice([b"", b"\xff", b"\x00", b'"', b"}" * 2000, b"[" * 5000]) + data[at + 1 :]
    return kind, reply, data


def broken(value: Any, rng: Random) -> Any:
    """A JSON value with a drawn part of it gone, twice, or strange."""
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        changed = value.copy()
        keys: Any = list(changed) if isinstance(changed, dict) else range(len(changed))
        key = rng.choice(keys)
        if rng.random() < 0.15:
            del changed[key]
        else:
            changed[key] = broken(changed[key], rng)
        return changed
    return rng.choice([*STRANGE, [value, value], {"content": value}, str(value)])


class Server(BaseHTTPRequestHandler):
    """Answers with ``body``, and right to a made picture."""

    body = b""
    photographs = 0

    def do_POST(self) -> None:
        asked = self.rfile.read(int(self.headers["content-length"]))
        body = MADE if READ.words.encode() in asked else self.body
        Server.photographs += body is self.body and b"image_url" in asked
        self.send_response(200)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *given: object) -> None:
        pass


def main() -> int:
    options = Parser(__doc__)
    options.add_argument("--cases", type=int, default=2000, help="bodies (default: %(default)s)")
    options.add_argument("--first", type=int, default=0, help="the first seed")
    asked = options.parse_args()
    from cartier.llm import server as transport

    transport.PAUSES_S = ()
    os.environ["OPENAI_API_KEY"] = "none"
    served = ThreadingHTTPServer(("127.0.0.1", 0), Server)
    threading.Thread(target=served.serve_forever, daemon=True).start()
    url, counts, bad, begun = f"http://127.0.0.1:{served.server_port}/v1", Counter[str](), 0, time.monotonic()
    for seed in range(asked.first, asked.first + asked.cases):
        kind, reply, Server.body = body_of(seed)
        outcome = outcome_of(kind, reply, f"{url}/{seed}")  # a server of its own: nothing is known of it
        counts[f"{kind}: {outcome}"] += 1
        if outcome.isupper():
            bad += 1
            print(f"{outcome} {seed}: {Server.body[:2000]!r}", flush=True)
    for name, count in sorted(counts.items()):
        print(f"{name:32} {count:6}")
    print(f"{asked.cases} bodies in {time.monotonic() - begun:.0f} s; {bad} faults")
    return 1 if bad else 0


def outcome_of(kind: str, reply: str, url: str) -> str:
    """What became of the body that the server sends now; a fault is in capitals."""
    try:
        if reply == LOOKS:
            Server.photographs = 0
            look = plugins.make("vision", "openai", model="m", base_url=url).look(QUESTION, PICTURES)
            if Server.photographs != 1:
                return "PHOTOGRAPHS LEFT MORE THAN ONCE"
            if look.valid != (kind == "whole") and kind != "broken":
                return "A LOOK WAS MISREAD"
            return "a look" if look.valid else "no look"
        chosen = plugins.make("reasoners", "openai", model="m", base_url=url).select("my feet hurt", LISTED)
    except CartierError as error:
        if kind == "whole":
            return "A WHOLE REPLY WAS LOST"
        return "an error of one line" if "\n" not in str(error) else "AN ERROR OF SEVERAL LINES"
    except BaseException:
        traceback.print_exc()
        return "TRACEBACK"
    if not all(LISTED.contains(need) for need in (chosen, *chosen.next)):
        return "OUT OF THE LIST"
    if kind == "cut off" and chosen.object is not None:
        return "A GOAL FROM AN INCOMPLETE REPLY"
    if kind == "whole" and plain(chosen) != plain(read(reply)):
        return "ANOTHER SELECTION"
    return chosen.status


def read(reply: str) -> Selection | None:
    from cartier.llm.reply_parser import read_reply

    return read_reply(reply, LISTED)


def plain(chosen: Selection | None) -> Selection | None:
    """A selection without what tells where it came from."""
    if chosen is None:
        return None
    further = tuple(replace(need, model="") for need in chosen.next)
    return replace(chosen, reply="", prompt="", model="", next=further)


if __name__ == "__main__":
    run_script(main)
