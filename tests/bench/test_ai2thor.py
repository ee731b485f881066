"""AI2-THOR adapter through the real client, with a stand-in in place of Unity's build, which is never run here."""

from __future__ import annotations

import inspect
import json
import math
import os
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cartier import plugins
from cartier.errors import BackendError, CartierError, InputError, MissingExtra
from cartier.geometry import backproject, transform
from cartier.pipeline import map_home
from cartier.types import Camera, Frame, TrueObject
from cartier_bench.thor import ai2thor as adapter
from cartier_bench.thor import unity
from cartier_dollhouse.model import Scene
from cartier_dollhouse.scene import load_home, load_scene

pytest.importorskip("ai2thor", reason="needs cartier[thor]: the real AI2-THOR client")
pytest.importorskip("msgpack", reason="needs msgpack: the stand-in for AI2-THOR's build speaks it")

STANDIN = Path(__file__).parent / "standin.py"
METADATA = Path(__file__).parents[1] / "data" / "ithor_room_metadata.json"
HOME = "living_room"
TINY = """
name: tiny
about: One room with a few things, for all that needs no real home.
start: [1.0, 1.0]
rooms:
  - {name: room, kind: living room, box: [0.0, 0.0, 4.0, 3.0], floor: "planks:oak", walls: "paint:cream"}
things:
  - type: DiningTable
    at: [2.8, 2.0]
    face: 20
    things: [{type: Mug, on: top, at: [-0.2, 0.0]}, {type: Laptop, on: top, at: [0.2, 0.0]}]
  - {type: Fridge, at: [0.5, 2.6], face: south}
"""
VARIANTS = {"fifo": ("fifo", ()), "wsgi": ("wsgi", ()), "fifo, old depth": ("fifo", ("--legacy",))}
Maker = Callable[..., Any]


def command(*arguments: str, homes: Sequence[str] = ()) -> str:
    return shlex.join([sys.executable, str(STANDIN), *(homes or [str(tiny())]), *arguments])


def tiny() -> Path:
    return Path.home() / "tiny.yaml"


@pytest.fixture(scope="module", autouse=True)
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The client writes to ~/.ai2thor, and refuses to start without a DISPLAY."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        patch.delenv("DISPLAY", raising=False)
        tiny().write_text(TINY)
        yield


@pytest.fixture(scope="module")
def start() -> Iterator[Maker]:
    """Makes worlds on the stand-in, and closes them at the end."""
    worlds = []

    def make(*arguments: str, homes: Sequence[str] = (), **options: Any) -> Any:
        options = {
            "executable": command(*arguments, homes=homes),
            "x_display": ":7",
            "width": 160,
            "height": 120,
            **options,
        }
        worlds.append(plugins.make("worlds", "ai2thor", **options))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


@pytest.fixture(scope="module")
def thor(start: Maker) -> Any:
    """A real home of the dollhouse as FloorPlan1, a tiny one as FloorPlan2."""
    return start(homes=(HOME, str(tiny())))


def dollhouse() -> Scene:
    return load_home(HOME)


def outside(frame: Frame, things: Sequence[TrueObject], margin_m: float = 0.02) -> tuple[int, int]:
    """How many unprojected pixels of things lie outside of their true boxes, and of how many."""
    points = transform(frame.world_from_camera, backproject(frame.depth_m, frame.camera))
    bad = total = 0
    for thing in things:
        own = points[frame.instances == thing.id]
        inside = (own >= np.array(thing.box_min) - margin_m) & (own <= np.array(thing.box_max) + margin_m)
        bad, total = bad + int((~inside.all(1)).sum()), total + len(own)
    return bad, total


def in_their_true_boxes(recording: Any, scene: Scene) -> int:
    """How many pixels of things were looked at; each must lie in its thing's box, as the dollhouse itself tells it."""
    true = {(t.label, tuple(np.round(t.box_min, 3))): t for t in scene.truth()}
    told = {(t.label, tuple(np.round(t.box_min, 3))): t.id for t in recording.truth}
    assert told.keys() == true.keys()
    things = [TrueObject(number, true[key].label, true[key].box_min, true[key].box_max) for key, number in told.items()]
    counts = [outside(recording[i], things) for i in range(len(recording))]
    assert sum(bad for bad, _ in counts) == 0
    return sum(total for _, total in counts)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_depth_pixel_of_a_thing_lies_in_its_box(start: Maker, variant: str) -> None:
    server, flags = VARIANTS[variant]
    world = start(*flags, server=server, width=160, height=100, fov=50)  # a wide image: a horizontal fov would show
    recording = world.explore("FloorPlan1", spacing_m=1.5, headings=5, horizons=(-10, 20))
    assert in_their_true_boxes(recording, load_scene(TINY)) > 25_000


