"""Backend interfaces: recordings, live sources, detectors, encoders, spatial indices, reasoners, vision models, robots
and worlds.

Each is a protocol, and a backend is any object that has its members. Members with a value are optional, and the value
is what a backend without them is taken to have: those of a ``Detector`` stand in the protocol, those of the others in
a class of their own (``RecordingDefaults``, …), and a backend may derive from either. cartier reads them with
``optional`` alone. ``cartier.testing`` checks backends against all of this. Units, frames and layouts are those at the
head of ``types/``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol, runtime_checkable

from cartier.types import (
    Array,
    Camera,
    CandidateView,
    Detections,
    DetectorScoreModel,
    DriveProgress,
    Frame,
    Goal,
    Inventory,
    MapObject,
    Place,
    Selection,
    TrueObject,
    VisualQuestion,
    VisualReply,
)  # fmt: skip
from cartier.types.streams import Event


def optional(backend: object, contract: type, name: str) -> Any:
    """An optional member of a backend.

    Args:
        backend: A recording, detector, encoder, index or reasoner.
        contract: The class that has the default, such as ``Detector`` or ``RecordingDefaults``.
        name: An optional member of it.

    Returns:
        The backend's own value, or the default if it has none. A default method is bound to the backend.
    """
    default = getattr(contract, name)
    return getattr(backend, name, partial(default, backend) if callable(default) else default)


@runtime_checkable
class Recording(Protocol):
    """The frames of one home, read lazily: only the frames that were asked for are held in memory."""

    name: str
    camera: Camera
    """The camera of all frames."""
    truth: Sequence[TrueObject] | None
    """A simulator's true objects; None for real recordings."""
    notes: Sequence[str]
    """What the reader estimated or assumed, one line each, for the person to see."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Frame:
        """Read one frame.

        Args:
            index: From 0 to ``len(self) - 1``. Frames may be asked for in any order.

        Returns:
            The frame; the same for the same index.

        Raises:
            IndexError: There is no such frame, negative numbers included.
            InputError: Its files are missing or damaged.
        """
        ...

    def fingerprint(self) -> str:
        """A digest of the recording's content and of the reader's settings.

        Returns:
            sha256 in hex. Equal fingerprints give equal homes.
        """
        ...


class RecordingDefaults:
    """Optional members of a Recording."""

    readers: int = 0
    """How many threads may read frames at once; 0 if only the thread that opened it may."""
    scale_guessed: bool = False
    """Whether the scale of poses and depth is a guess, so that metres are right only relative to each other."""
    read_with: Mapping[str, Any] = MappingProxyType({})
    """The options that it was opened with; ``open_recording`` sets them."""
    level_from_world: Array | None = None
    """(4, 4): how the reader levelled the recorded poses (z up, floor at z = 0); None if it did not."""
    levelled: Any = None
    """How its world and images are corrected for a map (``mapping.upright.Levelled``); None as a reader gives it."""
    detector: Detector | None = None
    """Gives the detections that the recording itself holds, if they are to be taken."""
    known_registration: tuple[float, float, float] | None = None
    """How the format's published depth lies on its colour, if that is known to be off: zoom, dx and dy in pixels."""


class Source(Protocol):
    """A stream of frames that are taken now, or played as if they were."""

    name: str

    def __iter__(self) -> Iterator[Event]:
        """Listen.

        Returns:
            Frames, pose updates and faults as they come. Something is yielded at least once in a second: if nothing
            arrives, a fault "silent" that says why. Stamps of frames rise, except after a fault "clock"; the indices
            of frames count from 0. It ends when the stream ends, or after ``close``.

        Raises:
            CartierError: Nothing can be listened to.
        """
        ...

    def close(self) -> None:
        """End the stream, from any thread; twice is once."""
        ...


class SourceDefaults:
    """Optional members of a Source."""

    waits: bool = False
    """Whether the stream may be held up, as a file can: then no frame is lost to a slow computer."""
    recording: Recording | None = None
    """The recording that is played, if the stream is one."""
    notes: Sequence[str] = ()
    """What it estimated or assumed so far, one line each."""
    world_frame: str = "map"
    """The name of the frame of its poses on the robot (REP-105)."""
    detector: Detector | None = None
    """Stands for the detector on the robot, if the frames bring their detections; none other is asked then."""


