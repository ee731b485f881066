"""Renderer of a dollhouse: exact depth, ids and boxes, the same pixels of both engines, plausible light."""

from __future__ import annotations

import builtins
import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from cartier.errors import CartierError, InputError
from cartier.geometry import backproject, project, transform
from cartier.types import Camera
from cartier_dollhouse import mesh
from cartier_dollhouse.materials import KINDS, material
from cartier_dollhouse.model import Opening, Part, Room, Scene, Shape, Thing
from cartier_dollhouse.render import Renderer, View

CAMERA = Camera(160, 120, 100.0, 100.0, 79.5, 59.5)
WIDE, DEEP, HIGH = 4.0, 3.0, 2.5
ENGINES = ["embree", "numpy"]


def look(x: float, y: float, z: float, yaw: float, pitch: float = 0.0) -> npt.NDArray[np.float64]:
    """The pose of a camera at (x, y, z) that looks along yaw, pitched up."""
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
    pose[:3, 3] = (x, y, z)
    return pose


def wall(x1: float, x2: float, z1: float, z2: float, material: str = "paint:cream") -> Part:
    return mesh.panel((x1, DEEP, z1), (x2, DEEP, z1), (x2, DEEP, z2), (x1, DEEP, z2), material)


def home() -> Scene:
    """A room with a window to the north, a table with a bowl on it, a lamp, a ball in the air and a black box."""
    structure = (
        mesh.panel((0, 0, 0), (WIDE, 0, 0), (WIDE, DEEP, 0), (0, DEEP, 0), "planks:oak"),
        mesh.panel((0, 0, HIGH), (0, DEEP, HIGH), (WIDE, DEEP, HIGH), (WIDE, 0, HIGH), "paint:white"),
        mesh.panel((WIDE, 0, 0), (0, 0, 0), (0, 0, HIGH), (WIDE, 0, HIGH), "tiles:blue"),
        mesh.panel((0, 0, 0), (0, DEEP, 0), (0, DEEP, HIGH), (0, 0, HIGH), "paint:sage"),
        mesh.panel((WIDE, DEEP, 0), (WIDE, 0, 0), (WIDE, 0, HIGH), (WIDE, DEEP, HIGH), "paint:cream"),
        *(wall(*hole) for hole in ((0, 1, 0, HIGH), (3, WIDE, 0, HIGH), (1, 3, 0, 0.8), (1, 3, 2.0, HIGH))),
        wall(1, 3, 0.8, 2.0, "glass"),
    )
    legs = [mesh.slab(0.06, 0.06, 0, 0.7, "oak", x, y) for x in (-0.5, 0.5) for y in (-0.25, 0.25)]
    shapes = {
        "Table": Shape((mesh.slab(1.2, 0.7, 0.7, 0.74, "walnut"), *legs)),
        "Bowl": Shape((mesh.lathe([(0, 0), (0.05, 0), (0.12, 0.08), (0.04, 0.01), (0, 0.01)], "ceramic:blue"),)),
        "Ball": Shape((mesh.sphere(0.15, (0, 0, 0.15), "plastic:red"),)),
        "Box": Shape((mesh.slab(0.4, 0.4, 0, 0.5, "black"),)),
        "Lamp": Shape((mesh.cylinder(0.1, 0, 0.2, "light"),)),
    }
    places = ((2, 1.8, 0, 0.4), (2.1, 1.8, 0.74, 0), (0.8, 1.2, 1.0, 0), (3.4, 1.0, 0, 0.2), (0.5, 2.6, 0, 0))
    things = tuple(
        Thing(number, name, shapes[name], (x, y, z), yaw)
        for number, (name, (x, y, z, yaw)) in enumerate(zip(shapes, places, strict=True), 1)
    )
    room = Room("room", "living room", (0, 0, WIDE, DEEP), "planks:oak", "paint:cream")
    window = Opening("window", (1, DEEP), (3, DEEP), 0.8, 2.0)
    return Scene("test", "", (room,), (window,), things, structure, HIGH, (1.0, 1.0))


