from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cartier import make
from cartier.cli import app
from cartier.errors import InputError
from cartier.pipeline import map_home

RULE = "avoid room:bathroom hard standing"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    walk = make("worlds", "dollhouse", width=96, height=72).explore("studio", max_frames=120)
    mapped = map_home(walk, make("detectors", "ground_truth", truth=walk.truth, source="dollhouse"))
    folder = tmp_path_factory.mktemp("homes") / "home"
    mapped.save(folder)
    return folder


def run(*given: str) -> str:
    result = CliRunner().invoke(app, [*given], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_rules_are_added_listed_and_lifted(home: Path, tmp_path: Path) -> None:
    assert "no rules hold" in run("rules", str(home))
    assert "stay out of the bathroom" in run("rules", str(home), "--add", RULE)
    (row,) = json.loads(run("rules", str(home), "--json"))["rules"]
    assert row["rule"] == RULE and row["holds"] == "now" and row["id"] in run("rules", str(home))
    picture = tmp_path / "asked.png"
    asked = run("ask", str(home), "take me to the toilet", "--reasoner", "embedded", "--plot", str(picture))
    assert asked.startswith("clarify: ") and "Shall I go all the same?" in asked and picture.stat().st_size > 10_000
    assert "no longer stay out of the bathroom" in run("rules", str(home), "--lift", row["id"])
    assert "no rules hold" in run("rules", str(home))
    assert "undone: no longer" in run("undo", str(home)) and RULE in run("rules", str(home))
    run("undo", str(home))


def test_an_unknown_rule_is_one_line(home: Path) -> None:
    with pytest.raises(InputError, match="no rule 'x' holds"):
        run("rules", str(home), "--lift", "x")
    with pytest.raises(InputError, match="a route rule is one of"):
        run("rules", str(home), "--add", "fly room:bathroom")
