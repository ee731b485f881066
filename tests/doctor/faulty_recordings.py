"""Recordings for the doctor: walks through built-in homes, the same with one fault each, and AI2-THOR frames."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from cartier.contracts import Recording
from cartier.doctor.hypotheses import QUARTER
from cartier.errors import frame_number
from cartier.mapping.upright import turned_camera, turned_image
from cartier.types import Camera, Frame, TrueObject
from cartier_bench.thor import unity
from cartier_dollhouse.explore import explore
from cartier_dollhouse.recording import EYE_M, DollhouseRecording, look, pinhole
from cartier_dollhouse.scene import load_home
from cartier_dollhouse.sensor import Sensor

LEVEL_BELOW_M = 0.5  # a camera as low as that looks straight ahead, as a vacuum robot's does

Change = Callable[[Frame, Recording], Frame]


class Thor:
    """A folder of AI2-THOR frames: 8-bit depth (metres = value / 51, 255 = 5 m or more), poses in Unity's frame."""

    name = "thor"
    truth: Sequence[TrueObject] | None = None
    notes: Sequence[str] = ()

    def __init__(self, root: Path) -> None:
        self.root = root
        poses = json.loads((root / "poses.json").read_text())
        self.frames = poses["frames"]
        numbers = poses["intrinsics"]
        size, focal = numbers["width"], numbers["fx"]
        self.camera = Camera(size, numbers["height"], focal, numbers["fy"], (size - 1) / 2, (numbers["height"] - 1) / 2)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        told = self.frames[frame_number(index, len(self), self.name)]
        agent = {"rotation": {"x": 0.0, "y": told["yaw_deg"], "z": 0.0}, "cameraHorizon": told["pitch_down_deg"]}
        metadata = {"agent": agent, "cameraPosition": dict(zip("xyz", told["position"], strict=True))}
        stem = f"{told['frame']:04d}"
        value = np.asarray(Image.open(self.root / f"{stem}_depth.png"))
        depth_m = value.astype(np.float32) / np.float32(51)
        depth_m[(value == 0) | (value == 255)] = np.nan
        rgb = np.asarray(Image.open(self.root / f"{stem}_rgb.png").convert("RGB"))
        return Frame(index, float(index), rgb, depth_m, unity.pose(metadata), self.camera)

    def fingerprint(self) -> str:
        return hashlib.sha256(json.dumps(self.frames).encode()).hexdigest()


