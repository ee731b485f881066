"""Rendered views of training homes, as npz shards: where cameras stand, and what they see."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from _detector_homes import ROBOT_M, varied
from scipy.ndimage import find_objects

from cartier_dollhouse import shapes
from cartier_dollhouse.generate import generate
from cartier_dollhouse.model import Scene
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import look, pinhole
from cartier_dollhouse.render import Renderer
from cartier_dollhouse.scene import load_scene

SIZE = (640, 480)
CLOSE_SIZE = (320, 240)  # of a close-up: the middle of a frame, which is all that training sees of one anyway
MIN_PIXELS = 64
POSES = 90  # views per home: the light's bake is paid once, and costs more than all of them
CLOSE_POSES, CLOSE_CROWD = 160, 1.8
SMALL_M = 0.45  # what is not larger is looked at in close-ups
HARD = (  # what is taken for something else the most: faced four times as often
    "Apple", "ButterKnife", "Candle", "Cloth", "CreditCard", "DishSponge", "Fork", "KeyChain", "Knife", "Ladle", "Pan",
    "Pen", "Plunger", "Spatula", "Spoon",
)  # fmt: skip


def poses(scene: Scene, count: int, rng: np.random.Generator) -> list[Any]:
    """Cameras where a robot fits: level to steep, 0.8 to 1.6 m above the floor; nearly half face a thing from near.

    Such a thing may be of any type, the smaller the likelier. The others stand anywhere; of four random yaws they
    mostly take that with most to see. Small things would hardly ever be seen from near if all did so.
    """
    plan, found = Plan(scene, ROBOT_M), []
    middle = np.array([(*obj.at[:2], obj.at[2] + obj.shape.size[2] / 2) for obj in scene.things])
    at = middle[:, :2]
    kinds, first = np.unique([obj.type for obj in scene.things], return_index=True)
    of = np.array([obj.type for obj in scene.things])
    odds = np.array([max(scene.things[i].shape.size) for i in first]) ** -1.0
    boxes = np.array([room.box for room in scene.rooms])
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    for _ in range(60 * count):
        near = rng.random() < 0.45
        if near:
            obj = middle[rng.choice(np.flatnonzero(of == rng.choice(kinds, p=odds / odds.sum())))]
            way, far = rng.uniform(0, math.tau), rng.uniform(0.5, 1.4)
            xy = obj[:2] + far * np.array([math.cos(way), math.sin(way)])
        else:
            box = boxes[rng.choice(len(boxes), p=areas / areas.sum())]
            xy = rng.uniform(box[:2], box[2:])
        if plan.free(xy):
            eye = 1.5 if rng.random() < 0.5 else float(rng.uniform(0.8, 1.6))
            down = math.radians(float(rng.choice((0.0, 22.5, 22.5))) + float(rng.normal(0, 6)))
            if rng.random() < 0.06:
                down = math.radians(float(rng.uniform(30, 55)))
            ways = rng.uniform(0, math.tau, 4 if rng.random() < 0.7 else 1).tolist()
            yaw = max(ways, key=lambda yaw: _in_view(at, xy, yaw))
            if near:
                yaw = math.atan2(obj[1] - xy[1], obj[0] - xy[0]) + float(rng.normal(0, 0.25))
                down = float(np.clip(math.atan2(eye - obj[2], far) + rng.normal(0, 0.2), -0.1, 0.75))
            found.append(look(xy, yaw, down, eye))
        if len(found) == count:
            break
    return found


def close_ups(scene: Scene, count: int, rng: np.random.Generator) -> list[Any]:
    """Cameras where a robot fits, each with a small thing somewhere ahead, all types as often but for the hard ones."""
    plan, found = Plan(scene, ROBOT_M), []
    small = [obj for obj in scene.things if max(obj.shape.size) <= SMALL_M]
    middle = np.array([(*obj.at[:2], obj.at[2] + obj.shape.size[2] / 2) for obj in small])
    of = np.array([obj.type for obj in small])
    kinds = np.unique(of)
    odds = np.where(np.isin(kinds, HARD), 4.0, 1.0)
    for _ in range(40 * count):
        obj = middle[rng.choice(np.flatnonzero(of == rng.choice(kinds, p=odds / odds.sum())))]
        way, far = rng.uniform(0, math.tau), rng.uniform(0.45, 1.5)
        xy = obj[:2] + far * np.array([math.cos(way), math.sin(way)])
        if plan.free(xy):
            eye = 1.5 if rng.random() < 0.6 else float(rng.uniform(0.9, 1.6))
            yaw = math.atan2(obj[1] - xy[1], obj[0] - xy[0]) + float(rng.uniform(-0.3, 0.3))
            found.append(look(xy, yaw, math.atan2(eye - obj[2], far) + float(rng.uniform(-0.2, 0.2)), eye))
        if len(found) == count:
            break
    return found


def _in_view(at: Any, xy: Any, yaw: float) -> int:
    """How many things lie ahead, walls not asked."""
    way = at - xy
    far = np.hypot(*way.T)
    return int((((way @ (math.cos(yaw), math.sin(yaw))) > 0.78 * far) & (far < 3.5)).sum())


def frames(seed: int, close: bool = False) -> dict[str, Any]:
    """Frames of one generated home: images (N, h, w, 3) uint8 of ``SIZE``, or of ``CLOSE_SIZE`` for close-ups.

    ``boxes`` (K, 4) float32, xyxy, with label, frame and pixels (K,). ``kinds`` (N, h/4, w/4) int16 has the number of
    the name at the middle of each cell of 4 × 4 pixels, -1 for walls and floors.
    """
    rng = np.random.default_rng((seed, 8))
    scene = load_scene(generate(seed))
    scene = varied(scene, rng, CLOSE_CROWD if close else 1.0)
    seen_from = close_ups(scene, CLOSE_POSES, rng) if close else poses(scene, POSES, rng)
    fov = 62.0 if rng.random() < 0.6 else float(rng.uniform(52, 72))
    wide, high = CLOSE_SIZE if close else SIZE
    # a close-up has a frame's focal length: it shows a part of it, no larger
    part = 2 * math.degrees(math.atan(wide / SIZE[0] * math.tan(math.radians(fov) / 2)))
    renderer = Renderer(scene, pinhole(wide, high, part))
    number = {kind: k for k, kind in enumerate(shapes.types())}
    kind_of = np.array([-1] + [number[t.type] for t in scene.things])
    images, boxes, labels, which, pixels, kinds = (list[Any]() for _ in range(6))
    for pose in seen_from:
        view = renderer.render(pose)
        count_of = np.bincount(view.instances.ravel())
        ids = np.flatnonzero(count_of >= MIN_PIXELS)
        ids = ids[ids > 0]
        if not len(ids):
            continue
        spans = find_objects(view.instances)
        boxes += [(s[1].start, s[0].start, s[1].stop, s[0].stop) for s in (spans[i - 1] for i in ids)]
        labels += kind_of[ids].tolist()
        which += [len(images)] * len(ids)
        pixels += count_of[ids].tolist()
        images.append(view.rgb)
        kinds.append(kind_of[view.instances[2::4, 2::4]])
    return {
        "images": np.array(images, np.uint8).reshape(-1, high, wide, 3),
        "boxes": np.array(boxes, np.float32).reshape(-1, 4),
        "labels": np.array(labels, np.int64),
        "frame": np.array(which, np.int64),
        "pixels": np.array(pixels, np.int64),
        "kinds": np.array(kinds, np.int16).reshape(-1, high // 4, wide // 4),
    }


def render_into(folder: Path, first: int, homes: int, keep: int, close: bool) -> None:
    """Homes from seed ``first`` on, one shard each, until ``homes`` were made; the oldest go when there are more than
    ``keep``.

    A shard is written beside and renamed, so that a reader never meets half of one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(first, first + homes):
        target = folder / f"{seed:08d}.npz"
        if target.exists():
            continue
        start = time.time()
        try:
            made = frames(seed, close)
        except Exception as error:  # one home that cannot be built must not end a night's rendering
            print(f"home {seed} left out: {type(error).__name__}: {error}", flush=True)
            continue
        if not len(made["images"]):
            continue
        part = target.with_suffix(".part")
        with part.open("wb") as file:
            np.savez(file, **made)
        part.replace(target)
        for old in sorted(folder.glob("*.npz"))[:-keep]:
            old.unlink()
        print(f"home {seed}: {len(made['images'])} frames in {time.time() - start:.1f} s", flush=True)