def test_every_depth_pixel_of_a_real_homes_thing_lies_in_its_box(thor: Any) -> None:
    assert (
        in_their_true_boxes(thor.explore("FloorPlan1", spacing_m=3.0, headings=3, horizons=(20,)), dollhouse()) > 25_000
    )


def test_things_have_the_boxes_of_the_dollhouse(thor: Any) -> None:
    mine = sorted((t.label, *t.box_min, *t.box_max) for t in thor.objects("FloorPlan1"))
    true = sorted((t.label, *t.box_min, *t.box_max) for t in dollhouse().truth())
    assert [row[0] for row in mine] == [row[0] for row in true]
    np.testing.assert_allclose([row[1:] for row in mine], [row[1:] for row in true], atol=1e-6)


class SamePoses:
    """The dollhouse's own recording from the poses of another."""

    name, notes = "dollhouse", ()

    def __init__(self, scene: Scene, camera: Camera, poses: Sequence[np.ndarray]) -> None:
        from cartier_dollhouse.render import Renderer

        self.camera, self.truth, self.poses = camera, scene.truth(), poses
        self.renderer = Renderer(scene, camera, light=False)

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Frame:
        view = self.renderer.render(self.poses[index])
        return Frame(index, float(index), view.rgb, view.depth_m, self.poses[index], self.camera, view.instances)

    def fingerprint(self) -> str:
        return "0" * 64


def test_the_map_is_that_of_the_dollhouse(thor: Any) -> None:
    recording = thor.explore("FloorPlan1", spacing_m=3.0, horizons=(20,))
    poses = [recording[i].world_from_camera for i in range(len(recording))]
    own = SamePoses(dollhouse(), recording.camera, poses)
    maps = [map_home(r, plugins.make("detectors", "ground_truth", truth=r.truth)) for r in (recording, own)]
    assert maps[0].names == maps[1].names
    assert len(maps[0].names) > 5
    for name in maps[0].names:
        mine, true = (home.index(None)[1].locate(name) for home in maps)
        assert np.linalg.norm(np.subtract(mine.position, true.position)) < 0.02, name
    assert maps[0].grid is not None and maps[1].grid is not None
    assert maps[0].grid.cells.shape == maps[1].grid.cells.shape
    assert (maps[0].grid.cells == maps[1].grid.cells).mean() > 0.999


def test_frames_are_the_same_when_asked_for_again_and_from_another_home_in_between(thor: Any) -> None:
    first, second = (thor.explore(home, spacing_m=3.0) for home in ("FloorPlan1", "FloorPlan2"))
    before = first[1]
    other = second[0]
    again = first[1]
    assert (before.rgb == again.rgb).all() and (before.instances == again.instances).all()
    np.testing.assert_array_equal(before.depth_m, again.depth_m)
    np.testing.assert_array_equal(before.world_from_camera, again.world_from_camera)
    assert not np.array_equal(before.rgb, other.rgb)
    assert first.fingerprint() == thor.explore("FloorPlan1", spacing_m=3.0).fingerprint() != second.fingerprint()
    for index in (-1, len(first)):
        with pytest.raises(IndexError, match="frames 0 to"):
            first[index]


def test_a_tour_covers_the_home_and_looks_all_around(thor: Any) -> None:
    recording = thor.explore("FloorPlan1", spacing_m=1.0)
    eyes = {tuple(np.round(s.position, 3)) for s in recording._stops}
    assert len(recording) == 8 * len(eyes)
    places = thor._scene("FloorPlan1").places
    away = np.linalg.norm(places[:, None] - np.array(sorted(eyes)), axis=2).min(1)
    assert away.max() <= 1.0 + 1e-6
    assert len(eyes) < len(places) / 3
    frames = [recording[i] for i in range(8)]
    yaws = [math.degrees(math.atan2(f.world_from_camera[1, 2], f.world_from_camera[0, 2])) for f in frames]
    assert sorted(round(yaw) % 360 for yaw in yaws) == [0, 0, 90, 90, 180, 180, 270, 270]
    np.testing.assert_allclose([f.world_from_camera[2, 2] for f in frames], [0, -0.5] * 4, atol=1e-6)
    assert all(f.world_from_camera[2, 3] == pytest.approx(1.576, abs=1e-3) for f in frames)
    assert thor.explore("FloorPlan1", seed=1).fingerprint() != thor.explore("FloorPlan1", seed=2).fingerprint()