class Walk:
    """A robot's walk through a built-in home, to be seen by a camera at any height."""

    def __init__(self, home: str, seed: int = 0, width: int = 160, max_frames: int = 800) -> None:
        self.seed, self.scene, self.camera = seed, load_home(home), pinhole(width, width * 3 // 4)
        self.way = explore(self.scene, self.camera, seed=seed, max_frames=max_frames)

    def seen(self, eye_m: float = EYE_M, sensor: bool = False) -> Kept:
        poses = self.way.poses.copy()
        poses[:, 2, 3] = eye_m
        if eye_m < LEVEL_BELOW_M:
            poses = np.array([look((x, y), yaw, 0.0, eye_m) for x, y, yaw in self.way.track])
        return Kept(DollhouseRecording(self.scene, self.camera, poses, Sensor(self.seed) if sensor else None))


WALK_FRAMES = 40


@cache
def walk(home: str) -> Walk:
    """A short walk that the tests share; benchmarks/doctor.py walks all the way."""
    return Walk(home, max_frames=WALK_FRAMES)


@cache
def seen(home: str, eye_m: float, sensor: bool = False) -> Kept:
    """The same, by a camera at this height; held in memory, and not to be changed."""
    return walk(home).seen(eye_m, sensor)


class Faulty:
    """A recording with each frame changed; ``numbers`` picks frames, ``camera`` overrides the intrinsics."""

    truth: Sequence[TrueObject] | None = None
    notes: Sequence[str] = ()

    def __init__(
        self,
        source: Recording,
        change: Change = lambda frame, source: frame,
        numbers: Sequence[int] | None = None,
        camera: Camera | None = None,
    ) -> None:
        self.source, self.change = source, change
        self.name = source.name
        self.camera = camera or source.camera
        self.numbers = list(range(len(source))) if numbers is None else list(numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def __getitem__(self, index: int) -> Frame:
        number = self.numbers[frame_number(index, len(self), self.name)]
        frame = self.change(self.source[number], self.source)
        return replace(frame, index=index, camera=self.camera)

    def fingerprint(self) -> str:
        return self.source.fingerprint()


class Kept:
    """A recording held in memory, so that twenty faults cost one reading; its poses are the source's."""

    def __init__(self, source: Recording, numbers: Sequence[int] | None = None) -> None:
        self.name, self.camera, self.truth, self.notes = source.name, source.camera, None, source.notes
        chosen = range(len(source)) if numbers is None else numbers
        self.frames = [replace(source[i], index=k, instances=None) for k, i in enumerate(chosen)]
        self._fingerprint = source.fingerprint()

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Frame:
        return self.frames[frame_number(index, len(self), self.name)]

    def fingerprint(self) -> str:
        return self._fingerprint


def joined(*walks: Recording) -> Kept:
    """Several walks as one recording, one after the other."""
    whole = Kept(walks[0])
    whole.frames = [frame for walk in walks for frame in Kept(walk).frames]
    whole.frames = [replace(frame, index=i, time_s=float(i)) for i, frame in enumerate(whole.frames)]
    return whole


def posed(change: Callable[[np.ndarray, int], np.ndarray]) -> Callable[[Recording], Recording]:
    """Poses changed by their matrix and frame number."""
    return lambda source: Faulty(
        source, lambda f, _: replace(f, world_from_camera=change(f.world_from_camera, f.index))
    )


def deep(change: Callable[[np.ndarray, int], np.ndarray | None]) -> Callable[[Recording], Recording]:
    """Depth changed by its image and frame number."""
    return lambda source: Faulty(source, lambda f, _: replace(f, depth_m=change(f.depth_m, f.index)))  # type: ignore[arg-type]


def axes(*signs: float) -> np.ndarray:
    return np.diag([*signs, 1.0])


def late(frames: int) -> Callable[[Recording], Recording]:
    """Frame i has the pose of frame i - frames; the first ones repeat the first pose."""

    def change(frame: Frame, source: Recording) -> Frame:
        at = min(max(frame.index - frames, 0), len(source) - 1)
        return replace(frame, world_from_camera=source[at].world_from_camera)

    return lambda source: Faulty(source, change)


def other_size(factor: float) -> Callable[[Recording], Recording]:
    """Intrinsics of images that are ``factor`` times as large."""

    def make(source: Recording) -> Recording:
        c = source.camera
        camera = replace(
            c, fx=c.fx * factor, fy=c.fy * factor, cx=(c.cx + 0.5) * factor - 0.5, cy=(c.cy + 0.5) * factor - 0.5
        )
        return Faulty(source, camera=camera)

    return make


def moved(zoom: float, dx: int, dy: int) -> Callable[[np.ndarray, int], np.ndarray]:
    """Depth zoomed about the middle and moved by pixels of a 640 px wide image."""

    def change(depth_m: np.ndarray, _: int) -> np.ndarray:
        height, width = depth_m.shape
        cols = np.rint((np.arange(width) - width / 2 - dx * width / 640) / zoom + width / 2).astype(int)
        rows = np.rint((np.arange(height) - height / 2 - dy * width / 640) / zoom + height / 2).astype(int)
        there: np.ndarray = depth_m[rows.clip(0, height - 1)[:, None], cols.clip(0, width - 1)].copy()
        there[(rows < 0) | (rows >= height)] = np.nan
        there[:, (cols < 0) | (cols >= width)] = np.nan
        return there

    return change


def tilted(degrees: float, axis: int = 0) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz"[axis], degrees, degrees=True).as_matrix()
    return turn


def leap(first: int, last: int, way_m: float) -> Callable[[np.ndarray, int], np.ndarray]:
    """Frames first to last stand elsewhere."""

    def change(pose: np.ndarray, i: int) -> np.ndarray:
        there = pose.copy()
        if first <= i <= last:
            there[:2, 3] += (way_m, -0.4 * way_m)
        return there

    return change


def in_units(per_metre: float) -> Callable[[np.ndarray, int], np.ndarray]:
    """Positions in another unit than metres."""

    def change(pose: np.ndarray, _: int) -> np.ndarray:
        there = pose.copy()
        there[:3, 3] *= per_metre
        return there

    return change


def bad_rotation(pose: np.ndarray, i: int) -> np.ndarray:
    there = pose.copy()
    if i % 7 == 3:
        there[:3, :3] *= 1.3
    return there


def rotated(turns: int) -> Callable[[Recording], Recording]:
    """Images turned to the left with their intrinsics and camera axes: the world stays where it is."""

    def change(frame: Frame, source: Recording) -> Frame:
        camera, old_from_new = turned_camera(frame.camera, turns)
        depth_m = None if frame.depth_m is None else turned_image(frame.depth_m, turns)
        pose = frame.world_from_camera @ old_from_new
        return replace(
            frame, rgb=turned_image(frame.rgb, turns), depth_m=depth_m, world_from_camera=pose, camera=camera
        )

    return lambda source: Faulty(source, change, camera=turned_camera(source.camera, turns)[0])


def blurred(sigma: float, every: int = 1) -> Callable[[Recording], Recording]:
    def change(frame: Frame, _: Recording) -> Frame:
        if frame.index % every:
            return frame
        return replace(frame, rgb=gaussian_filter(frame.rgb, (sigma, sigma, 0)).astype(np.uint8))

    return lambda source: Faulty(source, change)


UNITY = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # swaps y and z

INJECTED: dict[str, tuple[str, Callable[[Recording], Recording]]] = {
    "inverted": ("inverted_poses", posed(lambda p, i: np.linalg.inv(p))),
    "opengl": ("opengl_axes", posed(lambda p, i: p @ axes(1, -1, -1))),
    "pictures turned, poses not": ("opengl_axes", posed(lambda p, i: p @ QUARTER.T)),
    "mirrored y": ("left_handed", posed(lambda p, i: axes(1, -1, 1) @ p @ axes(-1, 1, 1))),
    "unity": ("left_handed", posed(lambda p, i: UNITY @ p @ axes(1, -1, 1))),
    "determinant -1": ("left_handed", posed(lambda p, i: axes(1, -1, 1) @ p)),
    "poses in mm": ("pose_scale", posed(in_units(1000))),
    "poses in cm": ("pose_scale", posed(in_units(100))),
    "depth x 1000": ("depth_scale", deep(lambda d, i: d * np.float32(1000))),
    "depth / 1000": ("depth_scale", deep(lambda d, i: d / np.float32(1000))),
    "depth x 5": ("depth_scale", deep(lambda d, i: d * np.float32(5))),
    "depth / 5": ("depth_scale", deep(lambda d, i: d / np.float32(5))),
    "depth x 1.2": ("depth_scale", deep(lambda d, i: d * np.float32(1.2))),
    "depth 24 px right": ("depth_not_registered", deep(moved(1, 24, 0))),
    "depth zoomed 1.1": ("depth_not_registered", deep(moved(1.1, 0, 6))),
    "intrinsics x 2": ("intrinsics_resolution", other_size(2)),
    "intrinsics / 2": ("intrinsics_resolution", other_size(0.5)),
    "late by 1": ("time_offset", late(1)),
    "early by 2": ("time_offset", late(-2)),
    "black depth": ("no_depth", deep(lambda d, i: np.full_like(d, np.nan))),
    "constant depth": ("no_depth", deep(lambda d, i: np.full_like(d, 1.0))),
    "scaled rotations": ("bad_rotation", posed(bad_rotation)),
    "tilted 12 degrees": ("not_level", posed(lambda p, i: tilted(12) @ p)),
    "turned to the left": ("rotated_images", rotated(1)),
    "turned to the right": ("rotated_images", rotated(3)),
    "upside down": ("rotated_images", rotated(2)),
    "y up": ("not_level", posed(lambda p, i: tilted(-90) @ p)),
    "jump for good": ("pose_jump", posed(leap(21, 10**6, 0.9))),
    "jump of one frame": ("pose_jump", posed(leap(12, 12, 1.0))),
    "blurred": ("blur", blurred(3)),
    "every 3rd blurred": ("blur", blurred(3, 3)),
    "5 frames": ("too_few_views", lambda source: Faulty(source, numbers=range(5))),
    "standing still": ("too_few_views", lambda source: Faulty(source, numbers=[7] * 30)),
}  # fmt: skip
