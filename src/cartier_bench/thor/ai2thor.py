"""AI2-THOR: any iTHOR or RoboTHOR scene of an installed build, or a ProcTHOR house from a JSON file.

Uses ``ai2thor.controller.Controller``. This project's tests never run Unity itself: they start the real client on a
stand-in that speaks the build's protocol.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from cartier.contracts import Recording
from cartier.errors import BackendError, InputError, frame_number
from cartier.io.files import read_json
from cartier.types import Camera, Frame, TrueObject
from cartier_bench.thor import unity

if TYPE_CHECKING:
    from cartier_bench.thor.thor_build import Build

T = TypeVar("T")
EXTRA = "thor"
AGENT = ("position", "rotation", "horizon", "standing")  # where a ProcTHOR house wants its agent
LOAD_S = 120.0  # a build may take so long to start or to load a scene


def make(
    executable: str | Path | None = None,
    server: str = "fifo",
    x_display: str | None = None,
    width: int = 640,
    height: int = 480,
    fov: float = 90.0,
    grid_size: float = 0.25,
    timeout_s: float = 4.0,
) -> Thor:
    """A world; its build is started when it is first needed.

    ``executable`` is the build's command line; without it the client downloads the build that belongs to its version.
    ``fov`` is Unity's vertical one, in degrees; ``grid_size`` (m) the distance of neighbouring places; a build that
    does not answer an action within ``timeout_s`` counts as hung and is stopped. Raises BackendError for an impossible
    option.
    """
    import ai2thor  # noqa: F401  # reports at once that the extra is missing

    _check(server in ("fifo", "wsgi"), f"server must be fifo or wsgi, got {server!r}")
    _check(0 < width <= 4096 and 0 < height <= 4096, f"width and height must be 1 to 4096 px, got {width}x{height}")
    _check(5 <= fov <= 150, f"fov must be 5 to 150 degrees (vertical), got {fov:g}")
    _check(0.05 <= grid_size <= 1, f"grid_size must be 0.05 to 1 m, got {grid_size:g}")
    _check(0 < timeout_s <= 600, f"timeout_s must be above 0 and at most 600, got {timeout_s:g}")
    options = {"width": width, "height": height, "fieldOfView": fov, "gridSize": grid_size, "x_display": x_display}
    if executable is not None:
        from cartier_bench.thor.thor_build import command_line

        options["local_executable_path"] = command_line(executable)
        if sys.platform.startswith("linux") and not (x_display or os.environ.get("DISPLAY")):
            raise BackendError(
                "AI2-THOR's Linux build needs an X display: start one (Xvfb :1 -screen 0 1024x768x24 &) and set "
                "DISPLAY=:1, or give the option x_display=:1"
            )
    return Thor(server, options, timeout_s)


def _check(ok: bool, message: str) -> None:
    if not ok:
        raise BackendError(f"AI2-THOR: {message}")


@dataclass(frozen=True)
class Stop:
    """One view of a tour: where the agent stands (m, our world; z is that of the agent's middle), and how it looks.

    ``yaw`` and ``horizon`` are Unity's degrees, clockwise from +y and downwards.
    """

    position: tuple[float, float, float]
    yaw: float
    horizon: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A loaded home: true objects, their ids by objectId, and the reachable ``places`` (N, 3)."""

    camera: Camera
    truth: list[TrueObject]
    ids: dict[str, int]
    notes: list[str]
    begin: tuple[float, ...]
    places: npt.NDArray[np.float64]


class Thor:
    """Obeys the World contract. One build shows one home at a time; its recordings take turns."""

    name = "ai2thor"

    def __init__(self, server: str, options: dict[str, Any], timeout_s: float) -> None:
        self._server, self._options, self._timeout_s = server, options, timeout_s
        self._scenes: dict[str, Scene] = {}
        self._build: Build | None = None
        self._shown: str | None = None
        self._closed = False

    def homes(self) -> list[str]:
        """The build's scenes. A path to a ProcTHOR house (.json) is a home as well."""
        names = {re.sub(r"^(FloorPlan\d+)_physics$", r"\1", name) for name in self._ask(lambda build: build.scenes())}
        return sorted(names - {"Procedural"}, key=lambda n: [p.zfill(9) for p in re.split(r"(\d+)", n)])

    def explore(
        self,
        home: str,
        spacing_m: float = 1.0,
        headings: int = 4,
        horizons: Sequence[float] = (0.0, 30.0),
        seed: int = 0,
        **unknown: Any,
    ) -> Recording:
        """Views from places that lie at most ``spacing_m`` of walking from every reachable one, on a greedy tour.

        At each place it looks in ``headings`` directions, at each camera pitch of ``horizons`` (degrees, positive
        down). Seed 0 begins where the agent wakes up, any other at a place of its own. Frames are rendered when they
        are asked for. Raises InputError for an unknown home, BackendError if the build fails.
        """
        if unknown:
            known = "spacing_m, headings, horizons, seed"
            raise BackendError(f"exploring AI2-THOR has no option {next(iter(unknown))!r}; it has {known}")
        _check(
            spacing_m > 0 and headings > 0 and len(horizons) > 0, "spacing_m, headings and horizons must not be empty"
        )
        scene = self._scene(home)
        places = scene.places
        begin = places[np.random.default_rng(seed).integers(len(places))].tolist() if seed else scene.begin
        stops = [
            Stop(tuple(places[i].tolist()), 360.0 * turn / headings, float(pitch))
            for i in tour(places, begin, self._options["gridSize"], spacing_m)
            for turn in range(headings)
            for pitch in horizons
        ]
        return ThorRecording(self, home, scene, stops)

    def objects(self, home: str) -> list[TrueObject]:
        """All objects of a home with their true boxes, as they are when it is loaded."""
        return self._scene(home).truth

    def free(self, home: str, xy: Sequence[float]) -> bool:
        """Whether the agent can stand within half a grid cell of a point."""
        off_m = np.abs(self._scene(home).places[:, :2] - np.asarray(xy, dtype=np.float64)).max(1)
        return bool(off_m.min() <= self._options["gridSize"] / 2 + 1e-6)

    def view(self, home: str, stop: Stop) -> tuple[Any, tuple[float, float]]:
        """The client's event at a stop, and the camera's near and far plane (m)."""
        if self._shown != home:
            self._show(home)
        place, rotation = unity.to_unity(stop.position), {"x": 0.0, "y": stop.yaw, "z": 0.0}
        event = self._step("Teleport", position=place, rotation=rotation, horizon=stop.horizon, forceAction=True)
        return event, self._ask(lambda build: build.clip_planes_m())

    def close(self) -> None:
        """Stop the build; its recordings can render no more."""
        self._closed = True
        self._drop()

    def _scene(self, home: str) -> Scene:
        if home not in self._scenes:
            start = self._show(home)
            found = self._step("GetReachablePositions").metadata["actionReturn"]
            places = [unity.point({"place": place}, "place") for place in found or ()]
            if not places:
                raise BackendError(f"AI2-THOR finds no reachable place in {home}: try a smaller grid_size")
            begin = unity.point(unity.field(start, "agent"), "position")
            truth, ids, notes = unity.true_objects(unity.field(start, "objects"))
            if re.match(r"FloorPlan_(Train|Val)", home):
                notes.append("a RoboTHOR scene, seen with the default agent's camera: LoCoBot's camera hangs lower")
            self._scenes[home] = Scene(unity.camera(start), truth, ids, notes, begin, np.array(places))
        return self._scenes[home]

    def _show(self, home: str) -> Any:
        """Load a home anew; the metadata of its first event."""
        house = read_house(Path(home)) if home.endswith(".json") else None
        if house is None and home not in (known := self.homes()):
            close = get_close_matches(home, known, 3) or known[:3]
            raise InputError(
                f"AI2-THOR's build has no scene {home!r} among its {len(known)}; there is {', '.join(close)}"
            )
        self._shown = None
        event = self._ask(lambda build: build.reset(house or home))
        if house and (agent := house["metadata"].get("agent")):
            event = self._step("TeleportFull", **{key: agent[key] for key in AGENT if key in agent})
        self._shown = home
        return event.metadata

    def _step(self, action: str, **arguments: Any) -> Any:
        return self._ask(lambda build: build.step(action, **arguments))

    def _ask(self, work: Callable[[Build], T]) -> T:
        """``work`` done with the running build, which is started if there is none, and forgotten if it fails."""
        if self._closed:
            raise BackendError("this AI2-THOR world was closed: make it again")
        if self._build is None:
            from cartier_bench.thor.thor_build import Build

            options = self._options | {"renderDepthImage": True, "renderInstanceSegmentation": True}
            self._build = Build(self._server, options, LOAD_S, self._timeout_s)
            self._finalizer = weakref.finalize(self, self._build.stop)
        try:
            return work(self._build)
        except BaseException:
            if not self._build.running:
                self._drop()
            raise

    def _drop(self) -> None:
        if self._build is not None:
            self._finalizer()
        self._build = self._shown = None


def read_house(file: Path) -> dict[str, Any]:
    house = read_json(file)
    if not isinstance(house, dict) or not isinstance(house.get("rooms"), list):
        raise InputError(f"{file} is no ProcTHOR house: it holds no list of rooms")
    metadata = house.setdefault("metadata", {})
    if not isinstance(metadata, dict) or not isinstance(metadata.get("agent", {}), dict):
        raise InputError(f"{file} is no ProcTHOR house: its metadata.agent is no pose")
    return house


class ThorRecording:
    """Obeys the Recording contract: each frame is rendered by the build when it is asked for."""

    def __init__(self, world: Thor, home: str, scene: Scene, stops: Sequence[Stop]) -> None:
        self.name = f"ai2thor {Path(home).stem}"
        self.camera = scene.camera
        self.truth: Sequence[TrueObject] | None = scene.truth
        self.notes: Sequence[str] = [
            *scene.notes,
            "times assumed: one second per frame; between views the agent teleports",
        ]
        self._world, self._home, self._stops, self._ids = world, home, stops, scene.ids

    def __len__(self) -> int:
        return len(self._stops)

    def __getitem__(self, index: int) -> Frame:
        index = frame_number(index, len(self), self.name)
        event, (near_m, far_m) = self._world.view(self._home, self._stops[index])
        if event.frame is None or event.depth_frame is None or event.instance_segmentation_frame is None:
            raise BackendError(f"frame {index}: AI2-THOR's build sent no picture, depth or instance masks")
        return Frame(
            index=index,
            time_s=float(index),
            rgb=np.ascontiguousarray(event.frame),
            depth_m=unity.depth(event.depth_frame, near_m, far_m),
            world_from_camera=unity.pose(event.metadata),
            camera=unity.camera(event.metadata),
            instances=unity.instances(event.instance_masks, self._ids, event.depth_frame.shape),
        )

    def fingerprint(self) -> str:
        content = {"stops": [vars(s) for s in self._stops], "camera": vars(self.camera), "home": self._home}
        content["truth"] = [vars(obj) for obj in self.truth or ()]
        return hashlib.sha256(("ai2thor 1 " + json.dumps(content, sort_keys=True)).encode()).hexdigest()


def tour(places: npt.NDArray[np.float64], begin: Sequence[float], step_m: float, spacing_m: float) -> list[int]:
    """Indices of ``places`` (N, 3), in walking order: each place is within ``spacing_m`` of walking from one of them.

    Greedy: from where it stands to the nearest place that is not yet covered. Neighbours lie ``step_m`` apart.
    """
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import KDTree

    tree = KDTree(places[:, :2])
    steps = tree.sparse_distance_matrix(tree, 1.1 * step_m, output_type="coo_matrix")
    uncovered = np.ones(len(places), bool)
    here = int(np.linalg.norm(places - np.asarray(begin), axis=1).argmin())
    chosen: list[int] = []
    while True:
        chosen.append(here)
        walk_m = dijkstra(steps, indices=[here])[0]
        uncovered &= walk_m > spacing_m + 1e-6
        if not uncovered.any():
            return chosen
        if np.isinf(walk_m[uncovered]).all():  # there is no way to what is left: as the crow flies
            walk_m = np.linalg.norm(places - places[here], axis=1)
        here = int(np.where(uncovered, walk_m, np.inf).argmin())
