"""The HTTP API as it is used, and each attack on it once, against a server."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hmac
import json
import os
import re
import shlex
import shutil
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter
from typer.testing import CliRunner

pytest.importorskip("fastapi", reason="needs cartier[serve]")
pytest.importorskip("uvicorn", reason="needs cartier[serve]")
httpx = pytest.importorskip("httpx")

from cartier.cli import app  # noqa: E402
from cartier.errors import InputError  # noqa: E402
from cartier.home import Home  # noqa: E402
from cartier.home.correction_log import LOG, read_log  # noqa: E402
from cartier.serving import guard, http, results  # noqa: E402
from cartier.serving import server as web_server  # noqa: E402
from cartier.serving.access import ACCESS, Access  # noqa: E402
from cartier.serving.guard import Guard, digest_of, host_names, read_tokens  # noqa: E402
from cartier.serving.homes import Homes  # noqa: E402
from cartier.serving.operations import Operations  # noqa: E402
from cartier.types import Inventory, Selection  # noqa: E402
from serving.conftest import Beside, Server, free_port, running_beside, starting  # noqa: E402
from serving.test_operations import CALLS, Echo  # noqa: E402
from vision import seeing_server  # noqa: E402
from vision import test_verification as verifying  # noqa: E402

TOKEN = "correct-horse-battery-staple-42"
JSON = {"content-type": "application/json"}
WEB = httpx.Client(limits=httpx.Limits(max_keepalive_connections=0))
"""A connection for each request; one client, since each new one reads all certificates of the machine."""


@pytest.fixture(scope="module")
def server(mapped: Path) -> Iterator[Beside]:
    with running_beside() as begin:
        yield begin("serve", mapped)


@pytest.fixture(scope="module")
def locked(mapped: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """In a process of its own, whose log holds all that it says."""
    with starting(tmp_path_factory.mktemp("locked")) as begin:
        yield begin("serve", mapped, CARTIER_TOKEN=TOKEN)


def raw(server: Beside, data: bytes, wait_s: float = 5.0) -> bytes:
    """What the server says to these bytes, until it closes or says no more."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=wait_s) as line:
        line.sendall(data)
        got = b""
        try:
            while part := line.recv(65536):
                got += part
                if b"\r\n\r\n" in got and got.endswith((b"}", b"\n")):
                    break
        except TimeoutError:
            pass
        return got


# --- as it is used -------------------------------------------------------------------------------------------------


def test_state_is_not_guessed_over_http(server: Beside) -> None:
    with httpx.Client(base_url=server.url) as web:
        told = web.post("/api/homes/room/ask", json={"words": "is the chair clean?"}).json()
    assert told["text"].startswith("I cannot tell by looking without a vision model") and told["goal"] is None


def test_ask_goal_photo_over_http(server: Beside) -> None:
    with httpx.Client(base_url=server.url) as web:
        assert web.get("/api/homes").json() == {"homes": ["room"]}
        told = web.post("/api/homes/room/ask", json={"words": "let me sit down"}).json()
        assert told["object"] == "chair" and told["goal"]["path"] and told["certainty"] > 0.5
        assert web.get("/api/homes/room/goal", params={"entity": "mug"}).json()["goal"]
        photo = web.get("/api/homes/room/photo", params={"entity": "chair"})
        assert photo.content[:2] == b"\xff\xd8" and len(json.loads(photo.headers["x-box"])) == 4
        plan = web.get("/api/homes/room/photo", params={"entity": "chair", "view": 0})
        assert plan.content[:2] == b"\xff\xd8" and "x-box" not in plan.headers
        assert web.get("/api/homes/room/objects", params={"room": "room:0"}).json()["total"] == 3
        assert web.get("/api/homes/room/relate", params={"entity": "mug", "other": "table"}).json()["relations"]
        assert len(web.get("/api/homes/room/view").json()["objects"]) >= 3
        cloud = web.get("/api/homes/room/cloud").json()["cloud"]
        assert len(base64.b64decode(cloud["points"])) == 10 * cloud["count"] > 0


def test_openapi_describes_every_path_and_answer(server: Beside) -> None:
    paths = WEB.get(f"{server.url}/openapi.json").json()["paths"]
    assert len(paths) == 16
    for path, verb in ((path, verb) for path, methods in paths.items() for verb in methods.values()):
        assert verb["summary"] and "4XX" in verb["responses"] and "422" not in verb["responses"], path
        for content in verb["responses"]["200"]["content"].values():
            assert {"$ref", "type", "anyOf"} & set(content["schema"]), f"{path} answers with anything"


