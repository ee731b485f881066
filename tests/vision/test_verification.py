"""Verification: doubtful objects are asked about once, by a model whose worth is measured on objects beyond doubt."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cartier
from cartier import cli
from cartier.blob_stores.folder import FolderBlobs
from cartier.errors import InputError, ReasonerError
from cartier.home import Home
from cartier.home.correction_log import LOG, read_log
from cartier.home.looking import verify
from cartier.home.store import PublishedStore
from cartier.serving.homes import Homes
from cartier.serving.operations import Operations
from cartier.types import CandidateView, Inventory, MapObject, Selection, VisualQuestion, VisualReply
from cartier.vision.permission import Look
from cartier.vision.verification import Calibration, contested, doubts
from vision.seeing_server import RGB, serving
from vision.staged_photos import BOX, mug, painted_home, photo

Served = tuple[str, list[dict]]
KNOWN = ("red", "blue", "green", "black", "yellow", "purple")


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))


@pytest.fixture
def seeing() -> Iterator[Served]:
    with serving() as served:
        yield served


class Blind:
    """A reasoner that nobody asks."""

    name = "blind"

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        raise AssertionError("nothing is asked")

    def propose(self, query: str) -> list[str]:
        raise AssertionError("nothing is asked")


def thing(number: int, colour: str, probability: float, label: str = "") -> MapObject:
    """A box that its colour makes what it is."""
    made = mug(number, [(number, BOX, 0), (number + 100, BOX, 90)], label=label or f"{colour} box")
    return replace(made, probability=probability, confirmed=probability >= 0.7)


def staged(folder: Path, *doubtful: tuple[int, str, float, str]) -> Home:
    """Six boxes beyond doubt, and doubtful ones: number, colour in the photograph, probability, label in the map."""
    rows = [*((k, colour, 0.99, "") for k, colour in enumerate(KNOWN, start=1)), *doubtful]
    jpegs = {}
    for number, colour, _, _ in rows:
        jpegs[number] = jpegs[number + 100] = photo((BOX, RGB[colour]))
    return painted_home([thing(*row) for row in rows], jpegs, folder)


def permitted(url: str, name: str = "sees") -> Look:
    return Look(cartier.make("vision", "openai", model=name, base_url=url))


def probability(home: Home, number: int) -> float:
    assert home.store is not None
    return next(obj.probability for obj in Home.load(home.store.folder).objects if obj.id == number)


def test_real_ones_gain_and_false_ones_lose(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""), (8, "pink", 0.75, "orange box"))
    calibration, checked = verify(home, permitted(seeing[0]))
    assert (calibration.named["yes"], calibration.misnamed["no"]) == (6, 6)
    assert [(each.obj.id, each.said) for each in checked] == [(8, "no"), (7, "yes")]
    assert probability(home, 7) == pytest.approx(7 / 8, abs=1e-4)  # odds of 1, times 7
    assert probability(home, 8) == pytest.approx(3 / 10, abs=1e-4)  # odds of 3, divided by 7
    assert home.store is not None
    after = {obj.id: obj.confirmed for obj in Home.load(home.store.folder).objects}
    assert after[7] and not after[8]
    assert not any(obj.by_person for obj in Home.load(home.store.folder).objects)


def test_one_call_a_question_and_none_twice(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""))
    verify(home, permitted(seeing[0]))
    assert len(seeing[1]) == 6 + 6 + 1
    again = Home.load(tmp_path / "home")
    assert verify(again, permitted(seeing[0])) == (Calibration(), [])
    assert len(seeing[1]) == 13


def test_undone_it_is_as_before_and_asked_again(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""))
    verify(home, permitted(seeing[0]))
    undone, told = Home.load(tmp_path / "home").correct("undo")
    assert told == "undone: pink box (7) was looked at: yes, odds x 7"
    assert undone.objects == home.objects and [obj.id for obj in doubts(undone.objects)] == [7]


@pytest.mark.parametrize("fault", ["yes-man", "ignores-grammar"])
def test_a_model_without_eyes_changes_nothing(fault: str, tmp_path: Path) -> None:
    always = json.dumps(
        {"picture_1": {"answer": "yes", "certainty": 1.0}, "picture_2": {"answer": "yes", "certainty": 1.0}}
    )
    with serving({"yes-man": always}) as (url, _):
        home = staged(tmp_path / "home", (7, "pink", 0.5, ""), (8, "pink", 0.75, "orange box"))
        verify(home, permitted(url, fault))
        assert (probability(home, 7), probability(home, 8)) == (0.5, 0.75)


def test_served_it_is_asked_only_where_the_owner_lets_photographs_leave(seeing: Served, tmp_path: Path) -> None:
    staged(tmp_path / "home", (7, "pink", 0.5, ""), (8, "pink", 0.75, "orange box"))
    served = Homes([tmp_path / "home"])
    for look in (None, replace(permitted(seeing[0]), when="ask")):
        shut = Operations(served, Blind(), look=look)
        assert not shut.verification.allowed
        with pytest.raises(InputError, match=r"no photograph may leave here.* --look auto"):
            shut.verify()
    assert not seeing[1]
    ops = Operations(served, Blind(), look=permitted(seeing[0]))
    told = ops.verify()
    assert [(row["id"], row["said"], row["frames"]) for row in told["asked"]] == [
        (8, "no", [8, 108]),
        (7, "yes", [7, 107]),
    ]
    assert told["asked"][1]["after"] == pytest.approx(7 / 8, abs=1e-4) and told["not_asked"] == 0
    assert told["model"].endswith(f"at {seeing[0]}") and told["weights"]["yes"] == 7
    assert probability(Home.load(tmp_path / "home"), 7) == pytest.approx(7 / 8, abs=1e-4)
    assert ops.verify()["next"] == "nothing changed"
    assert "undone: " in ops.undo()["done"]


def test_served_a_home_is_verified_by_one_at_a_time(tmp_path: Path) -> None:
    """A second asker is told so, and both ask again when the first has ended, also after a fault."""
    staged(tmp_path / "home", (7, "pink", 0.5, ""))
    refused = list[str]()

    class Asking:
        name, endpoint = "asks back", ""

        def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
            if not refused:
                with pytest.raises(InputError) as told:
                    ops.verify()
                refused.append(str(told.value))
            raise ReasonerError("the server is gone")

    ops = Operations(Homes([tmp_path / "home"]), Blind(), look=Look(Asking()))
    for _ in range(2):
        with pytest.raises(ReasonerError, match="the server is gone"):
            ops.verify()
    assert refused == ["home is being verified: call verify again when that has ended"]


def test_a_published_home_is_not_asked_about(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""))
    published = replace(home, store=PublishedStore(FolderBlobs(tmp_path / "store"), "homes/home/"))
    with pytest.raises(InputError, match="is published and stays as it is"):
        verify(published, permitted(seeing[0]))
    assert not seeing[1]


def test_what_a_person_said_outweighs_it(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (8, "pink", 0.75, "orange box"))
    verify(home, permitted(seeing[0]))
    said, _ = Home.load(tmp_path / "home").correct("confirm", 8)
    assert probability(said, 8) == 1.0
    assert [obj.id for obj in doubts(said.objects)] == []


def test_nothing_is_written_where_nobody_agrees_or_answers(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""))
    _, checked = verify(home, replace(permitted(seeing[0]), when="ask"))
    assert [each.trace.verdict for each in checked] == ["not_asked"] and not seeing[1]
    with pytest.raises(ReasonerError):
        verify(home, permitted("http://127.0.0.1:9/v1"))
    assert not (tmp_path / "home" / LOG).exists()


def test_who_is_asked_about_is_in_doubt() -> None:
    objects = [
        thing(1, "red", 0.05), thing(2, "red", 0.5), thing(3, "red", 0.8), thing(4, "red", 0.95),
        replace(thing(5, "red", 0.95), labels=(("red box", 0.4), ("blue box", 0.6))),
        replace(thing(6, "red", 0.5), by_person=True),
    ]  # fmt: skip
    assert [obj.id for obj in doubts(objects)] == [5, 3, 2]
    assert [obj.id for obj in doubts(objects, out={3})] == [5, 2]


def test_evidence_is_of_one_object_and_no_other(seeing: Served, tmp_path: Path) -> None:
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""))
    verify(home, permitted(seeing[0]))
    log = (tmp_path / "home" / LOG).read_text()
    elsewhere = [replace(obj, id=70) if obj.id == 7 else obj for obj in home.objects]
    other = painted_home(elsewhere, home.photos, tmp_path / "other")
    (tmp_path / "other" / LOG).write_text(log)
    assert probability(other, 70) == 0.5


@pytest.fixture(scope="module")
def verified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home of which one object was asked about; to be copied."""
    folder = tmp_path_factory.mktemp("verified")
    with pytest.MonkeyPatch.context() as patch, serving() as (url, _):
        patch.setenv("XDG_CONFIG_HOME", str(folder / "settings"))
        home = staged(folder / "home", (7, "pink", 0.5, ""))
        verify(home, permitted(url))
        assert probability(home, 7) > 0.5
    return folder / "home"


