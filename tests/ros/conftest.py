"""The distributions of ROS 2 that are built here."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from rospeers import DISTRIBUTIONS, Ros, missing

HERE = Path(__file__).parent


@pytest.hookimpl(tryfirst=True)  # before those that are not asked for are taken out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent == HERE:
            item.add_marker(pytest.mark.ros)


@pytest.fixture(params=DISTRIBUTIONS)
def ros(request: pytest.FixtureRequest) -> Iterator[Ros]:
    if why := missing(request.param):
        pytest.skip(why)
    here = Ros(request.param)
    yield here
    here.close()