def test_documentation_loads_nothing_from_elsewhere(server: Beside, locked: Server) -> None:
    html = WEB.get(f"{server.url}/docs").text
    for path in WEB.get(f"{server.url}/openapi.json").json()["paths"]:
        assert f"<code>{path}</code>" in html
    assert set(re.findall(r'(?:href|src)="([^"#]+)"', html)) == {"data:,", "/docs.css", "/openapi.json"}
    assert not re.search(r"https?:|<script|<style|style=", html), "its Content-Security-Policy would forbid it"
    links = set(re.findall(r'href="#([^"]+)"', html))
    assert "Answered" in links and links <= set(re.findall(r'id="([^"]+)"', html))
    assert "@import" not in WEB.get(f"{server.url}/docs.css").text
    assert WEB.get(f"{locked.url}/docs").status_code == 200, "it holds nothing of a home"


def documented() -> list[tuple[str, str]]:
    """The method and path of each curl line of docs/serving.md, and the line."""
    text = (Path(__file__).parents[2] / "docs" / "serving.md").read_text("utf-8")
    lines = [line.removeprefix("$ ") for line in text.splitlines() if line.startswith("$ curl ")]
    rows = []
    for line in lines:
        words = shlex.split(line)
        url = next(word for word in words if word.startswith("http://"))
        path = url.removeprefix("http://127.0.0.1:8735").partition("?")[0]
        rows.append(("POST" if "--json" in words else "GET", path, line))
    return [(f"{method} {path.replace('/homes/home', '/homes/{home}')}", line) for method, path, line in rows]


def answered_by(operation: str) -> Any:
    """The model of an operation's answer; None for pictures."""
    name = operation.rpartition("/")[2]
    either = {
        "describe": results.ObjectDescription | results.RoomDescription, "goal": results.ObjectPose | results.RoomPose,
        "homes": results.Homes, "ask": results.Answered, "find": results.FoundByName, "objects": results.ObjectList,
        "rooms": results.RoomList, "relate": results.Related, "view": results.View, "cloud": results.Cloud,
        "corrections": results.Corrected, "undo": results.Corrected, "live": results.LiveNow,
        "verify": results.Verified,
    }  # fmt: skip
    return either.get(name)


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_every_path_has_a_curl_line_that_works(home: Path, beside: Callable[..., Beside], tmp_path: Path) -> None:
    (tmp_path / "replies.jsonl").touch()  # nothing in this home is doubtful
    looking = ("--look", "auto", "--vision", f"replay:{tmp_path / 'replies.jsonl'}")
    server = beside("serve", Path(shutil.copytree(home, tmp_path / "served" / "home")), *looking)
    paths = WEB.get(f"{server.url}/openapi.json").json()["paths"]
    known = [f"{method.upper()} {path}" for path, methods in paths.items() for method in methods]
    rows = documented()
    assert sorted(operation for operation, _ in rows if "/api/" in operation) == sorted(known)
    for operation, line in rows:
        words = shlex.split(line.replace(":8735", f":{server.port}"))
        run = [words[0], "--fail", "-sS", *words[1:]]
        done = subprocess.run(run, cwd=tmp_path, capture_output=True, timeout=60)
        assert done.returncode == 0, (line, done.stderr)
        if (model := answered_by(operation)) is not None:
            TypeAdapter(model).validate_json(done.stdout)
    assert (tmp_path / "chair.jpg").read_bytes()[:2] == b"\xff\xd8"


@pytest.mark.parametrize("call", CALLS)
def test_operations_answer_as_openapi_says(home: Path, call: str) -> None:
    told = CALLS[call](Operations(Homes([home]), Echo()))
    names = {
        "describe room": results.RoomDescription,
        "goal_for": results.ObjectPose,
        "list_objects": results.ObjectList,
    }
    names |= {"ask": results.Answered, "find": results.FoundByName, "describe": results.ObjectDescription}
    names |= {"list_rooms": results.RoomList, "relate": results.Related}
    names |= {"correct": results.Corrected, "undo": results.Corrected}
    if call != "look_at":  # whose answer over HTTP is a picture
        TypeAdapter(names[call]).validate_json(json.dumps(told))


