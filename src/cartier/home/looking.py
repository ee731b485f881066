"""Visual question answering over a home: its photographs, its log of detections and its floor plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from cartier.contracts import VisionModel
from cartier.errors import InputError
from cartier.home import compaction, corrections
from cartier.home.data import origin_of
from cartier.types import Detections, Inventory, MapObject, RobotModel, Selection, VisualTrace
from cartier.vision.permission import Look

if TYPE_CHECKING:
    from cartier.home.entity import Home
    from cartier.understanding.cards import Deck
    from cartier.vision.look import Photographs
    from cartier.vision.verification import Calibration, Checked

Step = Callable[[int, int], None]
"""Told how many questions were asked, of how many."""


def _silent(done: int, total: int) -> None:
    """Whoever asks wants no progress."""


def photographs_of(home: Home) -> Photographs:
    """The stored photographs of a home, with all that the detector found in their frames."""
    from cartier.vision.look import Photographs  # Pillow, which answers from the list do not need

    def detections() -> Mapping[int, Detections]:
        log = home.detections()
        return {} if log is None else {number: frame.detections for number, frame in log.looked().items()}

    return Photographs(home.photos, detections)


def look_for_answer(
    home: Home,
    query: str,
    selection: Selection,
    inventory: Inventory,
    allowed: Look,
    from_xy: tuple[float, float],
    robot: RobotModel,
    deck: Deck,
) -> tuple[Selection, VisualTrace, tuple[str, ...]] | None:
    """What the photographs change in an answer, how, and what the person is told; None if they are not needed."""
    from cartier.vision.look import Surroundings, look

    around = Surroundings(home.grid, from_xy, robot)
    return look(allowed, query, selection, inventory, photographs_of(home), around, deck)


def seen_twice(home: Home, query: str, selection: Selection, inventory: Inventory) -> Selection:
    """The answer to whether a lamp or a screen is on, where the home's own photographs tell; nothing is sent."""
    from cartier.vision import brightness, pixels

    def seen(obj: MapObject) -> brightness.SeenTwice | None:
        photographs = photographs_of(home)
        return brightness.seen_twice(obj, photographs.sizes([obj]), photographs.rgb)

    return pixels.twice(query, selection, seen, inventory)


def ask_about_doubts(home: Home, allowed: Look, step: Step = _silent) -> tuple[Calibration, list[Checked]]:
    """Ask a vision model about the doubtful objects of a home that it was not asked about, and write nothing.

    Raises ReasonerError if the model cannot be reached.
    """
    from cartier.vision import verification
    from cartier.vision.look import Surroundings

    out = frozenset[int]() if home.corrected is None else home.corrected.looked_at
    doubtful = verification.doubts(home.objects, out)
    if not doubtful:
        return verification.Calibration(), []
    around = Surroundings(home.grid, home.start_xy, RobotModel())
    others = [obj for obj in home.objects if obj.id not in out]
    return verification.check(allowed, others, doubtful, photographs_of(home), around, step)


def verify(home: Home, allowed: Look, step: Step = _silent) -> tuple[Calibration, list[Checked]]:
    """Ask a vision model about the doubtful objects of a home, and add what it says to the log of the saved home.

    Each object is asked about once, until ``undo`` takes back what was said. What is added multiplies the odds that an
    object exists: it is evidence like any other, and what people said outweighs it.

    Args:
        home: A home that was loaded from a folder.
        allowed: Who may look.
        step: Told how many questions were asked, of how many.

    Returns:
        What the model said of objects beyond doubt, by which its answers are weighed, and of each doubtful one.

    Raises:
        InputError: The home was not loaded from a folder, or it is published and stays as it is; nothing was asked.
        ReasonerError: The model cannot be reached; nothing was added then.
    """
    if home.store is None or home.corrected is None:
        raise InputError(f"{home.name} was not loaded from a folder: save it, load it, and verify it then")
    home.store.check_appendable()
    calibration, checked = ask_about_doubts(home, allowed, step)
    who, origin = name_of(allowed.model), origin_of(home.settings)
    for each in checked:
        if each.trace.reply is not None:  # something was asked
            said = f"{each.label or each.said}, odds x {each.factor:g}"
            entry = corrections.evidence(each.obj, home.corrected, said, each.factor, who, origin, each.label)
            compaction.add(home.store, entry)
    return calibration, checked


def name_of(model: VisionModel) -> str:
    """A vision model, and where pictures are sent."""
    return f"{model.name} at {model.endpoint}" if model.endpoint else model.name
