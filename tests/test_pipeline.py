from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import threadpoolctl

import cartier
from cartier.conversation import Conversation
from cartier.errors import BackendError, InputError
from cartier.geometry import box_distance
from cartier.home import Home
from cartier.home.store import Store
from cartier.pipeline import map_home
from cartier.types import Detections, Frame, Inventory, Selection
from synthetic import CHAIR, THINGS, RoomRecording, TrueBoxes, walk


class Says:
    """A reasoner that always gives one answer: what is tested here is the line around it."""

    name = "test"

    def __init__(self, choice: str | None) -> None:
        self.choice = choice

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        return Selection("found", self.choice) if self.choice else Selection("not_found", reason="nothing fits")

    def propose(self, query: str) -> list[str]:
        return []


@pytest.fixture(scope="module")
def home() -> cartier.Home:
    return map_home(walk(), TrueBoxes(THINGS))


def test_from_frames_to_a_goal_that_faces_the_chair(home: cartier.Home) -> None:
    answer = cartier.ask(home, "let me sit down", Says("chair"))
    assert answer.place is not None and answer.goal is not None
    assert box_distance(answer.place.position, CHAIR.box_min, CHAIR.box_max) < 0.03
    to_chair = math.atan2(answer.place.position[1] - answer.goal.y, answer.place.position[0] - answer.goal.x)
    assert answer.goal.yaw == pytest.approx(to_chair)
    assert math.hypot(answer.goal.x - 3.85, answer.goal.y - 2.05) < 1.0 and answer.goal.line_of_sight
    assert set(answer.timing_ms) == {"select", "locate", "plan"}
    assert answer.place.frame in home.photos
    assert json.loads(json.dumps(answer.to_dict(), allow_nan=False))["object"] == "chair"


class Counts(Says):
    """Notes on how many threads BLAS computes, and asks once more meanwhile."""

    def __init__(self, home: cartier.Home) -> None:
        super().__init__("chair")
        self.home, self.threads = home, list[int]()

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        if not self.threads:
            self.threads = blas_threads()
            cartier.ask(self.home, query, self)
            self.threads += blas_threads()
        return super().select(query, inventory, dialogue)


def blas_threads() -> list[int]:
    return [library["num_threads"] for library in threadpoolctl.threadpool_info() if library["user_api"] == "blas"]


def test_an_answer_takes_one_thread(home: cartier.Home) -> None:
    counts = Counts(home)
    with threadpoolctl.threadpool_limits(3, user_api="blas"):
        cartier.ask(home, "let me sit down", counts)
        after = blas_threads()
    assert set(counts.threads) == {1} and set(after) == {3}


def test_each_index_answers(home: cartier.Home) -> None:
    assert set(home.indexes) == {"object_depth", "object_viewpoint"}
    for name in home.indexes:
        answer = cartier.ask(home, "let me sit down", Says("chair"), index=name)
        assert answer.index == name and answer.place is not None and answer.goal is not None


def test_the_start_decides_the_path(home: cartier.Home) -> None:
    a, b = (cartier.ask(home, "x", Says("chair"), from_xy=xy).goal for xy in ((1, 1), (3, 1)))
    assert a is not None and b is not None and a.length_m > b.length_m + 1
    nowhere = cartier.ask(home, "x", Says("chair"), from_xy=(50, 50))
    assert nowhere.goal is None and "no known free floor" in nowhere.notes[0]


class Unasked:
    """A reasoner that nobody may ask."""

    name = "unasked"

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        raise AssertionError("asked")

    def propose(self, query: str) -> list[str]:
        raise AssertionError("asked")


@pytest.mark.parametrize(
    "start", [(math.nan, 1.0), (1.0, math.inf), (1.0,), (1.0, 2.0, 3.0), 7, "ab", [[1], 2], (10**400, 0), (1e7, 0)]
)
def test_a_start_that_is_no_point_is_refused_before_anybody_is_asked(home: cartier.Home, start: object) -> None:
    with pytest.raises(InputError, match="the start must be two finite numbers"):
        cartier.ask(home, "let me sit down", Unasked(), from_xy=start)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the start must be two finite numbers"):
        Conversation(home, Unasked(), from_xy=start)  # type: ignore[arg-type]


def test_a_start_may_be_an_array(home: cartier.Home) -> None:
    there = cartier.ask(home, "x", Says("chair"), from_xy=np.array([3.0, 1.0])).goal
    same = cartier.ask(home, "x", Says("chair"), from_xy=(3.0, 1.0)).goal
    assert there is not None and same is not None and there.length_m == same.length_m
    assert Conversation(home, Says("chair"), from_xy=np.array([3.0, 1.0])).say("x").goal is not None