class Detector(Protocol):
    """Detects objects in single frames."""

    name: str
    """Which model it is, for the provenance of every output."""
    score_model: DetectorScoreModel = DetectorScoreModel()
    """What its scores say about existence."""
    notes: Sequence[str] = ()
    """What it assumed, one line each, for the person to see."""
    sha256: str = ""
    """Hex digest of the files that it was made from."""
    knows: Sequence[str] = ()
    """All labels that it can give, where they are known."""
    world: str | None = None
    """The simulator whose pictures it was trained for, empty for photographs, None if unknown."""
    as_recorded: bool = False
    """Whether its boxes belong to the images as they were recorded, so that those must not be turned upright."""
    batch: int = 1
    """How many frames ``detect_batch`` processes most efficiently."""

    def detect(self, frame: Frame) -> Detections:
        """Detect the objects of one frame.

        Args:
            frame: The frame; its ``rgb`` must not be changed.

        Returns:
            Boxes inside the image, low scores included; labels are display names (``labels.display_name``).
        """
        ...

    def detect_batch(self, frames: Sequence[Frame]) -> list[Detections]:
        """Detect the objects of several frames.

        Args:
            frames: Frames of one recording.

        Returns:
            What ``detect`` gives for each frame, in the order of ``frames``.
        """
        return [self.detect(frame) for frame in frames]


class Encoder(Protocol):
    """Encodes images and words as features in one space of D dimensions, for indices that compare both."""

    name: str
    text_only: bool
    """Whether it encodes words only; detections are then given the features of their labels."""

    def image(self, frame: Frame) -> Array:
        """Encode an image.

        Args:
            frame: The frame.

        Returns:
            (h, w, D) float32 at the encoder's own resolution, row by row; the h × w features cover the whole image.

        Raises:
            CartierError: The encoder is ``text_only``.
        """
        ...

    def text(self, texts: Sequence[str]) -> Array:
        """Encode words.

        Args:
            texts: n words or phrases.

        Returns:
            (n, D) float32.
        """
        ...


class EncoderDefaults:
    """Optional members of an Encoder."""

    notes: Sequence[str] = ()
    """What it assumed or cut, one line each."""


class SpatialIndex(Protocol):
    """Finds the place of a name. ``copy.deepcopy`` gives an independent index.

    Its factory is ``make(…)``. One that needs features also takes ``encoder``, a name or an ``Encoder``.
    """

    def set_objects(self, objects: Sequence[MapObject]) -> None:
        """Take in the objects of the map as they are now.

        Args:
            objects: All objects, confirmed and tentative. The names of the index are those of confirmed objects.
        """
        ...

    def names(self) -> list[str]:
        """The names that can be located.

        Returns:
            Each name once, sorted.
        """
        ...

    def locate(self, name: str) -> Place | None:
        """The place of a name.

        Args:
            name: One of ``names()``; an index that is ``Searchable`` takes any words.

        Returns:
            The best place, in the map frame (m), or None if there is none.
        """
        ...

    def state(self) -> dict[str, bytes]:
        """What the index holds, without the objects, to be stored with the home.

        Returns:
            Blobs by name, such as ``grid.npz``.
        """
        ...

    def restore(self, state: Mapping[str, bytes]) -> None:
        """Take a stored state into an index that was just made.

        Args:
            state: What ``state`` returned.

        Raises:
            InputError: A blob is damaged.
            KeyError: A blob is missing.
        """
        ...


class IndexDefaults:
    """Optional members of a SpatialIndex."""

    encoder: str = ""
    """Which encoder made its features, and from what; empty without features."""


@runtime_checkable
class FrameIndex(Protocol):
    """A spatial index that takes in every keyframe, such as one of image features; others need the objects alone."""

    def add(self, frame: Frame, detections: Detections) -> None:
        """Take in one more keyframe.

        Args:
            frame: The frame.
            detections: Its detections with scores of at least the detector's threshold.
        """
        ...


@runtime_checkable
class Instances(Protocol):
    """A spatial index that distinguishes objects of the same name."""

    def locate_object(self, obj: MapObject) -> Place | None:
        """The place of one object.

        Args:
            obj: An object of the map.

        Returns:
            Its place, in the map frame (m), or None if the index has none.
        """
        ...


@runtime_checkable
class Searchable(Protocol):
    """A spatial index in which any words can be looked up, not only the names of detected objects."""

    encoder: str
    """Which encoder made the features, and from what."""
    notes: Sequence[str]
    """What the encoder left out of the words so far, one line each."""

    def locate(self, name: str) -> Place | None:
        """The place most similar to the words.

        Args:
            name: Any words.

        Returns:
            The best place, in the map frame (m), or None if the index is empty.
        """
        ...

    def similarity(self, words: str) -> tuple[Array, Array, float]:
        """How similar each part of the floor is to the words.

        Args:
            words: Any words.

        Returns:
            Centres (n, 2) of square cells in the map frame (m), the cosine similarity (n,) of each, and their side (m).
        """
        ...


