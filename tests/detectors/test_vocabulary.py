"""The vocabulary: LVIS's names as people say them, and any text file or list in their place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier.detectors.vocabulary import LVIS, MAX_BYTES, MAX_NAME_CHARS, MAX_NAMES, read_vocabulary
from cartier.detectors.zero_shot import packed
from cartier.errors import InputError
from cartier.labels import display_name

LVIS_NAMES = Path(__file__).parents[1] / "data" / "lvis_names.txt"


def test_lvis_has_its_1203_names_unique_and_as_people_write_them() -> None:
    lvis = read_vocabulary()
    assert len(lvis.names) == len(set(lvis.names)) == 1203
    assert all(name == display_name(name) and "(" not in name for name in lvis.names)
    assert lvis.notes == ()
    assert lvis.source == "LVIS"


def test_lvis_namesakes_have_names_of_their_own_and_keep_the_bare_word_as_synonym() -> None:
    lvis = read_vocabulary()
    assert {"computer mouse", "archery bow", "ribbon bow", "bow-tie", "cooking pan", "metal pan"} <= set(lvis.names)
    assert "mouse" in lvis.synonyms["computer mouse"]
    assert lvis.synonyms["sofa"] == ("couch", "lounge")
    words = {word for others in lvis.synonyms.values() for word in others}
    assert not words & set(lvis.names)


def test_lvis_follows_the_datasets_ids() -> None:
    categories = LVIS_NAMES.read_text("utf-8").splitlines()
    lvis = read_vocabulary()
    changed = 0
    for name, category in zip(lvis.names, categories, strict=True):
        plain = category.replace("_", " ").lower()
        changed += name != plain
        words = re.findall(r"[a-z]{3,}", plain)
        said = {name, *lvis.synonyms.get(name, ())}
        assert any(word.rstrip("s") in " ".join(said) for word in words) or name == plain
        assert name == plain or "(" in plain
    assert changed == sum("(" in category for category in categories)


def test_a_file_may_have_comments_synonyms_and_windows_line_ends(tmp_path: Path) -> None:
    file = tmp_path / "names.txt"
    file.write_bytes("\ufeff# mine\r\nCoffeeMachine\tespresso maker\r\nmug\r\n".encode())
    read = read_vocabulary(file)
    assert read.names == ("coffee machine", "mug")
    assert read.synonyms == {"coffee machine": ("espresso maker",)}
    assert read == read_vocabulary(str(file))
    assert read.source == "names.txt"


def test_our_own_file_reads_like_any_other() -> None:
    assert read_vocabulary(LVIS).names == read_vocabulary().names


def test_blanks_are_left_out_and_duplicates_merged_and_both_are_said(tmp_path: Path) -> None:
    file = tmp_path / "names.txt"
    file.write_text("mug\n\n  \nCup\tbeaker\ncup\ttumbler\tbeaker\nMug\nbed\n")
    read = read_vocabulary(file)
    assert read.names == ("mug", "cup", "bed")
    assert read.synonyms == {"cup": ("beaker", "tumbler")}
    assert read.notes == (
        "vocabulary names.txt: 2 blank names are left out",
        'vocabulary names.txt: 2 duplicates are merged ("mug", "cup")',
    )


@given(st.lists(st.text(), max_size=30))
@settings(max_examples=40)
def test_any_list_gives_unique_display_names_in_order_or_one_clear_line(names: list[str]) -> None:
    expected = list(dict.fromkeys(filter(None, map(display_name, names))))
    try:
        read = read_vocabulary(names)
    except InputError as error:
        assert not expected or max(map(len, names)) > MAX_NAME_CHARS
        assert "\n" not in str(error)
    else:
        assert list(read.names) == expected
        assert all("\n" not in line for line in read.notes)


def test_as_many_names_as_allowed_are_read_and_one_more_is_refused() -> None:
    names = [f"thing {number}" for number in range(MAX_NAMES)]
    assert len(read_vocabulary([*names, "thing 0"]).names) == MAX_NAMES
    with pytest.raises(InputError, match=f"holds {MAX_NAMES + 1} names; at most {MAX_NAMES}"):
        read_vocabulary([*names, "bed"])


def test_20000_names_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "many.txt"
    file.write_text("\n".join(f"thing {number}" for number in range(20_000)))
    with pytest.raises(InputError, match=r"many.txt holds 20000 names; at most"):
        read_vocabulary(file)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"", "holds no name"),
        (b"\n \n\t\n# only a comment\n", "holds no name"),
        (b"mug\nca\xfff\xe9\n", "line 2: not UTF-8 text"),
        (b"a" * (MAX_BYTES + 1), "larger than 4 MiB"),
    ],
)
def test_a_file_that_is_no_vocabulary_is_refused_in_one_line(tmp_path: Path, content: bytes, fault: str) -> None:
    file = tmp_path / "names.txt"
    file.write_bytes(content)
    with pytest.raises(InputError, match=fault) as refused:
        read_vocabulary(file)
    assert "\n" not in str(refused.value)


def test_what_is_not_there_or_no_list_of_names_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"vocabulary .*missing.txt is missing"):
        read_vocabulary(tmp_path / "missing.txt")
    with pytest.raises(InputError, match="is a folder"):
        read_vocabulary(tmp_path)
    with pytest.raises(InputError, match=r"cannot be read \(embedded null byte"):
        read_vocabulary("a\0b")
    with pytest.raises(InputError, match="this list holds 7"):
        read_vocabulary(["mug", 7])  # type: ignore[list-item]
    with pytest.raises(InputError, match="a list holds no name"):
        read_vocabulary([])


@given(st.lists(st.integers(2, 20), max_size=200), st.integers(20, 80))
def test_names_are_packed_into_prompts_without_loss_and_nearly_as_few_as_can_be(sizes: list[int], room: int) -> None:
    packs = packed(sizes, room)
    assert sorted(item for pack in packs for item in pack) == list(range(len(sizes)))
    assert all(pack == sorted(pack) and sum(sizes[item] for item in pack) <= room for pack in packs)
    fewest = -(-sum(sizes) // room)
    largest_waste = room / (room - max(sizes, default=0) + 1) if sizes and max(sizes) < room else 2
    assert len(packs) <= fewest * largest_waste + 1


def test_lvis_takes_as_few_prompts_of_256_tokens_as_there_can_be() -> None:
    sizes = [1 + sum(1 + (len(word) > 6) for word in name.split()) for name in read_vocabulary().names]
    assert len(packed(sizes, 254)) == -(-sum(sizes) // 254)