@pytest.mark.parametrize("radius_m", [0.0, -1.0, math.nan, math.inf])
def test_a_robot_that_there_is_not_is_refused(radius_m: float) -> None:
    with pytest.raises(InputError, match="radius"):
        cartier.RobotModel(radius_m=radius_m)
    with pytest.raises(InputError, match="height"):
        cartier.RobotModel(camera_height_m=radius_m)


def test_absent_is_an_answer_without_a_place(home: cartier.Home) -> None:
    answer = cartier.ask(home, "take me to the moon", Says(None))
    assert answer.selection.status == "not_found" and answer.place is None and answer.goal is None


def test_a_reasoner_that_leaves_its_list_is_refused(home: cartier.Home) -> None:
    with pytest.raises(BackendError, match="not in the list"):
        cartier.ask(home, "x", Says("unicorn"))


def test_without_depth_the_viewpoint_answers_and_says_why_there_is_no_goal() -> None:
    home = map_home(walk(with_depth=False), TrueBoxes(THINGS))
    assert home.grid is None and any("bearings" in note for note in home.notes)
    answer = cartier.ask(home, "let me sit down", Says("chair"), index="object_viewpoint")
    assert answer.place is not None and answer.goal is None
    assert "without depth" in answer.notes[0] and "occupancy grid" in answer.notes[0]


def test_without_depth_objects_lie_where_bearings_meet() -> None:
    home = map_home(walk(with_depth=False), TrueBoxes(THINGS))
    assert set(home.names) == {obj.label for obj in THINGS}
    told = [obj for obj in home.objects if obj.located]
    assert told, "some were seen from several standpoints"
    for obj in told:
        assert min(box_distance(obj.position, t.box_min, t.box_max) for t in THINGS if t.label == obj.label) < 0.5
    once = walk(with_depth=False)
    once.poses = once.poses[:1]
    rows = map_home(once, TrueBoxes(THINGS)).to_dict()["objects"]
    assert rows and not any(row["located"] or row["on"] for row in rows)


def test_an_index_asked_for_that_cannot_be_built_is_an_error() -> None:
    once = walk(with_depth=False)
    once.poses = once.poses[:1]
    with pytest.raises(InputError, match="object_depth stayed empty"):
        map_home(once, TrueBoxes(THINGS), ["object_depth"])
    with pytest.raises(BackendError, match=r"did you mean 'object_depth'"):
        map_home(walk(), TrueBoxes(THINGS), ["objectdepth"])


def test_no_detections_and_no_frames_are_errors() -> None:
    with pytest.raises(InputError, match="found nothing in the 20 frames"):
        map_home(walk(), TrueBoxes([]))
    empty = walk()
    empty.poses = []
    with pytest.raises(InputError, match="no frames"):
        map_home(empty, TrueBoxes(THINGS))


def test_one_frame_at_a_time_is_asked_for_in_order() -> None:
    recording, seen = walk(), []
    map_home(recording, TrueBoxes(THINGS), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i + 1, 20) for i in range(20)]


class Dies(TrueBoxes):
    """Like TrueBoxes, but ends after so many frames, as a killed process does."""

    def __init__(self, frames: int) -> None:
        super().__init__(THINGS)
        self.left, self.asked = frames, 0

    def detect(self, frame: Frame) -> Detections:
        if self.asked >= self.left:
            raise KeyboardInterrupt
        self.asked += 1
        return super().detect(frame)


def test_a_killed_run_goes_on_where_it_stopped(tmp_path: Path, home: cartier.Home) -> None:
    resume = tmp_path / "unfinished.jsonl"
    with pytest.raises(KeyboardInterrupt):
        map_home(walk(), Dies(13), resume=resume)
    with resume.open("a") as file:
        file.write('{"frame": 13, "boxes_x')  # what a kill in the middle of a line leaves
    second = Dies(7)
    again = map_home(walk(), second, resume=resume)
    assert second.asked == 7
    assert {n: again.index()[1].locate(n) for n in again.names} == {n: home.index()[1].locate(n) for n in home.names}
    assert again.id == home.id
    third = Dies(100)
    map_home(walk(with_depth=False), third, resume=resume)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is a pipe"):  # and not a wait for ever
        map_home(walk(), second, resume=tmp_path / "pipe")
    assert third.asked == 20, "another recording takes nothing from the file"


def test_a_saved_home_is_the_same_home(tmp_path: Path, home: cartier.Home) -> None:
    home.save(tmp_path / "home")
    again = cartier.Home.load(tmp_path / "home")
    ours, theirs = (cartier.ask(h, "sit", Says("chair")).to_dict() | {"timing_ms": 0} for h in (home, again))
    assert ours == theirs
    assert again.id == home.id and again.objects == home.objects and again.to_dict() == home.to_dict()
    assert home.grid is not None and again.grid is not None and np.array_equal(again.grid.cells, home.grid.cells)
    photo = again.evidence(cartier.ask(again, "sit", Says("chair")).place)
    assert photo is not None and photo.shape == (120, 160, 3)


