"""The map of objects: laws that hold for any order of frames, and its evidence for and against."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.home.old_names import OLD_GROWTH
from cartier.io.files import json_bytes, npz_bytes, read_npz
from cartier.mapping.bearings import BearingGeometry
from cartier.mapping.existence import posterior
from cartier.mapping.extent import DepthGeometry, Geometry
from cartier.mapping.object_map import ObjectMap
from cartier.types import DetectorScoreModel, MapObject, TrueObject
from synthetic import THINGS, RoomRecording, TrueBoxes, box, walk

TWO_MUGS = (box(21, "mug", (2.0, 2.0, 0.6), (2.1, 2.1, 0.75)), box(22, "mug", (2.25, 2.0, 0.6), (2.35, 2.1, 0.75)))


def mapped(recording: RoomRecording, objects: Sequence[TrueObject] = THINGS, order: Iterable[int] = ()) -> ObjectMap:
    detector, made = TrueBoxes(objects), ObjectMap(TrueBoxes.score_model)
    for number in order or range(len(recording)):
        made.add(recording[number], detector.detect(recording[number]))
    made.merge_and_prune()
    return made


def told(objects: Iterable[MapObject]) -> list[tuple[str, bool]]:
    return sorted((obj.label, obj.confirmed) for obj in objects)


def test_each_object_is_mapped_once() -> None:
    objects = mapped(walk()).objects()
    assert sorted(obj.label for obj in objects) == sorted(obj.label for obj in THINGS)
    for obj in objects:
        true = next(t for t in THINGS if t.label == obj.label)
        assert np.linalg.norm(np.subtract(obj.position, np.add(true.box_min, true.box_max) / 2)) < 0.4
        assert obj.confirmed and 0 < obj.n_detected <= obj.n_observable


@pytest.mark.parametrize("seed", range(3))
def test_frame_order_and_repeats_change_nothing(seed: int) -> None:
    recording = walk()
    shuffled = np.random.default_rng(seed).permutation(len(recording)).tolist()
    once = told(mapped(recording).objects())
    assert told(mapped(recording, order=shuffled).objects()) == once
    assert told(mapped(recording, order=[*range(len(recording))] * 2).objects()) == once


def test_alike_neighbours_stay_two() -> None:
    recording = walk()
    both = RoomRecording(recording.poses, TWO_MUGS, name="two")
    assert [obj.label for obj in mapped(both, TWO_MUGS).objects()] == ["mug", "mug"]


def test_fragments_of_a_chair_merge() -> None:
    """What shows of it never touches; but together it is as large as the other chairs, and no frame shows both."""
    whole = tuple(box(40 + k, "chair", (1.0 + k, 3.0, 0.0), (1.45 + k, 3.5, 0.9)) for k in range(3))
    front, back = (
        box(50, "chair", (4.0, 3.0, 0.0), (4.45, 3.06, 0.3)),
        box(51, "chair", (4.0, 3.44, 0.3), (4.45, 3.5, 0.9)),
    )
    poses, made = walk().poses, ObjectMap(TrueBoxes.score_model)
    shown = [0]
    for half in (front, back):
        objs = (*whole, half)
        for frame in RoomRecording(poses, objs, name="half"):  # type: ignore[attr-defined]
            seen = TrueBoxes(objs).detect(frame)
            shown[-1] += "chair" in seen.labels
            made.add(frame, seen)
    made.merge_and_prune()
    assert shown[0] and [obj.label for obj in made.objects()] == ["chair"] * 4


def test_missed_objects_become_less_likely() -> None:
    cautious = DetectorScoreModel(beta_true=(2.0, 1.0), beta_false=(0.3, 6.0), prior_log_odds=-1.0)
    detector, made, recording = TrueBoxes(THINGS), ObjectMap(cautious), walk()
    first = detector.detect(recording[0])
    made.add(recording[0], first)
    at_once = {obj.label: obj.probability for obj in made.objects()}
    for number in range(1, len(recording)):
        made.add(recording[number], detector.detect(recording[number]).keep(np.zeros(0, int)))
    doubted = [obj for obj in made.objects() if obj.n_observable > 3]
    assert {obj.label for obj in doubted} == set(at_once) == {"chair"}
    assert all(obj.n_detected == 1 and obj.probability < at_once[obj.label] for obj in doubted)


def test_frames_from_one_viewpoint_count_little() -> None:
    cautious = DetectorScoreModel(beta_true=(2.0, 1.0), beta_false=(0.3, 6.0), prior_log_odds=-1.0)
    tried = np.zeros((2, 36), np.float32)
    tried[:, 0] = 1, 1000
    few, many = posterior(tried, tried, np.full(2, 0.1), cautious)
    assert many < 1 - (1 - few) / 6


@pytest.mark.parametrize("geometry", [DepthGeometry, BearingGeometry])
def test_restored_state_goes_on_as_before(geometry: type[Geometry]) -> None:
    detector, recording = TrueBoxes(THINGS), walk(with_depth=geometry.with_depth)
    whole, half, rest = (ObjectMap(TrueBoxes.score_model, geometry=geometry) for _ in range(3))
    for number in range(len(recording)):
        if number == 10:
            rest.restore(half.state())
        frame = recording[number]
        whole.add(frame, detector.detect(frame))
        (half if number < 10 else rest).add(frame, detector.detect(frame))
    assert rest.objects() == whole.objects()
    with pytest.raises(InputError, match="damaged"):
        ObjectMap(TrueBoxes.score_model, geometry=geometry).restore(half.state() | {"object_map.json": b"{}"})


@pytest.mark.parametrize("geometry", [DepthGeometry, BearingGeometry])
def test_state_of_cartier_0_1_0_loads(geometry: type[Geometry]) -> None:
    detector, recording = TrueBoxes(THINGS), walk(with_depth=geometry.with_depth)
    today, read = (ObjectMap(TrueBoxes.score_model, geometry=geometry) for _ in range(2))
    for number in range(len(recording)):
        today.add(recording[number], detector.detect(recording[number]))
    state, old = today.state(), {new: old for old, new in OLD_GROWTH.items()}
    arrays = {old.get(name, name): column for name, column in read_npz(state["object_map.npz"]).items()}
    about = {old.get(name, name): part for name, part in json.loads(state["object_map.json"]).items()}
    assert {"sightings", "chances", "tried", "hits", "low", "high", "reach_low", "reach_high"} <= arrays.keys()
    assert "together" in about
    read.restore({"object_map.npz": npz_bytes(**arrays), "object_map.json": json_bytes(about)})
    assert read.objects() == today.objects() and read.state() == state


def test_map_without_patches_keeps_its_boxes_and_grows() -> None:
    """Homes written before boxes were fitted to views."""
    detector, recording = TrueBoxes(THINGS), walk()
    today, read = (ObjectMap(TrueBoxes.score_model) for _ in range(2))
    for number in range(10):
        today.add(recording[number], detector.detect(recording[number]))
    arrays = read_npz(today.state()["object_map.npz"])
    before = {name: column for name, column in arrays.items() if name not in DepthGeometry.columns}
    read.restore(today.state() | {"object_map.npz": npz_bytes(**before)})
    assert [list(obj.box_min) for obj in read.objects()] == arrays["box_min"].round(4).tolist()
    for number in range(10, len(recording)):
        read.add(recording[number], detector.detect(recording[number]))
    assert [list(obj.box_min) for obj in read.objects()] != read.columns()["box_min"].round(4).tolist()


def test_map_without_views_of_sides_is_read() -> None:
    """Homes written before views of sides were kept."""
    today, read = mapped(walk()), ObjectMap(TrueBoxes.score_model)
    arrays = read_npz(today.state()["object_map.npz"])
    before = {name: column for name, column in arrays.items() if name not in ("side_views", "late_view", "late_s")}
    read.restore(today.state() | {"object_map.npz": npz_bytes(**before)})
    assert [obj.views for obj in read.objects()] == [obj.views for obj in today.objects()]
    assert any(obj.side_views for obj in today.objects()) and not any(obj.side_views for obj in read.objects())


def test_memory_depends_on_objects_only() -> None:
    recording = walk()
    once, often = (mapped(recording, order=[*range(len(recording))] * times) for times in (1, 10))
    sizes = [sum(map(len, made.state().values())) / len(made) for made in (once, often)]
    assert sizes[1] < 1.2 * sizes[0]