@pytest.mark.parametrize("factor", ["0", "-1", "NaN", "1e9", "true", '"7"', "null"])
def test_strange_factors_are_left_out(factor: str, verified: Path, tmp_path: Path) -> None:
    shutil.copytree(verified, tmp_path / "home")
    home = Home.load(tmp_path / "home")
    file = tmp_path / "home" / LOG
    row = json.loads(file.read_text())
    file.write_text(json.dumps(row | {"factor": "X"}).replace('"X"', factor) + "\n")
    entries, notes = read_log(tmp_path / "home")
    assert entries == () and "damaged" in notes[0]
    assert probability(home, 7) == 0.5


def test_command_writes_prompts_and_reads_replies(seeing: Served, tmp_path: Path) -> None:
    staged(tmp_path / "home", (7, "pink", 0.5, ""))
    run, home, prompts = CliRunner(), str(tmp_path / "home"), tmp_path / "prompts.jsonl"
    wrote = run.invoke(cli.app, ["verify", home, "--write-prompts", str(prompts)])
    assert wrote.exit_code == 0 and "nothing was sent" in wrote.output, wrote.output
    rows = [json.loads(line) for line in prompts.read_text().splitlines()]
    assert len(rows) == 13 and len(list((tmp_path / "prompts-photos").glob("*.jpg"))) == 2 * 2 * 13
    assert not (tmp_path / "home" / LOG).exists()
    replies = tmp_path / "replies.jsonl"
    reply = json.dumps({f"picture_{k}": {"answer": "yes", "certainty": 0.9} for k in (1, 2)})
    replies.write_text("".join(json.dumps({"custom_id": row["custom_id"], "reply": reply}) + "\n" for row in rows))
    told = run.invoke(cli.app, ["verify", home, "--look", "auto", "--vision", f"replay:{replies}", "--json"])
    assert told.exit_code == 0, told.output
    said = json.loads(told.stdout)
    assert said["calibration"]["yes"] == 1.0 and [row["said"] for row in said["objects"]] == ["yes"]
    assert not seeing[1]


