"""Log of detections: the boxes of every processed frame, and the object that each was associated with."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier.io.files import npz_bytes, read_npz
from cartier.types import Array, Detections

MAX_DETECTIONS = 60  # per frame, as many as are associated
MAX_BOXES = 400_000  # 16 bytes each
MAX_LABEL_CHARS = 80
KINDS = {
    "frames": "i4", "counts": "i4", "boxes_px": "i2", "scores": "f2", "labels": "i4", "objects": "i4",
    "names": "U", "least": "f8",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ProcessedFrame:
    """A frame that the detector processed.

    Args:
        detections: Its N most confident detections, with boxes in whole pixels.
        objects: (N,) int32, the id of the object that each was associated with, -1 for none.
    """

    detections: Detections
    objects: npt.NDArray[np.int32]


class DetectionLog:
    """Keeps the ``MAX_DETECTIONS`` most confident boxes of each frame, without masks.

    Memory is bounded: of more than ``MAX_BOXES``, the more confident half stays. ``least`` is the score below which
    boxes were dropped, 0 as long as none were.
    """

    def __init__(self) -> None:
        self.least = 0.0
        self._names: dict[str, int] = {}
        self._frames, self._counts = array("i"), array("i")
        self._boxes, self._scores, self._labels, self._objects = array("h"), array("f"), array("i"), array("i")

    def add(self, detections: Detections, objects: npt.NDArray[np.int64]) -> None:
        """Keep the detections of one more frame.

        Args:
            detections: Its N detections.
            objects: (N,) int64, the id of the object that each was associated with, -1 for none.
        """
        best = np.argsort(-detections.scores, kind="stable")[:MAX_DETECTIONS]
        limits = np.iinfo(np.int16)
        self._frames.append(detections.frame)
        self._counts.append(len(best))
        self._boxes.frombytes(
            np.rint(detections.boxes_xyxy[best]).clip(limits.min, limits.max).astype(np.int16).tobytes()
        )
        self._scores.frombytes(detections.scores[best].tobytes())
        names = (detections.labels[k][:MAX_LABEL_CHARS] for k in best)
        self._labels.extend(self._names.setdefault(name, len(self._names)) for name in names)
        self._objects.frombytes(objects[best].astype(np.int32).tobytes())
        if len(self._scores) > MAX_BOXES:
            self._thin()

    def _thin(self) -> None:
        """Drop the less confident half."""
        columns = self._columns()
        order = np.argsort(-columns["scores"], kind="stable")
        stays = np.sort(order[: MAX_BOXES // 2])
        owner = np.repeat(np.arange(len(columns["counts"])), columns["counts"])[stays]
        columns |= {name: columns[name][stays] for name in ("boxes_px", "scores", "labels", "objects")}
        columns["counts"] = np.bincount(owner, minlength=len(columns["counts"])).astype(np.int32)
        self.least = float(columns["scores"].min())
        self._take(columns)

    def _columns(self) -> dict[str, Array]:
        return {
            "frames": np.array(self._frames, np.int32), "counts": np.array(self._counts, np.int32),
            "boxes_px": np.array(self._boxes, np.int16).reshape(-1, 4), "scores": np.array(self._scores, np.float32),
            "labels": np.array(self._labels, np.int32), "objects": np.array(self._objects, np.int32),
        }  # fmt: skip

    def _take(self, columns: dict[str, Array]) -> None:
        self._frames, self._counts = (array("i", columns[name].tolist()) for name in ("frames", "counts"))
        self._boxes, self._scores = array("h", columns["boxes_px"].ravel().tolist()), array("f", columns["scores"])
        self._labels, self._objects = (array("i", columns[name].tolist()) for name in ("labels", "objects"))

    def co_detected(self, other: DetectionLog) -> dict[tuple[int, int], int]:
        """Which objects of two logs of the same detections were seen in the same boxes.

        Args:
            other: The log of another map of these frames.

        Returns:
            How many boxes two objects share, by the object's id here and its id there.
        """
        shared, theirs, at = Counter[tuple[int, int]](), dict[int, list[int]](), 0
        for frame, count in zip(other._frames, other._counts, strict=True):
            theirs[frame] = other._objects[at : at + count].tolist()
            at += count
        at = 0
        for frame, count in zip(self._frames, self._counts, strict=True):
            mine, at = self._objects[at : at + count].tolist(), at + count
            if len(mine) == len(theirs.get(frame, ())):
                shared.update(zip(mine, theirs[frame], strict=True))
        return {pair: count for pair, count in shared.items() if min(pair) >= 0}

    def renumber(self, new_ids: Mapping[int, int]) -> None:
        """Give objects other ids.

        Args:
            new_ids: The new id of each object by its old one; others keep theirs.
        """
        self._objects = array("i", [new_ids.get(number, number) for number in self._objects])

    def state(self) -> bytes:
        """The log in stored form.

        Returns:
            NPZ bytes, for ``restore``.
        """
        columns = self._columns()
        columns["scores"] = columns["scores"].astype(np.float16)
        names = np.array(list(self._names), str)
        return npz_bytes(**columns, names=names, least=np.array(self.least))

    def restore(self, data: bytes) -> None:
        """Replace the log by a stored one.

        Args:
            data: What ``state`` returned.

        Raises:
            InputError: It is damaged.
        """
        columns = read_npz(data, where="the log of detections")
        try:
            for name, kind in KINDS.items():
                if columns[name].dtype.kind != kind[0] or (kind != "U" and columns[name].dtype != np.dtype(kind)):
                    raise ValueError(f"{name} is of another kind")
            count, looked = len(columns["scores"]), columns["frames"].shape
            shapes = columns["boxes_px"].shape == (count, 4) and columns["labels"].shape == columns["objects"].shape
            if not shapes or columns["scores"].shape != (count,) or columns["labels"].shape != (count,):
                raise ValueError("columns of other lengths")
            counts, labels, names = columns["counts"], columns["labels"], columns["names"]
            flat = counts.shape == looked and counts.ndim == 1 and counts.min(initial=0) >= 0
            if not flat or int(counts.sum(dtype=np.int64)) != count:
                raise ValueError("frames and boxes that do not go together")
            if names.ndim != 1 or labels.min(initial=0) < 0 or labels.max(initial=-1) >= len(names):
                raise ValueError("a label has no name")
            self.least = float(columns["least"])
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the log of detections is damaged ({error}): map the recording again") from error
        self._names = {str(name): number for number, name in enumerate(names.tolist())}
        self._take(columns)

    def looked(self) -> dict[int, ProcessedFrame]:
        """The frames of the log.

        Returns:
            The processed frames by their numbers.

        Raises:
            InputError: A box or score is invalid.
        """
        columns, names, found, start = self._columns(), list(self._names), {}, 0
        for frame, count in zip(self._frames, self._counts, strict=True):
            part = slice(start, start + count)
            labels = tuple(names[k] for k in columns["labels"][part])
            boxes = columns["boxes_px"][part].astype(np.float32)
            seen = Detections(frame, boxes, columns["scores"][part], labels)
            found[frame] = ProcessedFrame(seen, columns["objects"][part])
            start += count
        return found
