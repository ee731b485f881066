"""Trips: how many files of cartier a reader has to open who follows one request, one choice or one recording."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import cartier
from cartier import plugins
from cartier.home import Home

SOURCE = str(Path(cartier.__file__).parents[1])
NEED = "I want to sit down"
MOST = {"ask": 44, "select": 32, "map_home": 49}


def entered(function: Callable[..., Any], *args: Any) -> set[str]:
    """The files of cartier in which a call runs a function; run it once before, so that nothing is loaded meanwhile."""
    files = set[str]()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(f"{SOURCE}/cartier/"):
            name = frame.f_code.co_filename.removeprefix(f"{SOURCE}/")
            files.add("cartier/types" if name.startswith("cartier/types/") else name)  # one dictionary of values

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        function(*args)
    finally:
        sys.setprofile(before)
    return files


@pytest.fixture(scope="module")
def recording() -> Any:
    return plugins.make("worlds", "dollhouse", width=160, height=120).explore("studio", max_frames=24)


@pytest.fixture(scope="module")
def detector(recording: Any) -> Any:
    return plugins.make("detectors", "ground_truth", truth=recording.truth, source="dollhouse")


@pytest.fixture(scope="module")
def home(recording: Any, detector: Any) -> Home:
    return cartier.map_home(recording, detector)


def test_map_home_enters_few_files(home: Home, recording: Any, detector: Any) -> None:
    files = entered(cartier.map_home, recording, detector)
    assert len(files) <= MOST["map_home"], sorted(files)


def test_ask_enters_few_files(home: Home) -> None:
    cartier.ask(home, NEED)
    files = entered(cartier.ask, home, NEED)
    assert len(files) <= MOST["ask"], sorted(files)


def test_select_enters_few_files(home: Home) -> None:
    select = plugins.make("reasoners", "embedded").select
    select(NEED, home.inventory())
    files = entered(select, NEED, home.inventory())
    assert len(files) <= MOST["select"], sorted(files)
