"""Home files: what is placed where, and every fault with its line."""

from __future__ import annotations

import math
import os
import time

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cartier.errors import InputError
from cartier_dollhouse.model import triangles
from cartier_dollhouse.scene import check, homes, load_home, load_scene
from dollhouse.toy import HEAD, SIZES, home, toys  # noqa: F401

pytestmark = pytest.mark.usefixtures("toys")


def _box(scene, number: int) -> tuple[list[float], list[float]]:
    true = scene.truth()[number - 1]
    return list(np.round(true.box_min, 3) + 0.0), list(np.round(true.box_max, 3) + 0.0)


def test_things_lie_where_the_file_says():
    scene = load_scene(
        home(
            "{type: Table, at: [2, 2], face: east, things: [{type: Block, at: [0.3, 0.1], things: [{type: Block}]}]}",
            "{type: Picture, room: small, wall: east, at: 1.5, height: 1.2}",
            "{type: Lamp, at: [3, 1]}",
            "{type: Block, at: [1, 1], height: 0}",
        )
    )
    assert [(t.id, t.type, t.on) for t in scene.things] == [
        (1, "Table", 0), (2, "Block", 1), (3, "Block", 2), (4, "Picture", 0), (5, "Lamp", 0), (6, "Block", 0),
    ]  # fmt: skip
    assert _box(scene, 1) == ([1.6, 1.4, 0.0], [2.4, 2.6, 0.75])
    # The table faces east: its right is north, its back is west.
    assert _box(scene, 2) == ([1.85, 2.25, 0.75], [1.95, 2.35, 0.85])
    assert _box(scene, 3) == ([1.85, 2.25, 0.85], [1.95, 2.35, 0.95])
    assert _box(scene, 4) == ([5.98, 1.2, 1.2], [6.0, 1.8, 1.7])
    assert _box(scene, 5)[1][2] == 2.6
    assert _box(scene, 6)[0][2] == 0.0


@pytest.mark.parametrize(("wall", "low", "high"), [
    ("north", (1.7, 2.98), (2.3, 3)), ("south", (1.7, 0), (2.3, 0.02)), ("west", (0, 1.7), (0.02, 2.3)),
    ("east", (3.98, 1.7), (4, 2.3)),
])  # fmt: skip
def test_what_hangs_on_a_wall_has_its_back_to_it(wall, low, high):
    scene = load_scene(home(f"{{type: Picture, room: big, wall: {wall}, at: 2, height: 2}}"))
    assert _box(scene, 1) == ([*low, 2.0], [*high, 2.5])
    front = scene.things[0].to_world(np.array([0.0, -1.0, 0.0]))[:2] - scene.things[0].at[:2]
    assert front @ (np.array([2.0, 1.5]) - scene.things[0].at[:2]) > 0


@pytest.mark.parametrize(
    ("face", "yaw"), [("south", 0), ("E", math.pi / 2), ("north", math.pi), ("w", -math.pi / 2), (30, math.pi / 6)]
)
def test_faces(face, yaw):
    scene = load_scene(home(f"{{type: Chair, at: [2, 1.5], face: {face}}}"))
    assert math.isclose(scene.things[0].yaw, yaw)


def test_a_thing_may_name_what_it_stands_on():
    scene = load_scene(home("{type: Rack, id: rack, at: [2, 2.7]}", "{type: Block, on: rack.shelf 1, at: [0.2, 0]}"))
    assert scene.things[1].on == 1
    assert _box(scene, 2) == ([2.15, 2.65, 0.52], [2.25, 2.75, 0.62])


def test_a_chair_under_a_table_and_a_table_on_a_rug_are_no_fault():
    text = home(
        "{type: Rug, at: [2, 1.7]}", "{type: Table, at: [2, 1.7]}",
        "{type: Chair, at: [2, 1.05], face: north, size: [0.45, 0.45, 0.7]}", "{type: Chair, at: [2, 2.2]}",
    )  # fmt: skip
    assert check(text) == []


