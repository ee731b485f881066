"""Options of a home: rugs and narrow doors; without them every home is, to the last triangle, what it was."""

from __future__ import annotations

import hashlib
from functools import cache

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import InputError
from cartier.types.route_rules import FLOOR_KINDS
from cartier_dollhouse.floors import NARROW_M, kinds_at, split_name
from cartier_dollhouse.materials import material
from cartier_dollhouse.model import Scene, triangles
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import look, pinhole
from cartier_dollhouse.render import Renderer
from cartier_dollhouse.scene import load_home

SCENES = {
    "bedroom_suite": "f3f16cebeeffe91b", "family_flat": "5ae774d4e615c42d", "kitchen_diner": "0a98b4dfc8b714f3",
    "living_room": "161402f5b3608364", "old_couple": "32bf584cce26a17b", "shared_flat": "569dab5bc85c3553",
    "studio": "34d453a2adea2919", "3": "4573c801948cba37", "101": "d12dcb357088529b",
    "80001": "5271224268231ba3", "76001": "fdbbf663bb4ffad1",
}  # fmt: skip
"""Of 24 November 2026, when all figures of the docs were measured and the detector was trained."""
TEXTURES = "132.9/34.3 219.2/15.3 179.9/28.5 125.4/7.3 211.9/10.9 136.7/33.8 232.8/21.7"
OPTIONAL = "family_flat+rugs+narrow"


def digest(scene: Scene) -> str:
    """Of what a picture is made of: triangles, what they belong to, their materials, and the openings for the light."""
    mesh = triangles(scene)
    total = hashlib.sha256("\0".join(mesh.materials).encode() + repr((scene.openings, scene.start_xy)).encode())
    for array in (mesh.vertices, mesh.uv_m):
        total.update(np.rint(array * 1e4).astype(np.int64).tobytes())
    for array in (mesh.faces, mesh.instance, mesh.part):
        total.update(array.astype(np.int64).tobytes())
    return total.hexdigest()[:16]


@cache
def home(name: str) -> Scene:
    return load_home(name)


@pytest.mark.parametrize("name", SCENES)
def test_homes_are_rendered_as_ever(name: str) -> None:
    assert digest(home(name)) == SCENES[name]


def test_textures_are_as_ever() -> None:
    """Mean and deviation of each floor's texture, to half a grey level."""
    names = ("planks:oak", "tiles:beige", "carpet:sand", "fabric:grey", "paint:cream", "wood", "stone:white")
    told = [f"{material(n).texture.mean():.1f}/{material(n).texture.std():.1f}" for n in names]
    assert " ".join(told) == TEXTURES


def test_rugs_lie_on_the_floor_and_are_no_objects() -> None:
    plain, laid = home("family_flat"), home(OPTIONAL)
    assert laid.name == OPTIONAL and len(laid.rugs) >= len(plain.rooms) and not plain.rugs
    assert [t.label for t in laid.truth()] == [t.label for t in plain.truth()]
    camera, rug = pinhole(80, 60), laid.rugs[0]
    middle = ((rug.box[0] + rug.box[2]) / 2, (rug.box[1] + rug.box[3]) / 2)
    pose = look((middle[0] - 0.01, middle[1]), 0.0, np.radians(89), 1.5)
    with_rug, without = (Renderer(scene, camera, light=False).render(pose) for scene in (laid, plain))
    assert np.abs(with_rug.rgb.astype(int) - without.rgb).mean() > 10
    assert 0.005 < np.nanmedian(without.depth_m - with_rug.depth_m) < 0.02


def test_narrow_doors_let_the_robot_through() -> None:
    plain, narrow = home("family_flat"), home("family_flat+narrow")
    widths = [float(np.hypot(*np.subtract(o.end, o.start))) for o in narrow.openings if o.kind == "door"]
    assert len(widths) == 5 and all(min(abs(w - n) for n in NARROW_M) < 1e-6 for w in widths)
    reached = [Plan(scene, 0.2).reachable(scene.start_xy).sum() for scene in (plain, narrow)]
    assert reached[1] > 0.9 * reached[0]
    wide = Plan(narrow, 0.36)
    assert wide.reachable(narrow.start_xy).sum() < 0.5 * Plan(plain, 0.36).reachable(plain.start_xy).sum()


def test_true_kinds_of_floor() -> None:
    scene = home(OPTIONAL)
    rug = scene.rugs[0].box
    points = np.array([[5.0, 0.1], [0.1, 3.5], [4.5, 8.5], [rug[0] + 0.1, rug[1] + 0.1], [4.85, 1.0], [50.0, 1.0]])
    kinds = [FLOOR_KINDS[k] for k in kinds_at(scene, points)]
    assert kinds == ["tiles", "planks", "carpet", "rug", "unknown", "unknown"]


def test_options_stand_at_the_end_of_any_name() -> None:
    assert split_name("studio+rugs+narrow") == ("studio", ("rugs", "narrow")) and split_name("a+b") == ("a+b", ())
    assert plugins.make("worlds", "dollhouse").scene("77050+rugs").name == "dollhouse 77050+rugs"
    with pytest.raises(InputError, match="no home 'studio\\+mats'"):
        load_home("studio+mats")
