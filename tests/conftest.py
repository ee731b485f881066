"""Every test: one BLAS thread, no key, no network beyond this machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

MISREAD = frozenset((Path(__file__).parent / "data" / "misread.txt").read_text(encoding="utf-8").splitlines())
"""Tests of sentences that the learned parser is known to read wrongly; take a line out when it reads them."""

os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.fixture(autouse=True)
def no_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.nodeid.removeprefix("tests/") in MISREAD:
            item.add_marker(pytest.mark.xfail(reason="the parser reads it wrongly", strict=False))


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """No workers for files named one by one: they would take longer to start than most files to run."""
    return 0 if all(arg.partition("::")[0].endswith(".py") for arg in config.args) else None
