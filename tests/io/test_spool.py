"""The spool: what is written is read, whatever a kill leaves at its end is passed over, and one goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartier import plugins
from cartier.errors import InputError
from cartier.io.spool import HEAD, MAGIC, Keyframe, Spool, SpoolWriter
from cartier.testing import check_recording
from synthetic import THINGS, TrueBoxes, walk

WALK, EYES = walk(), TrueBoxes(THINGS)


def kept(number: int) -> Keyframe:
    frame = WALK[number]
    odometry = frame.world_from_camera.copy()
    odometry[0, 3] += 1 / 3
    seen = EYES.detect(frame)
    if number > 1:
        masks = np.random.default_rng(number).random((len(seen.scores), *frame.rgb.shape[:2])) < 0.3
        seen = replace(seen, masks=masks)
    return Keyframe(frame, 10**9 + number, seen, odometry if number % 2 else None)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "home.spool"
    writer = SpoolWriter(path, {"name": "walk"})
    for number in range(4):
        writer.keyframe(kept(number))
    writer.poses("/mapPath", {10**9: WALK[1].world_from_camera})
    writer.close()
    return path


def numbers(spool: Spool) -> list[int]:
    return [spool.keyframe(place).frame.index for place in spool.keyframes()]


def test_what_is_written_is_read(written: Path) -> None:
    spool = Spool(written)
    assert spool.begin() == {"name": "walk"}
    assert numbers(spool) == [0, 1, 2, 3]
    for number, place in enumerate(spool.keyframes()):
        read, true = spool.keyframe(place), kept(number)
        pose = WALK[number or 1].world_from_camera  # that of the first was corrected
        np.testing.assert_array_equal(read.frame.world_from_camera, pose)
        np.testing.assert_allclose(read.frame.depth_m, true.frame.depth_m, atol=0.00051)
        assert np.abs(read.frame.rgb.astype(int) - true.frame.rgb).mean() < 3
        assert (read.stamp_ns, read.frame.time_s, read.frame.camera) == (10**9 + number, number / 10, WALK.camera)
        assert read.detections.labels == true.detections.labels
        np.testing.assert_array_equal(read.detections.boxes_xyxy, true.detections.boxes_xyxy)
        if true.odom_from_camera is None:
            assert read.odom_from_camera is None
        else:
            np.testing.assert_array_equal(read.odom_from_camera, true.odom_from_camera)
        np.testing.assert_array_equal(read.detections.masks, true.detections.masks)
    ((origin, poses),) = spool.updates()
    assert origin == "/mapPath"
    np.testing.assert_array_equal(poses[10**9], WALK[1].world_from_camera)


def test_it_is_a_recording(written: Path) -> None:
    check_recording(lambda: plugins.open_recording(written))
    recording = plugins.open_recording(written)
    assert recording.name == "walk"
    assert len(recording) == 4
    assert recording.detections(2).labels == EYES.detect(WALK[2]).labels


def test_empty_record_is_a_torn_tail(tmp_path: Path) -> None:
    """A computer that dies leaves zeros behind the marker, of which the checksum is zero, too."""
    path = tmp_path / "home.spool"
    writer = SpoolWriter(path, {})
    writer.keyframe(kept(0))
    writer.close()
    begin = path.read_bytes().rindex(b"CKF\x01")
    path.write_bytes(path.read_bytes() + path.read_bytes()[begin : begin + 5] + b"\0" * 40)
    assert numbers(Spool(path)) == [0]


@given(st.data())
@settings(max_examples=30, deadline=None)
def test_a_torn_tail_costs_the_last_record_alone(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    path = tmp_path_factory.mktemp("spool") / "home.spool"
    ends, begins, seen = [], [], []
    writer = SpoolWriter(path, {})
    for number in range(3):
        begins.append(path.stat().st_size)
        place = writer.keyframe(kept(number))
        ends.append(place.start + place.length)
        seen.append(path.stat().st_size)
    writer.close()
    whole = path.read_bytes()
    cut = data.draw(st.integers(0, len(whole)))
    garbage = data.draw(st.sampled_from([b"", b"\0" * 40, b"CKF\x01" * 9, whole[begins[1] : begins[1] + 30]]))
    path.write_bytes(whole[:cut] + garbage if cut > len(MAGIC) else whole[:cut])
    complete = sum(cut >= end for end in ends)
    if cut >= len(MAGIC):
        spool = Spool(path)
        assert numbers(spool) == list(range(complete))
        looked = [spool.keyframe(place).detections is not None for place in spool.keyframes()]
        assert looked == [cut >= end for end in seen[:complete]]
    writer = SpoolWriter(path, {})
    writer.keyframe(kept(7))
    writer.close()
    spool = Spool(path)
    assert numbers(spool) == [*range(complete), 7]
    assert spool.damaged == 0


def test_damage_in_the_middle_costs_one_record(written: Path) -> None:
    data = bytearray(written.read_bytes())
    place = Spool(written).keyframes()[1]
    data[place.start + 100] ^= 1
    written.write_bytes(bytes(data))
    spool = Spool(written)
    assert numbers(spool) == [0, 2, 3]
    assert spool.damaged == 1
    assert "1 damaged records left out" in plugins.open_recording(written).notes


def test_what_is_no_spool_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.spool"
    path.write_bytes(b"a file of somebody else")
    with pytest.raises(InputError, match="is no spool"):
        SpoolWriter(path, {})
    assert path.read_bytes() == b"a file of somebody else"


def test_a_record_that_claims_too_much_is_no_record(written: Path) -> None:
    whole = written.read_bytes()
    written.write_bytes(whole + HEAD.pack(b"CKF\x01", 2, 2**32 - 1, 0) + b"x" * 100)
    assert Spool(written).end == len(whole)


def test_an_empty_session_is_no_recording(tmp_path: Path) -> None:
    SpoolWriter(tmp_path / "a.spool", {}).close()
    with pytest.raises(InputError, match="holds no keyframe yet"):
        plugins.open_recording(tmp_path / "a.spool")
