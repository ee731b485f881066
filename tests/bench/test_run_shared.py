"""A bench whose homes are shared among processes or actors: the same rows as in one process, and it goes on."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from test_run import QUERIES, WORLD, run, without_times

from cartier import specs
from cartier.errors import InputError
from cartier_bench.maps import MapSettings
from cartier_bench.paper_run import BenchSettings, ReasonerSpec, share
from cartier_bench.suite import PARTS

SETTINGS = BenchSettings(("north", "east"), ("object_depth", "nlmap", "random"), maps=MapSettings(WORLD))
"""One method that asks once, one that asks twice by a threshold of all homes, and one that draws by the seed."""


@pytest.fixture(autouse=True)
def workers_find_the_world(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    monkeypatch.setenv("RAY_ADDRESS", "local")  # no cluster that another test or program left


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("maps")


@pytest.mark.parametrize("runner", ["local", "ray"])
def test_shared_homes_give_the_rows_of_one_process(runner: str, tmp_path: Path, maps: Path) -> None:
    if runner == "ray":
        pytest.importorskip("ray", reason="needs pip install '.[test-fleet]'")
    spec, reasoner = ReasonerSpec("embedded"), specs.reasoner("embedded")
    run(tmp_path / "alone", SETTINGS, QUERIES, reasoner, maps)
    folder = tmp_path / "shared"
    share(folder, SETTINGS, QUERIES, spec, maps, runner=runner, workers=2)
    assert not (folder / PARTS).exists() and len(without_times(folder)) == len(without_times(tmp_path / "alone"))
    run(folder, SETTINGS, QUERIES, reasoner, maps)
    assert without_times(folder) == without_times(tmp_path / "alone")
    before = (folder / "results.jsonl").read_bytes()
    share(folder, SETTINGS, QUERIES, spec, maps, runner=runner, workers=2)
    assert (folder / "results.jsonl").read_bytes() == before, "nothing is left to ask"


def test_a_home_that_fails_is_one_line(tmp_path: Path, maps: Path) -> None:
    (tmp_path / "replies.jsonl").write_text("")
    spec = ReasonerSpec("replay", path=str(tmp_path / "replies.jsonl"))
    with pytest.raises(InputError) as caught:
        share(tmp_path / "run", SETTINGS, QUERIES, spec, maps, runner="local", workers=1)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="the runner is local or ray"):
        share(tmp_path / "other", SETTINGS, QUERIES, ReasonerSpec("embedded"), maps, runner="dask", workers=1)
    assert not (tmp_path / "other").exists(), "it is said before the work"