def test_free_is_where_the_agent_can_stand(thor: Any) -> None:
    scene = dollhouse()
    assert thor.free("FloorPlan1", scene.start_xy)
    assert not thor.free("FloorPlan1", (-50.0, 0.0))
    bulky = max(scene.truth(), key=lambda t: (t.box_max[2] > 1.0) * np.prod(np.subtract(t.box_max, t.box_min)))
    assert not thor.free("FloorPlan1", np.add(bulky.box_min, bulky.box_max)[:2] / 2)


def test_a_procthor_house_is_a_home(thor: Any, tmp_path: Path) -> None:
    x, y = dollhouse().start_xy
    agent = {
        "position": {"x": x, "y": 0.95, "z": y},
        "rotation": {"x": 0, "y": 270, "z": 0},
        "horizon": 30,
        "standing": True,
    }
    house = tmp_path / "house.json"
    house.write_text(json.dumps({"rooms": [], "metadata": {"agent": agent}}))
    assert len(thor.objects(str(house))) == len(dollhouse().truth())
    assert thor.explore(str(house), spacing_m=4.0).name == "ai2thor house"
    house.write_text("[]")
    with pytest.raises(InputError, match=r"other.json is no ProcTHOR house: it holds no list of rooms"):
        thor.explore(str(house.rename(tmp_path / "other.json")))


def test_a_tour_reaches_parts_that_cannot_be_walked_to() -> None:
    row = [(0.25 * i, 0.0, 0.9) for i in range(9)]
    places = np.array([*row, (9.0, 9.0, 0.9), (9.0, 9.25, 0.9)])
    assert adapter.tour(places, (0.0, 0.1, 0.9), 0.25, 0.5) == [0, 3, 6, 9]
    assert adapter.tour(places[:1], (5.0, 5.0, 0.9), 0.25, 0.5) == [0]


# What goes wrong


def one_line(caught: pytest.ExceptionInfo[CartierError], *words: str) -> None:
    text = str(caught.value)
    assert "\n" not in text and len(text) < 400
    for word in words:
        assert word in text


@pytest.mark.parametrize("server", ["fifo", "wsgi"])
def test_a_build_that_dies_is_noticed_at_once(start: Maker, server: str) -> None:
    recording = start("--fault", "exit:Teleport", server=server).explore("FloorPlan1", spacing_m=9.0)
    begin, threads = time.monotonic(), set(threading.enumerate())
    with pytest.raises(BackendError) as caught:
        recording[0]
    assert time.monotonic() - begin < 2
    one_line(caught, "the AI2-THOR build ended with exit code 3 while doing Teleport", "~/.ai2thor/log/unity.log")
    assert set(threading.enumerate()) <= threads


@pytest.mark.parametrize("server", ["fifo", "wsgi"])
def test_a_build_that_dies_at_the_start_is_named_with_its_last_words(start: Maker, server: str) -> None:
    words = "Unable to open the display"
    world = start(server=server, executable=f'{sys.executable} -c "print(1); raise SystemExit({words!r})"')
    begin = time.monotonic()
    with pytest.raises(BackendError) as caught:
        world.homes()
    assert time.monotonic() - begin < 2
    one_line(caught, "ended with exit code 1 while starting", f"ends: {words}")


@pytest.mark.parametrize("server", ["fifo", "wsgi"])
def test_a_build_that_hangs_is_noticed_and_stopped(start: Maker, server: str) -> None:
    world = start("--fault", "hang:Teleport", server=server, timeout_s=1.0)
    recording = world.explore("FloorPlan1", spacing_m=9.0)
    process, begin, threads = world._build._process, time.monotonic(), set(threading.enumerate())
    with pytest.raises(BackendError) as caught:
        recording[0]
    assert time.monotonic() - begin < 3
    one_line(caught, "the AI2-THOR build hangs: no answer within 1 s while doing Teleport", "larger timeout_s")
    assert process.poll() is not None
    assert set(threading.enumerate()) <= threads


@pytest.mark.parametrize("server", ["fifo", "wsgi"])
def test_a_build_that_never_comes_up_is_noticed(start: Maker, server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adapter, "LOAD_S", 0.5)
    world = start(server=server, executable=f'{sys.executable} -c "import time; time.sleep(60)"')
    with pytest.raises(BackendError) as caught:
        world.homes()
    one_line(caught, "the AI2-THOR build hangs: no answer within 0.5 s while starting")