def test_verification_over_http_needs_the_owner_and_a_token(tmp_path: Path) -> None:
    """It answers as OpenAPI says where the owner lets photographs leave, and sends none for who has no token."""
    verifying.staged(tmp_path / "home", (8, "pink", 0.75, "orange box"))
    allowed = digest_of(TOKEN)
    with seeing_server.serving() as (url, asked):
        ops = Operations(Homes([tmp_path / "home"]), Echo(), look=verifying.permitted(url))
        app = Guard(
            http.make(ops), ["test"], {allowed: Access("a", ("home",)), digest_of(TOKEN[::-1]): Access("b", ())}
        )

        async def called() -> list[Any]:
            web = httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://test", timeout=60)
            path, bearers = "/api/homes/home/verify", [None, TOKEN[::-1], TOKEN]
            got = []
            for bearer in bearers:
                headers = {} if bearer is None else {"authorization": f"Bearer {bearer}"}
                got.append((await web.post(path, headers=headers, json={}), len(asked)))
            await web.aclose()
            return got

        (nobody, none), (stranger, still), (owner, sent) = asyncio.run(called())
    assert (nobody.status_code, none, stranger.status_code, still) == (401, 0, 404, 0)
    told = TypeAdapter(results.Verified).validate_json(owner.text)
    assert owner.status_code == 200 and sent == 13
    assert [(row.id, row.said, row.after) for row in told.asked] == [(8, "no", 0.3001)]


def test_long_work_sends_signs_of_life(mapped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http, "BEAT_S", 0.05)

    async def told() -> list[str]:
        def work() -> dict[str, str]:
            time.sleep(0.3)
            return {"status": "found"}

        return [event async for event in http._events(lambda: asyncio.to_thread(work))]

    events = asyncio.run(told())
    assert events[0].startswith("event: thinking") and len(events) >= 3
    assert events[-1] == 'event: answer\ndata: {"status": "found"}\n\n'


def test_events_over_http(server: Beside) -> None:
    got = WEB.post(f"{server.url}/api/homes/room/ask", json={"words": "a mug"}, headers={"accept": "text/event-stream"})
    assert got.headers["content-type"].startswith("text/event-stream") and "event: answer\ndata: {" in got.text


def test_corrections_last_and_are_seen_by_all(home: Path, beside: Callable[..., Beside]) -> None:
    web = httpx.Client(base_url=beside("serve", home).url)
    named = web.post(
        "/api/homes/room/corrections", json={"what": "name", "entity": "mug", "name": "Ayo's", "who": "Ayo"}
    )
    assert named.json()["done"].endswith("is called Ayo's")
    assert "Ayo's" in Home.load(home).names
    assert read_log(home)[0][0].who == "Ayo"
    Home.load(home).correct("forget", "chair")
    assert web.get("/api/homes/room/objects").json()["total"] == 2
    assert "forgotten" in web.post("/api/homes/room/undo", json={}).json()["done"]
    assert web.get("/api/homes/room/objects").json()["total"] == 3


def test_corrections_of_every_kind_and_by_words(home: Path, beside: Callable[..., Beside]) -> None:
    web = httpx.Client(base_url=beside("serve", home).url)
    before = web.get("/api/homes/room/view").json()["objects"]
    wishes: list[dict[str, Any]] = [
        {"what": "name", "entity": "home", "name": "Ben's flat"}, {"what": "confirm", "entity": "chair"},
        {"what": "relabel", "entity": "chair", "name": "throne"}, {"what": "add", "entity": "table", "name": "vase"},
        {"what": "add", "name": "lamp", "x": 2.0, "y": 1.0}, {"what": "merge", "entity": "table", "other": "mug"},
        {"what": "split", "entity": "table", "name": "desk"},
    ]  # fmt: skip
    done = [web.post("/api/homes/room/corrections", json=wish).json()["done"] for wish in wishes]
    now = web.get("/api/homes/room/view").json()
    assert now["title"] == "Ben's flat" and now["corrections"] == len(wishes)
    assert {"throne", "vase", "lamp", "table", "desk"} == {t["label"] for t in now["objects"] if t["said"]}
    row = web.get("/api/homes/room/describe", params={"entity": "vase"}).json()
    assert row["certainty"] == 1 and row["evidence"] == "a person said so; seen 0 of 0" and row["goal"]
    undone = [web.post("/api/homes/room/undo", json={}).json()["done"] for _ in wishes]
    assert undone == [f"undone: {each}" for each in reversed(done)]
    assert web.get("/api/homes/room/view").json()["objects"] == before

    def say(words: str) -> dict[str, Any]:
        result: dict[str, Any] = web.post("/api/homes/room/ask", json={"words": words, "conversation": "a"}).json()
        return result

    chair = say("take me to the chair")
    told = say("That is a pencil box.")
    assert told["text"] == f"Noted: chair ({chair['id']}) is labelled pencil box." and told["corrected"]
    assert "corrected" in say("undo that") and web.get("/api/homes/room/view").json()["objects"] == before
    assert "corrected" not in say("that is a pencil box"), "nobody spoke of an object right before"


