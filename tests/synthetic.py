"""A room of boxes, rendered in closed form: exact depth, exact instances, known sizes. The tests' own ground truth."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cartier.errors import frame_number
from cartier.types import Camera, Detections, DetectorScoreModel, Frame, TrueObject

CAMERA = Camera(160, 120, 120.0, 120.0, 79.5, 59.5)
SMALL = Camera(80, 60, 60.0, 60.0, 39.5, 29.5)
ROOM = ((0.0, 0.0, 0.0), (5.0, 4.0, 2.6))


def look(eye: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """world_from_camera (4, 4) of a level camera (no roll) at ``eye`` that looks at ``target``."""
    forward = np.subtract(target, eye).astype(float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


def box(id: int, label: str, low: Sequence[float], high: Sequence[float]) -> TrueObject:
    return TrueObject(id, label, tuple(map(float, low)), tuple(map(float, high)))


def render(pose: np.ndarray, camera: Camera, objects: Sequence[TrueObject]) -> tuple[np.ndarray, np.ndarray]:
    """z-depth (H, W) and instance ids (H, W) of boxes inside a closed room, by the slab method."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1) @ pose[:3, :3].T
    along = [np.ascontiguousarray(rays[..., axis]) for axis in range(3)]
    eye = pose[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):

        def slabs(low: Sequence[float], high: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
            t = [((low[i] - eye[i]) / ray, (high[i] - eye[i]) / ray) for i, ray in enumerate(along)]
            near, far = ([pick(*both) for both in t] for pick in (np.minimum, np.maximum))
            return np.fmax(np.fmax(near[0], near[1]), near[2]), np.fmin(np.fmin(far[0], far[1]), far[2])

        depth = slabs(*ROOM)[1]
        ids = np.zeros(depth.shape, np.int32)
        for obj in objects:
            near, far = slabs(obj.box_min, obj.box_max)
            hit = (near <= far) & (near > 1e-6) & (near < depth)
            depth = np.where(hit, near, depth)
            ids[hit] = obj.id
    return depth.astype(np.float32), ids


@dataclass
class RoomRecording:
    """Obeys the Recording contract; every frame is rendered when asked for."""

    poses: Sequence[np.ndarray]
    objects: Sequence[TrueObject]
    camera: Camera = CAMERA
    with_depth: bool = True
    name: str = "synthetic room"
    notes: Sequence[str] = field(default_factory=tuple)

    @property
    def truth(self) -> Sequence[TrueObject]:
        return self.objects

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Frame:
        pose = self.poses[frame_number(index, len(self), self.name)].copy()
        depth, ids = render(pose, self.camera, self.objects)
        colours = np.random.default_rng(0).integers(40, 255, (max([o.id for o in self.objects], default=0) + 1, 3))
        return Frame(
            index,
            index / 10,
            colours[ids].astype(np.uint8),
            depth if self.with_depth else None,
            pose,
            self.camera,
            ids,
        )

    def fingerprint(self) -> str:
        return hashlib.sha256(repr((self.poses, self.objects, self.camera, self.with_depth)).encode()).hexdigest()


class TrueBoxes:
    """A detector that reads the instances: the tests' stand-in for a detector, and called ground truth."""

    name = "ground truth (test)"
    score_model = DetectorScoreModel(
        0.5,
        spawn_threshold=0.0,
        zero_weight_score=0.0,
        full_weight_score=0.01,
        prior_log_odds=6.0,
        measured="it is the truth",
    )

    def __init__(self, objects: Sequence[TrueObject], with_masks: bool = False) -> None:
        self.labels = {o.id: o.label for o in objects}
        self.with_masks = with_masks

    def detect(self, frame: Frame) -> Detections:
        assert frame.instances is not None
        boxes, labels, masks = [], [], []
        for number, label in self.labels.items():
            mask = frame.instances == number
            if mask.sum() >= 20:
                rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
                boxes.append((cols[0], rows[0], cols[-1] + 1, rows[-1] + 1))
                labels.append(label)
                masks.append(mask)
        return Detections(
            frame.index, np.array(boxes, np.float32), np.ones(len(boxes), np.float32), tuple(labels),
            np.array(masks, bool).reshape(-1, *frame.instances.shape) if self.with_masks else None,
        )  # fmt: skip


CHAIR = box(1, "chair", (3.6, 1.8, 0), (4.1, 2.3, 0.9))
MUG = box(2, "mug", (1.45, 3.45, 0.8), (1.55, 3.55, 0.9))
TABLE = box(3, "table", (0.8, 3.2, 0), (2.2, 3.8, 0.8))
THINGS = (CHAIR, MUG, TABLE)


def walk(objects: Sequence[TrueObject] = THINGS, with_depth: bool = True) -> RoomRecording:
    """A camera at 1.5 m that walks round the room, half a metre a step, and looks about, somewhat down."""
    corners = np.array([(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (2.6, 2.4), (1.0, 2.4), (1.0, 1.0)])
    poses: list[np.ndarray] = []
    for here, there in itertools.pairwise(corners):
        for along in np.arange(0, 1, 0.25):
            x, y = here + along * (there - here)
            angle = 2.4 * len(poses)
            poses.append(look((x, y, 1.5), (x + math.cos(angle), y + math.sin(angle), 1.5 - 0.55)))
    return RoomRecording(poses, objects, with_depth=with_depth)


def small_walk(objects: Sequence[TrueObject] = THINGS, with_depth: bool = True) -> RoomRecording:
    """The same walk by a camera of a quarter of the pixels, mapped in a third of the time: where pixels are not the
    matter."""
    return replace(walk(objects, with_depth), camera=SMALL)