def test_a_hung_build_is_noticed_within_five_seconds_unless_told_otherwise() -> None:
    assert inspect.signature(adapter.make).parameters["timeout_s"].default <= 4.5


@pytest.mark.parametrize("server", ["fifo", "wsgi"])
def test_a_recording_goes_on_after_a_crash_but_not_after_close(start: Maker, server: str) -> None:
    world = start(server=server)
    recording = world.explore("FloorPlan1", spacing_m=9.0)
    before = recording[0]
    world._build._process.kill()
    with pytest.raises(BackendError) as caught:
        recording[0]
    one_line(caught, "was killed by signal 9 while doing Teleport")
    assert (recording[0].rgb == before.rgb).all()
    process = world._build._process
    world.close()
    assert process.poll() is not None
    with pytest.raises(BackendError, match="this AI2-THOR world was closed: make it again"):
        recording[0]


def test_python_ends_quietly_after_a_crash_and_leaves_no_build_behind() -> None:
    options = {"x_display": ":7", "width": 160, "height": 120}
    script = f"""
from cartier import plugins
from cartier.errors import BackendError
worlds, options = [], {options!r}
for server, action in (("fifo", "Teleport"), ("wsgi", "Teleport"), ("wsgi", "never")):
    command = {command("--fault", "exit:")!r} + action
    worlds.append(plugins.make("worlds", "ai2thor", executable=command, server=server, **options))
    try:
        worlds[-1].explore("FloorPlan1", spacing_m=9.0)[0]
    except BackendError as error:
        print(error)
print(worlds[-1]._build._process.pid)  # left running
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.stderr, done.returncode) == ("", 0)
    *lines, pid = done.stdout.splitlines()
    assert [line.startswith("the AI2-THOR build ended with exit code 3") for line in lines] == [True, True]
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid), 0)


def test_an_unknown_scene_is_named_with_what_is_close(thor: Any) -> None:
    with pytest.raises(InputError) as caught:
        thor.explore("FloorPlan11")
    one_line(caught, "no scene 'FloorPlan11' among its 2", "FloorPlan1")
    with pytest.raises(InputError, match=r"nowhere\.json is missing"):
        thor.explore("nowhere.json")
    with pytest.raises(BackendError, match="has no option 'sensor'; it has spacing_m"):
        thor.explore("FloorPlan1", sensor="phone")


def test_no_display_is_said_before_anything_starts(start: Maker) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only Linux builds need an X display")
    with pytest.raises(BackendError) as caught:
        start(x_display=None)
    one_line(caught, "needs an X display", "DISPLAY=:1", "x_display=:1")


def test_no_build_and_no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    import requests

    def refuse(*args: Any, **kwargs: Any) -> None:
        raise requests.exceptions.ConnectionError("no network")

    monkeypatch.setattr(requests.Session, "request", refuse)
    world = plugins.make("worlds", "ai2thor", x_display=":7")
    with pytest.raises(BackendError) as caught:
        world.homes()
    one_line(caught, "there is no AI2-THOR build on this machine and none could be downloaded", "executable=")


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ai2thor", None)
    with pytest.raises(MissingExtra, match=r"pip install .*\[thor\]'"):
        plugins.make("worlds", "ai2thor")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"server": "tcp"}, "server must be fifo or wsgi, got 'tcp'"),
        ({"width": 0}, "width and height must be 1 to 4096 px, got 0x480"),
        ({"fov": 180.0}, "fov must be 5 to 150 degrees"),
        ({"grid_size": -1.0}, "grid_size must be 0.05 to 1 m"),
        ({"timeout_s": 0.0}, "timeout_s must be above 0"),
        ({"executable": "/nowhere/thor"}, "no AI2-THOR build at '/nowhere/thor'"),
        ({"executable": "thor 'x"}, "is no command line"),
    ],
)
def test_impossible_options(options: dict[str, Any], words: str) -> None:
    with pytest.raises(BackendError) as caught:
        plugins.make("worlds", "ai2thor", **{"x_display": ":7"} | options)
    one_line(caught, words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"rooms": [], "metadata": 3}', "its metadata.agent is no pose"),
        ('{"rooms": 1}', "it holds no list of rooms"),
        ('{"rooms": [], "refuse": "no such wall"}', "AI2-THOR refused CreateHouse: no such wall"),
    ],
)
def test_a_house_that_is_none(thor: Any, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "house.json").write_text(text)
    with pytest.raises(CartierError) as caught:
        thor.objects(str(tmp_path / "house.json"))
    one_line(caught, words)


# The conversions on their own


def metadata(yaw: float = 0.0, horizon: float = 0.0, **more: Any) -> dict[str, Any]:
    agent = {"rotation": {"x": 0, "y": yaw, "z": 0}, "cameraHorizon": horizon}
    eye = {"x": 1.0, "y": 1.5, "z": 3.0}
    return {"agent": agent, "cameraPosition": eye, "fov": 60, "screenWidth": 640, "screenHeight": 360} | more


@pytest.mark.parametrize(
    ("yaw", "horizon", "forward", "right"),
    [
        (0, 0, (0, 1, 0), (1, 0, 0)),  # Unity's forward, +z, is our +y
        (90, 0, (1, 0, 0), (0, -1, 0)),  # clockwise seen from above
        (180, 30, (0, -(0.75**0.5), -0.5), (-1, 0, 0)),  # a positive horizon looks down
        (270, -30, (-(0.75**0.5), 0, 0.5), (0, 1, 0)),
    ],
)
def test_poses(yaw: float, horizon: float, forward: tuple[float, ...], right: tuple[float, ...]) -> None:
    pose = unity.pose(metadata(yaw, horizon))
    np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-12)
    np.testing.assert_allclose(pose[:3, 0], right, atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert pose[:3, 3].tolist() == [1.0, 3.0, 1.5]


def test_the_field_of_view_is_vertical() -> None:
    camera = unity.camera(metadata())
    assert (camera.width, camera.height, camera.cx, camera.cy) == (640, 360, 319.5, 179.5)
    assert camera.fx == camera.fy == pytest.approx(180 / math.tan(math.radians(30)))


def test_depth_at_the_far_plane_is_no_reading() -> None:
    read = unity.depth(np.array([[0.0, 0.2, 19.8, 19.9, 20.0, np.nan, np.inf, -1.0]]), 0.1, 20.0)
    np.testing.assert_array_equal(read, np.array([[np.nan, 0.2, 19.8, *[np.nan] * 5]], np.float32))
    assert read.dtype == np.float32


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({"fov": None}, "holds 'None' as fov, which is no number"),
        ({"fov": math.nan}, "holds 'nan' as fov"),
        ({"agent": {}}, "holds no 'rotation'"),
        ({"cameraPosition": "here"}, "holds no 'x'"),
    ],
)
def test_metadata_of_another_shape_is_named(broken: dict[str, Any], words: str) -> None:
    with pytest.raises(BackendError) as caught:
        unity.camera(metadata(**broken))
        unity.pose(metadata(**broken))
    one_line(caught, words)


def test_metadata_in_the_key_set_of_version_5() -> None:
    objects = json.loads(METADATA.read_text("utf-8"))["objects"]
    truth, ids, notes = unity.true_objects(objects)
    knob = "StoveKnob|+00.13|+00.86|-02.18"
    assert notes == [f"left out, because AI2-THOR gives no box for them: {knob}"]
    assert [t.id for t in truth] == list(range(1, len(truth) + 1)) == list(ids.values())
    assert {o["objectId"] for o in objects} - ids.keys() == {"Floor|00.00|-00.05|00.00", knob}
    mug = truth[ids["Mug|-00.66|+00.74|+00.59"] - 1]
    np.testing.assert_allclose(mug.box_min, (-0.71, 0.55, 0.74), atol=1e-4)
    np.testing.assert_allclose(mug.box_max, (-0.60, 0.63, 0.835), atol=1e-4)
    for thing, source in ((truth[ids[o["objectId"]] - 1], o) for o in objects if o["objectId"] in ids):
        corners = np.array(source["axisAlignedBoundingBox"]["cornerPoints"])[:, [0, 2, 1]]
        np.testing.assert_allclose(thing.box_min, corners.min(0), atol=1e-4)
        np.testing.assert_allclose(thing.box_max, corners.max(0), atol=1e-4)
        assert unity.type_of({"objectId": source["objectId"]}) == source["objectType"] == thing.label
    assert "Sink|+01.90|+00.80|-01.25|SinkBasin" in ids


def test_a_thing_without_a_box_is_left_out_aloud(thor: Any) -> None:
    recording = thor.explore("FloorPlan1")
    assert recording.notes[0] == "left out, because AI2-THOR gives no box for them: Sink|+01.38|+00.81|-01.27|SinkBasin"
    assert {t.id for t in recording.truth} >= set(np.unique(recording[0].instances)) - {0}