def test_kill_and_restart_leave_whole_corrections(home: Path, start: Callable[..., Server]) -> None:
    done = 0
    for kill_s in (0.05, 0.35):
        server = start("serve", home)

        def rename(at: Server = server) -> None:
            nonlocal done
            with httpx.Client(base_url=at.url) as web:
                for number in range(10_000):
                    try:
                        body = {"what": "name", "entity": "mug", "name": f"mug {number} é"}
                        done += web.post("/api/homes/room/corrections", json=body).status_code == 200
                    except httpx.HTTPError:
                        return

        busy = threading.Thread(target=rename)
        busy.start()
        time.sleep(kill_s)
        os.kill(server.process.pid, signal.SIGKILL)
        busy.join(30)
        entries, faults = read_log(home)
        assert len(entries) >= done and not faults[1:], "what was answered is on the disk"
        assert Home.load(home).objects
    assert done


def test_a_slow_home_holds_up_no_other(home: Path, tmp_path: Path) -> None:
    import shutil

    class Slow:
        name = "slow"

        def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
            if "slowly" in query:
                time.sleep(3)
            return Selection("found", "mug")

        def propose(self, query: str) -> list[str]:
            return []

    app = http.make(Operations(Homes([home, Path(shutil.copytree(home, tmp_path / "other"))]), Slow()))

    async def both() -> float:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://x") as web:
            slow = [asyncio.ensure_future(web.post("/api/homes/room/ask", json={"words": "slowly"})) for _ in range(60)]
            await asyncio.sleep(0.3)
            begin = time.perf_counter()
            for _ in range(5):
                assert (await web.post("/api/homes/other/ask", json={"words": "now"})).json()["object"] == "mug"
            took = time.perf_counter() - begin
            for each in slow:
                each.cancel()
            return took

    assert asyncio.run(both()) < 2.0


@pytest.mark.parametrize(("sign", "accept"), [(signal.SIGINT, "*/*"), (signal.SIGTERM, "text/event-stream")])
def test_the_end_does_not_wait_for_a_slow_model(
    home: Path, start: Callable[..., Server], sign: signal.Signals, accept: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:  # a language model that never answers
        silent.settimeout(60)
        model = f"http://127.0.0.1:{silent.getsockname()[1]}/v1"
        asked = start("serve", home, "--reasoner", "openai", "--model", "m", OPENAI_BASE_URL=model, OPENAI_API_KEY="k")
        said = list[Any]()

        def ask() -> None:
            said.append(
                WEB.post(f"{asked.url}/api/homes/room/ask", json={"words": "a bed"}, headers={"accept": accept})
            )

        thread = threading.Thread(target=ask)
        thread.start()
        waiting, _ = silent.accept()
        asked.process.send_signal(sign)
        assert asked.process.wait(20) in (0, -signal.SIGTERM)
        thread.join(20)
        waiting.close()
    assert "Traceback" not in asked.log.read_text()
    if accept == "*/*":
        assert (said[0].status_code, said[0].json()) == (503, {"error": guard.ENDS})
    else:
        event = said[0].text.rpartition("event: ")[2]
        assert event == f"fault\ndata: {json.dumps({'error': guard.ENDS})}\n\n"


# --- attacks -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["evil.example", "127.0.0.1", "localhost.evil.example", "", "127.0.0.1:1"])
def test_dns_rebinding_meets_a_check_of_the_host(server: Beside, name: str) -> None:
    got = WEB.get(f"{server.url}/api/homes", headers={"host": name or "x"})
    assert got.status_code == 421 and "homes" not in got.json()


def test_two_hosts_are_none(server: Beside) -> None:
    line = f"GET /api/homes HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nHost: evil.example\r\n\r\n"
    assert b"200" not in raw(server, line.encode()).partition(b"\r\n")[0]


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
        {"content-type": "text/plain"}, {"content-type": "application/x-www-form-urlencoded"},
    ],
)  # fmt: skip
def test_cross_site_posts_do_nothing(server: Beside, mapped: Path, headers: dict[str, str]) -> None:
    body = b'{"what": "forget", "entity": "mug"}'
    got = WEB.post(f"{server.url}/api/homes/room/corrections", content=body, headers=JSON | headers)
    assert got.status_code in (403, 415) and not (mapped / LOG).exists()


def test_no_other_site_may_read(server: Beside) -> None:
    for method in ("GET", "OPTIONS"):
        headers = {"origin": "https://evil.example", "access-control-request-method": "POST"}
        got = WEB.request(method, f"{server.url}/api/homes", headers=headers)
        assert got.status_code in (403, 405) and not any("access-control" in key for key in got.headers)


