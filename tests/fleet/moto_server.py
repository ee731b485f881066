"""An S3 server of moto in a process of its own, which can fail, be slow, and lose replies, as real ones do.

    python tests/fleet/moto_server.py PORT [--fail 0.1] [--lose 0.05] [--slow 0.1] [--seed 0]

``fail``: the share of requests answered 500 or 503 and not served; ``lose``: served, and then answered 500; ``slow``:
served after a pause.
"""

from __future__ import annotations

import argparse
import os
import random
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

BUCKET = "fleet"
WSGI = Callable[[dict[str, Any], Callable[..., Any]], Iterable[bytes]]


def faulty(app: WSGI, fail: float, lose: float, slow: float, seed: int) -> WSGI:
    """The application behind a bad network."""
    dice, writing = random.Random(seed), threading.Lock()

    def served(environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        if environ["REQUEST_METHOD"] != "PUT":
            return app(environ, start)
        with writing:  # moto looks at the condition and then writes; a real store does both at once
            return list(app(environ, start))

    def answer(environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        if "/moto-api" in environ["PATH_INFO"]:
            return app(environ, start)
        drawn = dice.random()
        if drawn < fail:
            environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
            start(dice.choice(["500 Internal Server Error", "503 Slow Down"]), [("Content-Length", "0")])
            return [b""]
        if drawn < fail + slow:
            time.sleep(dice.uniform(0.2, 1.0))
        elif drawn < fail + slow + lose:
            list(served(environ, lambda *_: None))
            start("500 Internal Server Error", [("Content-Length", "0")])
            return [b""]
        return served(environ, start)

    return answer


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("port", type=int)
    for option in ("--fail", "--lose", "--slow"):
        parser.add_argument(option, type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    import logging

    import boto3
    from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import WSGIRequestHandler, make_server

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    WSGIRequestHandler.protocol_version = "HTTP/1.1"  # connections stay open
    app = DomainDispatcherApplication(create_backend_app)
    server = make_server(
        "127.0.0.1", given.port, faulty(app, given.fail, given.lose, given.slow, given.seed), threaded=True
    )
    threading.Thread(target=server.serve_forever, daemon=True).start()
    client = boto3.client("s3", endpoint_url=f"http://127.0.0.1:{given.port}", **CREDENTIALS)
    client.create_bucket(Bucket=BUCKET)
    print("ready", flush=True)
    sys.stdin.read()  # until whoever started it ends


CREDENTIALS = {"region_name": "us-east-1", "aws_access_key_id": "a", "aws_secret_access_key": "b"}


@contextmanager
def moto_server(*options: str) -> Iterator[str]:
    """The place of a bucket on a server of its own, with the environment that leads to it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    child = subprocess.Popen(
        [sys.executable, __file__, str(port), *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    before = dict(os.environ)
    os.environ |= {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_ALLOW_HTTP": "true", "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b",
    }  # fmt: skip
    try:
        assert child.stdout is not None and child.stdout.readline() == "ready\n", "moto did not start"
        yield f"s3://{BUCKET}"
    finally:
        child.kill()
        child.wait()
        for stream in (child.stdin, child.stdout):
            if stream is not None:
                stream.close()
        os.environ.clear()
        os.environ.update(before)


def empty(place: str) -> None:
    """Forget everything that the server holds, and make the bucket again."""
    import boto3

    url = os.environ["AWS_ENDPOINT_URL"]
    urllib.request.urlopen(urllib.request.Request(f"{url}/moto-api/reset", method="POST"), timeout=10).close()
    boto3.client("s3", endpoint_url=url, **CREDENTIALS).create_bucket(Bucket=place.removeprefix("s3://"))


if __name__ == "__main__":
    main()
