"""Demo on a built-in home, offline: explore it, map it, ask three requests, drive to the goals, draw all of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cartier import plugins, specs
from cartier.errors import InputError
from cartier.home import Home
from cartier.io.atomic import replaced_folder, write_json
from cartier.labels import display_name
from cartier.pipeline import ask, map_home
from cartier.render.floor_plan import draw_answer, draw_home, write_photo
from cartier.types import Answer, RobotModel

SLEEPY = (
    "So much work tonight, and the presentation is still not finished. My colleague sent her slides hours ago, and the "
    "meeting is at nine in the morning. I have been staring at this laptop since lunch and I am getting really sleepy… "
    "we better do something about that."
)
REQUESTS = (
    ("explicit", "CoffeeMachine", "Please go to the coffee machine."),
    ("explicit", "Fridge", "Please go to the fridge."),
    ("explicit", "Bed", "Please drive to the bed."),
    ("explicit", "Sofa", "Please drive to the sofa."),
    ("implicit", "Sofa", "My feet hurt, I'd love to sit down for a while."),
    ("implicit", "ArmChair", "My feet hurt, I'd love to sit down for a while."),
    ("implicit", "Chair", "My feet hurt, I'd love to sit down for a minute."),
    ("implicit", "Bed", "I could do with a good night's sleep."),
    ("implicit", "Sink", "My hands are sticky, I have to wash them."),
    ("conversational", "CoffeeMachine", SLEEPY),
    (
        "conversational", "GarbageCan",
        "My brother was here with the kids, and we ate cake and laughed a lot. The sofa is fine, and somebody "
        "even washed the plates. But I keep finding wrappers and an apple core and wet tissues. They stick to my hand "
        "by now, and I want to be rid of them.",
    ),
    (
        "conversational", "Television",
        "What a week. On Monday the car would not start, and on Tuesday it rained into my shoes. Anyway, the final "
        "is on tonight and my sister says it will be a great match. I do not want to hear the score from the "
        "neighbours, I want to watch it myself.",
    ),
)  # fmt: skip


KEYS = ("kind", "arrived", "picture", "arrival")  # of a Step, beside its answer in answers.json


@dataclass(frozen=True)
class Step:
    """One request of the demo, its answer, and the robot's view on arrival."""

    kind: str
    answer: Answer
    arrived: bool
    picture: str
    arrival: str | None


def run(
    home: str,
    out: Path,
    seed: int = 0,
    detector: str = specs.DETECTOR,
    say: Callable[[str], None] = lambda line: None,
    progress: Callable[[str], Any] | None = None,
) -> list[Step]:
    """Explore, map, ask and drive in a home of the dollhouse; ``out`` is written completely or not at all.

    ``progress`` gives a context manager per stage that yields a callable (done, total). Raises InputError for an
    unknown home, and what ``specs.detector`` raises.
    """
    home = home.removeprefix("dollhouse:")
    world: Any = plugins.make("worlds", "dollhouse")
    scene = world.scene(home)
    say(f"exploring {home}: {scene.about}")
    recording = world.explore(home, seed=seed)
    say(f"explored: {len(recording)} frames")
    detects = specs.detector(detector, recording)
    with replaced_folder(out, "answers.json") as new:
        with progress("mapping") if progress else nullcontext() as step:
            mapped = map_home(recording, detects, progress=step)
        mapped.save(new / "home")
        there = {display_name(obj.label) for obj in world.objects(home)}
        say(f"mapped: {_compared(set(mapped.names), there)}; named by {detects.name}")
        draw_home(mapped, new / "home.png")
        steps = [_ask_and_drive(mapped, world, scene, kind, words, new, say) for kind, words in _requests(mapped)]
        answers = [step.answer.to_dict() | {key: vars(step)[key] for key in KEYS} for step in steps]
        about = {"home": home, "seed": seed, "detector": detects.name}
        write_json(new / "answers.json", about | {"answers": answers})
    return steps


def _compared(found: set[str], there: set[str]) -> str:
    """The labels that were found, against those of the simulator's objects."""
    false = sorted(found - there)
    wrong = f", and {len(false)} false positives ({', '.join(false)})" if false else ""
    return f"{len(found & there)} of the {len(there)} kinds of object in this home{wrong}"


def _requests(home: Home) -> list[tuple[str, str]]:
    """One explicit, one implicit and one conversational request that this home serves, each with another object."""
    chosen: dict[str, tuple[str, str]] = {}
    for kind, target, words in sorted(REQUESTS, key=lambda request: request[0] != "conversational"):
        taken = {name for name, _ in chosen.values()}
        if kind not in chosen and display_name(target) in home.names and target not in taken:
            chosen[kind] = (target, words)
    if not chosen:
        raise InputError(f"the demo has no request for what is in {home.name}: try another --home")
    return [(kind, chosen[kind][1]) for kind in ("explicit", "implicit", "conversational") if kind in chosen]


def _ask_and_drive(
    home: Home, world: Any, scene: Any, kind: str, words: str, folder: Path, say: Callable[[str], None]
) -> Step:
    answer = ask(home, words)
    picture, arrival, arrived = f"{kind}.png", None, False
    say(f"“{words}”")
    say(f"  → {answer.selection.object or answer.selection.status}: {answer.selection.reason}")
    if answer.goal is not None:
        driven = world.drive(scene, home.start_xy, answer.goal, RobotModel().radius_m)
        arrived, arrival = driven.arrived, f"{kind}_arrival.png"
        write_photo(np.asarray(driven.view), folder / arrival)
        say(f"  → drove {driven.length_m:.1f} m and {'arrived' if arrived else 'bumped into something'}")
    draw_answer(home, answer, folder / picture)
    return Step(kind, answer, arrived, picture, arrival)
