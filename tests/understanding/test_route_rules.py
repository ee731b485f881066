"""Rules from marked words: what a parser that reads perfectly would hand over."""

from __future__ import annotations

import pytest

from cartier.spatial.expressions import ParsedUtterance
from cartier.spatial.query import Scene
from cartier.types import Inventory
from cartier.types.route_rules import RouteRule
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.dialogue_state import DialogueState
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.parser import parser
from cartier.understanding.route_rules import Driving, agrees, asks_of_rules, driving, ended_by, says_how, told
from cartier.understanding.rule_scope import scope_of
from cartier.understanding.utterance import listen
from route_talk import clauses_of, flat_inventory

HOME = flat_inventory()
CASES = [
    ("go", "to the [sofa:t], but not over the [carpet:va]", "avoid floor:carpet hard drive"),
    ("go", "to the [sofa:t], rather not over the [rug:va]", "avoid floor:rug soft drive"),
    ("go", "to the [sofa:t], keep well clear of the [vase:vk] [on:on] the [table:l]", "keep-away object:4 hard drive"),
    ("go", "to the [sofa:t], and slowly near the [chairs:vs]", "slow-near object:2,3 hard drive"),
    ("go", "past the [red:c] [chair:vv] to the [sofa:t]", "via object:3 hard drive"),
    ("go", "to the [sofa:t], take the [parquet:vp] if you can", "prefer floor:planks soft drive"),
    ("go", "to the [sofa:t], and you must keep to the [tiles:vp]", "prefer floor:tiles hard drive"),
    ("go", "the [sofa:t], on the [wooden floor:vp]", "prefer floor:planks soft drive"),
    ("go", "to the [sofa:t], only through the [hall:vo]", "only-through room:hall hard drive"),
    ("go", "the [sofa:t], [short way:vh], I'm in a hurry", "shortest hard drive"),
    ("rule", "don't wake the baby: not through the [study:va]", "avoid room:study hard standing"),
    ("rule", "nobody in the [study:va] [until three:vt]", "avoid room:study hard until:15:00"),
    ("rule", "not through the [hall:va] [after ten at night:vt]", "avoid room:hall hard daily:22:00-06:00"),
    ("rule", "not through the [hall:va] [from nine at night:vt] till seven, kindly",
     "avoid room:hall hard daily:21:00-07:00"),
    ("rule", "leave the [kitchen:r] [door:va] alone", "avoid door:study|kitchen,kitchen|hall hard standing"),
    ("rule", "keep off the [trampoline:va]", "avoid none:trampoline hard standing"),
    ("rule", "never drive through Ben's [study:va]", "avoid room:study hard standing"),
    ("rule", "stay out of this family's [attic room:va]", "avoid none:attic room hard standing"),
    ("go", "to the [sofa:t], not over the [rug:va] and if you can past the [vase:vv]",
     "avoid floor:rug hard drive + via object:4 soft drive"),
    ("go", "to the [sofa:t], past the [vase:vv] and [from now on:vt] never through the [hall:va]",
     "via object:4 hard drive + avoid room:hall hard standing"),
]  # fmt: skip


@pytest.mark.parametrize(("act", "words", "rules"), CASES, ids=[words[:40] for _, words, _ in CASES])
def test_marked_words_give_typed_rules(act: str, words: str, rules: str) -> None:
    (clause,) = clauses_of(act, words)[1]
    assert says_how(clause)
    how = driving(clause, lexicon(read_deck(SHIPPED), HOME), Scene(HOME), DialogueState(), "said")
    assert [rule.text for rule in how.rules] == rules.split(" + ")
    assert all(rule.said == "said" for rule in how.rules) and bool(how.unknown) == ("none:" in rules)


ORDERS = (
    "never drive over the carpet", "keep off the rug", "you must not go through the kitchen",
    "stay well away from the vase", "only go through the hall, nothing else", "don't you dare cross the rug",
    "no driving through the study", "slow down near the vase, that's an order",
)  # fmt: skip
WISHES = (
    "I'd rather you didn't drive over the carpet", "if you can, keep off the rug", "better not go through the kitchen",
    "I'd prefer it if you stayed away from the vase", "try to go through the hall", "perhaps go round the rug",
    "it would be nice if you avoided the study", "it would be kind of you to slow down near the vase",
)  # fmt: skip


@pytest.mark.parametrize("words", [*ORDERS, *WISHES])
def test_orders_and_wishes_are_told_apart(words: str) -> None:
    (clause,) = parser()(listen(words).tokens, None, lexicon(read_deck(SHIPPED), HOME))
    how = driving(clause, lexicon(read_deck(SHIPPED), HOME), Scene(HOME), DialogueState())
    assert [rule.strength for rule in how.rules] == ["soft" if words in WISHES else "hard"]


def test_a_rule_about_nothing_is_asked_about() -> None:
    answer = told(Driving(), [], "model", lifts=False)
    assert answer.status == "clarify" and answer.question is not None and answer.question.endswith("?")


