from __future__ import annotations

import json
import os
import re
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartier import plugins
from cartier.errors import InputError
from cartier.labels import display_name
from cartier.llm.prompts import check_query
from cartier_bench.lines import MAX_BYTES
from cartier_bench.queries import MAX_QUERIES, OWN, SPLITS, TYPES, Query, cases, load_file, load_queries, targets
from cartier_bench.rows import read_rows

WORLD = plugins.make("worlds", "dollhouse")
HOMES = {home: {display_name(o.label) for o in WORLD.objects(home)} for home in WORLD.homes()}
EVERYTHING = set().union(*HOMES.values())
PAPER, EXTENDED = load_queries("paper"), load_queries("extended")
ALL = [*PAPER, *EXTENDED]
TARGETS = {target["name"]: target for target in targets()}
DOCS = Path(__file__).parents[2] / "docs" / "queries.md"
NO_WORDS: dict[str, list[str]] = {"synonyms": []}
THOR = Path(__file__).parents[1] / "data" / "thor_object_types.json"


def of(kind: str, queries: list[Query] = ALL) -> list[Query]:
    return [q for q in queries if q.type == kind]


def names(word: str, text: str) -> bool:
    """Whether the text has the word or its plural, as a word of its own and in any case."""
    return re.search(rf"\b{re.escape(word)}(?:e?s)?\b", text, re.IGNORECASE) is not None


def sentences(text: str) -> int:
    return len(re.findall(r"[.!?…]+[\"'”’)]*(?=\s|$)", text if text[-1] in ".!?…" else text + "."))


def words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9']+", text.lower())


def test_forty_targets_asked_in_three_ways() -> None:
    assert len(TARGETS) == len(list(targets())) == 40
    for target in TARGETS:
        for kind in TYPES:
            assert [q.split for q in of(kind) if q.target == target] == ["paper", "extended", "extended"], (
                target,
                kind,
            )
    assert len(PAPER) == 120 and len(EXTENDED) == 240
    assert len({q.id for q in ALL}) == 360


def test_the_paper_split_makes_127_pairs_per_type() -> None:
    asked = cases(PAPER, HOMES)
    assert Counter(query.type for _, query in asked) == dict.fromkeys(TYPES, 127)
    assert len(set(asked)) == len(asked)
    assert {home for home, _ in asked} == set(HOMES), "every home has its share"
    assert Counter(query.type for _, query in cases(EXTENDED, HOMES)) == dict.fromkeys(TYPES, 254)


def test_the_targets_are_object_types_of_ai2thor() -> None:
    types = {display_name(name) for name in json.loads(THOR.read_text())["SimObjType"]}
    assert set(TARGETS) <= types


def test_the_page_about_the_set_tells_the_truth() -> None:
    page = DOCS.read_text(encoding="utf-8")
    prose = " ".join(page.split())
    rows = {int(n): names.split(", ") for n, names in re.findall(r"^\| (\d) \| (.+) \|$", page, re.MULTILINE)}
    counted = {target: sum(target in held for held in HOMES.values()) for target in TARGETS}
    assert {name: n for n, listed in rows.items() for name in listed} == counted
    per_home = Counter(home for home, query in cases(PAPER, HOMES) if query.type == "explicit")
    told = re.findall(r"([a-z][a-z -]+?) (\d+)(?=[,.])", prose.split("pairs evenly: ")[1])
    assert {name.strip().replace(" ", "_").replace("-", "_"): int(n) for name, n in told[:7]} == per_home
    for kind in TYPES:
        right = [len(HOMES[home] & set(q.accept)) for home, q in cases(PAPER, HOMES) if q.type == kind]
        assert f"{sum(right) / 127:.2f} {kind}" in prose
        assert kind == "explicit" or f"{right.count(1)} of 127" in prose


