"""The doctor reports no fault in a sound recording, and applies only repairs that other frames confirm."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from faulty_recordings import INJECTED, Faulty, deep, joined, seen

from cartier import cli
from cartier.contracts import Recording
from cartier.doctor import Report, examine, repair
from cartier.errors import InputError
from cartier.recordings.folder import save


def names(report: Report) -> list[str]:
    return [fault.fault for fault in report.faults]


@pytest.mark.parametrize(
    "home, sensor, eye_m",
    [("old_couple", False, 0.2), ("118", True, 0.2), ("118", False, 1.5), ("old_couple", True, 1.5)],
)
def test_no_alarm_over_a_sound_walk_alone_or_joined_with_another(home: str, sensor: bool, eye_m: float) -> None:
    """A slice of what benchmarks/doctor.py does with all homes and more heights."""
    one = seen(home, eye_m, sensor)
    for recording in (one, joined(one, seen("studio", eye_m, sensor))):
        report = examine(recording)
        assert report.to_dict() == {"ok": True, "faults": []}
        assert len(report.notes) == 1, "no doubt either"


@pytest.mark.parametrize("home, eye_m", [("studio", 0.3), ("118", 1.5)])
def test_a_turn_by_90_degrees_on_the_spot_is_no_jump(home: str, eye_m: float) -> None:
    """The first frames turn by 30° each; with two of them left out there is no common view before and after."""
    whole = seen(home, eye_m)
    for last in (1, 2, 5):
        turned = Faulty(whole, numbers=[*range(last + 1), *range(last + 3, len(whole))])
        assert names(examine(turned)) == []


def test_missing_frames_are_no_jump() -> None:
    """A step over dropped frames is longer, and noisy depth alone makes no step of 0.5 m a jump."""
    thinned = seen("118", 0.2)
    for seed in range(2):
        kept = np.random.default_rng(seed).permutation(len(thinned))[: int(0.7 * len(thinned))]
        assert names(examine(Faulty(thinned, numbers=sorted(kept.tolist())))) == []
    blurred = INJECTED["every 3rd blurred"][1](seen("old_couple", 1.5, sensor=True))
    assert names(examine(repair(blurred, examine(blurred)))) == []


def test_poses_in_millimetres_are_called_that_and_the_depth_is_left_alone() -> None:
    whole = seen("studio", 1.5)
    faulty = INJECTED["poses in mm"][1](whole)
    report = examine(faulty)
    assert names(report) == ["pose_scale"] and "poses in millimetres" in report.faults[0].evidence
    repaired = repair(faulty, report)
    assert np.allclose(repaired[30].world_from_camera, whole[30].world_from_camera, atol=1e-9)
    assert np.array_equal(repaired[30].depth_m, whole[30].depth_m, equal_nan=True)


@pytest.mark.parametrize("injected", ["opengl", "mirrored y"])
def test_what_a_level_camera_cannot_tell_apart_the_world_that_stands_upright_decides(injected: str) -> None:
    fault, inject = INJECTED[injected]
    report = examine(inject(seen("studio", 0.3)))
    assert names(report) == [fault]


def test_jumps_are_looked_for_once_the_depth_lies_on_the_colour() -> None:
    assert names(examine(INJECTED["depth zoomed 1.1"][1](seen("studio", 0.3)))) == ["depth_not_registered"]


def wrong_where_it_is_chosen() -> Recording:
    """Depth five times too large in the first and last third of 38 frames: the frames that choose a reading."""
    whole = seen("104", 1.5)
    return deep(lambda depth, i: depth * np.float32(1 if i * 3 // len(whole) == 1 else 5))(whole)


def test_no_repair_that_other_frames_contradict() -> None:
    recording = wrong_where_it_is_chosen()
    report = examine(recording)
    assert not report.ok and "depth_scale" not in names(report)
    assert any("other frames contradict that" in note for note in report.notes)
    with pytest.raises(InputError, match="other frames contradict that"):
        repair(recording, report)


@pytest.mark.parametrize("kind", ["sound", "contradicts itself", "5 frames"])
def test_fix_without_a_repair_is_one_line(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = seen("studio", 1.5)
    numbers = list(range(5)) if kind == "5 frames" else range(len(whole))
    save(
        wrong_where_it_is_chosen() if kind == "contradicts itself" else Faulty(whole, numbers=numbers), tmp_path / "in"
    )
    words = ("cartier", "doctor", tmp_path / "in", "--fix", "-o", tmp_path / "out")
    monkeypatch.setattr(sys, "argv", [*map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    out, err = capsys.readouterr()
    assert ended.value.code == 1 and [path.name for path in tmp_path.iterdir()] == ["in"]
    said = [line for line in err.splitlines() if line.strip()]
    assert len(said) == 1 and "nothing to repair" in said[0] and "Traceback" not in out + err
