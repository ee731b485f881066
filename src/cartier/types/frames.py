"""Frames: one image with its pose and camera, what a detector found in it, and what its scores are worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import MAX_TIME_S, BackendError, check_camera, check_pose, need, only_readings

Array = npt.NDArray[Any]
Floats = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion.

    Args:
        width, height: The size of its images in pixels.
        fx, fy: The focal lengths in pixels.
        cx, cy: The principal point in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        check_camera(self.width, self.height, (self.fx, self.fy, self.cx, self.cy))

    def scaled(self, width: int, height: int) -> Camera:
        """The same camera with images of another size.

        Args:
            width, height: The new size in pixels.

        Returns:
            The camera; pixel centres stay at whole numbers.
        """
        sx, sy = width / self.width, height / self.height
        return Camera(width, height, self.fx * sx, self.fy * sy, (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5)


@dataclass(frozen=True, eq=False)
class Frame:
    """One RGB-D image with its pose. All its images have the size of ``camera``; ``cropped`` gives a part.

    Args:
        index: Its number in the recording, from 0.
        time_s: When it was taken.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32, or None without depth.
        world_from_camera: (4, 4) pose.
        camera: The camera, of the size of the image.
        instances: (H, W) int32, a simulator's true object ids (0 = none). Only what is *called* ground truth may read
            them.
    """

    index: int
    time_s: float
    rgb: npt.NDArray[np.uint8]
    depth_m: npt.NDArray[np.float32] | None
    world_from_camera: npt.NDArray[np.float64]
    camera: Camera
    instances: npt.NDArray[np.int32] | None = None

    def __post_init__(self) -> None:
        shape, where = (self.camera.height, self.camera.width), f"frame {self.index}"
        need(math.isfinite(self.time_s), f"{where}: time_s must be finite, got {self.time_s}")
        in_ns = f"{where}: {self.time_s:g} is no time in seconds: are its stamps in nanoseconds? divide them by 1e9"
        need(abs(self.time_s) <= MAX_TIME_S, in_ns)
        right = self.rgb.shape == (*shape, 3) and self.rgb.dtype == np.uint8
        need(right, f"{where}: rgb must be {(*shape, 3)} uint8, got {self.rgb.shape} {self.rgb.dtype}")
        for name, image in (("depth_m", self.depth_m), ("instances", self.instances)):
            if image is not None:
                need(image.shape == shape, f"{where}: {name} must be {shape}, got {image.shape}")
        if self.depth_m is not None:
            object.__setattr__(self, "depth_m", only_readings(self.depth_m, where))
        object.__setattr__(self, "world_from_camera", check_pose(self.world_from_camera, where))

    def cropped(self, box_xyxy: Sequence[int]) -> Frame:
        """A part of the image, with its depth and the camera that sees that part alone.

        The pose stays, and the camera's principal point moves, so pixels show the same points of the world as before.
        A detector that looks at parts adds (x1, y1) to their boxes: its detections are those of the whole image.

        Args:
            box_xyxy: The part in whole pixels; x2 and y2 are the first that are left out.

        Returns:
            The part, with the index and time of the frame.

        Raises:
            InputError: The part is empty or reaches out of the image.
        """
        x1, y1, x2, y2 = box_xyxy
        width, height, where = self.camera.width, self.camera.height, f"frame {self.index}"
        inside = 0 <= x1 < x2 <= width and 0 <= y1 < y2 <= height
        need(inside, f"{where}: a part must lie in the {width}x{height} px of its image, got {tuple(box_xyxy)}")
        camera = replace(self.camera, width=x2 - x1, height=y2 - y1, cx=self.camera.cx - x1, cy=self.camera.cy - y1)
        depth = None if self.depth_m is None else self.depth_m[y1:y2, x1:x2]
        instances = None if self.instances is None else self.instances[y1:y2, x1:x2]
        rgb = self.rgb[y1:y2, x1:x2]
        return Frame(self.index, self.time_s, rgb, depth, self.world_from_camera, camera, instances)


@dataclass(frozen=True, eq=False)
class Detections:
    """The N detections of one frame, low scores included.

    Args:
        frame: The number of the frame.
        boxes_xyxy: (N, 4) float32, pixels.
        scores: (N,) float32, 0 to 1.
        labels: N display names.
        masks: (N, H, W) bool, or None.
    """

    frame: int
    boxes_xyxy: npt.NDArray[np.float32]
    scores: npt.NDArray[np.float32]
    labels: tuple[str, ...]
    masks: npt.NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # 1e308 becomes infinite, which is refused below
            boxes = np.asarray(self.boxes_xyxy, dtype=np.float32).reshape(-1, 4)
            scores = np.asarray(self.scores, dtype=np.float32).reshape(-1)
        object.__setattr__(self, "boxes_xyxy", boxes)
        object.__setattr__(self, "scores", scores)
        object.__setattr__(self, "labels", tuple(self.labels))
        n, where = len(self.labels), f"detections of frame {self.frame}"
        need(len(boxes) == len(scores) == n, f"{where}: {len(boxes)} boxes, {len(scores)} scores, {n} labels")
        finite = bool(np.isfinite(boxes).all() and np.isfinite(scores).all())
        need(finite, f"{where}: a box or score is NaN or infinite")
        need(bool((boxes[:, 2:] >= boxes[:, :2]).all()), f"{where}: a box has x2 < x1 or y2 < y1")
        need(self.masks is None or len(self.masks) == n, f"{where}: as many masks as boxes are needed")

    def __len__(self) -> int:
        return len(self.labels)

    def keep(self, which: Array) -> Detections:
        """Some of the detections.

        Args:
            which: Their indices, or a boolean mask (N,).

        Returns:
            The detections chosen.
        """
        chosen = np.arange(len(self))[which]
        labels = tuple(self.labels[i] for i in chosen)
        masks = None if self.masks is None else self.masks[chosen]
        return Detections(self.frame, self.boxes_xyxy[chosen], self.scores[chosen], labels, masks)


@dataclass(frozen=True)
class DetectorScoreModel:
    """What a detector's scores say about existence; the defaults are cautious values for unmeasured detectors.

    Args:
        threshold: The score from which a single detection counts.
        spawn_threshold: The score from which a detection starts a new object.
        zero_weight_score, full_weight_score: The scores at which a detection weighs 0 and 1.
        beta_true, beta_false: Beta(a, b) distributions of the share of viewpoint bins with a detection, for real
            objects and for false positives.
        prior_log_odds: The log-odds of an object before any frame.
        best_view_log_odds: What its best viewpoint bin adds.
        log_odds_per_log_width: What the log-odds lose for each factor e by which its best view is wider than 0.1 rad:
            real objects that appear large are detected reliably.
        measured: The data that it was measured on; empty for the defaults.
    """

    threshold: float = 0.5
    spawn_threshold: float = 0.32
    zero_weight_score: float = 0.32
    full_weight_score: float = 0.5
    beta_true: tuple[float, float] = (1.5, 1.25)
    beta_false: tuple[float, float] = (0.19, 15.0)
    prior_log_odds: float = -2.0
    best_view_log_odds: float = 1.4
    log_odds_per_log_width: float = 0.0
    measured: str = ""

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DetectorScoreModel:
        """A score model from JSON values.

        Args:
            values: Fields by name; those left out have their defaults.

        Returns:
            The score model.

        Raises:
            TypeError, ValueError: A field is unknown, or a value is out of range.
        """
        given: dict[str, Any] = {
            name: tuple(map(float, value)) if isinstance(value, list) else value for name, value in values.items()
        }
        model = cls(**given)
        scores = (model.threshold, model.spawn_threshold, model.zero_weight_score, model.full_weight_score)
        betas = (*model.beta_true, *model.beta_false)
        log_odds = (model.prior_log_odds, model.best_view_log_odds, model.log_odds_per_log_width)
        if not all(map(math.isfinite, (*scores, *betas, *log_odds))) or min(scores) < 0 or max(scores) > 1:
            raise ValueError("scores lie between 0 and 1, and all numbers are finite")
        if not model.zero_weight_score < model.full_weight_score:
            raise ValueError("zero_weight_score must be below full_weight_score")
        if len(model.beta_true) != 2 or len(model.beta_false) != 2 or min(betas) <= 0:
            raise ValueError("beta_true and beta_false are two positive numbers each")
        return model

    def with_threshold(self, threshold: float | None) -> DetectorScoreModel:
        """The same with another threshold; its other scores are scaled with it, and it no longer counts as measured.

        Args:
            threshold: The new threshold; None changes nothing.

        Returns:
            The score model.

        Raises:
            BackendError: The threshold is not from 0 to 1.
        """
        if threshold is None or threshold == self.threshold:
            return self
        if not 0 <= threshold <= 1:
            raise BackendError(f"option threshold must be from 0 to 1, got {threshold}")
        factor = threshold / max(self.threshold, 1e-6)
        given = (self.zero_weight_score, self.spawn_threshold, self.full_weight_score)
        zero, spawn, full = (min(factor * score, 1.0) for score in given)
        return replace(
            self, threshold=threshold, zero_weight_score=min(zero, 0.99), spawn_threshold=spawn,
            full_weight_score=max(full, zero + 0.01), measured="",
        )  # fmt: skip


@dataclass(frozen=True)
class TrueObject:
    """A simulator's object: ground truth, never an estimate.

    Args:
        id: Its number in ``Frame.instances``, from 1.
        label: Its display name.
        box_min, box_max: Its axis-aligned box in the world (m).
    """

    id: int
    label: str
    box_min: tuple[float, ...]
    box_max: tuple[float, ...]
