"""A live session in a frame of its own, moved onto a home of another day."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from test_session import Scripted

import cartier
from another_day import ANOTHER_DAY, MOVED, OTHER_THINGS, ROOM_THINGS, mapped, rounds
from cartier import Live
from cartier.errors import InputError
from cartier.io.spool import Spool
from cartier.types.streams import Event, PoseUpdate, Stamped
from synthetic import TrueBoxes


@pytest.fixture(scope="module")
def old() -> cartier.Home:
    return mapped(rounds(ROOM_THINGS, 0.0, 1.1), ROOM_THINGS)


def events(by: np.ndarray = MOVED, update: bool = False) -> Iterator[Event]:
    """A walk, moved; with ``update``, its poses are wrong at first, and corrected."""
    walk = rounds(ROOM_THINGS, 0.1, 0.9)
    wrong = np.eye(4)
    wrong[:2, 3] = (0.4, -0.3)
    for number in range(len(walk)):
        frame = walk[number]
        pose = by @ (wrong @ frame.world_from_camera if update and number < 8 else frame.world_from_camera)
        sent = cartier.Frame(number, number / 10, frame.rgb, frame.depth_m, pose, frame.camera, frame.instances)
        yield Stamped(sent, number * 10**8)
        if update and number == 7:
            yield PoseUpdate({k * 10**8: by @ walk[k].world_from_camera for k in range(8)}, "/mapPath")


def run(stream: Iterator[Event], old: cartier.Home, spool: Path | None = None) -> tuple[Live, cartier.Home]:
    live = Live(Scripted(stream), TrueBoxes(ROOM_THINGS), onto=old, align=True, every=1, spool=spool)
    live.start()
    return live, live.wait()


@pytest.mark.parametrize("update", [False, True])
def test_a_session_is_moved_onto_the_home(update: bool, old: cartier.Home, tmp_path: Path) -> None:
    live, grown = run(events(update=update), old, tmp_path / "a.spool")
    assert live.frame_epoch >= 1 + update
    known = {obj.id: obj for obj in old.objects}
    assert {obj.id for obj in grown.objects} <= known.keys()
    for obj in grown.objects:
        np.testing.assert_allclose(obj.position, known[obj.id].position, atol=0.2)
    row = grown.settings["recordings"][-1]
    assert row["frames"] == 24 and len(row["moved"]) == 4
    spool = Spool(tmp_path / "a.spool")
    kept = spool.keyframe(spool.keyframes()[2]).frame.world_from_camera
    np.testing.assert_allclose(kept, ANOTHER_DAY[2].world_from_camera, atol=1e-6)
    assert len(old.settings["recordings"]) == 1


def test_the_spool_stays_in_the_frame_of_the_robot(old: cartier.Home, tmp_path: Path) -> None:
    def stream() -> Iterator[Event]:
        for number, event in enumerate(events()):
            if number == 20:
                until_s = time.monotonic() + 60
                while live._map.apart and time.monotonic() < until_s:
                    time.sleep(0.01)
                assert not live._map.apart
            yield event

    live = Live(
        Scripted(stream()), TrueBoxes(ROOM_THINGS), onto=old, align=True, every=1, spool=tmp_path / "a.spool"
    )  # fmt: skip
    live.start()
    live.wait()
    spool = Spool(tmp_path / "a.spool")
    kept = [spool.keyframe(place).frame.world_from_camera for place in spool.keyframes()]
    np.testing.assert_allclose(kept, [frame.world_from_camera for frame in ANOTHER_DAY], atol=1e-6)


def test_another_room_is_refused_and_its_frames_are_kept(old: cartier.Home, tmp_path: Path) -> None:
    walk = rounds(OTHER_THINGS, 0.1, 0.9)
    stream = (Stamped(walk[number], number * 10**8) for number in range(len(walk)))
    live = Live(Scripted(stream), TrueBoxes(OTHER_THINGS), onto=old, align=True, every=1, spool=tmp_path / "a.spool")
    live.start()
    with pytest.raises(InputError, match=r"cannot be aligned.*cartier map .*a\.spool -o OTHER") as refused:
        live.wait()
    assert "\n" not in str(refused.value)
    assert len(Spool(tmp_path / "a.spool").unsaved()) == len(walk)
    assert any("own frame" in note for note in live.home().notes)
