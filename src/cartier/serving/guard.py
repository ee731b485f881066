"""Access control of the server: host, origin, token, sizes and rates, checked before the app gets the request.

``docs/serving.md`` lists the checks, which follow OWASP's Application Security Verification Standard.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import json
import os
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any

import anyio

from cartier.errors import InputError
from cartier.io.files import read_text
from cartier.serving.access import ACCESS, Access

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

TOKEN_VARIABLE = "CARTIER_TOKEN"
MIN_TOKEN_CHARS, MAX_TOKENS_CHARS = 20, 2**20
MAX_BODY, MAX_TARGET = 64 * 1024, 4096  # bytes of a request's body, and of its path with the query
BODY_S, SEND_S = 10.0, 30.0  # for a body to arrive, and for a part of an answer to be sent
GRACE_S = 1.0  # for requests in flight when the server ends
ENDS = "the server is ending: ask again when it runs"
MAX_IN_FLIGHT = 256
RATE, BURST = 50.0, 200.0  # requests of one token, or of one other machine without, per second, and at once
WRONG_TOKENS, WRONG_S = 20, 60.0  # wrong tokens from one address within this time
MAX_ADDRESSES = 10_000
HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), geolocation=(), payment=(), usb=(), microphone=(self)"),
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        b"base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
)


def is_loopback(host: str) -> bool:
    """Whether an address is a loopback address, which other machines cannot reach."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def host_names(host: str, port: int, more: Iterable[str] = ()) -> frozenset[str]:
    """The Host headers that a server accepts; without the port if it is the default of the scheme."""
    names = {"localhost", "127.0.0.1", "[::1]"} if is_loopback(host) else set[str]()
    if host not in ("0.0.0.0", "::"):
        names.add(f"[{host}]" if ":" in host else host)
    names.update(more)
    if not names:
        raise InputError(f"a server that listens on {host} needs the names it is called by: --name kitchen-robot.local")
    ends = (f":{port}", "") if port in (80, 443) else (f":{port}",)
    return frozenset(f"{name.lower()}{end}" for name in names for end in ends)


def read_tokens(host: str, file: Path | None) -> Mapping[bytes, Access] | None:
    """What each token may see, by the token's digest; None if there is none and the server is on loopback.

    A line of the file is a token, and the names of the homes that it may see, if these are not all. The token of the
    environment may see all. Raises InputError if there is none, one is too short to be safe, or others may read the
    file.
    """
    rows = None
    if file is not None:
        rows = [line.split() for line in read_text(file, MAX_TOKENS_CHARS).splitlines() if line.strip()] or [[""]]
        if os.name == "posix" and file.stat().st_mode & 0o077:
            raise InputError(f"{file} can be read by others: chmod 600 {file}")
    elif TOKEN_VARIABLE in os.environ:
        rows = [[os.environ[TOKEN_VARIABLE].strip()]]
    if rows is None:
        if is_loopback(host):
            return None
        raise InputError(
            f"{host} can be reached from other machines: give a token in a file (--token-file) or in {TOKEN_VARIABLE}, "
            'for example from: python -c "import secrets; print(secrets.token_urlsafe(32))"'
        )
    found = dict[bytes, Access]()
    for token, *homes in rows:
        if len(token) < MIN_TOKEN_CHARS or not token.isascii() or not token.isprintable() or " " in token:
            raise InputError(f"a token needs {MIN_TOKEN_CHARS} or more printable ASCII characters without blanks")
        digest = digest_of(token)
        if digest in found:
            raise InputError(f"{file} has a token twice: put all of its homes on one line")
        found[digest] = Access(digest.hex()[:16], tuple(homes) or Access.homes)
    return found


def digest_of(token: str) -> bytes:
    """What is kept of a token, and compared."""
    return hashlib.sha256(token.encode("latin-1")).digest()