@pytest.mark.parametrize("query", ALL, ids=lambda q: q.id)
def test_a_request_obeys_the_rules(query: Query) -> None:
    target, text = TARGETS[query.target], query.text
    known = [query.target, *target["synonyms"]]
    others = EVERYTHING - set(query.accept)

    assert query.target in query.accept
    assert set(query.accept) <= EVERYTHING, "a name that no home has can never be right"
    assert len(set(query.accept)) == len(query.accept)
    assert check_query(text) == text and text.isascii(), "plain words, no odd quotes"

    if query.type == "explicit":
        assert any(names(name, text) for name in known)
        assert 1 <= sentences(text) <= 3 and len(words(text)) <= 20
        return
    given_away = [word for word in [*known, *target["giveaways"]] if names(word, text)]
    assert not given_away
    served = [word for name in query.accept for word in (name, *TARGETS.get(name, NO_WORDS)["synonyms"])]
    assert not [word for word in served if names(word, text)], "what is named is not wanted"
    if query.type == "implicit":
        assert 1 <= sentences(text) <= 2 and 5 <= len(words(text)) <= 40
    else:
        assert 4 <= sentences(text) <= 8 and 50 <= len(words(text)) <= 130
        assert sum(names(name, text) for name in others) >= 2, "at least two objects of the homes that are not wanted"


def test_no_two_requests_share_six_words_in_a_row() -> None:
    seen: dict[tuple[str, ...], str] = {}
    for query in ALL:
        spoken = words(query.text)
        for start in range(len(spoken) - 5):
            run = tuple(spoken[start : start + 6])
            assert seen.setdefault(run, query.id) == query.id, " ".join(run)


def test_short_requests_differ_too() -> None:
    texts = [tuple(words(q.text)) for q in ALL]
    assert len(set(texts)) == len(texts)


def test_people_begin_in_many_ways() -> None:
    for kind in TYPES:
        starts = Counter(tuple(words(q.text)[:2]) for q in of(kind))
        assert starts.most_common(1)[0][1] <= 6, starts.most_common(3)
        assert len(starts) >= 90, "of 120"


def test_long_requests_are_not_cut_to_one_length() -> None:
    lengths = Counter(sentences(q.text) for q in of("conversational"))
    assert set(lengths) == {4, 5, 6, 7, 8}
    assert max(lengths.values()) <= 0.6 * 120, lengths


def test_a_request_is_asked_where_its_target_is() -> None:
    kettle, sofa = (Query(t, "implicit", t, (t, "mug"), "…", "paper") for t in ("kettle", "sofa"))
    homes = {"one": {"kettle", "mug"}, "two": {"mug"}, "three": {"kettle", "sofa"}}
    assert cases([kettle, sofa], homes) == [("one", kettle), ("three", kettle), ("three", sofa)]
    assert cases([kettle, sofa], {"two": {"mug"}}) == [], (
        "a built-in request is left out where nothing holds its target"
    )


def test_a_request_of_ones_own_that_no_home_can_answer_is_reported() -> None:
    lost = Query("q7", "implicit", "piano", ("piano",), "Play it again", OWN)
    with pytest.raises(InputError, match=r"'q7' can be asked nowhere.*one, two.*'piano'"):
        cases([lost], {"one": {"sofa"}, "two": {"bed"}})
    beside = Query("q8", "implicit", "piano", ("piano", "bed"), "Play it again", OWN)
    with pytest.raises(InputError, match=r"accepts 'bed', which they hold: make that its target"):
        cases([beside], {"one": {"sofa"}, "two": {"bed"}})


def test_an_unknown_split_is_refused() -> None:
    with pytest.raises(InputError, match="there are paper and extended"):
        load_queries("test")
    assert SPLITS == ("paper", "extended")


GOOD = {
    "id": "1",
    "type": "implicit",
    "target": "CoffeeMachine",
    "accept": ["coffee_machine", "Kettle"],
    "text": "Tired.",
}


def written(folder: Path, *rows: object) -> Path:
    file = folder / "mine.jsonl"
    file.write_text("\n".join(r if isinstance(r, str) else json.dumps(r) for r in rows), encoding="utf-8")
    return file


def test_a_file_of_ones_own(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD, "", GOOD | {"id": "2", "type": "explicit"})
    first, second = load_file(file)
    assert first == Query("1", "implicit", "coffee machine", ("coffee machine", "kettle"), "Tired.", OWN)
    assert (second.id, second.type) == ("2", "explicit")
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    assert load_file(file) == [first, second], "as an editor on Windows would save it"


