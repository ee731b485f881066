"""Every fault, put in one at a time, is named, and nothing else; what can be repaired is well afterwards."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import published
import pytest
from faulty_recordings import INJECTED, Faulty, Kept, Thor, deep, leap, posed, rotated, seen

from cartier import plugins
from cartier.contracts import Recording
from cartier.doctor import FAULTS, Report, draw_report, examine, open_for_doctor, repair
from cartier.errors import InputError, check_pose
from cartier.mapping.samples import MAX_FRAMES, chosen, is_mirror_fault, is_pose_fault
from cartier.recordings.folder import save
from cartier_bench.datasets import sevenscenes

ONE_OF_EACH = [
    "inverted", "opengl", "mirrored y", "poses in mm", "depth x 1000", "depth 24 px right", "intrinsics x 2",
    "late by 1",
    "black depth", "scaled rotations", "tilted 12 degrees", "turned to the right", "jump of one frame", "blurred",
    "5 frames",
]  # fmt: skip
UNREPAIRABLE = {"black depth", "blurred", "5 frames"}


@pytest.fixture(scope="module")
def dollhouse() -> Recording:
    """A small walk through a built-in home, which needs no files."""
    return seen("studio", 1.5)


@pytest.fixture(scope="module")
def raw_kitchen(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A kitchen as 7-Scenes publishes one, by a reader that leaves its depth beside the colour and says so."""
    walk, folder = published.kitchen(40), tmp_path_factory.mktemp("7scenes") / "kitchen"
    published.write_sevenscenes(walk, folder, range(len(walk)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sevenscenes, "LEAST_FIT", 1.0)
        recording: Any = plugins.open_recording(folder)
    recording.known_registration = sevenscenes.REGISTRATION
    return cast(Recording, recording)


@pytest.fixture(scope="module")
def kitchen(raw_kitchen: Recording) -> Recording:
    """The same with its depth moved onto its colour."""
    return Kept(repair(raw_kitchen, examine(raw_kitchen)))


@pytest.fixture(scope="module")
def thor(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """AI2-THOR's conventions: a square picture of 90 degrees, 8-bit depth that ends at 5 m, and poses of Unity."""
    published.write_thor("101", folder := tmp_path_factory.mktemp("thor"))
    return Kept(Thor(folder))


@pytest.fixture(params=["dollhouse", "kitchen", "thor"])
def home(request: pytest.FixtureRequest) -> Recording:
    recording: Recording = request.getfixturevalue(request.param)
    return recording


def names(report: Report) -> list[str]:
    return [fault.fault for fault in report.faults]


def test_one_injection_for_each_fault() -> None:
    assert {INJECTED[name][0] for name in ONE_OF_EACH} == set(FAULTS)


def test_a_sound_recording_is_called_sound(home: Recording) -> None:
    report = examine(home)
    assert report.to_dict() == {"ok": True, "faults": []}
    with pytest.raises(InputError, match="nothing to repair"):
        repair(home, report)


ON_DISK = ["kitchen", "thor"]


@pytest.mark.parametrize(
    "place, injected", [("dollhouse", name) for name in ONE_OF_EACH] + [*zip(itertools.cycle(ON_DISK), ONE_OF_EACH)]
)
def test_a_fault_is_named_and_repaired(place: str, injected: str, request: pytest.FixtureRequest) -> None:
    """Those on disk take turns here; benchmarks/doctor.py puts every fault into every recording."""
    home: Recording = request.getfixturevalue(place)
    fault, inject = INJECTED[injected]
    faulty = inject(home)
    report = examine(faulty)
    assert names(report) == [fault], report.faults
    found = report.to_dict()["faults"][0]
    assert found.keys() == {"fault", "evidence", "repair"}
    assert any(c.isdigit() for c in found["evidence"]) or injected == "scaled rotations"
    if injected in UNREPAIRABLE:
        with pytest.raises(InputError):
            repair(faulty, report)
    elif home.name.startswith("dollhouse"):  # on the others benchmarks/doctor.py does it; a test should be quick
        again = examine(repair(faulty, report))
        assert again.ok, again.faults


def test_unregistered_depth_is_known_as_published(raw_kitchen: Recording) -> None:
    """7-Scenes' depth is the infrared camera's own; its colour camera has 0.9 of that focal length."""
    report, raw_fx = examine(raw_kitchen), raw_kitchen.camera.fx
    assert report.ok and any("this data set is published" in note for note in report.notes)
    assert repair(raw_kitchen, report).camera.fx == pytest.approx(0.91 * raw_fx, rel=0.03)


@pytest.mark.parametrize("injected", ["turned to the left", "upside down", "y up", "tilted 12 degrees"])
def test_a_world_is_tipped_only_where_it_leans(home: Recording, injected: str) -> None:
    fault, inject = INJECTED[injected]
    faulty = inject(home)
    report = examine(faulty)
    assert names(report) == [fault], report.faults
    assert "--up" not in report.faults[0].repair  # this reader has no such option
    repaired, way = repair(faulty, report), []
    assert (repaired.camera.width, repaired.camera.height) == (home.camera.width, home.camera.height)
    for i in (0, len(home) // 2):
        up = home[i].world_from_camera[2, :3]  # the world's up as the camera has it
        assert np.allclose(repaired[i].world_from_camera[2, :3], up, atol=0.03)
        way.append(repaired[i].world_from_camera[:2, 3] - home[i].world_from_camera[:2, 3])
        if fault == "rotated_images":
            assert np.array_equal(repaired[i].rgb, home[i].rgb)
            assert np.array_equal(repaired[i].depth_m, home[i].depth_m, equal_nan=True)
    if fault == "rotated_images":
        assert np.allclose(way, 0, atol=1e-9)


def test_depth_that_was_never_there_is_no_fault(dollhouse: Recording) -> None:
    report = examine(Faulty(dollhouse, lambda frame, _: replace(frame, depth_m=None)))
    assert report.ok and report.faults == ()
    assert any("no frame has a depth image" in note and "without a floor plan" in note for note in report.notes)


@pytest.mark.parametrize("turns", [1, 3])
def test_pictures_on_their_side_are_known_without_depth(dollhouse: Recording, turns: int) -> None:
    blind = Faulty(dollhouse, lambda frame, _: replace(frame, depth_m=None))
    assert names(examine(rotated(turns)(blind))) == ["rotated_images"]


@pytest.mark.parametrize(
    "injected", ["inverted", "opengl", "pictures turned, poses not", "late by 1", "depth x 5", "intrinsics / 2"]
)
def test_repair_undoes_the_fault(dollhouse: Recording, injected: str) -> None:
    faulty = INJECTED[injected][1](dollhouse)
    repaired = repair(faulty, examine(faulty))
    frame, true = repaired[20], dollhouse[20]
    assert np.allclose(frame.world_from_camera, true.world_from_camera, atol=1e-9)
    assert np.allclose(frame.depth_m, true.depth_m, rtol=0.02, equal_nan=True)
    assert repaired.camera.fx == pytest.approx(dollhouse.camera.fx)


def test_no_unit_is_guessed(dollhouse: Recording) -> None:
    faulty = deep(lambda depth_m, _: depth_m / np.float32(3.4))(dollhouse)
    report = examine(faulty)
    assert "depth_scale" in names(report)
    repaired = repair(faulty, report)
    far_m = [np.nanmedian([np.nanmedian(of[k].depth_m) for k in range(5)]) for of in (faulty, repaired)]
    assert far_m[1] < 2 * far_m[0]


def test_a_mirrored_world_is_set_upright(thor: Recording) -> None:
    faulty = INJECTED["unity"][1](thor)
    repaired = repair(faulty, examine(faulty))
    heights = [repaired[i].world_from_camera[2, 3] for i in range(0, len(repaired), 9)]
    assert np.allclose(heights, thor[0].world_from_camera[2, 3], atol=0.05)
    assert repaired.truth is None


def test_two_faults_are_both_found(dollhouse: Recording) -> None:
    both = INJECTED["depth / 1000"][1](INJECTED["inverted"][1](dollhouse))
    report = examine(both)
    assert names(report) == ["inverted_poses", "depth_scale"]
    assert examine(repair(both, report)).ok


def test_a_jump_for_good_keeps_the_longest_piece_and_a_stray_frame_is_left_out(dollhouse: Recording) -> None:
    for_good = posed(leap(15, 10**6, 1.0))(dollhouse)
    repaired = repair(for_good, examine(for_good))
    assert len(repaired) == len(dollhouse) - 15
    stray = posed(leap(25, 25, 1.0))(dollhouse)
    assert len(repair(stray, examine(stray))) == len(dollhouse) - 1


def test_repaired_recording_is_saved_and_read(dollhouse: Recording, tmp_path: Path) -> None:
    faulty = INJECTED["inverted"][1](Faulty(dollhouse, numbers=range(0, len(dollhouse), 2)))
    save(faulty, tmp_path / "in")
    opened = open_for_doctor(tmp_path / "in")
    assert not isinstance(opened, Report)
    report = examine(opened)
    assert names(report) == ["inverted_poses"]
    repaired = repair(opened, report)
    save(repaired, tmp_path / "out")
    again = plugins.open_recording(tmp_path / "out")
    assert examine(again).ok
    assert any("repaired by cartier doctor: inverted_poses" in note for note in again.notes)
    assert repaired.fingerprint() != opened.fingerprint()


def test_poses_that_a_reader_refuses_are_a_finding(dollhouse: Recording, tmp_path: Path) -> None:
    save(Faulty(dollhouse, numbers=range(9)), tmp_path / "in")
    file = tmp_path / "in" / "trajectory.txt"
    lines = file.read_text().splitlines()
    lines[3] = "1.0 0 0 0 0 0 0 0"
    file.write_text("\n".join(lines) + "\n")
    report = open_for_doctor(tmp_path / "in")
    assert isinstance(report, Report)
    assert names(report) == ["bad_rotation"] and "line 4" in report.faults[0].evidence
    (tmp_path / "in" / "recording.json").write_text("{}")
    with pytest.raises(InputError, match="schema"):
        open_for_doctor(tmp_path / "in")


BAD_POSES: dict[str, Callable[[], np.ndarray]] = {
    "shape": lambda: np.eye(3),
    "nan": lambda: np.full((4, 4), np.nan),
    "last row": lambda: np.ones((4, 4)),
    "scaled": lambda: np.diag([2.0, 2, 2, 1]),
    "mirrored": lambda: np.diag([1.0, -1, 1, 1]),
}


@pytest.mark.parametrize("kind", BAD_POSES)
def test_each_refusal_of_a_pose_is_known_as_one(kind: str) -> None:
    """Holds the doctor's reading of messages to the messages of ``check_pose``."""
    with pytest.raises(InputError) as caught:
        check_pose(BAD_POSES[kind]())
    assert is_pose_fault(caught.value)
    assert is_mirror_fault(caught.value) == (kind == "mirrored")


def test_a_fault_of_a_file_is_raised_as_it_is(dollhouse: Recording) -> None:
    class Broken(Faulty):
        def __getitem__(self, index: int):  # type: ignore[no-untyped-def]
            raise InputError("rgb/000000.jpg is damaged")

    with pytest.raises(InputError, match="damaged"):
        examine(Broken(dollhouse))


def test_frames_that_disagree_for_no_known_reason_are_not_called_sound(dollhouse: Recording) -> None:
    from scipy.spatial.transform import Rotation

    def anywhere(pose: np.ndarray, i: int) -> np.ndarray:
        there = pose.copy()
        turn = Rotation.from_euler("z", np.random.default_rng(i).uniform(0, 360), degrees=True).as_matrix()
        there[:3, :3] = turn @ pose[:3, :3]
        return there

    report = examine(posed(anywhere)(dollhouse))
    assert not report.ok
    assert any("disagree" in note for note in report.notes) or report.faults


def test_all_poses_bad_and_no_frame_at_all(dollhouse: Recording) -> None:
    all_bad = posed(lambda pose, i: pose @ np.diag([3.0, 3, 3, 1]))(dollhouse)
    report = examine(all_bad)
    assert names(report) == ["bad_rotation"] and "40 of 40" in report.faults[0].evidence
    assert names(examine(Faulty(dollhouse, numbers=[]))) == ["too_few_views"]


def test_progress_and_json_and_picture(dollhouse: Recording, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    faulty = INJECTED["opengl"][1](dollhouse)
    report = examine(faulty, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (40, 40)
    assert json.loads(json.dumps(report.to_dict()))["ok"] is False
    for name, shown in (("a.png", report), ("b.svg", examine(INJECTED["depth 24 px right"][1](dollhouse)))):
        draw_report(faulty, shown, tmp_path / name)
        assert (tmp_path / name).stat().st_size > 20_000
    with pytest.raises(InputError, match="cannot draw"):
        draw_report(faulty, report, tmp_path / "c.doc")


def test_a_long_recording_is_looked_at_in_runs() -> None:
    numbers = chosen(12_345)
    assert len(numbers) == MAX_FRAMES and numbers[0] == 0 and numbers[-1] == 12_344
    assert sum(b - a != 1 for a, b in itertools.pairwise(numbers)) == 9
    assert chosen(7) == list(range(7))