T = "{type: Table, at: [2, 1.6]"
FAULTS = {
    "unknown type": (["{type: Tabel, at: [1, 1]}"], 12, "Tabel"),
    "unknown room": (["{type: Picture, room: bog, wall: east, at: 1, height: 1}"], 12, "did you mean 'big'"),
    "unknown surface": ([T + ", things: [{type: Block, on: drawer}]}"], 12,
        "unknown surface 'drawer' of a Table: it has top"),
    "unknown parent": (["{type: Block, on: desk, at: [0, 0]}"], 12, "no thing with id 'desk'"),
    "no surface": (["{type: Chair, at: [1, 2], things: [{type: Block}]}"], 12, "nothing can stand on a Chair"),
    "stands on nothing": (["{type: Chair, at: [3, 2]}", "{type: Block, at: [1, 1]}"], 13, "stands on no surface"),
    "in one place": ([T + "}", "{type: Rack, at: [2.8, 1.6]}"], 13, "Rack and the Table"),
    "in one place, turned": (["{type: Rack, at: [2, 1.6], face: 45}", "{type: Rack, at: [2.3, 1.9]}"], 13,
        "in one place"),
    "over the edge": ([T + ", things: [{type: Block, at: [0.6, 0]}]}"], 12, "5 cm over the edge of the top"),
    "too tall": (["{type: Rack, at: [2, 2], things: [{type: Block, size: [0.1, 0.1, 0.45]}]}"], 12, "0.45 m tall"),
    "in a wall": (["{type: Rack, at: [1, 2.9]}"], 12, "reaches 10 cm into the north wall of 'big'"),
    "outside": (["{type: Rack, at: [5, 2.5]}"], 12, "outside of every room"),
    "through the ceiling": (["{type: Rack, at: [2, 2], size: [0.8, 0.4, 3]}"], 12, "3.00 m"),
    "in a doorway": (["{type: Chair, at: [3.7, 1]}"], 12, "stands in the doorway at [4.05, 1.00]"),
    "at the start": (["{type: Table, at: [0.8, 0.8]}"], 2, "start [0.5, 0.5] is not free"),
    "no height": (["{type: Picture, room: big, wall: east, at: 1}"], 12, "`height`"),
    "no wall": (["{type: Picture, at: [1, 1]}"], 12, "hangs on a wall"),
    "at is one number": (["{type: Table, at: 1}"], 12, "'at' must be [x, y]"),
    "twice the id": ([T + ", id: a}", "{type: Chair, at: [1, 2], id: a}"], 13, "two things with id 'a'"),
    "unknown key": (["{type: Table, at: [2, 2], colr: red}"], 12, "unknown key 'colr': did you mean 'colour'?"),
    "no type": (["{at: [2, 2]}"], 12, "'type' is missing"),
    "wrong form": (["{type: Table, at: [2, 2, 2]}"], 12, "'at' must be [x, y]"),
    "unknown colour": (["{type: Table, at: [2, 2], colour: 'paint:grean'}"], 12, "grean"),
    "wrong face": (["{type: Table, at: [2, 2], face: up}"], 12, "'face' must be"),
    "infinite": (["{type: Table, at: [2, .inf]}"], 12, "'at' must be"),
    "twice the key": (["{type: Table, at: [2, 2], at: [1, 1]}"], 12, "'at' is given twice"),
    "an alias": (["&a {type: Table, at: [2, 2]}", "*a"], 13, "aliases"),
    "a python object": (["!!python/object/apply:os.system [ls]"], 12, "YAML tag"),
    "a python name": (["{type: !!python/name:os.system , at: [2, 2]}"], 12, "not valid YAML"),
    "not YAML": (["{type: Table, at: [2, 2}"], 12, "not valid YAML"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_with_its_line(name):
    things, line, words = FAULTS[name]
    found = check(home(*things), "my.yaml")
    assert len(found) == 1, found
    assert found[0].startswith(f"my.yaml:{line}: ") and words in found[0], found
    assert "\n" not in found[0] and "Traceback" not in found[0]


@pytest.mark.parametrize(("old", "new", "line", "words"), [
    ("at: 1.0, width: 0.9", "at: 1.8, width: 0.9", 7, "leads nowhere"),
    ("between: [big, small]", "between: [big, smal]", 7, "did you mean 'small'"),
    ("[4.1, 0, 6, 2]", "[4.5, 0, 6, 2]", 7, "share no wall"),
    ("[4.1, 0, 6, 2]", "[3.9, 0, 6, 2]", 5, "must lie 0.05 m apart"),
    ("side: north, at: 2.0", "side: east, at: 1.0", 9, "looks into 'small'"),
    ("side: south, at: 1.5", "side: south, at: 3.9", 10, "does not fit"),
    ("width: 1.2}", "width: 1.2, height: 1.8}", 9, "rooms are 2.6 m high"),
    ("tiles:blue", "tails:blue", 5, "there is no material 'tails'"),
    ("name: small", "name: big", 5, "two rooms 'big'"),
    ("start: [0.5, 0.5]", "start: [9, 9]", 2, "not free"),
    ("start: [0.5, 0.5]", "start: here", 2, "'start' must be [x, y]"),
])  # fmt: skip
def test_faults_of_the_house(old, new, line, words):
    found = check(home(head=HEAD.replace(old, new)), "my.yaml")
    assert any(one.startswith(f"my.yaml:{line}: ") and words in one for one in found), found


def test_a_thousand_things_in_one_place_are_refused_quickly():
    """Each with each would be half a million faults; and memory grows with the square of what stands on what."""
    begin = time.process_time()
    for kind in ("Table", "Rug"):  # rugs may lie under anything
        found = check(home(*[f"{{type: {kind}, at: [2, 2]}}"] * 1000), "my.yaml")
        assert found == [f"my.yaml:12: this {kind} at [2.00, 2.00, 0.00] and 999 more things are in one place"]
    nested = "{type: Table, at: [2, 2], things: [" + ", ".join(["{type: Mug, at: [0, 0]}"] * 1500) + "]}"
    assert check(home(nested, nested), "my.yaml") == ["my.yaml:1: a home holds 2000 things at most, got 3002"]
    assert time.process_time() - begin < 20


def test_what_is_on_a_misplaced_thing_is_still_read():
    found = check(home("{type: Table, at: [1, 1], on: desk, things: [{type: Tabel}]}"))
    assert len(found) == 2 and "desk" in found[0] and "Tabel" in found[1]


def test_all_faults_are_found_and_loading_names_the_first(tmp_path):
    text = home("{type: Tabel, at: [1, 1]}", "{type: Rack, at: [1, 2.9]}", "{type: Block, at: [2, 1]}")
    assert [int(one.split(":")[1]) for one in check(text, "a")] == [12, 13, 14]
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"mine\.yaml:12: .*Tabel.*\(and 2 more\)$"):
        load_scene(path)


@pytest.mark.parametrize(
    "text", ["", "a", "- 1\n", "[" * 100_000, "x: " + "a" * (1 << 20), "\0\n", "name: [\n", "? [1]\n: 2\n"]
)
def test_rubbish_is_one_line(text):
    found = check(text, "f")
    assert len(found) == 1 and found[0].startswith("f:") and "\n" not in found[0]


def test_files_and_names_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match="is missing"):
        load_scene(tmp_path / "none.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"name: caf\xe9\n")
    with pytest.raises(InputError, match="UTF-8"):
        load_scene(tmp_path / "latin.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(InputError, match="is a pipe"):
        load_scene(tmp_path / "pipe.yaml")
    with pytest.raises(InputError, match=f"did you mean '{homes()[0]}'"):
        load_home(homes()[0] + "x")
    with pytest.raises(InputError, match="no home"):
        load_home("../../../secret")


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_random_homes_load_with_boxes_where_asked(data):
    """Things in the middle of their own cells of a lattice, turned at will, load and lie there."""
    cells = data.draw(st.lists(st.sampled_from([(x, y) for x in (1, 3) for y in (1.3, 2.3)]), unique=True))
    kinds = [(data.draw(st.sampled_from(["Chair", "Rack", "Block"])), data.draw(st.integers(-180, 180))) for _ in cells]
    things = [
        f"{{type: {kind}, at: [{x}, {y}], face: {face}, height: 0}}"
        for (x, y), (kind, face) in zip(cells, kinds, strict=True)
    ]
    scene = load_scene(home(*things))
    for true, (x, y), (kind, face) in zip(scene.truth(), cells, kinds, strict=True):
        w, d, h = SIZES[kind]
        c, s = abs(math.cos(math.radians(face))), abs(math.sin(math.radians(face)))
        half = np.array([w * c + d * s, w * s + d * c]) / 2
        assert np.allclose(true.box_min, [x - half[0], y - half[1], 0], atol=1e-5) or kind == "Rack"
        assert np.allclose(np.add(true.box_min, true.box_max)[:2] / 2, [x, y], atol=1e-5)
        assert math.isclose(true.box_max[2] - true.box_min[2], h, abs_tol=1e-5)


def test_walls_are_seen_from_their_rooms_and_open_at_doors_and_windows():
    scene = load_scene(home())
    mesh = triangles(scene)
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(float) for k in range(3))
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
    for room in scene.rooms:
        x1, y1, x2, y2 = room.box
        inside = (
            (middle[:, 0] > x1 - 1e-3)
            & (middle[:, 0] < x2 + 1e-3)
            & (middle[:, 1] > y1 - 1e-3)
            & (middle[:, 1] < y2 + 1e-3)
        )
        wall = inside & np.array([mesh.materials[p] == room.walls for p in mesh.part])
        centre = np.array([(x1 + x2) / 2, (y1 + y2) / 2, 1.3])
        assert (np.einsum("ij,ij->i", normal[wall], centre - middle[wall]) > 0).all()
        openings = {"big": 0.9 * 2.05 + 1.2 * 1.3 + 0.95 * 2.05, "small": 0.9 * 2.05}[room.name]
        area = np.linalg.norm(normal[wall], axis=1).sum() / 2
        assert math.isclose(area, 2 * (x2 - x1 + y2 - y1) * 2.6 - openings, rel_tol=1e-5)


def test_texture_coordinates_are_metres():
    mesh = triangles(load_scene(home()))
    long = mesh.vertices[mesh.faces].astype(float)
    uv = mesh.uv_m[mesh.faces].astype(float)
    for k in range(3):
        edge = np.linalg.norm(long[:, k] - long[:, (k + 1) % 3], axis=1)
        assert np.allclose(np.linalg.norm(uv[:, k] - uv[:, (k + 1) % 3], axis=1), edge, atol=1e-4)
