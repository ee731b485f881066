"""VLMaps: a top-down grid of mean image features, searched with any words; needs depth and an --encoder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier import plugins
from cartier.contracts import Encoder, EncoderDefaults, optional
from cartier.errors import BackendError, CartierError, InputError
from cartier.io.files import json_bytes, npz_bytes, parse_json, read_npz
from cartier.types import Array, Detections, Frame, MapObject, Place
from cartier_bench.baselines.fusion import CELL, FeatureGrid

DOMINATES = 0.05  # share of the map's mean energy in one dimension; evenly spread it would be 1 / D, 0.2 % for 512
EQUAL = 1e-3  # cosines this close are the same
BACKGROUND = "wall and floor"  # of uncovered surfaces; with zeros, a trace of the object beside them would pass for it
STRIDE = 4  # pixels per label feature: a mug at 3 m is still 15 features wide in a 640 px image


def make(encoder: str | Encoder = "embedded", cell_m: float = 0.05) -> VLMaps:
    """``encoder`` is NAME or NAME:MODEL as on the command line, or an Encoder; ``cell_m`` the side of a cell."""
    return VLMaps(encoder, cell_m)


class VLMaps:
    """Per cell the mean feature over all points that fell into it; a place is the cell most similar to the words.

    Source: VLMaps (Huang et al. 2023, arXiv 2210.05714) as CARTIER (arXiv 2307.11865) uses it: 2-D grid, cosine
    similarity after dropping the dominating dimensions, the best cell wins. Memory grows with the cells seen, not with
    frames.
    """

    def __init__(self, encoder: str | Encoder, cell_m: float) -> None:
        self._spec = encoder if isinstance(encoder, str) else None
        self._encoder = None if isinstance(encoder, str) else encoder
        self._names: list[str] = []
        self._called: dict[str, str] = {}
        self._grid = FeatureGrid(cell_m)
        self._search: tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]] | None = None
        self._texts: dict[str, Array] = {}
        self._made_by = ""

    @property
    def encoder(self) -> str:
        """Which encoder made the features, and from what."""
        return self._made_by

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(optional(self._encoder, EncoderDefaults, "notes"))

    def add(self, frame: Frame, detections: Detections) -> None:
        if frame.depth_m is None:
            return
        encoder = self._working_encoder()
        if not encoder.text_only:
            features = encoder.image(frame)
            self._made_by = encoder.name
        else:
            features = label_features(frame, detections, self._vectors)
            self._made_by = f"{encoder.name}, from the detector's labels"
        try:
            self._grid.add(features, frame.depth_m, frame.camera, frame.world_from_camera, frame.index)
        except BackendError as error:
            raise BackendError(f"encoder {encoder.name}: {error}") from error
        self._search = None

    def set_objects(self, objects: Sequence[MapObject]) -> None:
        sure = [obj for obj in objects if obj.confirmed]
        self._names = sorted({obj.label for obj in sure})
        self._called = {name: obj.label for obj in sure for name in obj.names}  # no picture shows whose it is

    def names(self) -> list[str]:
        return sorted({*self._names, *self._called}) if len(self._grid.cells) else []

    def locate(self, name: str) -> Place | None:
        """The cell most similar to any words, at the mean height of what was seen in it; the score is the cosine.

        Of cells that are equally good (features of labels are often the same) it is the one seen in most pixels.
        """
        cells = self._grid.cells
        if not len(cells):
            return None
        cosines = self._cosines(self._called.get(name, name))
        best = int(np.where(cosines >= cosines.max() - EQUAL, cells["pixels"], 0).argmax())
        x, y = (cells["xy"][best] + 0.5) * self._grid.cell_m
        z = cells["height_sum"][best] / cells["pixels"][best]
        return Place(name, (float(x), float(y), float(z)), float(cosines[best]), int(cells["frame"][best]))

    def similarity(self, words: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float32], float]:
        """Centres (n, 2) of the cells in metres, the words' cosine with each (n,), and the side of a cell in metres."""
        centres = (self._grid.cells["xy"] + 0.5) * self._grid.cell_m
        return centres, self._cosines(words), self._grid.cell_m

    def state(self) -> dict[str, bytes]:
        cells = self._grid.cells
        means = (self._grid.sums / np.maximum(cells["pixels"], 1)[:, None]).astype(np.float16)
        if not np.isfinite(means).all():
            raise BackendError(f"encoder {self._made_by}: features above 65,504 cannot be stored in half precision")
        # so that a home can be asked for its names without the encoder's model
        texts = self._names if len(self._grid.cells) else []
        about = {"encoder": self._spec, "made_by": self._made_by, "cell_m": self._grid.cell_m}
        return {
            "grid.npz": npz_bytes(cells=cells, features=means),
            "texts.npz": npz_bytes(texts=np.array(texts, np.str_), vectors=self._vectors(texts)),
            "vlmaps.json": json_bytes(about),
        }

    def restore(self, state: Mapping[str, bytes]) -> None:
        about = parse_json(state["vlmaps.json"], "vlmaps.json")
        grid, texts = read_npz(state["grid.npz"], where="grid.npz"), read_npz(state["texts.npz"], where="texts.npz")
        try:
            self._spec, self._made_by = about["encoder"], str(about["made_by"])
            if not isinstance(self._spec, str | None):
                raise TypeError("the encoder's name is no text")
            self._grid = FeatureGrid(float(about["cell_m"]))
            cells, features = grid["cells"], grid["features"]
            if cells.dtype != CELL or features.ndim != 2 or len(features) != len(cells):
                raise ValueError("arrays of another kind or length")
            if len(cells):
                self._grid.restore(cells, features.astype(np.float32) * cells["pixels"][:, None].astype(np.float32))
            vectors = texts["vectors"].astype(np.float32)
            if not np.isfinite(vectors).all():
                raise ValueError("a text's vector holds NaN or infinity")
            self._texts = dict(zip(texts["texts"].tolist(), vectors, strict=True))
        except (ValueError, KeyError, TypeError, OverflowError, CartierError) as error:
            raise InputError(f"the index vlmaps is damaged ({error})") from error

    def __deepcopy__(self, memo: dict[int, Any]) -> VLMaps:
        memo[id(self._encoder)] = self._encoder  # a model is shared, not copied
        copied = VLMaps.__new__(VLMaps)
        copied.__dict__ = deepcopy(self.__dict__, memo)
        return copied

    def _cosines(self, words: str) -> npt.NDArray[np.float32]:
        if self._search is None:
            self._search = searchable(self._grid.sums)
        rows, kept = self._search
        vector = self._vectors([words])[0]
        if len(vector) != len(kept):
            raise InputError(f"the map's features have {len(kept)} dimensions, the encoder's words {len(vector)}")
        vector = vector[kept]
        cosines: npt.NDArray[np.float32] = rows @ (vector / max(float(np.linalg.norm(vector)), 1e-12))
        return cosines

    def _vectors(self, texts: Any) -> Array:
        new = [text for text in dict.fromkeys(texts) if text not in self._texts]
        if new:
            self._texts |= dict(zip(new, self._working_encoder().text(new).astype(np.float32), strict=True))
        return np.stack([self._texts[text] for text in texts]) if texts else np.zeros((0, 0), np.float32)

    def _working_encoder(self) -> Encoder:
        if self._encoder is None:
            if self._spec is None:
                raise InputError(
                    f"these words are new, and only {self._made_by} can encode them: it is not a named backend"
                )
            if self._spec.partition(":")[0].endswith(".py") and self._made_by:
                raise InputError(f"this home's encoder is {self._spec}; code that a home names is not run")
            self._encoder = plugins.make_from_spec("encoders", self._spec)
        return self._encoder


