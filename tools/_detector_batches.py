"""Training batches: random crops of rendered frames, disturbed as cameras do, with CenterNet's targets."""

from __future__ import annotations

import io
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.ndimage import uniform_filter1d

CROP = (320, 240)  # training sees parts of frames; the network is convolutional, so that use sees whole ones
NEAREST = 0.42  # of a frame's width: things are shown at half to 1.2 times the size that a frame of 640 pixels has them
LEAST_WIDE = 250  # pixels: what is rendered is not to be blown up much
STRIDE = 4
SPREAD = 0.54  # of TTFNet: a Gaussian's deviation is its box side * SPREAD / 6


SELDOM = 0.06  # share of the frames below which a name makes a frame be drawn more often
WELL_SEEN = 300  # pixels of a box that show enough of a thing for its name to count there
AIMED = 0.5  # of the crops are laid around a thing, the more seldom its name the likelier
PART = 1500  # pixels of a box that are enough to know a thing by, even if a crop has most of it cut off
SMALL = 40  # pixels of a box below which a thing is neither to be found nor wrong to be found


class Pool:
    """The frames of the shards in a folder, as JPEG, the newest that fit in ``room`` bytes; ``refresh`` looks for new
    shards."""

    def __init__(self, folder: Path, room: int) -> None:
        self._folder, self._room = folder, room
        self._seen: set[str] = set()
        self._held = 0
        self._odds, self._repeat = np.zeros(0), np.zeros(0)
        self.frames: deque[tuple[bytes, Any, Any, Any]] = deque()

    def refresh(self, most: int = 1000) -> None:
        """At most ``most`` new shards: reading them all at once would hold up the training."""
        for path in [p for p in sorted(self._folder.glob("*.npz")) if p.name not in self._seen][:most]:
            self._seen.add(path.name)
            with np.load(path, allow_pickle=False) as shard:
                images, boxes, labels, frame, kinds = (
                    shard[key] for key in ("images", "boxes", "labels", "frame", "kinds")
                )
            with ThreadPoolExecutor(2) as both:
                files = list(both.map(_jpeg, images))
            for i, data in enumerate(files):
                mine = frame == i
                self.frames.append((data, boxes[mine], labels[mine], kinds[i]))
                self._held += len(data) + kinds[i].nbytes
        while self._held > self._room:
            data, _, _, cells = self.frames.popleft()
            self._held -= len(data) + cells.nbytes
        self._odds = np.cumsum(self._repeats())

    def draw(self, rng: np.random.Generator) -> tuple[Any, Any, Any, Any, Any]:
        """A random frame: image (h, w, 3) uint8, boxes, labels, cells, and the middle (2,) of what to crop around, or
        None."""
        data, boxes, labels, cells = self.frames[int(np.searchsorted(self._odds, rng.uniform(0, self._odds[-1])))]
        well, aim = np.flatnonzero(_well_seen(boxes)), None
        if len(well) and rng.random() < AIMED:
            odds = self._repeat[labels[well]] ** 2
            box = boxes[rng.choice(well, p=odds / odds.sum())]
            aim = (box[:2] + box[2:]) / 2
        return np.asarray(Image.open(io.BytesIO(data))), boxes, labels, cells, aim

    def _repeats(self) -> Any:
        """How often each frame is drawn: more often if it shows a name that is in few frames (LVIS, Gupta et al.
        2019)."""
        shown = [np.unique(labels[_well_seen(boxes)]) for _, boxes, labels, _ in self.frames]
        share = np.bincount(np.concatenate(shown)) / len(shown)
        self._repeat = np.clip((SELDOM / np.maximum(share, 1e-9)) ** 0.75, 1, 6)
        return np.array([self._repeat[labels].max() if len(labels) else 0.5 for labels in shown])

    def counts(self, classes: int) -> Any:
        """How many boxes of each class there are."""
        return np.bincount(np.concatenate([labels for _, _, labels, _ in self.frames]), minlength=classes)


