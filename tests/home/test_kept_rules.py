from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from cartier import Conversation, Home, InputError, make
from cartier.pipeline import ask, map_home
from cartier.reasoners import embedded
from cartier.types import Answer
from cartier.types.route_rules import RouteRule
from route_talk import reads


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    walk = make("worlds", "dollhouse", width=96, height=72).explore("studio", max_frames=120)
    home = map_home(walk, make("detectors", "ground_truth", truth=walk.truth, source="dollhouse"))
    folder = tmp_path_factory.mktemp("homes") / "home"
    home.save(folder)
    return folder


@pytest.fixture
def folder(mapped: Path) -> Path:
    (mapped / "corrections.jsonl").unlink(missing_ok=True)
    return mapped


def kept(folder: Path) -> list[str]:
    return [rule.text for rule in Home.load(folder).rules]


def said(talk: Conversation, words: str) -> Answer:
    return talk.say(words)


def way(answer: Answer) -> Sequence[str]:
    assert answer.goal is not None and answer.goal.route is not None
    return [rule.text for rule in answer.goal.route.rules]


RULE = "avoid room:bathroom hard standing"


def test_a_rule_is_kept_listed_and_taken_back(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    never, again = reads(monkeypatch, rule="never through the [bathroom:va]", lift="use the [bathroom:va] again")
    talk = Conversation(Home.load(folder), embedded.make())
    assert said(talk, never).selection.text == "Noted: stay out of the bathroom, until you say otherwise."
    (rule,) = Home.load(folder).rules
    assert (rule.text, rule.said) == (RULE, never) and rule.id and rule.made
    assert said(talk, never).selection.status == "answered" and kept(folder) == [RULE], "it is kept once"
    assert said(talk, again).selection.text == "Noted: no longer stay out of the bathroom." and kept(folder) == []
    assert said(talk, "undo that").selection.status == "answered" and kept(folder) == [RULE]


def test_a_rule_stands_in_the_way_and_yes_drives(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    never, toilet = reads(monkeypatch, rule="never through the [bathroom:va]", go="to the [toilet:t]")
    talk = Conversation(Home.load(folder), embedded.make())
    said(talk, never)
    asked = said(talk, toilet)
    assert asked.selection.status == "clarify" and asked.goal is None and asked.place is not None
    assert never in str(asked.selection.question) and str(asked.selection.question).endswith("Shall I go all the same?")
    assert said(talk, "no").goal is None
    said(talk, toilet)
    driven = said(talk, "yes, please")
    assert driven.selection.object == "toilet" and driven.goal is not None and driven.goal.route is not None
    assert [rule.text for rule in driven.goal.route.breaks] == [RULE]
    assert kept(folder) == [RULE], "that was for once"


def test_a_rule_for_one_drive_is_not_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (fridge,) = reads(monkeypatch, go="to the [fridge:t], but rather not through the [bathroom:va]")
    talk = Conversation(Home.load(folder), embedded.make())
    answer = said(talk, fridge)
    assert way(answer) == ["avoid room:bathroom soft drive"] and kept(folder) == []
    assert "understood: stay out of the bathroom if that is no great detour, for this drive" in answer.notes
    values = answer.to_dict()
    assert values["rules"] == ["avoid room:bathroom soft drive"] and values["goal"]["route"]["directions"]


def test_an_unknown_object_of_a_rule_is_asked_about(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (fridge,) = reads(monkeypatch, go="to the [fridge:t], but not over the [trampoline:va]")
    asked = said(Conversation(Home.load(folder), embedded.make()), fridge)
    assert asked.selection.status == "clarify" and asked.goal is None
    assert "I know of no trampoline here" in str(asked.selection.question)


def test_rules_hold_at_their_hours(folder: Path) -> None:
    home = Home.load(folder)
    home, told = home.correct("rule", "avoid room:bathroom hard daily:22:00-06:00", name="not at night")
    assert told == "stay out of the bathroom, daily from 22:00 to 06:00"
    night = datetime(2026, 11, 25, 23, 0).astimezone()
    assert ask(home, "take me to the toilet", now=night).selection.status == "clarify"
    day = ask(home, "take me to the toilet", now=night + timedelta(hours=12))
    assert day.goal is not None and day.goal.route is None


def test_expired_rules_are_ignored(folder: Path) -> None:
    home = Home.load(folder).correct("rule", "avoid room:bathroom hard until:tomorrow")[0]
    later = datetime.now().astimezone() + timedelta(days=3)
    assert ask(home, "take me to the toilet", now=later).goal is not None


@pytest.mark.parametrize(
    ("rule", "why"),
    [
        ("avoid room:bathroom hard drive", "not kept"),
        ("avoid room:cellar hard standing", "no room is called"),
        ("avoid object:9999 hard standing", "nothing in this home"),
        ("avoid none:trampoline hard standing", "does not have"),
        ("fly", "a route rule is one of"),
    ],
)
def test_unfit_rules_are_refused(folder: Path, rule: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        Home.load(folder).correct("rule", rule)
    assert kept(folder) == []


def test_a_rule_follows_its_room_to_a_new_name(folder: Path) -> None:
    home = Home.load(folder).correct("rule", RULE)[0]
    home.correct("name", "bathroom", name="Ann's room")
    assert kept(folder) == ["avoid room:Ann's room hard standing"]


def test_a_damaged_rule_is_left_out_with_a_note(folder: Path) -> None:
    Home.load(folder).correct("rule", RULE)
    log = folder / "corrections.jsonl"
    row = json.loads(log.read_text())
    log.write_text(log.read_text() + json.dumps(row | {"id": "x", "rule": "avoid lava"}) + "\n")
    home = Home.load(folder)
    assert [rule.text for rule in home.rules] == [RULE]
    assert any("line 2 is damaged" in note for note in home.to_dict()["notes"])


def test_an_unsaved_home_remembers_for_the_conversation(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    never, toilet, again = reads(
        monkeypatch, rule="never through the [bathroom:va]", go="to the [toilet:t]", lift="use the [bathroom:va] again"
    )
    talk = Conversation(replace(Home.load(folder), store=None), embedded.make())
    assert said(talk, never).selection.text.startswith("Understood: ")
    assert said(talk, toilet).selection.status == "clarify"
    said(talk, again)
    assert talk.rules == () and said(talk, toilet).goal is not None


def test_rules_of_a_caller_hold_for_one_drive(folder: Path) -> None:
    answer = ask(
        Home.load(folder), "take me to the toilet", rules=[RouteRule.parse("slow-near room:bathroom hard drive")]
    )
    assert way(answer) == ["slow-near room:bathroom hard drive"]