def test_command_refuses_never_and_unknown_replies(tmp_path: Path) -> None:
    staged(tmp_path / "home", (7, "pink", 0.5, ""))
    (tmp_path / "none.jsonl").write_text("")
    with pytest.raises(InputError, match="--look ask or auto"):
        CliRunner().invoke(cli.app, ["verify", str(tmp_path / "home"), "--look", "never"], catch_exceptions=False)
    with pytest.raises(ReasonerError, match="no reply"):
        CliRunner().invoke(
            cli.app,
            ["verify", str(tmp_path / "home"), "--look", "auto", "--vision", f"replay:{tmp_path / 'none.jsonl'}"],
            catch_exceptions=False,
        )


def test_cannot_tell_is_no_evidence() -> None:
    counted = Calibration(Counter(yes=6), Counter({"cannot tell": 6}))
    assert counted.factor("cannot tell") == 1 and counted.factor("yes") == 7


def test_of_a_contested_object_the_name_is_asked_for(seeing: Served, tmp_path: Path) -> None:
    """A sure object of two names as likely: the chosen one counts for more, and the object stays."""
    home = staged(tmp_path / "home", (7, "pink", 0.95, "orange box"))
    unclear = replace(home.objects[6], labels=(("orange box", 4.0), ("pink box", 3.0), ("lid", 1.0)))
    assert contested(unclear) == ("orange box", "pink box") and doubts([unclear]) == [unclear]
    assert not contested(replace(unclear, labels=(("orange box", 4.0), ("pink box", 1.9))))
    replace(home, objects=(*home.objects[:6], unclear), corrected=None).save(tmp_path / "unclear")
    home = Home.load(tmp_path / "unclear")
    (each,) = verify(home, permitted(seeing[0]))[1]
    assert (each.said, each.label, each.factor) == ("yes", "pink box", 7.0)
    after = Home.load(tmp_path / "unclear").objects[6]
    assert (after.id, after.label, after.confirmed) == (7, "pink box", True) and after.probability > 0.99
    undone, told = Home.load(tmp_path / "unclear").correct("undo")
    assert "pink box, odds x 7" in told and undone.objects[6].label == "orange box"


def test_a_yes_to_a_second_entry_of_one_thing_counts_nothing(seeing: Served, tmp_path: Path) -> None:
    """A photograph does not tell that an object is listed twice: it shows the other one."""
    home = staged(tmp_path / "home", (7, "pink", 0.5, ""), (8, "pink", 0.95, ""))
    for apart_m, factor in ((0.2, 1.0), (2.0, 7.0)):
        moved = tuple(replace(obj, position=(apart_m * (obj.id == 7), 9.0, 0.8)) for obj in home.objects)
        folder = tmp_path / f"apart {apart_m}"
        replace(home, objects=moved, corrected=None).save(folder)
        (each,) = verify(Home.load(folder), permitted(seeing[0]))[1]
        assert (each.obj.id, each.said, each.factor) == (7, "yes", factor)