def test_the_built_in_set_passes_as_a_file_of_ones_own(tmp_path: Path) -> None:
    rows = [{"id": q.id, "type": q.type, "target": q.target, "accept": q.accept, "text": q.text} for q in ALL]
    read = load_file(written(tmp_path, *rows))
    assert [(q.id, q.target, q.accept, q.text) for q in read] == [(q.id, q.target, q.accept, q.text) for q in ALL]
    assert len(cases(read, HOMES)) == 9 * 127


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ('{"id": "2", ', "not valid JSON"),
        ("[]", "the line: input should be a valid"),
        ("[" * 100_000, "not valid JSON"),
        ('{"id": ' + "9" * 5000 + "}", "not valid JSON"),
        ({k: v for k, v in GOOD.items() if k != "accept"}, "'accept' is missing"),
        (GOOD | {"id": "2", "acept": []}, "'acept' is no key here"),
        (GOOD | {"id": "2", "type": "vague"}, "type: input should be 'explicit', 'implicit' or 'conv"),
        (GOOD | {"id": "2", "type": ["implicit"]}, "type: input should be 'explicit'"),
        (GOOD, "the id '1' was used before"),
        (GOOD | {"id": 2}, "id: input should be a valid string"),
        (GOOD | {"id": "a\nb"}, "id: must be text of 1 to 100 characters in one line"),
        (GOOD | {"id": "x" * 101}, "id: must be text"),
        (GOOD | {"id": "2", "target": " "}, "target: must be text"),
        (GOOD | {"id": "2", "accept": []}, "accept: tuple should have at least 1 item"),
        (GOOD | {"id": "2", "accept": "kettle"}, "accept: input should be a valid tuple"),
        (GOOD | {"id": "2", "accept": ["kettle", None]}, "accept.1: input should be a valid string"),
        (GOOD | {"id": "2", "accept": ["kettle"]}, "'accept' lacks the target 'coffee machine'"),
        (GOOD | {"id": "2", "text": 3}, "text: input should be a valid string"),
        (GOOD | {"id": "2", "text": " \t"}, "the request is empty"),
        (GOOD | {"id": "2", "text": "so " * 3000}, "the request is too long"),
    ],
)
def test_a_broken_line_is_named(tmp_path: Path, line: object, reason: str) -> None:
    with pytest.raises(InputError) as error:
        load_file(written(tmp_path, GOOD, line))
    message = str(error.value)
    assert f"mine.jsonl line 2: {reason}" in message
    assert "\n" not in message and len(message) < 500


def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is missing"):
        load_file(tmp_path / "mine.jsonl")
    with pytest.raises(InputError, match="is a folder"):
        load_file(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    for read in (load_file, read_rows):
        with pytest.raises(InputError, match="is a pipe"):
            read(tmp_path / "pipe")
    with pytest.raises(InputError, match=r"holds no request; a line looks like"):
        load_file(written(tmp_path, "", "  "))
    latin = tmp_path / "latin.jsonl"
    latin.write_bytes(json.dumps(GOOD).encode() + b'\n{"text": "caf\xe9"}')
    with pytest.raises(InputError, match="line 2: not UTF-8"):
        load_file(latin)


def test_a_file_has_bounds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"line {MAX_QUERIES + 1}: more than {MAX_QUERIES} lines"):
        load_file(written(tmp_path, *(GOOD | {"id": str(n)} for n in range(MAX_QUERIES + 2))))
    huge = tmp_path / "huge.jsonl"
    with huge.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match="larger than 64 MiB"):
        load_file(huge)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(row=JSON | st.fixed_dictionaries({}, optional=dict.fromkeys(GOOD, JSON)).map(lambda changed: GOOD | changed))
def test_any_json_is_read_or_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, row: object) -> None:
    file = tmp_path_factory.getbasetemp() / "any.jsonl"
    file.write_text(json.dumps(row), encoding="utf-8")
    try:
        (query,) = load_file(file)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert query.target in query.accept and query.type in TYPES