def _well_seen(boxes: Any) -> Any:
    return (boxes[:, 2:] - boxes[:, :2]).prod(1) >= WELL_SEEN


def _jpeg(rgb: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "JPEG", quality=92, subsampling=0)
    return file.getvalue()


@dataclass(frozen=True)
class Batch:
    """``images`` (B, 3, h, w) float32, 0 to 1; of the heatmaps only what is not zero: ``spots`` (M, 4) of image, row,
    column and class, with their ``heat`` (M,), of which ``hits`` (K,) are the middles; ``boxes`` (B, 5, h/4, w/4): xyxy
    and weight; ``kinds`` (B, h/4, w/4): the class of each cell, -1 for walls; ``objects`` (T, 6): image, xyxy and class
    of each."""

    images: Any
    spots: Any
    heat: Any
    hits: Any
    boxes: Any
    kinds: Any
    objects: Any


def batch(pool: Pool, size: int, rng: np.random.Generator) -> Batch:
    """Random crops of random frames."""
    columns, rows = CROP[0] // STRIDE, CROP[1] // STRIDE
    images = np.empty((size, CROP[1], CROP[0], 3), np.float32)
    boxes = np.zeros((size, 5, rows, columns), np.float32)
    kinds = np.empty((size, rows, columns), np.int64)
    spots, heats, objs = [], [], []
    for k in range(size):
        images[k], xyxy, labels, kinds[k] = _cropped(*pool.draw(rng), rng)
        objs.append(np.column_stack([np.full(len(labels), k), xyxy, labels]))
        for label, heat in draw_targets(xyxy, labels, boxes[k]).items():
            y, x = np.nonzero(heat)
            spots.append(np.stack([np.full_like(y, k), y, x, np.full_like(y, label)], 1))
            heats.append(heat[y, x])
    where = np.concatenate(spots) if spots else np.zeros((0, 4), np.int64)
    heat = np.concatenate(heats) if heats else np.zeros(0, np.float32)
    hits = np.flatnonzero(heat == 1)
    return Batch(images.transpose(0, 3, 1, 2), where, heat, hits, boxes, kinds, np.concatenate(objs))


def _cropped(
    rgb: Any, boxes: Any, labels: Any, kinds: Any, aim: Any, rng: np.random.Generator
) -> tuple[Any, Any, Any, Any]:
    """``NEAREST`` of a frame's width to all of it, maybe mirrored, with the boxes of which enough is left, and cells'
    classes.

    ``aim`` (2,), if any, is to be in it, not at its rim.
    """
    high, wide = rgb.shape[:2]
    part_of = float(np.exp(rng.uniform(np.log(max(NEAREST, LEAST_WIDE / wide)), 0)))
    w, h = wide * part_of, high * part_of
    room = np.array([wide - w, high - h])
    low, most = np.zeros(2), room
    if aim is not None:
        low, most = (np.clip(aim - part * np.array([w, h]), 0, room) for part in (0.9, 0.1))
    x, y = rng.uniform(low, most).tolist()
    part = Image.fromarray(rgb).resize(CROP, Image.Resampling.BILINEAR, (x, y, x + w, y + h))
    moved = (boxes - (x, y, x, y)) * (CROP[0] / w, CROP[1] / h, CROP[0] / w, CROP[1] / h)
    cut = np.clip(moved, 0, CROP * 2)
    before = (moved[:, 2:] - moved[:, :2]).prod(1)
    sides = cut[:, 2:] - cut[:, :2]
    left = sides.prod(1)
    keep = (sides.min(1) > 0.5) & (left > 4) & ((left > 0.2 * before) | (left > PART))
    image, cut, labels = np.asarray(part, np.float32) / 255, cut[keep], labels[keep]
    columns, rows = CROP[0] // STRIDE, CROP[1] // STRIDE
    down = ((y + (np.arange(rows) + 0.5) * h / rows) / STRIDE).astype(np.intp)
    across = ((x + (np.arange(columns) + 0.5) * w / columns) / STRIDE).astype(np.intp)
    cells = kinds[np.ix_(np.minimum(down, kinds.shape[0] - 1), np.minimum(across, kinds.shape[1] - 1))]
    if rng.random() < 0.5:
        image, cells = image[:, ::-1], cells[:, ::-1]
        cut = np.stack([CROP[0] - cut[:, 2], cut[:, 1], CROP[0] - cut[:, 0], cut[:, 3]], 1)
    return _disturbed(image, rng), cut, labels, cells


