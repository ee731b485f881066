"""Laws of every index: confirmed objects can be located, evidence is named, restoring a state changes nothing."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from cartier import plugins
from cartier.contracts import FrameIndex, SpatialIndex
from cartier.errors import BackendError, InputError
from cartier.geometry import box_distance
from cartier.mapping.object_map import ObjectMap
from cartier.testing import check_index
from cartier.types import Detections, MapObject
from synthetic import CHAIR, MUG, THINGS, TrueBoxes, box, look, walk

NAMES = [backend.name for backend in plugins.backends("indexes")]
OF_OBJECTS = ["object_depth", "object_viewpoint"]


def built(name: str, with_depth: bool = True) -> tuple[SpatialIndex, tuple[MapObject, ...]]:
    """An index over a walk through the room, and the objects that were mapped."""
    index, recording, detector = plugins.make("indexes", name), walk(with_depth=with_depth), TrueBoxes(THINGS)
    objects = ObjectMap(detector.score_model)
    for number in range(len(recording)):
        detections = detector.detect(recording[number])
        if isinstance(index, FrameIndex):
            index.add(recording[number], detections)
        objects.add(recording[number], detections)
    found = objects.objects()
    index.set_objects(found)
    return index, found


@cache
def kept(name: str) -> dict[str, bytes]:
    """The state of an index; nobody changes it."""
    return dict(built(name)[0].state())


@pytest.mark.parametrize("name", NAMES)
def test_it_obeys_the_laws_of_every_index(name: str) -> None:
    recording = walk()
    index = check_index(lambda: plugins.make("indexes", name), [recording[i] for i in range(20)], TrueBoxes(THINGS))
    assert index.names() == ["chair", "mug", "table"]


@pytest.mark.parametrize("name", OF_OBJECTS)
def test_index_of_objects_keeps_nothing(name: str) -> None:
    assert built(name)[0].state() == {}, "it is made of the map's objects each time"


@pytest.mark.parametrize("name", [n for n in NAMES if n not in OF_OBJECTS])
@pytest.mark.parametrize("rubbish", ["", "[1, 2", "[1]", '{"a": 1}', "\x00\xff"])
def test_a_damaged_state_is_one_clear_line(name: str, rubbish: str) -> None:
    state = kept(name)
    assert state
    for blob in state:
        with pytest.raises(InputError, match=r"damaged|not valid JSON|no file of|not UTF-8"):
            plugins.make("indexes", name).restore(state | {blob: rubbish.encode("latin-1")})


@pytest.mark.parametrize("name", [n for n in NAMES if n != "vlmaps"])
def test_the_largest_corrected_view_of_a_name_wins(name: str) -> None:
    """Of two cups the nearer one looks larger; of two views of it the nearer one."""
    near, far = box(1, "cup", (1.0, 3.4, 0.8), (1.1, 3.5, 0.9)), box(2, "cup", (3.8, 3.4, 0.8), (3.9, 3.5, 0.9))
    poses = [
        look((3.8, 1.4, 1.2), far.box_min),
        look((1.05, 2.2, 1.2), near.box_min),
        look((1.05, 2.6, 1.2), near.box_min),
    ]
    recording, detector = type(walk())(poses, [near, far]), TrueBoxes([near, far])
    index, objects = plugins.make("indexes", name), ObjectMap(detector.score_model)
    for number in range(3):
        if isinstance(index, FrameIndex):
            index.add(recording[number], detector.detect(recording[number]))
        objects.add(recording[number], detector.detect(recording[number]))
    index.set_objects(objects.objects())
    place = index.locate("cup")
    assert place is not None and place.frame == 2


def test_object_depth_lies_on_the_object_and_carries_its_box_and_id() -> None:
    index, objects = built("object_depth")
    for obj in THINGS:
        place = index.locate(obj.label)
        assert place is not None and place.box_min is not None and place.box_max is not None
        assert box_distance(np.array(place.position), np.array(obj.box_min), np.array(obj.box_max)) < 0.05
        assert np.abs(np.subtract(place.box_min, obj.box_min)).max() < 0.45
        assert next(o for o in objects if o.id == place.object_id).label == obj.label


def test_object_viewpoint_is_where_the_camera_stood_and_needs_no_depth() -> None:
    index, objects = built("object_viewpoint")
    recording = walk()
    for label in ("chair", "mug", "table"):
        place = index.locate(label)
        assert place is not None and place.view_yaw is not None
        np.testing.assert_allclose(place.position, recording[place.frame].world_from_camera[:3, 3], atol=1e-3)
    assert objects


@pytest.mark.parametrize("name", OF_OBJECTS)
def test_what_is_only_tentative_is_not_listed(name: str) -> None:
    index, objects = built(name)
    index.set_objects([dataclasses.replace(obj, confirmed=obj.label != "mug") for obj in objects])
    assert index.names() == ["chair", "table"] and index.locate("mug") is None


def test_the_papers_object_depth_believes_every_detection_and_takes_all_depth_in_the_box() -> None:
    index, frame = plugins.make("indexes", "object_depth_paper"), walk()[3]
    seen = TrueBoxes([CHAIR, MUG]).detect(frame)
    boxes = seen.boxes_xyxy.copy()
    boxes[:, :2] -= 25  # a generous box holds the wall behind, too
    index.add(frame, Detections(3, boxes, np.full(len(seen), 0.01), ("throne",) * len(seen)))
    index.set_objects(())
    place = index.locate("throne")
    assert index.names() == ["throne"] and place is not None and place.box_min is None
    assert box_distance(np.array(place.position), np.array(CHAIR.box_min), np.array(CHAIR.box_max)) > 0.05
    with pytest.raises(BackendError, match="min_views must be at least 1"):
        plugins.make("indexes", "object_depth_paper", min_views=0)
    twice = plugins.make("indexes", "object_depth_paper", min_views=2)
    twice.add(frame, seen)
    assert twice.names() == []
    twice.add(frame, seen)
    assert twice.names() == sorted(seen.labels)