def test_every_answer_has_the_security_headers(server: Beside) -> None:
    for path in ("/", "/app.js", "/api/homes", "/api/homes/attic/rooms", "/nothing", "/openapi.json", "/docs"):
        headers = WEB.get(server.url + path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers and headers["cache-control"] in ("no-store", "no-cache")


PATHS = [
    "/../../../../etc/passwd", "/..%2f..%2fetc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd",
    "/app.js/../../../page.py", "/.git/config",
    "/api/homes/..%2f..%2f..%2fetc/rooms", "/api/homes/%2e%2e/view", "/api/homes/room%00/view",
    "/api/homes/room/../../x", "/page.py", "/api/homes//view",
]  # fmt: skip


@pytest.mark.parametrize("path", PATHS)
def test_no_path_leads_to_a_file(server: Beside, path: str) -> None:
    got = raw(server, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode())
    status = int(got.split()[1])
    assert status in (400, 404) and b"root:" not in got and b"import" not in got


def test_a_body_of_ten_megabytes_is_refused_unread(server: Beside) -> None:
    begin = time.perf_counter()
    got = WEB.post(f"{server.url}/api/homes/room/ask", content=json.dumps({"words": "x" * 10_000_000}), headers=JSON)
    assert got.status_code == 413 and time.perf_counter() - begin < 5


def test_an_endless_body_is_cut_off(server: Beside) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as line:
        head = f"POST /api/homes/room/ask HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
        head += "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
        line.sendall(head.encode())
        sent = 0
        try:
            while sent < 50_000_000:
                line.sendall(b"1000\r\n" + b"x" * 4096 + b"\r\n")
                sent += 4096
        except OSError:
            pass
        assert sent < 20_000_000
    assert WEB.get(f"{server.url}/api/homes").status_code == 200


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("ask", b"[" * 60_000), ("ask", b'{"words": ' + b"1" * 5000 + b"}"), ("ask", b'{"words": NaN}'),
        ("ask", b"\xff\xfe"), ("ask", b""),
        ("ask", b'{"words": "x", "topic": "/cmd_vel"}'), ("ask", json.dumps({"words": "x" * 5000}).encode()),
        ("ask", b'{"words": "x", "from_x": 1e999, "from_y": 0}'),
        ("ask", b'{"words": "x", "from_x": 1}'), ("ask", b'{"words": "\\ud800"}'), ("ask", b'{"words": "   "}'),
        ("corrections", b'{"what": "delete", "entity": "mug"}'), ("corrections", b'{"what": "undo", "entity": "mug"}'),
        ("corrections", b'{"what": "move", "entity": "mug", "x": 1e9, "y": 0}'),
        ("corrections", b'{"what": "name", "entity": "mug", "name": "a\\u0000b"}'),
        ("corrections", b'{"what": "name", "entity": "mug", "name": "\\ud800"}'),
    ],
)  # fmt: skip
def test_hostile_json_is_one_line(server: Beside, mapped: Path, path: str, body: bytes) -> None:
    got = WEB.post(f"{server.url}/api/homes/room/{path}", content=body, headers=JSON)
    assert got.status_code in (400, 404, 413, 422), got.text
    assert set(got.json()) == {"error"} and "Traceback" not in got.text and not (mapped / LOG).exists()


def test_no_more_requests_at_once_than_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MAX_IN_FLIGHT", 2)
    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"x")], "client": ("127.0.0.1", 1)}

    async def status(guarded: Guard) -> int:
        sent: list[dict[str, Any]] = []

        async def keep(message: dict[str, Any]) -> None:
            sent.append(message)

        async def empty() -> dict[str, Any]:
            return {"type": "http.request", "body": b"", "more_body": False}

        await guarded(scope, empty, keep)
        return int(sent[0]["status"])

    async def three_at_once() -> tuple[list[int], int]:
        async def app(scope: Any, receive: Any, send: Any) -> None:
            await asyncio.sleep(0.05)
            await send({"type": "http.response.start", "status": 200, "headers": []})

        guarded = Guard(app, ["x"])
        return list(await asyncio.gather(*(status(guarded) for _ in range(3)))), await status(guarded)

    assert asyncio.run(three_at_once()) == ([200, 200, 503], 200)


