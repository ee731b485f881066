"""A walk through a generated home that no training of the detector saw, rendered once for all tests of what it sees."""

from __future__ import annotations

from functools import cache

from cartier import plugins
from cartier.contracts import Recording
from cartier.errors import frame_number
from cartier.types import Frame

HELD_BACK = (
    "90011"  # a generated home: training has seeds from 100000 on, the threshold was chosen on others below 90010
)
FRAMES = 14


class Rendered:
    """A recording whose frames are rendered the first time that they are asked for; nobody may change them."""

    def __init__(self, source: Recording) -> None:
        self.name, self.camera, self.truth, self.notes = source.name, source.camera, source.truth, source.notes
        self._source, self._frames = source, dict[int, Frame]()

    def __len__(self) -> int:
        return len(self._source)

    def __getitem__(self, index: int) -> Frame:
        number = frame_number(index, len(self), self.name)
        if number not in self._frames:
            self._frames[number] = self._source[number]
        return self._frames[number]

    def fingerprint(self) -> str:
        return self._source.fingerprint()


@cache
def strange_walk() -> Rendered:
    world = plugins.make("worlds", "dollhouse", width=320, height=240)
    return Rendered(world.explore(HELD_BACK, max_frames=FRAMES))
