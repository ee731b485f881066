"""The commands: map --append --align, and join, which say in one line what they refuse and write nothing then."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from another_day import MOVED, OTHER_THINGS, ROOM_THINGS, rounds
from cartier.cli import app
from cartier.errors import CartierError
from cartier.home import Home
from cartier.mapping.poses.motions import Reposed
from cartier.recordings.folder import save
from synthetic import SMALL

TRUTH = ["--detector", "ground_truth"]


def cli(*words: object) -> str:
    """What a command prints. Raises what it raises."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(done.exception, CartierError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def days(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two walks through one home, the second in a pose frame of its own, and one through another home."""
    folder = tmp_path_factory.mktemp("days")
    one, two, elsewhere = (
        replace(rounds(things, phase, radius_m), camera=SMALL, name="room")
        for things, phase, radius_m in ((ROOM_THINGS, 0.0, 1.0), (ROOM_THINGS, 0.1, 0.9), (OTHER_THINGS, 0.0, 1.0))
    )
    save(one, folder / "one")
    save(Reposed(two, lambda number, pose: MOVED @ pose), folder / "two")
    save(replace(elsewhere, poses=elsewhere.poses[:8], name="elsewhere"), folder / "elsewhere")
    for name in ("one", "two", "elsewhere"):
        cli("map", folder / name, "-o", folder / f"home_{name}", *TRUTH, "--keep-poses")
    return folder


def labels(home: Home) -> set[str]:
    return {obj.label for obj in home.objects if obj.confirmed}


def test_another_day_is_appended_where_it_belongs(days: Path) -> None:
    shutil.copytree(days / "home_one", days / "grown")
    cli("map", days / "two", "-o", days / "grown", *TRUTH, "--append", "--align")
    grown, one, two = (Home.load(days / name) for name in ("grown", "home_one", "home_two"))
    assert labels(grown) >= labels(one) | labels(two) - {""}
    assert len(grown.objects) < len(one.objects) + 0.5 * len(two.objects)
    assert grown.grid is not None and one.grid is not None
    np.testing.assert_allclose(grown.grid.cells.shape, one.grid.cells.shape, atol=40)


def test_two_homes_are_joined(days: Path) -> None:
    told = cli("join", days / "home_one", days / "home_two", "-o", days / "both", "--recording", days / "two", *TRUTH)
    both, one = Home.load(days / "both"), Home.load(days / "home_one")
    assert "of both homes" in told and len(both.settings["recordings"]) == 2
    assert {obj.id for obj in one.objects if obj.confirmed} & {obj.id for obj in both.objects}
    assert any("was aligned" in note for note in both.notes)


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (("home_one", "home_elsewhere", "-o", "no", "--recording", "elsewhere"), "same detector"),
        (("home_one", "home_two", "-o", "no"), "--recording"),
        (("home_one", "home_two", "-o", "no", "--recording", "one"), "was not mapped from"),
        (("home_one", "home_two", "-o", "home_one", "--recording", "two"), "another folder"),
    ],
)
def test_what_does_not_fit_is_refused(words: tuple[str, ...], refusal: str, days: Path) -> None:
    before = (days / "home_one" / "home.json").read_bytes()
    given = [word if word.startswith("-") else days / word for word in words]
    with pytest.raises(CartierError, match=refusal) as refused:
        cli("join", *given, *TRUTH)
    assert "\n" not in str(refused.value)
    assert not (days / "no" / "home.json").exists()
    assert (days / "home_one" / "home.json").read_bytes() == before


def test_aligning_needs_a_home(days: Path) -> None:
    with pytest.raises(CartierError, match="--append"):
        cli("map", days / "two", "-o", days / "new", *TRUTH, "--align")
