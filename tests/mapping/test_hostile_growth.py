"""What mapping goes on from may come from a stranger: numbers that no map holds are refused."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

from cartier.errors import InputError
from cartier.io.files import json_bytes, npz_bytes, read_npz
from cartier.mapping.box_fitting import agreed_surface
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.observation import PATCH_KIND, PATCH_SIDE, SEED
from synthetic import THINGS, TrueBoxes, walk


@cache
def sound() -> dict[str, bytes]:
    recording, detector, made = walk(), TrueBoxes(THINGS), ObjectMap(TrueBoxes.score_model)
    for number in range(0, len(recording), 3):
        made.add(recording[number], detector.detect(recording[number]))
    return made.state()


def restored(arrays: dict[str, Any], **about: Any) -> ObjectMap:
    made = ObjectMap(TrueBoxes.score_model)
    text = json_bytes(json.loads(sound()["object_map.json"]) | about)
    made.restore({"object_map.npz": npz_bytes(**arrays), "object_map.json": text})
    return made


@pytest.mark.parametrize(
    ("column", "field", "to"),
    [
        (column, field, to)
        for column, fields in {
            "points": ("",), "box_min": ("",), "extent_max": ("",), "observable": ("",), "label_weights": ("",),
            "first_s": ("",), "colours": ("",), "views": ("box", "camera", "surface", "worth", "yaw"),
            "side_views": ("box", "worth"), "late_view": ("camera", "worth"), "late_s": ("",),
            "patches": ("pose", "camera", "box", "seed_m", "size_m", "worth"),
        }.items()
        for field in fields
        for to in (np.nan, np.inf, -1e30)
    ]
    + [
        ("id", "", 5), ("id", "", -1), ("label_votes", "", -1), ("views", "label", -1), ("side_views", "label", 99),
        ("late_view", "label", -1), ("n_detected", "", -1),
        ("observable", "", -1), ("patches", "pose", 0), ("patches", "pose", 2e5), ("patches", "camera", 0),
        ("patches", "camera", 1e-3), ("patches", "box", 7), ("patches", "seed_m", 0), ("patches", "seed_m", 1.5e5),
        ("patches", "size_m", 1.5e5), ("earlier_pose", "", np.nan), ("earlier_pose", "", 2e5),
        ("earlier_counts", "", 0), ("earlier_camera", "", 0), ("earlier_camera", "", np.nan),
    ],
)  # fmt: skip
def test_numbers_that_no_map_holds_are_refused(column: str, field: str, to: float) -> None:
    arrays = read_npz(sound()["object_map.npz"])
    assert len(restored(arrays)) == len(THINGS)
    (arrays[column][field] if field else arrays[column])[...] = to
    with pytest.raises(InputError, match="the map of objects is damaged"):
        restored(arrays)


@pytest.mark.parametrize("about", [{"next_id": 0}, {"labels": [7] * 99}, {"labels": ["mug"] * 99}])
def test_names_and_numbers_that_no_map_holds_are_refused(about: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="the map of objects is damaged"):
        restored(read_npz(sound()["object_map.npz"]), **about)


def test_views_that_are_worlds_apart_give_a_surface_all_the_same() -> None:
    """Each pose is one that a frame may have."""
    patches = np.zeros(4, PATCH_KIND)
    patches["pose"][:, :, :3], patches["worth"], patches["inside"] = np.eye(3), 1, 255
    patches["pose"][:, :, 3] = np.array([(-9e4, -9e4, -9e4), (9e4, 9e4, 9e4), (-9e4, 9e4, 9e4), (9e4, -9e4, -9e4)])
    patches["camera"], patches["box"], patches["seed_m"], patches["size_m"] = (100, 100, 50, 50), (40, 40, 60, 60), 2, 1
    patches["depth"] = np.linspace(SEED - 9, SEED + 9, PATCH_SIDE**2).reshape(PATCH_SIDE, PATCH_SIDE)
    points, masked = agreed_surface(patches, 0.0)
    assert len(points) and not masked