@pytest.mark.parametrize(
    ("said", "scope"),
    [
        ("until three", "until:15:00"), ("till half past six", "until:18:30"), ("before noon", "until:12:00"),
        ("until five o ' clock", "until:17:00"), ("until 7 in the morning", "until:07:00"),
        ("until 18:30", "until:18:30"),
        ("until quarter to eight", "until:19:45"), ("until midnight", "until:00:00"),
        ("till tomorrow", "until:tomorrow"),
        ("today", "until:tomorrow"), ("after ten", "daily:22:00-06:00"), ("at night", "daily:22:00-06:00"),
        ("between eight in the evening and seven in the morning", "daily:20:00-07:00"),
        ("from 9 pm to 7 am", "daily:21:00-07:00"),
        ("in the mornings", "daily:06:00-12:00"), ("just this once", "drive"), ("from now on", "standing"),
        ("until I say so", "standing"), ("one day", "standing"),
        ("from nine to five each day", "daily:09:00-17:00"), ("from ten in the evening to six", "daily:22:00-06:00"),
        ("from one to three", "daily:13:00-15:00"), ("every night from seven till six", "daily:19:00-06:00"),
        ("nine p.m. to six a.m.", "daily:21:00-06:00"), ("up to eight this evening", "until:20:00"),
        ("till twelve", "until:12:00"), ("for the rest of the day", "until:tomorrow"), ("on this errand", "drive"),
    ],
)  # fmt: skip
def test_how_long_a_rule_holds(said: str, scope: str) -> None:
    assert scope_of(said) == scope


def test_a_rule_just_after_a_goal_is_about_the_drive_to_it() -> None:
    names, scene = lexicon(read_deck(SHIPPED), HOME), Scene(HOME)
    begun = DialogueState(last=HOME.objects[0])
    for said, scope in (("and not over the [rug:va]", "drive"), ("and from now on not over the [rug:va]", "standing")):
        (clause,) = clauses_of("rule", said)[1]
        assert [rule.scope for rule in driving(clause, names, scene, begun).rules] == [scope]
        assert [rule.scope for rule in driving(clause, names, scene, DialogueState()).rules] == ["standing"]


def test_a_rule_in_a_conversation_is_about_its_drive() -> None:
    """Also where the turn before served nothing, unless the words say how long."""
    before = DialogueState(before=ParsedUtterance("need"))
    names = lexicon(read_deck(SHIPPED), HOME)
    for words, scope in (("by the [short way:vh]", "drive"), ("[from now on:vt] by the [short way:vh]", "standing")):
        (clause,) = clauses_of("rule", words)[1]
        assert driving(clause, names, Scene(HOME), before).rules[0].scope == scope


def test_a_zone_that_a_rule_has_named_is_known_by_its_name() -> None:
    zone = RouteRule.parse("slow-near zone:play corner=0,0;1,0;1,1 soft standing")
    names = lexicon(read_deck(SHIPPED), HOME)
    for words in ("keep out of the [play corner:va]", "keep out of the play [corner:va]"):
        (clause,) = clauses_of("rule", words)[1]
        (rule,) = driving(clause, names, Scene(HOME), DialogueState(), "", [zone]).rules
        assert rule.text == "avoid zone:play corner=0,0;1,0;1,1 hard standing"
        assert driving(clause, names, Scene(HOME), DialogueState()).unknown


def test_lifts_end_what_holds() -> None:
    (clause,) = clauses_of("lift", "you may cross the [study:va] again")[1]
    how = driving(clause, lexicon(read_deck(SHIPPED), HOME), Scene(HOME), DialogueState())
    standing = [RouteRule.parse(f"{kind} room:{room} hard standing") for kind, room in
                (("avoid", "hall"), ("avoid", "study"), ("slow-near", "study"))]  # fmt: skip
    assert not how.rules and ended_by(how.lifts, standing) == (standing[1],)
    assert ended_by(how.lifts, [standing[0], standing[2]]) == (standing[2],), (
        "of the same place, if none is of the kind"
    )
    answer = told(how, standing, "model")
    assert answer.lifts == (standing[1],) and answer.text == "Understood: no longer stay out of the study."
    assert told(how, standing[:1], "model").text.startswith("There is no such rule. These hold: stay out of the hall")


@pytest.mark.parametrize("words", ["which rules are there?", "what rules hold?", "are there any rules?"])
def test_who_asks_for_the_rules_takes_none_back(words: str) -> None:
    (clause,) = clauses_of("lift", words)[1]
    assert asks_of_rules(clause)
    standing = [RouteRule.parse("avoid room:hall hard standing")]
    answer = told(Driving(), standing, "model", asks_of_rules(clause))
    assert not answer.lifts and answer.text == "These rules hold: stay out of the hall, until you say otherwise."
    (clause,) = clauses_of("lift", "forget all the rules")[1]
    assert told(Driving(), standing, "model", asks_of_rules(clause)).lifts == tuple(standing)


@pytest.mark.parametrize(
    ("words", "says"),
    [("yes", True), ("Yes, please!", True), ("ok, go ahead", True), ("no", False), ("no, leave it", False),
     ("don't", False), ("bring me the cup", None), ("yesterday", None), ("go to the sofa", None)],
)  # fmt: skip
def test_yes_and_no(words: str, says: bool | None) -> None:
    assert agrees(words) is says


def test_no_words_about_the_way_are_none() -> None:
    assert not any(says_how(clause) for clause in clauses_of("go", "to the [sofa:t] [in:in] the [study:r]")[1])
    assert Inventory(()).rules == ()