POSES = [look(2, 0.3, 1.5, math.pi / 2, -0.3), look(3.6, 2.6, 1.3, -2.4, -0.3), look(0.4, 0.4, 1.5, 0.7, -0.1)]


@pytest.fixture(scope="module")
def renderers() -> dict[str, Renderer]:
    pytest.importorskip("embreex")
    return {engine: Renderer(home(), CAMERA, engine=engine) for engine in ENGINES}


@pytest.fixture(scope="module")
def views(renderers: dict[str, Renderer]) -> dict[str, list[View]]:
    return {engine: [renderer.render(pose) for pose in POSES] for engine, renderer in renderers.items()}


def test_both_engines_make_the_same_picture(views: dict[str, list[View]]) -> None:
    for first, second in zip(views["embree"], views["numpy"], strict=True):
        same = first.instances == second.instances
        assert (~same).mean() <= 1e-3
        assert (np.isnan(first.depth_m) != np.isnan(second.depth_m)).mean() <= 1e-3
        apart = np.abs(first.depth_m - second.depth_m)[same]
        colours = np.abs(first.rgb.astype(int) - second.rgb).max(-1)[same]
        assert (apart[np.isfinite(apart)] > 1e-3).mean() <= 1e-3  # edges within one thing
        assert (colours > 2).mean() <= 1e-3  # a coordinate that rounds to the next texel


@pytest.mark.parametrize("engine", ENGINES)
def test_depth_is_exact(engine: str) -> None:
    pytest.importorskip("embreex") if engine == "embree" else None
    renderer = Renderer(home(), CAMERA, light=False, engine=engine)
    pose = look(2, 1.5, 1.2, -math.pi / 2)
    view = renderer.render(pose)
    assert view.depth_m.dtype == np.float32 and view.instances.dtype == np.int32 and view.rgb.dtype == np.uint8
    assert view.depth_m[60, 80] == pytest.approx(1.5, abs=1e-5)  # the south wall, parallel to the image: z, not range
    assert view.depth_m[60, 5] == pytest.approx(1.5, abs=1e-5)
    np.testing.assert_array_equal(view.depth_m, renderer.depth(pose))


@pytest.mark.parametrize("engine", ENGINES)
def test_what_an_instance_covers_lies_in_its_true_box(engine: str, views: dict[str, list[View]]) -> None:
    seen = set()
    for view, pose in zip(views[engine], POSES, strict=True):
        points = transform(pose, backproject(view.depth_m, CAMERA))
        for true in home().truth():
            mine = points[view.instances == true.id]
            seen |= {true.id} if len(mine) else set()
            assert (mine >= np.array(true.box_min) - 1e-3).all() and (mine <= np.array(true.box_max) + 1e-3).all()
    assert seen == {1, 2, 3, 4, 5}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pixel_sees_what_projects_to_its_centre(engine: str) -> None:
    """A ball of 0.15 m: its pixels are those whose rays pass its middle closer than its radius."""
    pytest.importorskip("embreex") if engine == "embree" else None
    pose = look(0.8, 0.1, 1.15, math.pi / 2)
    view = Renderer(home(), CAMERA, light=False, engine=engine).render(pose)
    row, col = np.nonzero(view.instances == 3)
    uv, _ = project(np.array([0.8, 1.2, 1.15]), CAMERA, pose)
    assert (col.mean(), row.mean()) == pytest.approx(tuple(uv), abs=0.3)
    assert (col.max() - col.min() + 1) / 2 == pytest.approx(100 * 0.15 / 1.1, abs=1.0)


def test_the_window_is_open_and_the_sky_is_nothing(views: dict[str, list[View]]) -> None:
    view = views["embree"][0]
    uv, _ = project(np.array([2.0, DEEP, 1.9]), CAMERA, POSES[0])
    col, row = np.round(uv).astype(int)
    assert np.isnan(view.depth_m[row, col]) and view.instances[row, col] == 0 and not view.hard[row, col]
    assert view.rgb[row, col].min() > 120  # bright outside


