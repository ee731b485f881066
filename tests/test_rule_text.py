from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier.errors import InputError
from cartier.types.route_rules import FLOOR_KINDS, RouteRule, RouteTarget, called, echo

LETTERS = st.characters(codec="utf-8", exclude_categories=("C", "Z")) | st.just(" ")
NAMES = st.text(LETTERS, min_size=1, max_size=20).map(lambda text: " ".join(text.split())).filter(bool)
IDS = st.sets(st.integers(0, 10**6), min_size=1, max_size=5)
CORNER = st.tuples(*[st.floats(-50, 50).map(lambda v: round(v, 3))] * 2)
TARGETS = st.one_of(
    st.builds(RouteTarget, st.just("room"), st.lists(NAMES, min_size=1, max_size=3).map(tuple)),
    st.builds(RouteTarget, st.just("floor"), st.sampled_from(FLOOR_KINDS[1:]).map(lambda kind: (kind,))),
    st.builds(RouteTarget, st.just("door"), st.tuples(NAMES, NAMES)),
    st.builds(RouteTarget, st.just("none"), st.tuples(NAMES)),
    st.builds(lambda ids: RouteTarget("object", ids=tuple(ids)), IDS),
    st.builds(
        lambda name, corners: RouteTarget("zone", name, polygon_xy=tuple(corners)),
        st.just(()) | st.tuples(NAMES), st.lists(CORNER, min_size=3, max_size=6),
    ),
)  # fmt: skip
SCOPES = st.sampled_from(["drive", "standing", "until:22:00", "until:tomorrow", "daily:22:00-06:00"])
KINDS = st.sampled_from(["avoid", "keep-away", "slow-near", "prefer", "only-through", "via"])


@given(st.builds(RouteRule, KINDS, TARGETS, st.sampled_from(["hard", "soft"]), SCOPES))
def test_text_form_is_read_back(rule: RouteRule) -> None:
    assert RouteRule.parse(rule.text) == rule and RouteRule.parse(rule.text).text == rule.text
    assert rule.in_words() and "\n" not in rule.text


def test_defaults_may_be_left_out() -> None:
    assert RouteRule.parse("avoid room:living room").text == "avoid room:living room hard drive"
    assert RouteRule.parse("shortest").text == "shortest hard drive"


@pytest.mark.parametrize(
    "text",
    ["", "avoid", "avoid carpet", "avoid floor:lava hard drive", "shortest room:hall", "fly room:hall", "via object:x",
     "avoid object: hard drive", "avoid zone:1,2;3,4", "avoid zone:1,2;nan,4;5,6", "avoid door:hall", "avoid room:,",
     "avoid zone:1e9,2;3,4;5,6", "avoid room:hall hard until:25:00", "avoid room:hall hard daily:22:00"],
)  # fmt: skip
def test_other_forms_are_refused(text: str) -> None:
    if text.endswith(("25:00", "daily:22:00")):  # then it is part of the name
        assert RouteRule.parse(text).scope == "drive"
    else:
        with pytest.raises(InputError):
            RouteRule.parse(text)


ZONE = timezone(timedelta(hours=2))


def at(day: int, hour: int, minute: int = 0) -> datetime:
    return datetime(2026, 11, day, hour, minute, tzinfo=ZONE)


@pytest.mark.parametrize(
    ("scope", "made", "holds", "not_then"),
    [
        ("standing", at(1, 12), [at(1, 12), at(30, 3)], []),
        ("drive", at(1, 12), [at(1, 12)], []),
        ("until:15:00", at(1, 12), [at(1, 12), at(1, 14, 59)], [at(1, 15), at(2, 12)]),
        ("until:15:00", at(1, 16), [at(1, 17), at(2, 14)], [at(2, 15)]),
        ("until:tomorrow", at(1, 12), [at(1, 23), at(2, 5, 59)], [at(2, 6), at(3, 1)]),
        ("until:tomorrow", at(2, 1), [at(2, 5)], [at(2, 6)]),  # a night belongs to the day before
        ("daily:22:00-06:00", at(1, 12), [at(1, 22), at(2, 5, 59), at(9, 23)], [at(1, 12), at(2, 6), at(1, 21, 59)]),
        ("daily:12:00-14:00", at(1, 9), [at(1, 12), at(5, 13, 59)], [at(1, 11), at(1, 14)]),
    ],
)
def test_a_rule_holds_as_long_as_said(
    scope: str, made: datetime, holds: list[datetime], not_then: list[datetime]
) -> None:
    rule = RouteRule("avoid", RouteTarget("room", ("hall",)), "hard", scope, made=made.astimezone(UTC).isoformat())
    assert all(rule.holds(now) for now in holds) and not any(rule.holds(now) for now in not_then)
    assert not any(rule.expired(now) for now in holds)
    assert all(rule.expired(now) == scope.startswith("until") for now in not_then)


@pytest.mark.parametrize(
    ("lift", "rule", "ends"),
    [
        ("avoid room:hall", "avoid room:hall soft standing", True),
        ("avoid room:hall", "avoid room:study hard standing", False),
        ("avoid room:hall", "prefer room:hall hard standing", False),
        ("avoid object:3", "avoid object:3,4 hard standing", True),
        ("avoid door:hall|study", "avoid door:study|hall hard standing", True),
        ("avoid floor:carpet", "avoid room:carpet hard standing", False),
        ("shortest", "shortest hard standing", True),
        ("shortest", "avoid room:hall hard standing", False),
    ],
)
def test_a_rule_ends_those_about_the_same(lift: str, rule: str, ends: bool) -> None:
    assert RouteRule.parse(lift).ends(RouteRule.parse(rule)) is ends


def test_rules_in_words() -> None:
    rule = RouteRule.parse("avoid room:bedroom 2,Ben's room hard until:15:00")
    assert rule.in_words() == "stay out of bedroom 2 and Ben's room, until 15:00"
    assert RouteRule.parse("prefer floor:tiles soft drive").wish == "go over the tiles if that is no great detour"
    assert called(RouteTarget("door", ("hall", "bedroom 2"))) == "the door between the hall and bedroom 2"
    assert echo([RouteRule.parse("shortest")]) == "Understood: take the shortest way, for this drive."
