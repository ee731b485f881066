"""Way to a server: what goes through a proxy, what never does, and what is said where the environment is wrong."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import cartier
from cartier.cli import app
from cartier.errors import ReasonerError
from cartier.llm.network import is_own, proxy_to
from cartier.types import Inventory
from llm.bodies import completion

LISTED = Inventory.of(["bed", "chair"])
BED = completion({"content": '{"object": "bed"}'})
VARIABLES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "NO_PROXY")


@pytest.fixture(autouse=True)
def no_proxies(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    for name in (*VARIABLES, "SSL_CERT_FILE", "SSL_CERT_DIR", "OPENAI_BASE_URL", "OPENAI_API_KEY", "CARTIER_MODEL"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


@contextmanager
def answering() -> Iterator[tuple[str, list[str]]]:
    """A server's URL, and what it was asked for; it answers "bed" to everybody, as a proxy to any host."""
    heard: list[str] = []

    class Face(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            heard.append(self.path + " " + self.rfile.read(int(self.headers["content-length"])).decode())
            data = json.dumps(BED).encode()
            self.send_response(200)
            self.send_header("content-type", "application/json")
            self.send_header("content-length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *given: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Face)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", heard
    finally:
        server.shutdown()
        server.server_close()


def ask(url: str, name: str = "openai", **options: Any) -> cartier.Selection:
    mind = cartier.make("reasoners", name, model="m", base_url=f"{url}/v1", prompt="paper", **options)
    return mind.select("my private words", LISTED)  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("variable", ["HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"])
def test_words_for_this_machine_meet_no_proxy(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with answering() as (server, served), answering() as (proxy, passed):
        monkeypatch.setenv(variable, proxy)
        assert ask(server).object == "bed" and len(served) == 1 and not passed


def test_others_are_reached_by_the_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    with answering() as (proxy, passed):
        monkeypatch.setenv("HTTP_PROXY", proxy.replace("//", "//me:secret@"))
        assert ask("http://models.example.org").object == "bed"
        assert passed[0].startswith("http://models.example.org/v1/chat/completions ") and "private words" in passed[0]
        seen = cartier.make("vision", "openai", model="m", base_url="http://models.example.org/v1")
        assert seen.endpoint == f"http://models.example.org/v1 through the proxy {proxy} (HTTP_PROXY)"  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("variable", "value", "said"),
    [
        ("ALL_PROXY", "socks://127.0.0.1:7891/", "the proxy socks://127.0.0.1:7891/ (ALL_PROXY) cannot be used"),
        ("HTTPS_PROXY", "quic://me:secret@proxy:1", "the proxy quic://proxy:1 (HTTPS_PROXY) cannot be used"),
        ("SSL_CERT_FILE", "/nowhere/at-all.pem", "SSL_CERT_FILE names /nowhere/at-all.pem, where no certificates can"),
        ("SSL_CERT_FILE", __file__, "where no certificates can be read"),
    ],
)
def test_a_wrong_environment_is_one_line(variable: str, value: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(variable, value)
    url = "https://models.example.org"
    for kind, name in (("reasoners", "openai"), ("vision", "openai")):
        with pytest.raises(ReasonerError) as caught:
            cartier.make(kind, name, model="m", base_url=url)
        assert said in str(caught.value) and "\n" not in str(caught.value) and "secret" not in str(caught.value)
    mind = cartier.make("reasoners", "auto", model="m", base_url=url)
    assert mind.select("take me to the bed", LISTED).object == "bed"  # type: ignore[attr-defined]
    assert said in mind.notes[0]  # type: ignore[attr-defined]
    with answering() as (server, served):  # what is of no use there is not looked at
        assert ask(server).object == "bed" and served


def test_show_prompt_names_the_proxy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from cartier.pipeline import map_home
    from synthetic import THINGS, TrueBoxes, walk

    map_home(walk(), TrueBoxes(THINGS)).save(tmp_path / "room")
    monkeypatch.setenv("ALL_PROXY", "http://me:secret@proxy.example.org:3128")
    for url, way in (
        ("http://models.example.org/v1", "http://proxy.example.org:3128"), ("http://10.0.0.9/v1", None),
    ):  # fmt: skip
        line = ["ask", str(tmp_path / "room"), "a bed", "--model", "m", "--base-url", url, "--show-prompt"]
        told = json.loads(CliRunner().invoke(app, [*line, "--json"]).stdout)
        assert (told["to"], told["through"]) == (f"{url}/chat/completions", way)
        first = CliRunner().invoke(app, line).stdout.splitlines()[0]
        through = f" through the proxy {way} (ALL_PROXY)" if way else ""
        assert first == f"this is sent to {url}/chat/completions{through} and nowhere else"


@pytest.mark.parametrize(
    "host",
    [
        "localhost", "LOCALHOST.", "api.localhost", "127.0.0.1", "127.1", "2130706433", "::1", "::ffff:127.0.0.1",
        "0.0.0.0", "10.1.2.3", "172.16.0.1", "192.168.1.9", "169.254.7.7", "fe80::1", "fe80::1%eth0", "fd00::9",
        "100.64.0.1", "gpu-box", "robot.local", "nas.lan", "llm.internal", "box.home.arpa",
    ],
)  # fmt: skip
def test_own_hosts_are_known(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ALL_PROXY", "http://proxy.example.org:3128")
    assert is_own(host)
    assert proxy_to(f"http://{f'[{host}]' if ':' in host else host}:8000/v1") is None


@pytest.mark.parametrize(
    "host", ["api.openai.com", "8.8.8.8", "2606:4700::1111", "172.32.0.1", "local.example.org", "10.example.org"]
)
def test_other_hosts_are_not(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_own(host)
    url = f"http://{f'[{host}]' if ':' in host else host}/v1"
    assert proxy_to(url) is None
    monkeypatch.setenv("HTTP_PROXY", "proxy.example.org:3128")
    monkeypatch.setenv("ALL_PROXY", "http://other.example.org:1")
    proxy = proxy_to(url)
    assert proxy is not None and (proxy.url, proxy.variable) == ("http://proxy.example.org:3128", "HTTP_PROXY")
    monkeypatch.setenv("NO_PROXY", f"[{host}]" if ":" in host else host)
    assert proxy_to(url) is None


def test_a_proxy_that_is_gone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        free = taken.getsockname()[1]
    monkeypatch.setenv("HTTP_PROXY", f"http://127.0.0.1:{free}")
    with pytest.raises(ReasonerError, match=rf"cannot reach http://models.example.org/v1 through the proxy .*{free}"):
        ask("http://models.example.org")


@pytest.mark.parametrize(
    ("header", "seconds"), [(None, 0), ("2", 2), ("soon", 0), ("Wed, 21 Oct 2015 07:28:00 GMT", -1e8), ("", 0)]
)
def test_seconds_of_retry_after(header: str | None, seconds: float) -> None:
    pytest.importorskip("openai")
    from cartier.llm.server import seconds_of

    assert seconds_of(header) == seconds if seconds >= 0 else seconds_of(header) < seconds
