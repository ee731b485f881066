"""What can be swapped: small protocols. A backend is one file; its laws are in cartier.testing, run over all of a kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from cartier.types import (
    Array,
    Camera,
    Detections,
    DetectorScoreModel,
    Frame,
    Goal,
    Inventory,
    MapObject,
    Place,
    Selection,
    TrueObject,
)  # fmt: skip


@runtime_checkable
class Recording(Protocol):
    """Frames of one home, read lazily: nothing but the frame asked for is held in memory.

    It may have ``readers``, how many threads may ask for frames at once; without, only the one that opened it; and
    ``scale_guessed``, true where nobody measured its metres. Who opens it by ``open_recording`` finds the options in ``read_with``.
    """

    name: str
    camera: Camera
    truth: Sequence[TrueObject] | None
    """A simulator's true objects, or None: real recordings have none."""
    notes: Sequence[str]
    """What the reader estimated or assumed, one line each, for the person to see."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Frame: ...

    def fingerprint(self) -> str:
        """sha256 (hex) over the recording's content and the reader's settings: equal content maps to an equal home."""
        ...


class Detector(Protocol):
    """Finds objects in one frame. ``name`` says which model it is, for every output's provenance.

    Who derives from this class may leave out what has a default: what its reports are worth, lines about what it assumed, and
    the sha256 of the files that it was made from; all names that it can give, where they are known; the simulator whose
    pictures it was made for, empty for photographs, None where nobody knows; and how many frames it likes best at once.
    """

    name: str
    score_model: DetectorScoreModel = DetectorScoreModel()
    notes: Sequence[str] = ()
    sha256: str = ""
    knows: Sequence[str] = ()
    world: str | None = None
    batch: int = 1

    def detect(self, frame: Frame) -> Detections:
        """All detections that may mean something, low scores too; labels are display names (see ``language.names``)."""
        ...

    def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
        """The same for several frames, in their order."""
        return [self.detect(frame) for frame in frames]


class Encoder(Protocol):
    """Image and text features in one space of D dimensions. It may have ``notes``, lines about what it assumed or cut."""

    name: str
    text_only: bool
    """An encoder of words only: what a detector found then gets the features of its labels."""

    def image(self, frame: Frame) -> Array:
        """(h, w, D) float32, row by row; together the h × w features cover the whole image, at the encoder's own resolution."""
        ...

    def text(self, texts: Sequence[str]) -> Array:
        """(n, D) float32."""
        ...


class SpatialIndex(Protocol):
    """Where each named thing is, one place per name. A copy (``copy.deepcopy``) is an index of its own.

    Its factory is ``make(…)``. One that needs image features also takes ``encoder``, and says which in its attribute ``encoder``.
    """

    def set_objects(self, objects: Sequence[MapObject]) -> None:
        """What the map of objects holds now; names are those of confirmed objects."""
        ...

    def names(self) -> list[str]:
        """The names that the index can locate, sorted."""
        ...

    def locate(self, name: str) -> Place | None: ...

    def state(self) -> dict[str, bytes]:
        """All that it holds besides the objects, as named blobs: ``grid.npz``. Whoever keeps a home keeps them."""
        ...

    def restore(self, state: Mapping[str, bytes]) -> None:
        """Take what ``state`` gave into a freshly made index. Raises InputError if it is damaged, KeyError for a missing blob."""
        ...


@runtime_checkable
class FrameIndex(Protocol):
    """A spatial index that takes in every frame, such as one of image features; others are made of the objects alone."""

    def add(self, frame: Frame, detections: Detections) -> None:
        """Take in one more frame, with the detections that count by themselves."""
        ...


@runtime_checkable
class Instances(Protocol):
    """A spatial index that tells objects of one name apart."""

    def locate_object(self, obj: MapObject) -> Place | None: ...


@runtime_checkable
class Searchable(Protocol):
    """A spatial index that any words can be looked up in, not only the names of things that were detected."""

    encoder: str
    """Which encoder made the features, and from what."""
    notes: Sequence[str]
    """What the encoder left out of the words so far."""

    def locate(self, name: str) -> Place | None: ...

    def similarity(self, words: str) -> tuple[Array, Array, float]:
        """Centres (n, 2) of square cells in metres, the cosine of the words with each (n,), and the cells' side in metres."""
        ...


class Reasoner(Protocol):
    """Picks the object that serves a person's words. Never returns one that is not in the inventory it was given.

    It may count what it asked of a language model, in running totals ``calls`` and ``tokens``, and have ``notes``, lines
    about how it came to its latest answer.
    """

    name: str

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """``dialogue`` holds earlier (person, robot) turns, oldest first."""
        ...

    def propose(self, query: str) -> list[str]:
        """Names of things that would serve the words, without sight of any list (for the NLMap baseline)."""
        ...


class Robot(Protocol):
    """How a goal leaves the program."""

    name: str

    def go_to(self, goal: Goal) -> str:
        """Send the goal; returns one line that says what happened."""
        ...


class World(Protocol):
    """A simulator that homes can be explored in."""

    name: str

    def homes(self) -> list[str]: ...
    def explore(self, home: str, **options: Any) -> Recording: ...
    def objects(self, home: str) -> list[TrueObject]: ...
    def free(self, home: str, xy: Sequence[float]) -> bool: ...
