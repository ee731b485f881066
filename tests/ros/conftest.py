"""The distributions of ROS 2 that are built here."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from rospeers import DISTRIBUTIONS, Ros, missing


@pytest.fixture(params=DISTRIBUTIONS)
def ros(request: pytest.FixtureRequest) -> Iterator[Ros]:
    if why := missing(request.param):
        pytest.skip(why)
    here = Ros(request.param)
    yield here
    here.close()