def searchable(sums: Array) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Unit rows (n, kept dimensions) for cosines, and which of the D dimensions are kept.

    CLIP-like features have a few dimensions that are large and nearly the same everywhere. They say nothing about
    *where*, yet they decide the cosine. A dimension is dropped if its mean over the cells holds more than 5 % of the
    energy of the mean vector (or 5 times an even share, where there are few dimensions) and varies less than a third of
    that mean.
    """
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    rows = np.divide(sums, norms, out=np.zeros(sums.shape, np.float32), where=norms > 0)
    seen = rows[norms[:, 0] > 0]
    if not len(seen):
        return rows, np.ones(sums.shape[1], bool)
    mean, spread = seen.mean(0), seen.std(0)
    share = max(DOMINATES, 5 / len(mean))
    kept = (mean**2 <= share * (mean**2).sum()) | (spread > np.abs(mean) / 3)
    if not kept.all():
        rows = rows[:, kept]
        norms = np.linalg.norm(rows, axis=1, keepdims=True)
        np.divide(rows, norms, out=rows, where=norms > 0)
    return np.asfortranarray(
        rows
    ), kept  # column by column: a product with one vector is then twice as fast on one thread


def label_features(
    frame: Frame, detections: Detections, text: Callable[[Sequence[str]], Array]
) -> npt.NDArray[np.float32]:
    """(h, w, D) features of a frame with depth: the vector of the label in each mask, or in each box without masks.

    In a box only the object's own surface gets it: depths within half its own width or height of the near third of the
    box's middle, as in object_depth. Smaller objects lie over larger ones, and the rest is "wall and floor".
    """
    assert frame.depth_m is not None
    height, width = frame.depth_m.shape
    h, w = max(1, height // STRIDE), max(1, width // STRIDE)
    rows = ((np.arange(h) + 0.5) * height / h).astype(np.intp)
    cols = ((np.arange(w) + 0.5) * width / w).astype(np.intp)
    depth_m = frame.depth_m[np.ix_(rows, cols)]
    names = sorted(set(detections.labels))
    which = np.zeros((h, w), np.intp)  # 0 = background
    x1, y1, x2, y2 = detections.boxes_xyxy.T
    for i in np.argsort(-(x2 - x1) * (y2 - y1), kind="stable"):
        if detections.masks is not None:
            inside = detections.masks[i][np.ix_(rows, cols)]
        else:
            inside = _surface(frame, depth_m, rows, cols, detections.boxes_xyxy[i])
        which[inside] = 1 + names.index(detections.labels[i])
    features: npt.NDArray[np.float32] = text([BACKGROUND, *names])[which]
    return features


def _surface(
    frame: Frame, depth_m: Array, rows: npt.NDArray[np.intp], cols: npt.NDArray[np.intp], box: npt.NDArray[np.float32]
) -> npt.NDArray[np.bool_]:
    (x1, y1, x2, y2), camera = box, frame.camera
    inside = np.outer((rows >= y1) & (rows < y2), (cols >= x1) & (cols < x2)) & (depth_m > 0)
    middle = inside & np.outer(
        np.abs(rows - (y1 + y2) / 2) <= (y2 - y1) / 4, np.abs(cols - (x1 + x2) / 2) <= (x2 - x1) / 4
    )
    depths = depth_m[middle] if middle.any() else depth_m[inside]
    if not len(depths):
        return inside
    seed = float(np.partition(depths, len(depths) // 3)[len(depths) // 3])
    extent_m = max(float(x2 - x1) / camera.fx, float(y2 - y1) / camera.fy) * seed
    own: npt.NDArray[np.bool_] = inside & (np.abs(depth_m - seed) <= extent_m / 2)
    return own
