"""Places of stores for the tests: a folder, obstore in memory, and S3 by moto's server."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cartier.blob_stores import BlobStore, open_store
from fleet.moto_server import moto_server

PREFIX = itertools.count()


@pytest.fixture(scope="session")
def s3() -> Iterator[str]:
    pytest.importorskip("moto.server", reason="needs pip install '.[test-fleet]'")
    pytest.importorskip("obstore", reason="needs pip install '.[test-fleet]'")
    with moto_server() as place:
        yield place


@pytest.fixture(params=["folder", "memory", "s3"])
def opened(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], BlobStore]:
    """Opens an empty store, each time as another client of it."""
    if request.param == "folder":
        return lambda: open_store(str(tmp_path / "store"))
    if request.param == "memory":
        pytest.importorskip("obstore", reason="needs pip install '.[fleet]'")
        from obstore.store import MemoryStore

        from cartier.blob_stores.bucket import BucketBlobs

        memory = MemoryStore()
        return lambda: BucketBlobs(memory, "memory")
    place = f"{request.getfixturevalue('s3')}/{next(PREFIX)}"
    return lambda: open_store(place)


@pytest.fixture(params=["folder", "s3"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty store that other processes can open, too."""
    if request.param == "folder":
        return str(tmp_path / "store")
    return f"{request.getfixturevalue('s3')}/{next(PREFIX)}"