def _disturbed(image: Any, rng: np.random.Generator) -> Any:
    """Exposure, contrast, gamma, white balance and colour, sometimes blur, noise and grey."""
    if rng.random() < 0.85:
        image = image ** np.float32(np.exp(rng.normal(0, 0.15)))
        gain = np.exp(rng.normal(0, 0.10) + rng.normal(0, 0.05, 3)).astype(np.float32)
        image = (image - 0.5) * np.float32(np.exp(rng.normal(0, 0.12))) + 0.5
        image = image * gain
        if rng.random() < 0.4:
            grey = image.mean(2, keepdims=True)
            image = grey + (image - grey) * np.float32(rng.uniform(0.3, 1.5))
    if rng.random() < 0.15:
        image = uniform_filter1d(uniform_filter1d(image, int(rng.integers(2, 4)), axis=0), 2, axis=1)
    if rng.random() < 0.5:
        image = image + np.float32(rng.uniform(0, 0.025)) * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(image, 0, 1)


def draw_targets(boxes: Any, labels: Any, target: Any) -> dict[int, Any]:
    """TTFNet's targets (Liu et al. 2020): an elliptic Gaussian per box in its class, and the box wherever that is high.

    Large boxes first, so that where two meet the smaller one is learnt. Very small ones are not learnt, and the heat
    that is all but 1 there says that it is no mistake to see them. Returns the heat (h, w) of each class that there is.
    """
    rows, columns = target.shape[1:]
    heats: dict[int, Any] = {}
    sizes = (boxes[:, 2:] - boxes[:, :2]).prod(1) if len(boxes) else np.zeros(0)
    for i in np.argsort(-sizes):
        heat = heats.setdefault(int(labels[i]), np.zeros((rows, columns), np.float32))
        x1, y1, x2, y2 = boxes[i].tolist()
        cx, cy = min(int((x1 + x2) / 2 / STRIDE), columns - 1), min(int((y1 + y2) / 2 / STRIDE), rows - 1)
        if sizes[i] < SMALL:
            part = heat[max(0, cy - 1) : cy + 2, max(0, cx - 1) : cx + 2]
            np.maximum(part, np.float32(0.99), out=part)
            continue
        rx, ry = max(0, int((x2 - x1) / 2 / STRIDE * SPREAD)), max(0, int((y2 - y1) / 2 / STRIDE * SPREAD))
        a1, a2, b1, b2 = max(0, cx - rx), min(columns, cx + rx + 1), max(0, cy - ry), min(rows, cy + ry + 1)
        dx = (np.arange(a1, a2) - cx) / ((2 * rx + 1) / 6)
        dy = (np.arange(b1, b2) - cy) / ((2 * ry + 1) / 6)
        spot = np.exp(-0.5 * (dy[:, None] ** 2 + dx[None] ** 2)).astype(np.float32)
        part = heat[b1:b2, a1:a2]
        np.maximum(part, spot, out=part)
        box = target[:, b1:b2, a1:a2]
        inner = spot > 0.1
        weight = spot / float(spot[inner].sum())
        for k, value in enumerate((x1, y1, x2, y2)):
            box[k][inner] = value
        box[4][inner] = weight[inner]
    return heats
