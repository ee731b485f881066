"""Photos of a map: of the frames, those that are among the best views of an object, or the largest of a side."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence, Set

from cartier.types import Frame, MapObject

JPEG_QUALITY = 88


class BestPhotos:
    """Keeps JPEGs by frame number."""

    def __init__(self, photos: Mapping[int, bytes] | None = None) -> None:
        self._photos = dict(photos or {})

    def keep(self, frame: Frame, wanted: Set[int]) -> None:
        """Keep the photo of a frame if its number is wanted, and drop those that no longer are."""
        if frame.index in wanted:
            from PIL import Image

            buffer = io.BytesIO()
            Image.fromarray(frame.rgb).save(buffer, "JPEG", quality=JPEG_QUALITY)
            self._photos[frame.index] = buffer.getvalue()
        for old in self._photos.keys() - wanted:
            del self._photos[old]

    def of(self, objects: Sequence[MapObject]) -> dict[int, bytes]:
        """The photos of all views of confirmed objects, and of the best and the largest one of the others."""
        shown = {
            view.frame for obj in objects for views in (obj.views, obj.side_views)
            for view in views[: None if obj.confirmed else 1]
        }  # fmt: skip
        return {frame: jpeg for frame, jpeg in sorted(self._photos.items()) if frame in shown}
