"""Names that mean the same, things that come together, and distances to boxes in closed form."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier_bench.metrics import canonical, distances, listed_as, matches
from cartier_bench.queries import targets
from synthetic import box

NAMES = st.sampled_from([name for target in targets() for name in (target["name"], *target["synonyms"])])


@given(NAMES, NAMES)
def test_matching_is_the_same_both_ways_and_of_itself(a: str, b: str) -> None:
    assert matches(a, [a])
    assert matches(a, [b]) == matches(b, [a])
    assert canonical(canonical(a)) == canonical(a)


@pytest.mark.parametrize(
    ("named", "accept", "right"),
    [
        ("CoffeeMachine", ["coffee machine"], True),
        ("coffee maker", ["coffee machine"], True),
        ("faucet", ["sink"], True),
        ("bed", ["sheets"], False),
        ("mug", ["coffee machine"], False),
        ("curtain", ["curtains"], True),
        (None, ["bed"], False),
        ("sofa", [], False),
    ],
)
def test_what_counts_as_the_right_thing(named: str | None, accept: list[str], right: bool) -> None:
    assert matches(named, accept) is right


def test_a_free_name_is_found_in_a_list() -> None:
    assert listed_as("Refrigerator", ["bed", "fridge"]) == "fridge"
    assert listed_as("sofas", ["sofa"]) == "sofa"
    assert listed_as("unicorn", ["sofa"]) is None


def test_distances_are_to_the_nearest_acceptable_box() -> None:
    truth = [
        box(1, "Sofa", (0, 0, 0), (2, 1, 1)),
        box(2, "Sofa", (10, 0, 0), (12, 1, 1)),
        box(3, "Bed", (5, 5, 0), (6, 6, 1)),
    ]
    assert distances((1, 0.5, 0.5), truth, ["sofa"]) == (0, 0)
    in_space, on_floor = distances((15, 1, 5), truth, ["sofa"])  # type: ignore[misc]
    assert (in_space, on_floor) == (5, 3)
    assert distances(None, truth, ["sofa"]) == (None, None)
    assert distances((0, 0, 0), truth, ["lamp"]) == (None, None)