def _files(folder: Path) -> list[Path]:
    return sorted(f for f in folder.rglob("*") if f.is_file())


def read_all(folder: Path) -> None:
    home = cartier.Home.load(folder)
    dict(home.growth), dict(home.photos)  # read when asked for


@pytest.mark.parametrize("damage", ["gone", "cut", "rubbish", "bit"])
def test_any_damaged_file_is_named(damage: str, tmp_path: Path, home: cartier.Home) -> None:
    home.save(tmp_path / "home")
    for file in _files(tmp_path / "home"):
        if file.name == "occupancy.yaml":  # for Nav2: never read
            continue
        whole = file.read_bytes()
        flipped = whole[: len(whole) // 2] + bytes([whole[len(whole) // 2] ^ 4]) + whole[len(whole) // 2 + 1 :]
        file.unlink()
        if damage != "gone":
            file.write_bytes({"cut": whole[: len(whole) // 2], "rubbish": b"\xff\x00 rubbish", "bit": flipped}[damage])
        with pytest.raises(InputError) as caught:
            read_all(tmp_path / "home")
        assert "home" in str(caught.value) and "\n" not in str(caught.value)
        assert Store(tmp_path / "home").faults()
        file.write_bytes(whole)
    read_all(tmp_path / "home")
    assert Store(tmp_path / "home").faults() == []


def test_a_newer_home_and_a_foreign_folder_are_refused(tmp_path: Path, home: cartier.Home) -> None:
    home.save(tmp_path / "home")
    about = json.loads((tmp_path / "home" / "home.json").read_text())
    Store(tmp_path / "home").put(about | {"schema": 99}, {}, {})
    with pytest.raises(InputError, match="newer cartier"):
        cartier.Home.load(tmp_path / "home")
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter1.tex").write_text("precious")
    with pytest.raises(InputError, match=r"holds no home\.json"):
        home.save(precious)
    assert (precious / "chapter1.tex").read_text() == "precious"


def test_a_failed_save_leaves_the_old_home_and_nothing_else(
    tmp_path: Path, home: cartier.Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    home.save(tmp_path / "home")
    before = {f: f.read_bytes() for f in _files(tmp_path / "home")}

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    for target in ("home", "new"):
        with pytest.raises(InputError, match="cannot be written: No space left"):
            map_home(walk(), TrueBoxes(THINGS), ["object_depth"]).save(tmp_path / target)
    assert {f: f.read_bytes() for f in _files(tmp_path / "home")} == before
    assert [f.name for f in tmp_path.iterdir()] == ["home"]


def test_a_home_grows_by_a_second_recording_as_if_both_were_one(tmp_path: Path) -> None:
    whole = walk()
    halves = [
        RoomRecording(whole.poses[:12], THINGS, name="first"),
        RoomRecording(whole.poses[12:], THINGS, name="second"),
    ]
    names = ("object_depth", "object_viewpoint", "vlmaps")
    map_home(halves[0], TrueBoxes(THINGS), names).save(tmp_path / "home")
    grown = map_home(halves[1], TrueBoxes(THINGS), onto=Home.load(tmp_path / "home"))
    grown.save(tmp_path / "home")
    grown, together = Home.load(tmp_path / "home"), map_home(whole, TrueBoxes(THINGS), names)
    assert [(o.id, o.label, o.confirmed) for o in grown.objects] == [
        (o.id, o.label, o.confirmed) for o in together.objects
    ]
    assert together.names == sorted(obj.label for obj in THINGS)
    for index in names:
        for label in together.names:
            mine, theirs = grown.index(index)[1].locate(label), together.index(index)[1].locate(label)
            assert mine is not None and theirs is not None and mine.frame == theirs.frame
            np.testing.assert_allclose(mine.position, theirs.position, atol=1e-6)
            assert grown.evidence(mine) is not None
    assert grown.grid is not None and together.grid is not None
    assert (grown.grid.cells != together.grid.cells).mean() < 0.01, (
        "only the step from one recording to the other differs"
    )
    assert map_home(halves[1], TrueBoxes(THINGS), onto=grown) is grown, "it is in it already"
    unscaled = walk()
    unscaled.poses, unscaled.scale_guessed = unscaled.poses[:3], True
    with pytest.raises(InputError, match="where a scale is a guess, two recordings do not fit together"):
        map_home(unscaled, TrueBoxes(THINGS), onto=grown)
    other = TrueBoxes(THINGS)
    other.name = "another detector"
    with pytest.raises(InputError, match="add with the same detector"):
        map_home(whole, other, onto=grown)