def test_slow_bodies_and_slow_readers_keep_no_place(server: Beside, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "BODY_S", 0.2)
    monkeypatch.setattr(guard, "SEND_S", 0.2)
    sent: list[dict[str, Any]] = []

    async def never() -> dict[str, Any]:
        await asyncio.sleep(60)
        raise AssertionError

    async def stuck(message: dict[str, Any]) -> None:
        await asyncio.sleep(60)

    async def keep(message: dict[str, Any]) -> None:
        sent.append(message)

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def empty() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    guarded = Guard(app, ["x"])
    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"x")], "client": ("127.0.0.1", 1)}
    asyncio.run(asyncio.wait_for(guarded(scope, never, keep), 5))
    assert sent[0]["status"] == 408
    asyncio.run(asyncio.wait_for(guarded(scope, empty, stuck), 5))
    assert guarded._in_flight == 0
    lines = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(150)]
    for line in lines:  # who asks and never reads, and who never ends asking
        line.sendall(f"GET /api/homes/room/view HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n".encode())
    begin = time.perf_counter()
    assert WEB.get(f"{server.url}/api/homes").status_code == 200 and time.perf_counter() - begin < 3
    for line in lines:
        line.close()


def test_heads_that_drip_are_cut_off_and_others_are_served(server: Beside, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three clients that keep a connection busy: a head byte by byte, the same after a whole request, and silence."""
    monkeypatch.setattr(web_server, "HEAD_S", 1.5)
    ask = f"GET /api/homes HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode()
    head = b"GET / HTTP/1.1\r\nX-" + b"a" * 60
    lasted: dict[str, float] = {}

    def drip(name: str, whole: bytes, dripped: bytes) -> None:
        with socket.create_connection(("127.0.0.1", server.port), timeout=0.3) as line:
            if whole:
                line.sendall(whole)
                assert b"200 OK" in line.recv(65536)
            begin = time.perf_counter()
            for byte in dripped:
                try:
                    if byte != ord("-"):
                        line.sendall(bytes([byte]))
                    if line.recv(1) == b"":
                        break
                except TimeoutError:
                    continue  # that long without an answer
                except OSError:
                    break
            lasted[name] = time.perf_counter() - begin

    clients = [
        threading.Thread(target=drip, args=each)
        for each in (("drips", b"", head), ("drips later", ask, head), ("says nothing", b"", b"-" * 30))
    ]
    for each in clients:
        each.start()
    served = 0
    while any(each.is_alive() for each in clients):
        begin = time.perf_counter()
        assert WEB.get(f"{server.url}/api/homes").status_code == 200 and time.perf_counter() - begin < 2
        served += 1
        time.sleep(0.1)
    assert served >= 5 and set(lasted) == {"drips", "drips later", "says nothing"}
    assert all(web_server.HEAD_S - 0.5 < took < web_server.HEAD_S + 4 for took in lasted.values()), lasted


def test_a_slow_answer_is_no_slow_head_and_connections_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    import uvicorn

    monkeypatch.setattr(web_server, "HEAD_S", 0.2)
    monkeypatch.setattr(web_server, "MAX_CONNECTIONS", 3)

    async def slow(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.sleep(0.8)
        await nothing(scope, receive, send)
        await send({"type": "http.response.body", "body": b"done"})

    async def run() -> None:
        config = uvicorn.Config(slow, port=free_port(), http=web_server.Connection, lifespan="off", log_level="error")
        server = uvicorn.Server(config)
        serving = asyncio.ensure_future(server.serve())
        while not server.started:
            await asyncio.sleep(0.02)
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{config.port}") as web:
            for _ in range(2):  # the second on the same connection
                assert (await web.get("/")).text == "done"
        held = [await asyncio.open_connection("127.0.0.1", config.port) for _ in range(3)]
        one_more, _ = await asyncio.open_connection("127.0.0.1", config.port)
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.wait_for(one_more.read(), 0.15) == b"", "at once, and not when its head is late"
        for _, writer in held:
            writer.close()
        server.should_exit = True
        await serving

    asyncio.run(run())


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


async def called(guarded: Guard, headers: dict[str, str], address: str = "10.0.0.9") -> int:
    """The status of one request to a guard, without a network."""
    statuses: list[int] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: dict[str, Any]) -> None:
        statuses.append(message.get("status", 0))

    told = [(key.encode(), value.encode("latin-1")) for key, value in headers.items()]
    scope = {"type": "http", "method": "GET", "path": "/api/homes", "headers": told, "client": (address, 1)}
    await guarded(scope, receive, send)  # type: ignore[arg-type]
    return statuses[0]


def call(guarded: Guard, headers: dict[str, str], address: str = "10.0.0.9") -> int:
    return asyncio.run(called(guarded, headers, address))


async def nothing(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})


def test_thousands_of_wrong_tokens(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[tuple[int, int]] = []
    real = hmac.compare_digest
    monkeypatch.setattr(guard.hmac, "compare_digest", lambda a, b: (compared.append((len(a), len(b))), real(a, b))[1])
    now = [0.0]
    guarded = Guard(nothing, ["x"], {digest_of(TOKEN): Access()}, clock=lambda: now[0])
    host = {"host": "x"}
    statuses = Counter[int]()

    async def guess() -> None:
        for number in range(2_000):  # 100 s
            now[0] += 0.05
            wrong = {"authorization": f"Bearer {TOKEN[:-1]}x{number}"[: 8 + number % 40]}
            statuses[await called(guarded, host | wrong)] += 1

    asyncio.run(guess())
    assert set(statuses) == {401, 429} and statuses[401] <= 20 * (100 / 60 + 1)
    assert set(compared) == {(32, 32)}, "digests of one length: the time says nothing about the token"
    for address in ("10.0.0.9", "10.0.0.10"):  # behind a proxy the owner has a stranger's address
        assert call(guarded, host | {"authorization": f"Bearer {TOKEN}"}, address) == 200
    for wrong in ({}, {"authorization": TOKEN}, {"authorization": f"Basic {TOKEN}"}, {"authorization": "Bearer \xff"}):
        assert call(guarded, host | wrong, "10.0.0.11") == 401


def test_one_address_has_its_rate() -> None:
    now = [0.0]
    guarded = Guard(nothing, ["x"], clock=lambda: now[0])
    statuses = [call(guarded, {"host": "x"}) for _ in range(300)]
    assert statuses.count(200) == guard.BURST and set(statuses) == {200, 429}
    assert call(guarded, {"host": "x"}, "10.0.0.10") == 200
    now[0] += 1
    assert [call(guarded, {"host": "x"}) for _ in range(60)].count(200) == guard.RATE


def test_strangers_use_up_no_rate_of_a_token() -> None:
    guarded = Guard(nothing, ["x"], {digest_of(TOKEN): Access("owner")}, clock=lambda: 0.0)
    assert [call(guarded, {"host": "x"}) for _ in range(300)].count(429) == 300 - guard.BURST
    mine = [call(guarded, {"host": "x"} | bearer(TOKEN)) for _ in range(300)]
    assert mine.count(200) == guard.BURST and set(mine) == {200, 429}


def test_with_a_token_only_the_empty_page_is_open(locked: Server) -> None:
    for path in ("/api/homes", "/api/homes/room/view", "/openapi.json", "/nothing"):
        assert WEB.get(locked.url + path).status_code == 401
        got = WEB.get(locked.url + path, headers={"authorization": f"Bearer {TOKEN}"})
        assert got.status_code == (404 if path == "/nothing" else 200)
    assert WEB.get(locked.url + f"/api/homes?token={TOKEN}").status_code == 401
    page = WEB.get(f"{locked.url}/")
    assert page.status_code == 200 and "mug" not in page.text


def test_the_homes_of_one_token_are_not_those_of_another(
    mapped: Path, tmp_path: Path, beside: Callable[..., Beside]
) -> None:
    shutil.copytree(mapped, tmp_path / "flat-1")
    shutil.copytree(mapped, tmp_path / "flat-2")
    mine, other, keeper = (f"{name}-correct-horse-battery" for name in ("mine", "other", "keeper"))
    file = tmp_path / "tokens"
    file.write_text(f"{mine} room\n\n{other} attic flat-*\n{keeper}\n")
    file.chmod(0o600)
    at = beside("serve", mapped, tmp_path / "flat-1", tmp_path / "flat-2", "--token-file", file).url

    def get(token: str, path: str, **given: Any) -> Any:
        return WEB.request("POST" if given else "GET", f"{at}/api/homes{path}", headers=bearer(token), **given)

    assert get(mine, "").json()["homes"] == ["room"] and get(other, "").json()["homes"] == ["flat-1", "flat-2"]
    assert get(keeper, "").json()["homes"] == ["room", "flat-1", "flat-2"]
    view = get(keeper, "/room/view").json()
    for path, given in [(f"/{{}}/{rest}", more) for rest, more in (
        ("view", {}), ("cloud", {}), ("rooms", {}), ("rules", {}), ("live", {}), ("objects", {}), ("find?name=mug", {}),
        ("describe?entity=mug", {}), ("photo?entity=mug", {}), ("goal?entity=mug", {}), ("undo", {"json": {}}),
        ("relate?entity=mug&other=table", {}), ("ask", {"json": {"words": "mug", "conversation": "a"}}),
        ("corrections", {"json": {"what": "forget", "entity": "mug"}}),
    )]:  # fmt: skip
        for token, name in ((mine, "flat-1"), (other, "room"), (other, f"room@{view['home_id']}")):
            got = get(token, path.format(name), **given)
            assert got.status_code == 404 and "there is no home" in got.json()["error"], path
            assert ("flat" in got.text.partition(": pass")[2]) is (token == other), "it names what the token may see"
    assert get(keeper, "/room/view").json() == view, "nothing was corrected"
    assert get(mine, "/room/ask", json={"words": "mug", "conversation": "a"}).status_code == 200
    assert WEB.get(f"{at}/api/homes", headers=bearer(mine[:-1])).status_code == 401


def test_without_an_access_a_guarded_home_is_shown_to_nobody(home: Path) -> None:
    """If a thread ever ran an operation outside of its request, it must show nothing."""
    served = Homes([home])
    assert served.names == ["room"]
    served.guarded = True
    assert served.names == []
    with pytest.raises(InputError, match="there is no home 'room'"):
        served.get("room")


def test_two_tokens_share_no_conversation(home: Path) -> None:
    ops, heard = Operations(Homes([home]), Echo()), list[tuple[tuple[str, str], ...]]()
    real = ops.reasoner.select

    def select(query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        heard.append(tuple(dialogue))
        return real(query, inventory)

    ops.reasoner.select = select  # type: ignore[method-assign]
    for who in ("one", "two", "one"):
        held = ACCESS.set(Access(who))
        ops.ask("mug", "room", "talk")
        ACCESS.reset(held)
    assert [len(turns) for turns in heard] == [0, 0, 1]


def test_files_of_tokens(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    for text, fault in (
        ("", "20 or more"),
        (f"{TOKEN} a\n{TOKEN} b\n", "a token twice"),
        (f"{TOKEN}\nshort a", "20 or"),
    ):
        file.write_text(text)
        file.chmod(0o600)
        with pytest.raises(InputError, match=fault):
            read_tokens("127.0.0.1", file)


def test_no_secret_and_no_word_of_a_person_is_logged(locked: Server) -> None:
    for token in (TOKEN, TOKEN + "x"):
        headers = {"authorization": f"Bearer {token}"}
        WEB.post(f"{locked.url}/api/homes/room/ask", json={"words": "my secret illness"}, headers=headers)
        WEB.post(f"{locked.url}/api/homes/attic/ask", content=b"{", headers=headers | JSON)
    log = locked.log.read_text()
    assert TOKEN[:10] not in log and "illness" not in log


def test_other_machines_need_a_token_and_names(mapped: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="give a token in a file"):
        read_tokens("0.0.0.0", None)
    with pytest.raises(InputError, match="needs the names"):
        host_names("0.0.0.0", 80)
    assert host_names("0.0.0.0", 443, ["Home.local"]) == {"home.local:443", "home.local"}
    assert read_tokens("127.0.0.1", None) is None
    file = tmp_path / "token"
    file.write_text("short\n")
    file.chmod(0o600)
    with pytest.raises(InputError, match="20 or more"):
        read_tokens("127.0.0.1", file)
    file.write_text(TOKEN + "\n")
    assert read_tokens("0.0.0.0", file) == {digest_of(TOKEN): Access(digest_of(TOKEN).hex()[:16])}
    file.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        read_tokens("0.0.0.0", file)
    command = ["serve", str(mapped), "--host", "0.0.0.0"]
    ended = CliRunner().invoke(app, command)
    assert ended.exit_code == 1 and isinstance(ended.exception, InputError) and "token" in str(ended.exception)
    said = CliRunner().invoke(app, [*command, "--help"]).stdout
    assert "--token-file" in said
    assert not re.search(r"--token\b(?!-file)", said), "a command line is seen by all on the machine"


def test_tls_is_spoken_where_a_certificate_is_given(home: Path, tmp_path: Path, beside: Callable[..., Beside]) -> None:
    import shutil

    if shutil.which("openssl") is None:
        pytest.skip("needs openssl to make a certificate")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", tmp_path / "key.pem",
         "-out", tmp_path / "cert.pem",
         "-days", "1", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"],
        check=True, capture_output=True,
    )  # fmt: skip
    server = beside("serve", home, "--tls-cert", tmp_path / "cert.pem", "--tls-key", tmp_path / "key.pem")
    got = httpx.get(
        f"https://localhost:{server.port}/api/homes", verify=ssl.create_default_context(cafile=tmp_path / "cert.pem")
    )
    assert got.status_code == 200 and "max-age" in got.headers["strict-transport-security"]
