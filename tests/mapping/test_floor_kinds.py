"""Floor kinds: true labels come back per cell, textures are told apart, what is strange stays unknown."""

from __future__ import annotations

import random
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from cartier.errors import InputError
from cartier.types import FREE, Frame, OccupancyGrid
from cartier.types.route_rules import FLOOR_KINDS
from cartier_dollhouse import floor_kinds
from cartier_dollhouse.floor_kinds import FloorKindMapper, laid_out
from cartier_dollhouse.floors import kinds_at
from cartier_dollhouse.model import Scene

sys.path.append(str(Path(__file__).parents[2] / "tools"))
from fit_floor_kinds import random_frame, random_scene, true_classifier

FIRST = 5000  # scenes that nothing was fitted on


@cache
def looks(number: int) -> tuple[Scene, Frame]:
    scene = random_scene(random.Random(number))
    return scene, random_frame(scene, number)


def floor(scene: Scene) -> tuple[OccupancyGrid, npt.NDArray[np.uint8]]:
    """A free floor plan of a scene, and its true kinds."""
    shape = (112, 112)
    grid = OccupancyGrid(np.full(shape, FREE, np.int8), 0.05, (-0.25, -0.25), np.zeros(shape, np.float16))
    return grid, kinds_at(scene, grid.centre(np.moveaxis(np.indices(shape), 0, -1)))


def told(number: int, true: bool) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """What is told of the cells that a look shows, and the truth."""
    scene, frame = looks(number)
    mapper = FloorKindMapper(0.05, true_classifier(scene) if true else None)
    mapper.add(frame)
    grid, truth = floor(scene)
    kinds = mapper.kinds(grid)
    assert kinds is not None
    seen = (truth > 0) & (kinds > 0)
    return kinds[seen], truth[seen]


def test_true_labels_come_back() -> None:
    pairs = [told(FIRST + k, true=True) for k in range(6)]
    kinds, truth = (np.concatenate(side) for side in zip(*pairs, strict=True))
    assert len(kinds) > 3000 and (kinds == truth).mean() >= 0.97


def test_textures_are_told_apart() -> None:
    pairs = [told(FIRST + k, true=False) for k in range(12)]
    kinds, truth = (np.concatenate(side) for side in zip(*pairs, strict=True))
    assert len(kinds) > 3000 and (kinds == truth).mean() >= 0.85


@pytest.mark.parametrize("change", ["stripes", "plain"])
def test_what_is_like_no_floor_stays_unknown(change: str) -> None:
    scene, frame = looks(FIRST)
    rgb = np.full_like(frame.rgb, 128)
    if change == "stripes":
        rgb[:, np.arange(rgb.shape[1]) % 12 < 6] = 255
    mapper = FloorKindMapper(0.05)
    mapper.add(replace(frame, rgb=rgb))
    kinds = mapper.kinds(floor(scene)[0])
    assert kinds is not None and (kinds > 0).mean() < 0.02


