"""Blob stores: the laws over a folder and object storage, and what a bad network, a kill and a wrong place give."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from cartier import testing
from cartier.blob_stores import BlobStore, FolderBlobs, open_store
from cartier.errors import InputError, MissingExtra
from fleet.moto_server import moto_server


def test_laws(opened: Callable[[], BlobStore]) -> None:
    testing.check_blob_store(opened)


def test_laws_hold_behind_a_bad_network() -> None:
    """A tenth of the calls fails, a tenth arrives without a reply, a tenth is slow."""
    pytest.importorskip("moto.server", reason="needs pip install '.[test-fleet]'")
    pytest.importorskip("obstore", reason="needs pip install '.[test-fleet]'")
    with moto_server("--fail", "0.1", "--lose", "0.1", "--slow", "0.02") as place:
        testing.check_blob_store(lambda: open_store(f"{place}/p"), writers=3)


def test_a_write_whose_reply_is_lost_is_no_failure() -> None:
    pytest.importorskip("moto.server", reason="needs pip install '.[test-fleet]'")
    pytest.importorskip("obstore", reason="needs pip install '.[test-fleet]'")
    with moto_server("--lose", "0.5", "--seed", "3") as place:
        store = open_store(place)
        assert all(store.create(f"k{number}", b"mine") for number in range(12))
        assert not any(store.create(f"k{number}", b"yours") for number in range(12))


def test_a_store_that_stays_away_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    bucket = pytest.importorskip("cartier.blob_stores.bucket")
    pytest.importorskip("obstore", reason="needs pip install '.[fleet]'")
    monkeypatch.setattr(bucket, "FIRST_WAIT_S", 0.0)
    for name, value in {"AWS_ENDPOINT_URL": "http://127.0.0.1:1", "AWS_ALLOW_HTTP": "true"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "b")
    with pytest.raises(InputError, match=r"s3://nowhere/a: the store failed"):
        open_store("s3://nowhere").get("a")


def test_http_is_read_and_not_written(tmp_path: Path) -> None:
    pytest.importorskip("obstore", reason="needs pip install '.[fleet]'")
    import functools
    import http.server
    import threading

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None: ...

    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x").write_bytes(b"hello")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(tmp_path)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        from obstore.store import HTTPStore

        from cartier.blob_stores.bucket import BucketBlobs

        url = f"http://127.0.0.1:{server.server_port}"
        store = BucketBlobs(HTTPStore.from_url(url, client_options={"allow_http": True}), url)
        held = store.get("a/x")
        assert held is not None and held.data == b"hello"
        assert store.get("a/none") is None
        with pytest.raises(InputError, match="the store failed"):
            store.create("a/y", b"no")
    finally:
        server.shutdown()


@pytest.mark.parametrize("place", ["ftp://x/y", "nonsense://"])
def test_other_places_are_refused(place: str) -> None:
    with pytest.raises(InputError, match="is no store"):
        open_store(place)


def test_the_extra_is_named_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "obstore.store", None)
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(MissingExtra, match=r"s3://b needs the package 'obstore': pip install .*fleet"):
        open_store("s3://b")


def test_links_in_a_folder_are_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"secret")
    store = FolderBlobs(tmp_path / "store")
    store.put("a", b"x")
    (tmp_path / "store" / "link").symlink_to(tmp_path / "secret")
    assert store.list() == ["a"]
    with pytest.raises(InputError):
        store.get("link")


WRITER = """
import sys
from cartier.blob_stores import FolderBlobs
store, number = FolderBlobs(sys.argv[1]), 0
print("ready", flush=True)
while True:
    number += 1
    data = (b"%08d" % number) * 20_000
    held = store.get("counter")
    store.create("counter", data) if held is None else store.swap("counter", data, held.version)
    store.create(f"made/{number}", data)
"""


def test_a_killed_writer_leaves_whole_blobs(tmp_path: Path) -> None:
    for number in range(6):
        child = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None and child.stdout.readline() == "ready\n"
        time.sleep(0.05 + 0.03 * number)
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        child.stdout.close()
        store = FolderBlobs(tmp_path)
        assert store.list()
        for key in store.list():
            held = store.get(key)
            assert held is not None and len(held.data) == 160_000 and held.data == held.data[:8] * 20_000
    held = FolderBlobs(tmp_path).get("counter")
    assert held is not None and FolderBlobs(tmp_path).swap("counter", b"free", held.version)
