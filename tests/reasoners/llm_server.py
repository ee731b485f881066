"""A real inference engine (mistralrs) with a random-weight model, behind an HTTP server with optional faults.

python llm_server.py FILE.gguf      prints the port; the model's name in a request chooses the behaviour:
``honest`` honours json_schema, ``ignores`` drops every form of structured output; the rest is said by their names.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

CANNED = {
    "rubbish": "\x00\ufffd lorem {{{ ]] ipsum",
    "truncated": '{"object": "cha',
    "outside": '{"object": "helicopter"}',
    "wrapped": "The best place to send the robot is the object called `Chair'.",
    "empty": "",
    "proposes": "1. Sofa, the bed",
    "no-bounds": '{"reason": "It is soft.", "status": "found", "object": "bed", "question": "", "say": "", '
    '"answer": null, "then": []}',
    "nothing": '{"object": "nothing"}',
    "two-needs": '{"reason": "Muddy clothes want a wash.", "status": "found", "object": "chair", "question": "", '
    '"then": ['
    '{"reason": "Then you rest.", "status": "near", "object": "Bed", "question": ""}, '
    '{"reason": "", "status": "found", "object": "helicopter", "question": ""}]}',
    "blanks": '{"object": "bed"' + " " * 19_000 + "}",
    "asks": '{"reason": "Both fit.", "status": "clarify", "object": "nothing", "question": "Chair\\nor bed?", '
    '"then": []}',
}
REFUSES = {"no-temperature": ("temperature",), "picky": ("max_tokens", "temperature")}


def write_tiny_llama(
    path: Path, seed: int = 0, width: int = 64, hidden: int = 96, layers: int = 2, heads: int = 4
) -> None:
    """A Llama of random weights over bytes and printable characters, about 470 kB."""
    import gguf

    rng, writer = np.random.default_rng(seed), gguf.GGUFWriter(str(path), "llama")
    printable = ["▁" if c == 32 else chr(c) for c in range(32, 127)]
    tokens = [t.encode() for t in ["<unk>", "<s>", "</s>", *(f"<0x{i:02X}>" for i in range(256)), *printable]]
    kind = gguf.TokenType
    kinds = [kind.UNKNOWN, kind.CONTROL, kind.CONTROL] + [kind.BYTE] * 256 + [kind.NORMAL] * len(printable)
    writer.add_context_length(4096)
    writer.add_embedding_length(width)
    writer.add_block_count(layers)
    writer.add_feed_forward_length(hidden)
    writer.add_head_count(heads)
    writer.add_head_count_kv(heads)
    writer.add_layer_norm_rms_eps(1e-5)
    writer.add_rope_dimension_count(width // heads)
    writer.add_vocab_size(len(tokens))
    writer.add_tokenizer_model("llama")
    writer.add_token_list(tokens)
    writer.add_token_scores([0.0] * len(tokens))
    writer.add_token_types(kinds)
    writer.add_bos_token_id(1)
    writer.add_eos_token_id(2)
    writer.add_unk_token_id(0)
    writer.add_add_bos_token(True)
    writer.add_chat_template("{% for m in messages %}[{{ m['role'] }}] {{ m['content'] }}\n{% endfor %}[assistant] ")
    shapes = {"token_embd": (len(tokens), width), "output": (len(tokens), width)}
    for i in range(layers):
        shapes |= {f"blk.{i}.attn_{k}": (width, width) for k in ("q", "k", "v", "output")}
        shapes |= {
            f"blk.{i}.ffn_gate": (hidden, width),
            f"blk.{i}.ffn_up": (hidden, width),
            f"blk.{i}.ffn_down": (width, hidden),
        }
    for name, shape in shapes.items():
        writer.add_tensor(f"{name}.weight", (rng.standard_normal(shape) * 0.3).astype(np.float32))
    for name in ["output_norm", *(f"blk.{i}.{k}" for i in range(layers) for k in ("attn_norm", "ffn_norm"))]:
        writer.add_tensor(f"{name}.weight", np.ones(width, np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


def serve(model: Path) -> None:
    os.environ["HF_HUB_OFFLINE"] = "1"
    import mistralrs

    which = mistralrs.Which.GGUF(quantized_model_id=str(model.parent), quantized_filename=model.name)
    runner = mistralrs.Runner(which, max_seqs=2)

    class Face(BaseHTTPRequestHandler):
        seen: ClassVar[dict[str, list[dict[str, Any]]]] = {}
        dripped: ClassVar[dict[bytes, float]] = {}

        def log_message(self, *_: object) -> None:
            pass

        def send(self, status: int, value: object, cut: bool = False) -> None:
            body = json.dumps(value).encode()
            self.send_response(status)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if cut else body)
            self.close_connection = True

        def send_spaces(self, size: int, pause_s: float = 0.0, status: bytes = b"200 OK") -> None:
            """White space before a JSON reply that never comes: some hosts keep a connection alive in this way."""
            self.wfile.write(b"HTTP/1.0 " + status + b"\r\ncontent-type: application/json\r\n\r\n")
            with contextlib.suppress(OSError):  # until the client has had enough
                for _ in range(80):
                    self.wfile.write(b" " * size)
                    time.sleep(pause_s)

        def drip(self, head: bytes, line: bytes, pause_s: float) -> None:
            """One line of a head after another, and never its end."""
            with contextlib.suppress(OSError):  # until the client has had enough
                self.wfile.write(head)
                for _ in range(int(8 / max(pause_s, 0.001))):
                    self.wfile.write(line)
                    self.wfile.flush()
                    time.sleep(pause_s)
                    self.dripped[line] = time.monotonic()

        def do_GET(self) -> None:
            """What a model was asked, or how long ago a line was dripped, for the tests to look at."""
            name = self.path.strip("/")
            dripping = {line.decode().split(":")[0].strip(): time.monotonic() - at for line, at in self.dripped.items()}
            self.send(200, dripping if name == "dripping" else self.seen.get(name, []))

        def do_POST(self) -> None:
            asked = json.loads(self.rfile.read(int(self.headers["content-length"])))
            name = asked["model"]
            self.seen.setdefault(name, []).append(asked)
            form = (asked.get("response_format") or {}).get("type")
            before = len(self.seen[name]) - 1
            if name == "hangs" or (name == "hangs-later" and before):
                time.sleep(8)
            elif name in ("dawdles", "endless"):
                self.send_spaces(**{"dawdles": {"size": 1, "pause_s": 0.1}, "endless": {"size": 2**16}}[name])
            elif name.startswith("moves-"):  # moves-308-http://127.0.0.1:1234/v1
                _, status, target = name.split("-", 2)
                self.send_response(int(status))
                self.send_header("location", target)
                self.send_header("content-length", "0")
                self.end_headers()
            elif name == "drips":
                self.drip(b"HTTP/1.1 200 OK\r\n", b"x-patience: a virtue\r\n", 0.05)
            elif name == "continues":
                self.drip(b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.01)
            elif name == "endless-500":
                self.send_spaces(2**16, status=b"500 Sorry")
            elif name.isdigit():
                self.send(int(name), {"error": {"message": f"you asked for {name}"}})
            elif name == "cut-500":
                self.send(500, {"error": {"message": "half a"}}, cut=True)
            elif name == "html":
                self.wfile.write(b"HTTP/1.0 200 OK\r\ncontent-type: text/html\r\n\r\n<h1>router login</h1>")
            elif name == "repeats-the-key":
                self.send(400, {"error": {"message": f"bad request with {self.headers['authorization']}"}})
            elif (name == "knows-no-schema" and form == "json_schema") or (name == "tool-only" and form):
                self.send(500, {"error": {"message": "unknown response_format"}})
            elif (name == "busy-later" and before == 1) or (name == "busy-first" and not before):
                self.send({"busy-later": 503, "busy-first": 429}[name], {"error": {"message": "overloaded"}})
            elif name == "no-bounds" and "maxLength" in json.dumps(asked):
                self.send(400, {"error": {"message": "Invalid schema: 'maxLength' is not permitted."}})
            elif refused := [p for p in REFUSES.get(name, ()) if p in asked]:
                self.send(400, {"error": {"message": f"Unsupported parameter: '{refused[0]}'"}})
            elif name == "tool-only" and asked.get("tools"):
                call = {"function": {"name": "go_to", "arguments": '{"object": "bed"}'}, "type": "function", "id": "1"}
                self.send(200, {"choices": [{"message": {"content": None, "tool_calls": [call]}}]})
            else:
                self.send(200, self.complete(asked, name), cut=name == "cut" or (name == "cut-once" and not before))

        def complete(self, asked: dict[str, Any], name: str) -> dict[str, Any]:
            later = name == "rubbish-later" and len(self.seen[name]) > 1
            lists = name == "lawful" and not asked.get("response_format")  # random weights know no list of names
            text, used, finish = CANNED.get("rubbish" if later else "proposes" if lists else name), 0, "stop"
            if text is None:
                form, grammar = asked.get("response_format") or {}, {}
                if name != "ignores" and form.get("type") in ("json_schema", "json_object"):
                    schema = form["json_schema"]["schema"] if form["type"] == "json_schema" else form["schema"]
                    compact = {"x-guidance": {"whitespace_flexible": False}}  # llama.cpp too bounds white space
                    grammar = {"grammar": json.dumps(schema | compact), "grammar_type": "json_schema"}
                request = mistralrs.ChatCompletionRequest(
                    model="default",
                    messages=asked["messages"],
                    temperature=0.0,
                    max_tokens=asked.get("max_tokens", 64),
                    **grammar,
                )
                reply: Any = runner.send_chat_completion_request(request)
                text, used = reply.choices[0].message.content, reply.usage.total_tokens
                finish = reply.choices[0].finish_reason
                self.seen.setdefault(f"replies-of-{name}", []).append({"text": text})
            choice = {"index": 0, "finish_reason": finish, "message": {"role": "assistant", "content": text}}
            about = {"id": "x", "object": "chat.completion", "created": 0, "model": name, "choices": [choice]}
            return about | {"usage": {"total_tokens": used}}

    server = ThreadingHTTPServer(("127.0.0.1", 0), Face)
    print(f"port {server.server_address[1]}", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    serve(Path(sys.argv[1]).resolve())