class Guard:
    """ASGI middleware. ``hosts`` are the accepted Host headers, with the port; ``tokens`` what ``read_tokens`` gives.

    ``open_paths`` (the page itself, which holds no data) need no token.
    """

    def __init__(
        self,
        app: App,
        hosts: Iterable[str],
        tokens: Mapping[bytes, Access] | None = None,
        *,
        tls: bool = False,
        open_paths: Iterable[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._app, self._hosts, self._scheme = app, frozenset(h.lower() for h in hosts), "https" if tls else "http"
        self._tokens = tokens
        self._open, self._clock, self._in_flight = frozenset(open_paths), clock, 0
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # by token or address: how many are left
        self._wrong: OrderedDict[str, list[float]] = OrderedDict()  # by address: times of wrong tokens
        self._endings: set[asyncio.Future[None]] = set()  # of the requests in flight
        self._headers = HEADERS + (((b"strict-transport-security", b"max-age=31536000"),) if tls else ())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # no websockets
            return
        begun: list[Message] = []

        async def safe_send(message: Message) -> None:
            if message["type"] == "http.response.start":
                kept = [(k, v) for k, v in message.get("headers", ()) if not k.lower().startswith(b"access-control-")]
                cache = [] if any(k.lower() == b"cache-control" for k, _ in kept) else [(b"cache-control", b"no-store")]
                message = {**message, "headers": [*kept, *cache, *self._headers]}
                begun.append(message)
            with anyio.fail_after(SEND_S):  # a client that does not read keeps no place
                await send(message)

        refused = self._refusal(scope)
        if not isinstance(refused, tuple):
            ACCESS.set(refused)
            refused = None
        if refused is None and self._in_flight >= MAX_IN_FLIGHT:
            refused = (503, "too many requests at once: try again in a second")
        if refused is not None:
            await _answer(safe_send, *refused)
            return
        self._in_flight += 1
        try:
            if not await self._in_time(self._served(scope, receive, safe_send)):
                await _end(safe_send, begun)
        except TimeoutError:
            if not begun:
                await _answer(safe_send, 503, "the answer took too long: try again")
        finally:
            self._in_flight -= 1

    async def _served(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = await _body(receive)
        if isinstance(body, tuple):
            await _answer(send, *body)
        else:
            await self._app(scope, _replayed(body, receive), send)

    def end(self) -> None:
        """End the requests in flight: each has ``GRACE_S`` to finish, and then its client is told so. In the loop."""
        for ending in self._endings:
            if not ending.done():
                ending.set_result(None)

    async def _in_time(self, work: Coroutine[Any, Any, None]) -> bool:
        """Do the work of a request; False if the server ended before it was done."""
        task, ending = asyncio.ensure_future(work), asyncio.get_running_loop().create_future()
        self._endings.add(ending)
        try:
            await asyncio.wait({task, ending}, return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                await asyncio.wait({task}, timeout=GRACE_S)
            if task.done():
                task.result()
            return task.done()
        finally:
            self._endings.discard(ending)
            task.cancel()

    def _refusal(self, scope: Scope) -> tuple[int, str] | Access | None:
        """Status and message if the request is refused, else what it may see; None where it shows no token."""
        headers: dict[bytes, list[str]] = {}
        for key, value in scope["headers"]:
            headers.setdefault(key.lower(), []).append(value.decode("latin-1"))
        host, origin = headers.get(b"host", [""]), headers.get(b"origin", [])
        address = (scope.get("client") or ("unknown", 0))[0]
        if len(host) != 1 or host[0].lower() not in self._hosts:
            return 421, "this server has no such name (Host)"
        if any(o.lower() != f"{self._scheme}://{host[0].lower()}" for o in origin):
            return 403, "requests from other sites are refused (Origin)"
        site = headers.get(b"sec-fetch-site", ["none"])[0]
        if site not in ("none", "same-origin") and scope["path"] not in self._open:
            return 403, "requests from other sites are refused (Sec-Fetch-Site)"
        if len(scope.get("raw_path") or b"") + len(scope.get("query_string") or b"") > MAX_TARGET:
            return 414, f"the address is longer than {MAX_TARGET} bytes"
        if scope["method"] not in ("GET", "HEAD", "POST", "DELETE"):
            return 405, f"the method {scope['method']} is not allowed"
        if b"content-encoding" in headers:
            return 415, "compressed bodies are not accepted"
        length = headers.get(b"content-length", ["0"])[0]
        if not length.isdecimal() or int(length[:20]) > MAX_BODY:
            return 413, f"a body has {MAX_BODY} bytes at most"
        kind = headers.get(b"content-type", [""])[0].partition(";")[0].strip().lower()
        if scope["method"] == "POST" and kind != "application/json":
            return 415, "a body must be application/json"
        given = headers.get(b"authorization", [])
        access = self._access(given)
        if not is_loopback(address) and not self._in_rate(access.who if access else address):
            return 429, "too many requests from this address: wait a second"
        if access is not None:  # whatever others tried from the same address, which may be a proxy's
            return access
        if self._tokens is not None and scope["path"] not in self._open:
            return self._without_token(address, bool(given))
        return None

    def _access(self, given: list[str]) -> Access | None:
        """What a right token may see; None for any other."""
        kind, _, token = given[0].partition(" ") if len(given) == 1 else ("", "", "")
        digest = digest_of(token.strip())
        access = [held for known, held in (self._tokens or {}).items() if hmac.compare_digest(digest, known)]
        return access[0] if kind.lower() == "bearer" and access else None

    def _without_token(self, address: str, wrong_one: bool) -> tuple[int, str]:
        now = self._clock()
        wrong = [t for t in self._wrong.get(address, ()) if now - t < WRONG_S]
        if len(wrong) >= WRONG_TOKENS:
            return 429, "too many wrong tokens from this address: wait a minute"
        if wrong_one:
            self._wrong[address] = [*wrong, now]
            _trim(self._wrong)
        return 401, "a token is needed: Authorization: Bearer TOKEN"

    def _in_rate(self, who: str) -> bool:
        now = self._clock()
        left, before = self._buckets.pop(who, (BURST, now))
        left = min(BURST, left + (now - before) * RATE)
        self._buckets[who] = (max(left - 1, 0.0), now)
        _trim(self._buckets)
        return left >= 1


def _trim(addresses: OrderedDict[str, Any]) -> None:
    while len(addresses) > MAX_ADDRESSES:
        addresses.popitem(last=False)


async def _body(receive: Receive) -> bytes | tuple[int, str]:
    """The whole body, or status and message if it is too long or too slow."""
    parts, size = [], 0
    with anyio.move_on_after(BODY_S):
        while True:
            message = await receive()
            if message["type"] == "http.disconnect":
                return 400, "the request ended early"
            parts.append(message.get("body", b""))
            size += len(parts[-1])
            if size > MAX_BODY:
                return 413, f"a body has {MAX_BODY} bytes at most"
            if not message.get("more_body", False):
                return b"".join(parts)
    return 408, f"the body did not arrive within {BODY_S:.0f} s"


def _replayed(body: bytes, receive: Receive) -> Receive:
    sent = False

    async def again() -> Message:
        nonlocal sent
        if sent:
            return await receive()
        sent = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


async def _end(send: Send, begun: Sequence[Message]) -> None:
    """Tell a client that the server ends: an answer of its own, or the last event of a stream that has begun."""
    if not begun:
        await _answer(send, 503, ENDS)
    elif any(key == b"content-type" and kind.startswith(b"text/event-stream") for key, kind in begun[0]["headers"]):
        event = f"event: fault\ndata: {json.dumps({'error': ENDS})}\n\n"
        await send({"type": "http.response.body", "body": event.encode(), "more_body": False})


async def _answer(send: Send, status: int, line: str) -> None:
    body = json.dumps({"error": line}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    headers += [(b"connection", b"close")] if status in (408, 413) else []
    headers += [(b"www-authenticate", b"Bearer")] if status == 401 else []
    headers += [(b"retry-after", b"1")] if status in (429, 503) else []
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
