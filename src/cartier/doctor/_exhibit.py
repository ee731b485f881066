"""The pair of frames that shows the report best."""

from __future__ import annotations

import numpy as np

from cartier.doctor._consistency import Pairs, motions, turns_deg
from cartier.doctor._diagnosis import Diagnosis, small_camera
from cartier.doctor._readings import Reading
from cartier.doctor._report import Exhibit
from cartier.doctor.sampling import Samples
from cartier.geometry import backproject, transform
from cartier.types import Array


def exhibit(samples: Samples, diagnosis: Diagnosis) -> Exhibit | None:
    """Of the pairs that overlap in the mended recording the one that agrees best, as given and as mended."""
    pairs, reading = diagnosis.mended.pairs, diagnosis.reading
    if not len(pairs):
        return None
    motion = motions(reading.shifted(samples.poses, samples.index), pairs)
    small = small_camera(samples, reading.camera(samples.camera))
    score = np.nan_to_num(Pairs(samples, pairs).agreement(motion, reading.depth_scale, small).met)
    telling = np.minimum(turns_deg(motion), 30) / 100
    a, b = (int(i) for i in pairs[int((score + telling).argmax())])
    given = _off(samples, Reading(diagnosis.reading.level), a, b)
    return Exhibit(int(samples.index[a]), int(samples.index[b]), given, _off(samples, diagnosis.reading, a, b))


def _off(samples: Samples, reading: Reading, a: int, b: int) -> Array:
    """How far (m) a's depth, carried into b, lies off b's, at b's pixels (h, w); NaN where nothing falls."""
    camera = small_camera(samples, reading.camera(samples.camera))
    poses = reading.shifted(samples.poses, samples.index)
    depth = samples.depth_m * np.float32(reading.depth_scale)
    image = np.full(depth.shape[1:], np.nan, np.float32)
    motion = motions(poses, np.array([[a, b]]))[0]
    if not np.isfinite(motion).all():
        return image
    points = transform(motion, backproject(depth[a], camera).reshape(-1, 3))
    points = points[np.isfinite(points[:, 2]) & (points[:, 2] > 1e-6)]
    u = np.rint(points[:, 0] / points[:, 2] * camera.fx + camera.cx)
    v = np.rint(points[:, 1] / points[:, 2] * camera.fy + camera.cy)
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    rows, cols, z = v[inside].astype(int), u[inside].astype(int), points[inside, 2]
    order = np.argsort(-z)  # the nearest is written last and stays
    image[rows[order], cols[order]] = z[order]
    return np.asarray(np.abs(image - depth[b]), dtype=np.float32)
