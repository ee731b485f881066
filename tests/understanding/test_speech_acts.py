"""No goal leaves that nobody asked for. The sentences are in nothing_asked.py; how they came about is said there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from held_out import HELD_OUT
from nothing_asked import ASKED, FRESH_ASKED, FRESH_TOLD, HOME, LATER_ASKED, LATER_TOLD, TOLD

from cartier.reasoners import embedded
from cartier.types import Inventory, Selection
from cartier_bench.queries import load_queries

REASONER = embedded.make()
AT_HOME = Inventory.of(HOME)
REQUESTS = Path(__file__).parents[2] / "tools" / "requests"


def answers(sentences: list[str]) -> list[Selection]:
    return [REASONER.select(sentence, AT_HOME) for sentence in sentences]


def refused(chosen: Selection) -> bool:
    return chosen.status == "answered" and chosen.reason.startswith("understood: ")


def asks(text: str) -> bool:
    """Whether the words are taken to ask for something."""
    return not refused(REASONER.select(text, AT_HOME))


@pytest.mark.parametrize(
    "words",
    [
        "Don't go to the fridge",
        "Do not bring me the cup",
        "Stay away from the stove",
        "Never ever touch the vase, it's from my grandmother.",
        "dont go to teh fridge",
        "don't bring me the cup or the bowl",
        "I hate that chair",
        "the sofa is ugly",
        "nice weather today",
        "thank you",
        "you are doing a great job",
        "I don't need the towel.",
    ],
)
def test_what_asks_for_nothing_is_understood_and_gets_no_goal(words: str) -> None:
    chosen = REASONER.select(words, AT_HOME)
    assert (chosen.status, chosen.object, chosen.question) == ("answered", None, None) and chosen.text
    assert REASONER.propose(words) == []


def test_what_is_only_told_about_gets_no_goal_and_an_offer_of_it_can_be_answered() -> None:
    story = "This mug was a gift from my aunt."
    chosen = REASONER.select(story, AT_HOME)
    assert (chosen.status, chosen.object) == ("answered", None)
    dialogue = [(story, "Shall I go to the mug?")]
    assert REASONER.select("yes please", AT_HOME, dialogue).object == "mug"
    for no in ("no", "don't go to the mug", "no, not the mug"):
        assert REASONER.select(no, AT_HOME, dialogue).object is None
    assert REASONER.select("no, my feet hurt, I need to sit", AT_HOME, dialogue).object in (
        "armchair",
        "chair",
        "couch",
        "stool",
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("don't bring me the cup, bring me the glass", "glass"),
        ("dont bring the cup bring the glass", "glass"),  # as speech recognition writes it
        ("I don't want to stand any more", "armchair|chair|couch|stool"),
        ("don't forget the coffee", "coffee machine|mug"),
        ("why don't you go to the kitchen table?", "dining table"),
        ("I can't find my phone", "cell phone"),
        ("my feet hurt", "armchair|chair|couch|slippers|stool"),
        ("it's freezing in here", "heater|blanket"),
        ("I'm thirsty, but don't bring me the cup", "glass|mug|fridge|wine glass|sink|teapot"),
    ],
)
def test_a_need_is_served_whatever_else_is_forbidden(words: str, expected: str) -> None:
    assert REASONER.select(words, AT_HOME).object in expected.split("|")


def test_a_correction_stays_a_correction() -> None:
    served = [("I'm so thirsty", "mug")]
    assert REASONER.select("not the mug, it's dirty", AT_HOME, served).object not in ("mug", None)
    either = [("I need to cut this string", "Do you mean the knife or the scissors?")]
    for words in ("not the knife, it's dirty", "I don't want the knife", "don't bring the knife"):
        assert REASONER.select(words, AT_HOME, either).object == "scissors"


@pytest.mark.parametrize(
    ("sentences", "most_goals"),
    [
        (TOLD[::2], 0.06),
        pytest.param(TOLD[1::2], 0.05, marks=pytest.mark.slow),
        (LATER_TOLD, 0.1),
        (FRESH_TOLD, 0.06),
    ],
    ids=["even", "odd", "later", "fresh"],
)
def test_of_all_that_asks_for_nothing_few_get_a_goal(sentences: list[str], most_goals: float) -> None:
    """What was measured; where all words are served, 0.78, 0.84, 0.88 and 0.82 of them get one."""
    goals = [s for s, c in zip(sentences, answers(sentences), strict=True) if c.object is not None]
    assert len(goals) <= most_goals * len(sentences), goals


@pytest.mark.parametrize(
    ("sentences", "most_refused", "most_asked_back"),
    [pytest.param(ASKED, 16, 0.04, marks=pytest.mark.slow), (LATER_ASKED, 16, 0.07), (FRESH_ASKED, 12, 0.14)],
    ids=["both halves", "later", "fresh"],
)
def test_what_only_sounds_like_it_is_not_refused(
    sentences: list[str], most_refused: int, most_asked_back: float
) -> None:
    chosen = answers(sentences)
    assert sum(map(refused, chosen)) <= most_refused
    asked_back = [c for c in chosen if (c.question or "").startswith("Shall I go")]
    assert len(asked_back) <= most_asked_back * len(sentences), asked_back


@pytest.mark.parametrize("step", [5, pytest.param(1, marks=pytest.mark.slow)])
def test_no_request_of_the_bench_or_of_the_held_out_ones_is_refused(step: int) -> None:
    texts = [query.text for query in (*load_queries("paper"), *load_queries("extended")[::6])]
    texts += [text for _, _, text, expected in HELD_OUT if expected]
    assert [text for text in texts[::step] if not asks(text)] == []


@pytest.mark.slow
@pytest.mark.no_cover  # too many rounds to trace each line
def test_of_hundreds_of_requests_hardly_any_is_refused() -> None:
    """Every ninetieth; of every tenth 11 are refused, which is 1.0 %."""
    files = sorted(REQUESTS.glob("*.jsonl"))  # which are every ninetieth must not depend on the file system
    rows = [json.loads(line) for file in files for line in file.read_text("utf-8").splitlines()]
    texts = [row["text"] for row in rows if row["kind"] != "nothing"][::90]
    lost = [text for text in texts if not asks(text)]
    assert len(texts) > 110 and len(lost) <= 0.02 * len(texts), lost
