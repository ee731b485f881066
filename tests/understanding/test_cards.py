"""The knowledge cards: those that ship are whole, faulty ones get one line, and your own are used."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import pytest
from held_out import COCO

from cartier.errors import InputError
from cartier.labels import display_name, name_key
from cartier.reasoners import embedded
from cartier.types import Inventory
from cartier.understanding import cards
from cartier.understanding.card_vectors import shipped, text_key
from cartier.understanding.cards import SHIPPED, deck_of, read_deck
from cartier.understanding.out_of_vocabulary import out_of_vocabulary_mention
from cartier.understanding.spelling import Spelling
from cartier.understanding.spoken_corrections import spoken_correction
from cartier.understanding.text import stem
from cartier.vision.pixels import BLIND

THOR = Path(__file__).parents[1] / "data" / "thor_object_types.json"


def test_every_shipped_card_is_whole() -> None:
    deck = read_deck(SHIPPED)
    at_home = [card for card in deck.cards if card.at_home]
    assert len(at_home) >= 800
    assert all(10 <= len(set(card.uses)) == len(card.uses) <= 20 for card in at_home)
    assert [b for card in at_home for b in card.beside if deck.card_of(b) is None] == []


def test_every_text_of_the_cards_has_its_vector() -> None:
    """Else the first request waits until they are encoded: run tools/train_scorer.py after editing cards."""
    known, _, _ = shipped()
    texts = [text for card in read_deck(SHIPPED).cards for text in (*card.names, *card.uses)]
    assert [text for text in texts if text_key(text) not in known] == []


def test_every_household_type_of_coco_and_thor_has_a_card() -> None:
    deck = read_deck(SHIPPED)
    thor = json.loads(THOR.read_text("utf-8"))
    no_thing = {"ContainerFull", "Dirt", "MiscTableObject", "MassObjectSpawner", "TargetCircle", "Floor", "ScreenFrame"}
    no_thing |= {"PaintingHangerSmall", "PaintingHangerMedium", "PaintingHangerLarge"}
    coco = "bench tie suitcase handbag cat dog bed toilet donut|hot dog|teddy bear|hair drier|remote|pizza|broccoli"
    wanted = [n for n in thor["SimObjType"] + thor["seen_elsewhere"] if n not in no_thing]
    wanted += COCO + [n for part in coco.split("|") for n in (part.split() if part.startswith("bench") else [part])]
    assert [n for n in wanted if deck.card_of(display_name(n)) is None] == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[chair]\nuses = [", "not valid TOML"),
        ('[chair]\nsynonyms = ["seat"]', "card 'chair': has no uses"),
        ("[chair]\nuses = []", "card 'chair': has no uses"),
        ('[chair]\nuses = ["sit down"]\nsynonyms = ["a", "A"]', "card 'chair' has the name 'A' twice"),
        ('["arm chair"]\nuses = ["sit"]\n[armchair]\nuses = ["sit"]', "that card 'arm chair' has already"),
        ("[chair]\nuses = ['sit']\n[chair]\nuses = ['sit']", "not valid TOML"),
        ('[chair]\nuses = "sit down"', "card 'chair': uses must be a list of phrases"),
        ('[chair]\nuses = ["sit", 3]', "card 'chair': uses must be a list of phrases"),
        ('[chair]\nuses = ["?!"]', "card 'chair': uses must be a list of phrases"),
        ('[chair]\nuses = ["sit"]\nuse = ["sit"]', "there is no field 'use'"),
        ('[chair]\nuses = ["sit"]\nat_home = 1', "at_home must be true or false"),
        ('["?"]\nuses = ["sit"]', "the name of a card holds letters or digits"),
        ("chair = 3", "a card is a table with uses, not a bare value"),
        ("", "holds no card"),
        ("chair = " + "[" * 5000, "nested too deeply"),
    ],
)
def test_a_faulty_card_file_gets_one_line(tmp_path: Path, text: str, fault: str) -> None:
    file = tmp_path / "cards.toml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        embedded.make(cards=file)
    assert fault in str(error.value) and str(file) in str(error.value) and "\n" not in str(error.value)


def test_a_name_belongs_to_one_card_of_all_files(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('[chair]\nuses = ["sit"]\n')
    (tmp_path / "b.toml").write_text('[stool]\nuses = ["perch"]\nsynonyms = ["Chairs"]\n')
    with pytest.raises(InputError, match=r"b\.toml: card 'stool' has the name 'Chairs' that card 'chair' has already"):
        embedded.make(cards=tmp_path)


def test_a_card_file_that_cannot_be_read_gets_one_line(tmp_path: Path) -> None:
    (tmp_path / "latin1.toml").write_bytes(b"# \xe9\n")
    (tmp_path / "empty").mkdir()
    for file in (tmp_path / "none.toml", tmp_path / "empty", tmp_path / "latin1.toml"):
        with pytest.raises(InputError, match="card file") as error:
            embedded.make(cards=file)
        assert "\n" not in str(error.value)


def test_your_own_cards_are_used(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('[theremin]\nuses = ["eerie music", "wave my hands in the air"]\n')
    mine = embedded.make(cards=tmp_path / "mine.toml")
    assert mine.select("some eerie music, please", Inventory.of(["cup", "theremin"])).object == "theremin"


def test_your_own_cards_name_things_everywhere(tmp_path: Path) -> None:
    """In questions about looks, in corrections, and in what a detector has no name for."""
    (tmp_path / "mine.toml").write_text('[theremin]\nsynonyms = ["etherwave"]\nuses = ["eerie music"]\n')
    mine, shipped = embedded.make(cards=tmp_path / "mine.toml"), embedded.make()
    listed = Inventory.of(["cup", "theremin"])
    assert BLIND in (mine.select("Is the etherwave clean?", listed).text or "")
    for reasoner, known in ((mine, True), (shipped, False)):
        deck = deck_of(reasoner)
        said = spoken_correction("that is an etherwave", [("the cup?", "cup #0")], listed, None, (), deck)
        assert (said is not None) == known
        assert out_of_vocabulary_mention("bring me the etherwave", ["cup"], deck) == ("etherwave" if known else None)


@pytest.mark.parametrize(
    "alike",
    [
        "sleepy sleeping slept asleep",
        "plate plates",
        "bleeding bled blood",
        "smelly smell",
        "tired tiring",
        "wrinkled wrinkly",
        "dirty filthy",
    ],
)
def test_stems(alike: str) -> None:
    assert len({stem(word) for word in alike.split()}) == 1


def test_name_keys() -> None:
    assert name_key("Bath Tubs") == name_key("bath-tub") == name_key("bathtub")
    assert name_key("paintings") == name_key("painting") != name_key("paint")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("cofee", "coffee"), ("curtian", "curtain"), ("stov", "stove"), ("umberella", "umbrella"), ("teh", "the")],
)
def test_slips_of_the_keyboard(typed: str, meant: str) -> None:
    spelling = Spelling({"sweep", "dont"}, ["the", "coffee", "curtain", "stove", "umbrella"], ["morning"])
    assert spelling(typed) == meant and spelling(meant) == meant


@pytest.mark.parametrize("word", ["sweeping", "dont", "mine", "storm", "a", "", "über", "3rd", "x" * 50])
def test_words_that_are_no_slips_stay(word: str) -> None:
    assert Spelling({"sweep", "storm"}, ["the", "stove"], ["morning"])(word) == word


def test_the_ready_made_cards_are_those_of_the_files(monkeypatch: pytest.MonkeyPatch) -> None:
    made = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "build_cards.py"))["built"]()
    assert cards.BUILT.read_bytes() == made, "run tools/build_cards.py"
    quick, slow = cards._built(), cards.Deck(cards.read_cards(SHIPPED))
    assert quick is not None and vars(quick) == vars(slow)
    monkeypatch.setattr(cards, "source", lambda: "a card was changed")
    assert cards._built() is None