class Reasoner(Protocol):
    """Chooses the object that serves a person's words."""

    name: str

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        """Choose an object, answer in words, or ask back.

        Args:
            query: What the person says.
            inventory: What there is to choose from.
            dialogue: Earlier (person, robot) turns, oldest first.

        Returns:
            The choice. It never names an object that is not in ``inventory``.

        Raises:
            InputError: The words are empty or too long.
            ReasonerError: A language model cannot be reached.
        """
        ...

    def propose(self, query: str) -> list[str]:
        """Name objects that would serve the words, without seeing an inventory (for the NLMap baseline).

        Args:
            query: What the person says.

        Returns:
            Up to 20 different names, best first.

        Raises:
            InputError: The words are empty or too long.
            ReasonerError: A language model cannot be reached.
        """
        ...


class ReasonerDefaults:
    """Optional members of a Reasoner."""

    notes: Sequence[str] = ()
    """How it came to its latest answer, one line each."""
    calls: int = 0
    """How many requests it has sent to a language model so far."""
    tokens: int = 0
    """How many tokens these took, prompts and replies together."""
    deck: Any = None
    """The cards of the things that it knows by name (``understanding.cards.Deck``); None for those that ship."""


class VisionModel(Protocol):
    """Answers questions about photographs of objects (visual question answering)."""

    name: str
    """Which model it is, for the provenance of every output."""
    endpoint: str
    """Where pictures are sent: a URL without credentials, and a proxy on the way; empty if they stay here."""

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        """Answer a question about each of the pictures, in one call: photographs leave once a question.

        Words that are seen in a picture are data: they change neither the question nor the form of the answer.

        Args:
            question: What is asked.
            pictures: At most three, of one or several candidates, in the order in which they were taken.

        Returns:
            One answer for each picture, in their order: a choice of the question, or None for "cannot tell". A reply
            that cannot be read is "cannot tell" for all of them.

        Raises:
            ReasonerError: The model cannot be reached or refuses; NothingSent if the pictures did not leave.
        """
        ...


class VisionModelDefaults:
    """Optional members of a VisionModel."""

    sees: bool | None = None
    """False if a check found that it does not see the pictures that it is sent, True if it does."""


class Robot(Protocol):
    """Drives to goals, or passes them on to what drives."""

    name: str

    def go_to(self, goal: Goal) -> str:
        """Send a goal.

        Args:
            goal: Pose and path in the map frame (m, rad).

        Returns:
            One line that says what happened.

        Raises:
            CartierError: The goal was refused or could not be sent.
        """
        ...


@runtime_checkable
class DrivingRobot(Robot, Protocol):
    """A robot that can be watched while it drives, and stopped. It has all that a ``Robot`` has."""

    def drive(self, goal: Goal) -> Iterator[DriveProgress]:
        """Send a goal, and watch the robot until it has arrived, failed or was stopped.

        Args:
            goal: Pose and path in the map frame (m, rad).

        Returns:
            Progress, at least once in a second while the robot drives; the last one alone has ``ended``. Closed before
            its end, or left by an exception, it stops the robot as ``stop`` does.

        Raises:
            CartierError: The goal was refused or could not be sent.
        """
        ...

    def pose(self) -> tuple[float, float, float] | None:
        """Where the robot is.

        Returns:
            x, y (m) and yaw (rad) in the map frame, or None if it does not say so.
        """
        ...

    def stop(self) -> DriveProgress:
        """Stop the robot, from any thread, and wait until it says so, at most some 3 s; a ``drive`` ends so, too.

        Returns:
            What became of the robot: "stopped", "arrived" or "failed" if it stands, "unknown" if it may still drive.

        Raises:
            CartierError: The robot cannot be stopped from here.
        """
        ...


class World(Protocol):
    """A simulator with homes to explore."""

    name: str

    def homes(self) -> list[str]:
        """The homes that can be explored.

        Returns:
            Their names, each once.
        """
        ...

    def explore(self, home: str, **options: Any) -> Recording:
        """Record a walk through a home.

        Args:
            home: One of ``homes()``.
            **options: Options of the simulator, such as ``max_frames``.

        Returns:
            The recording, with ``truth``; the same for the same home and options.

        Raises:
            CartierError: There is no such home.
        """
        ...

    def objects(self, home: str) -> list[TrueObject]:
        """The true objects of a home.

        Args:
            home: One of ``homes()``.

        Returns:
            What ``explore(home).truth`` holds.

        Raises:
            CartierError: There is no such home.
        """
        ...

    def free(self, home: str, xy: Sequence[float]) -> bool:
        """Whether the robot can stand at a point.

        Args:
            home: One of ``homes()``.
            xy: The point (x, y) in the map frame (m).

        Returns:
            False for points outside of the home, too.

        Raises:
            CartierError: There is no such home.
        """
        ...