def test_lamps_shine_and_a_table_throws_a_shadow() -> None:
    """With the window walled up only the ceiling lamp is left, and it is darker under the table than beside it."""
    pytest.importorskip("embreex")
    given = home()
    dark = replace(given, openings=(), structure=(*given.structure[:-1], wall(1, 3, 0.8, 2.0)))
    pose = look(2, 0.2, 1.5, math.pi / 2, -0.6)
    renderer = Renderer(dark, CAMERA)
    view = renderer.render(pose)
    points = transform(pose, backproject(view.depth_m, CAMERA))
    floor = (view.instances == 0) & (np.abs(points[..., 2]) < 1e-3)
    under = floor & (np.hypot(points[..., 0] - 2, points[..., 1] - 1.8) < 0.3)
    beside = floor & (np.hypot(points[..., 0] - 2, points[..., 1] - 0.9) < 0.3)
    assert under.sum() > 20 and view.rgb[under].mean() < 0.8 * view.rgb[beside].mean()
    lamp = renderer.render(look(1.5, 1.6, 0.8, 2.35, -0.4))
    assert lamp.rgb[lamp.instances == 5].mean() > 150


def test_the_sun_draws_the_window_on_the_floor(renderers: dict[str, Renderer]) -> None:
    """It shines on the side with the glass: somewhere the floor is far brighter than it mostly is."""
    view = renderers["embree"].render(look(2, 0.2, 2.2, math.pi / 2, -1.0))
    floor = view.rgb[view.instances == 0].mean(1)
    assert np.percentile(floor, 97) > 1.4 * np.percentile(floor, 30)


def test_black_is_hard_for_depth_sensors(views: dict[str, list[View]]) -> None:
    view = views["embree"][1]
    assert view.hard[view.instances == 4].all() and not view.hard[view.instances == 1].any()


def test_without_embreex_the_z_buffer_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *args: Any, **options: Any) -> Any:
        if name.partition(".")[0] == "embreex":
            raise ImportError(name)
        return real(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", missing)
    renderer = Renderer(home(), CAMERA)
    view = renderer.render(POSES[0])
    assert renderer.engine == "numpy" and {1, 2} <= set(np.unique(view.instances)) and view.rgb.std() > 20
    with pytest.raises(CartierError, match="embreex"):
        Renderer(home(), CAMERA, engine="embree")


def test_rendering_twice_gives_the_same_bytes(renderers: dict[str, Renderer]) -> None:
    first, second = (Renderer(home(), CAMERA).render(POSES[1]) for _ in range(2))
    assert first.rgb.tobytes() == second.rgb.tobytes() and first.depth_m.tobytes() == second.depth_m.tobytes()


@pytest.mark.parametrize(
    "name", [*KINDS, "print:7", "print", "screen:on", "fabric:petrol", "tiles:blue", "food:#aa3311"]
)
def test_every_material_has_a_texture_without_a_seam(name: str) -> None:
    made = material(name)
    texture = made.texture.astype(int)
    assert texture.shape == (256, 256, 3) and 0 < made.albedo.max() < 1
    if made.tile_m:  # it repeats: across the seam it changes no more than elsewhere
        for axis in (0, 1):
            steps = np.abs(np.diff(texture, axis=axis)).mean((1 - axis, 2))
            seam = np.abs(np.take(texture, 0, axis) - np.take(texture, -1, axis)).mean()
            assert seam <= 2 * steps.max() + 3


@pytest.mark.parametrize(
    ("name", "said"),
    [("oka", "oak"), ("fabric:petrl", "petrol"), ("print:x", "number"), ("", "no material"), ("metal:#zzz", "colour")],
)
def test_an_unknown_material_is_one_clear_line(name: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        material(name)
    assert "\n" not in str(caught.value)


def test_an_unknown_engine_is_refused() -> None:
    with pytest.raises(CartierError, match="vulkan"):
        Renderer(home(), CAMERA, engine="vulkan")
