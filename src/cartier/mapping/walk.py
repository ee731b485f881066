"""A whole recording into a mapper: every frame's depth, and the detections of keyframes."""

from __future__ import annotations

from collections.abc import Callable

from cartier.contracts import Recording
from cartier.mapping.detection_cache import Detect
from cartier.mapping.keyframes import Keyframes
from cartier.mapping.mapper import Mapper
from cartier.mapping.pose_graph import PoseGraph
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.types import Frame


def integrate(
    mapper: Mapper,
    recording: Recording,
    detect: Detect,
    every: int | None,
    graph: PoseGraph | None,
    progress: Callable[[int, int], None] | None,
) -> int:
    """Map all frames of a recording, and show them to ``graph``; returns in how many objects were detected."""
    keyframes, processed, waiting = Keyframes(every, mapper.config.keyframes), 0, list[Frame]()
    batch = batch_size(mapper.detector, recording.camera)
    for done, frame in enumerate(prefetch(recording, batch), 1):
        if graph is not None:
            graph.add(frame)
        waiting += keyframes.push(frame) if mapper.integrate_depth(frame) else []
        waiting += keyframes.flush() if done == len(recording) else []
        if len(waiting) >= batch or done == len(recording):
            for keyframe, detections in zip(waiting, detect(waiting), strict=True):
                mapper.integrate_detections(keyframe, detections)
            processed, waiting = processed + len(waiting), []
        if progress:
            progress(done, len(recording))
    return processed
