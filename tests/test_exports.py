"""What is written for other programs, read back by programs that are not ours."""

from __future__ import annotations

import base64
import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cartier.errors import InputError
from cartier.exports import WRITERS, export
from cartier.exports.scene import boxes, rectangles
from cartier.exports.tables import outlines
from cartier.home import Home
from cartier.pipeline import map_home
from synthetic import CHAIR, THINGS, TrueBoxes, walk


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Home:
    folder = tmp_path_factory.mktemp("exports") / "room"
    map_home(walk(), TrueBoxes(THINGS)).save(folder)
    return Home.load(folder)


def chair(home: Home) -> tuple[np.ndarray, np.ndarray]:
    obj = next(t for t in home.objects if t.label == "chair")
    return np.array(obj.box_min), np.array(obj.box_max)


@pytest.mark.parametrize("suffix", WRITERS)
def test_equal_homes_give_equal_files(home: Home, tmp_path: Path, suffix: str) -> None:
    if suffix == ".mcap":
        pytest.importorskip("mcap")
    first, second = (export(home, tmp_path / f"{name}{suffix}")[0].read_bytes() for name in "ab")
    assert first == second


def test_an_unknown_suffix_lists_those_there_are(home: Home, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there are \.glb, \.ply, .*\.mcap, and nav2"):
        export(home, tmp_path / "home.fbx")
    assert not list(tmp_path.iterdir())


def test_ply_in_trimesh_is_the_boxes_in_metres(home: Home, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(export(home, tmp_path / "home.ply")[0], process=False)
    every = boxes(home)
    assert len(mesh.vertices) == 8 * len(every) and len(mesh.faces) == 12 * len(every)
    volume = sum(float(np.prod(np.subtract(box.high, box.low))) for box in every)
    assert mesh.volume == pytest.approx(volume, rel=1e-4), "all faces look outwards"
    at = next(k for k, box in enumerate(every) if box.obj is not None and box.obj.label == "chair")
    corners = mesh.vertices[8 * at : 8 * at + 8]
    np.testing.assert_allclose([corners.min(0), corners.max(0)], chair(home), atol=1e-5)
    assert tuple(mesh.visual.vertex_colors[8 * at][:3]) == every[at].rgb


def test_glb_in_trimesh_has_each_object_where_it_is(home: Home, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.load(export(home, tmp_path / "home.glb")[0])
    names = [name for name in scene.graph.nodes_geometry if name.startswith("chair")]
    transform, geometry = scene.graph[names[0]]
    vertices = trimesh.transform_points(scene.geometry[geometry].vertices, transform)
    low, high = chair(home)
    np.testing.assert_allclose(vertices.min(0), [low[0], low[2], -high[1]], atol=1e-5)
    np.testing.assert_allclose(vertices.max(0), [high[0], high[2], -low[1]], atol=1e-5)
    inside = np.minimum(high, CHAIR.box_max) - np.maximum(low, CHAIR.box_min)
    assert (inside > 0.3).all(), "and that is where the chair truly is"
    assert scene.geometry[geometry].volume == pytest.approx(1.0), "the unit cube's faces look outwards"


def test_glb_in_pygltflib_is_well_formed(home: Home, tmp_path: Path) -> None:
    pygltflib = pytest.importorskip("pygltflib")
    gltf = pygltflib.GLTF2().load(str(export(home, tmp_path / "home.glb")[0]))
    assert gltf.asset.version == "2.0" and len(gltf.binary_blob()) == gltf.buffers[0].byteLength
    sure = {t.id: t for t in home.objects if t.confirmed}
    about = {node.extras["id"]: node for node in gltf.nodes if node.extras}
    assert set(about) == set(sure) and all(about[k].extras["label"] == sure[k].label for k in sure)
    for accessor in gltf.accessors:
        view = gltf.bufferViews[accessor.bufferView]
        size = {"VEC3": 3, "VEC4": 4}[accessor.type] * {5126: 4, 5123: 2}[accessor.componentType]
        assert view.byteOffset % 4 == 0 and view.byteLength == size * accessor.count
        if accessor.componentType != 5126:
            linear = (
                np.frombuffer(gltf.binary_blob(), "<u2", 4 * accessor.count, view.byteOffset).reshape(-1, 4) / 65535
            )
            cloud = home.cloud()
            assert accessor.normalized and cloud is not None
            np.testing.assert_allclose(255 * linear[:, :3] ** (1 / 2.2), cloud.rgb, atol=1)
            continue
        data = np.frombuffer(gltf.binary_blob(), "<f4", 3 * accessor.count, view.byteOffset).reshape(-1, 3)
        np.testing.assert_allclose([data.min(0), data.max(0)], [accessor.min, accessor.max], rtol=1e-6)


def test_the_point_cloud_is_in_ply_glb_and_mcap(home: Home, tmp_path: Path) -> None:
    trimesh, mcap = pytest.importorskip("trimesh"), pytest.importorskip("mcap.reader")
    cloud = home.cloud()
    assert cloud is not None
    mesh, beside = export(home, tmp_path / "home.ply")
    assert (mesh.name, beside.name) == ("home.ply", "home.points.ply")
    points = trimesh.load(beside, process=False)
    np.testing.assert_allclose(points.vertices, cloud.xyz_m, atol=1e-5)
    np.testing.assert_array_equal(points.colors[:, :3], cloud.rgb)
    scene = trimesh.load(export(home, tmp_path / "home.glb")[0], process=False)
    transform, geometry = scene.graph["points"]
    up = trimesh.transform_points(scene.geometry[geometry].vertices, transform)
    np.testing.assert_allclose(up, cloud.xyz_m[:, [0, 2, 1]] * (1, 1, -1), atol=1e-5)
    with export(home, tmp_path / "home.mcap")[0].open("rb") as opened:
        told = next(json.loads(m.data) for _, c, m in mcap.make_reader(opened).iter_messages() if c.topic == "/points")
    rows = np.frombuffer(base64.b64decode(told["data"]), np.uint8).reshape(-1, told["point_stride"])
    at = {field["name"]: field["offset"] for field in told["fields"]}
    np.testing.assert_allclose(rows[:, at["z"] : at["z"] + 4].copy().view("<f4")[:, 0], cloud.xyz_m[:, 2], atol=1e-5)
    np.testing.assert_array_equal(rows[:, at["green"]], cloud.rgb[:, 1])


def test_a_home_without_points_is_exported_as_before(tmp_path: Path) -> None:
    blind = map_home(walk(with_depth=False), TrueBoxes(THINGS))
    assert export(blind, tmp_path / "home.ply") == [tmp_path / "home.ply"]
    assert b"points" not in export(blind, tmp_path / "home.glb")[0].read_bytes()


def test_mcap_in_its_own_reader_has_transforms_and_a_layout(home: Home, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    from mcap.reader import make_reader

    file, layout = export(home, tmp_path / "home.mcap")
    found = {}
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened, validate_crcs=True).iter_messages():
            found[channel.topic] = json.loads(message.data)
            assert schema is not None and schema.encoding == "jsonschema" and channel.message_encoding == "json"
            assert set(json.loads(schema.data)["properties"]) == set(found[channel.topic])
    panel = json.loads(layout.read_text())["configById"]["3D!home"]
    assert {topic for topic, shown in panel["topics"].items() if shown["visible"]} == set(found) - {"/tf"}
    frames = {t["parent_frame_id"] for t in found["/tf"]["transforms"]}
    assert {panel["followTf"], found["/floor_plan"]["frame_id"]} | {
        e["frame_id"] for e in found["/objects"]["entities"]
    } == frames
    cube = next(e for e in found["/objects"]["entities"] if e["texts"][0]["text"] == "chair")["cubes"][0]
    low, high = chair(home)
    np.testing.assert_allclose([cube["size"][axis] for axis in "xyz"], high - low, atol=1e-6)
    np.testing.assert_allclose([cube["pose"]["position"][axis] for axis in "xyz"], (low + high) / 2, atol=1e-6)
    plan, grid = found["/floor_plan"], home.grid
    assert grid is not None
    shade = np.frombuffer(base64.b64decode(plan["data"]), np.uint8).reshape(-1, plan["column_count"], 4)
    assert shade.shape[:2] == grid.cells.shape and ((shade[..., 3] == 0) == (grid.cells == -1)).all()


def test_geojson_in_shapely_is_the_floor_plan(home: Home, tmp_path: Path) -> None:
    shapely = pytest.importorskip("shapely")
    told = json.loads(export(home, tmp_path / "home.geojson")[0].read_text())
    assert told["type"] == "FeatureCollection" and home.grid is not None
    shapes = {f["id"]: shapely.geometry.shape(f["geometry"]) for f in told["features"]}
    assert all(shape.is_valid for shape in shapes.values())
    for room in home.rooms:
        area = len(room.cells) * home.grid.resolution_m**2
        assert shapes[f"room:{room.id}"].area == pytest.approx(area)
        middle = home.grid.centre(room.cells[len(room.cells) // 2]).tolist()
        assert shapes[f"room:{room.id}"].contains(shapely.Point(middle))
    for obj in home.objects:
        assert shapes[obj.id].bounds == pytest.approx((*obj.box_min[:2], *obj.box_max[:2]))


@settings(deadline=None, max_examples=150)
@given(arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))))
def test_outlines_hold_every_cell_once_and_nothing_else(mask: np.ndarray) -> None:
    shapely = pytest.importorskip("shapely")
    polygons = [shapely.Polygon(rings[0], rings[1:]) for rings in outlines(mask)]
    assert all(shapely.LinearRing(rings[0]).is_ccw for rings in outlines(mask))
    assert sum(polygon.area for polygon in polygons) == mask.sum()
    for row, col in np.ndindex(*mask.shape):
        inside = sum(polygon.contains(shapely.Point(col + 0.5, row + 0.5)) for polygon in polygons)
        assert inside == mask[row, col]
    assert all(polygon.is_valid for polygon in polygons)


@settings(deadline=None, max_examples=100)
@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_rectangles_cover_each_cell_once(mask: np.ndarray) -> None:
    count = np.zeros(mask.shape, int)
    for row, col, down, across in rectangles(mask):
        count[row : row + down, col : col + across] += 1
    assert (count == mask).all()


def test_csv_holds_the_objects_and_runs_nothing(home: Home, tmp_path: Path) -> None:
    home.save(tmp_path / "h")
    named, _ = Home.load(tmp_path / "h").correct("name", "mug", name='=HYPERLINK("http://evil", "x, y")')
    rows = list(csv.DictReader(io.StringIO(export(named, tmp_path / "home.csv")[0].read_text())))
    assert [int(row["id"]) for row in rows] == [t.id for t in home.objects]
    mug = next(row for row in rows if row["label"] == "mug")
    assert mug["name"] == '\'=HYPERLINK("http://evil", "x, y")'
    np.testing.assert_allclose(
        [float(mug[axis]) for axis in "xyz"], next(t for t in home.objects if t.label == "mug").position
    )


def test_json_is_what_show_prints(home: Home, tmp_path: Path) -> None:
    assert json.loads(export(home, tmp_path / "home.json")[0].read_text()) == json.loads(json.dumps(home.to_dict()))