def test_only_the_floor_is_laid_out() -> None:
    """A table half a metre high, a camera that looks up, and one that lies on the floor show none."""
    _, frame = looks(FIRST)
    assert laid_out(frame, 0.05) is not None
    assert frame.depth_m is not None
    assert laid_out(replace(frame, depth_m=frame.depth_m * np.float32(0.6)), 0.05) is None
    up = frame.world_from_camera.copy()
    up[:3, :3] = up[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    low = frame.world_from_camera.copy()
    low[2, 3] = 0.02
    assert all(laid_out(replace(frame, world_from_camera=pose), 0.05) is None for pose in (up, low))


def test_a_patch_lies_where_the_floor_is() -> None:
    """The border between two floors is where the truth has it, to a texel."""
    scene, frame = looks(FIRST + 1)
    patch = laid_out(frame, 0.05)
    assert patch is not None
    kinds = kinds_at(scene, patch.xy())
    rug = (kinds == FLOOR_KINDS.index("rug")) & patch.seen
    if rug.sum() > 100:
        assert np.median(patch.height_m[rug]) > 0.005 > np.median(patch.height_m[patch.seen & ~rug])


def test_floor_that_was_looked_at_often_is_not_looked_at_again() -> None:
    scene, frame = looks(FIRST)
    called: list[int] = []

    def counting(frame: Frame, patch: floor_kinds.Patch) -> npt.NDArray[np.float32]:
        called.append(1)
        return true_classifier(scene)(frame, patch)

    mapper = FloorKindMapper(0.05, counting)
    for _ in range(3 * floor_kinds.ENOUGH):
        mapper.add(frame)
    assert len(called) == floor_kinds.ENOUGH
    elsewhere = frame.world_from_camera.copy()
    elsewhere[:2, 3] += 8.0
    mapper.add(replace(frame, world_from_camera=elsewhere))
    assert len(called) == floor_kinds.ENOUGH + 1


def test_state_goes_on() -> None:
    whole, first, second = FloorKindMapper(0.05), FloorKindMapper(0.05), FloorKindMapper(0.05)
    frames = [looks(FIRST + k)[1] for k in range(3)]
    for frame in frames:
        whole.add(frame)
    first.add(frames[0])
    second.restore(first.state())
    for frame in frames[1:]:
        second.add(frame)
    grid = floor(looks(FIRST)[0])[0]
    one, other = whole.kinds(grid), second.kinds(grid)
    assert one is not None and other is not None and (one == other).all()


@pytest.mark.parametrize(
    "change",
    [
        {"votes": np.zeros((3, 3), np.int16)}, {"votes": np.zeros((3, 3, 6), np.float32)},
        {"votes": np.full((3, 3, 6), -1, np.int16)}, {"low": np.array([1e300, 0])}, {"low": np.array([2**62, 0])},
        {"resolution_m": np.array(0.1)},
    ],
)  # fmt: skip
def test_states_that_are_none_are_refused(change: dict[str, npt.NDArray[np.generic]]) -> None:
    with pytest.raises(InputError, match="floor kinds are damaged"):
        FloorKindMapper(0.05).restore(FloorKindMapper(0.05).state() | change)


def test_a_plan_elsewhere_gets_what_falls_into_it() -> None:
    scene, frame = looks(FIRST)
    mapper = FloorKindMapper(0.05, true_classifier(scene))
    mapper.add(frame)
    grid = floor(scene)[0]
    whole = mapper.kinds(grid)
    assert whole is not None
    part = replace(grid, cells=grid.cells[20:60, 30:90], height_m=grid.height_m[20:60, 30:90], origin_xy=(1.25, 0.75))
    found = mapper.kinds(part)
    assert found is not None and (found == whole[20:60, 30:90]).all() and found.any()
    away = mapper.kinds(replace(grid, origin_xy=(500.0, 500.0)))
    assert away is not None and not away.any()


def test_nothing_seen_is_nothing_known() -> None:
    assert FloorKindMapper(0.05).kinds(floor(looks(FIRST)[0])[0]) is None
    assert len(FLOOR_KINDS) - 1 == floor_kinds.KNOWN


@pytest.mark.parametrize(("strange", "known"), [(2, True), (9, False)])
def test_floors_of_another_world_stay_unknown(strange: int, known: bool) -> None:
    """Ten looks at each cell that speak for tiles, and so many more that are like no floor."""
    votes = np.full((20, 20, floor_kinds.KNOWN + 2), -640, np.int16)
    votes[..., 0], votes[..., floor_kinds.KNOWN], votes[..., floor_kinds.STRANGE] = 0, 10, strange
    mapper = FloorKindMapper(0.05)
    mapper.restore(mapper.state() | {"votes": votes, "low": np.array([0, 0])})
    kinds = mapper.kinds(floor(looks(FIRST)[0])[0])
    assert kinds is not None and bool((kinds == FLOOR_KINDS.index("tiles")).any()) is known
