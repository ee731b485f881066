"""Measures how often questions about colours are answered right without a vision model, and that states never are.

python benchmarks/look_colours.py                         (the built-in homes)
python benchmarks/look_colours.py 80001 80002             (other homes whose inventories tests/data stores)

Asks about each object that is the only one of its label, and whose colour people would name: what colour it is, whether
it has that colour, and whether it has one that its materials do not have. The homes' stored inventories come from
ground truth or from pixels; the truth is the materials of the dollhouse.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from command_line import Parser, run_script

from cartier.reasoners import embedded
from cartier.types import Inventory, MapObject
from cartier.vision.attributes import COLOURS
from cartier_bench.true_home import true_objects
from cartier_dollhouse.scene import homes, load_home
from stored import inventory, stored

DOMINANT, MATCH_M = 0.7, 0.5
MAY_CALL = {
    "cream": "white yellow", "dark grey": "grey black", "rust": "brown red orange", "light wood": "brown yellow orange",
    "beige": "brown white yellow",
}  # fmt: skip
"""What people call the truth's colours that are no basic ones."""
STATES = ("clean", "on", "open", "full", "broken")


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("homes", nargs="*", help="stored homes; by default the built-in ones")
    names = parser.parse_args().homes or homes()
    print(f"{'inventory':10} {'question':24} {'right':>6} {'of':>5} {'share':>7}")
    for kind in ("truth", "pixels"):
        right, asked = Counter[str](), Counter[str]()
        for name in sorted(set(names) & set(stored(kind))):
            for question, good in _answers(name, inventory(name, kind)):
                asked[question] += 1
                right[question] += good
        for question, count in asked.items():
            print(f"{kind:10} {question:24} {right[question]:6} {count:5} {right[question] / count:7.1%}")


def _answers(name: str, home: Inventory) -> Iterator[tuple[str, bool]]:
    """The kind of each question that is asked in a home, and whether its answer is right."""
    reasoner, true = embedded.make(), true_objects(load_home(name))
    labels = Counter(obj.label for obj in home.objects if obj.confirmed)
    for obj in home.objects:
        if not obj.confirmed or labels[obj.label] > 1 or (real := _nearest(obj, true)) is None:
            continue
        for state in STATES:
            fact = reasoner.select(f"is the {obj.label} {state}?", home).fact
            yield "state: no guess", fact is not None and fact.kind == "tell" and fact.value is None
        if not real.colours or real.colours[0][1] < DOMINANT:
            continue
        may = set(MAY_CALL.get(real.colours[0][0], real.colours[0][0]).split())
        has = may | {word for colour, _ in real.colours for word in MAY_CALL.get(colour, colour).split()}
        fact = reasoner.select(f"what colour is the {obj.label}?", home).fact
        yield "what colour", fact is not None and fact.value in may
        wanted = sorted(may)[0] if len(may) == 1 else None
        if wanted:
            said = reasoner.select(f"is the {obj.label} {wanted}?", home).text
            yield "is it: yes", said.startswith("Yes")
        other = next(colour for colour in COLOURS[(obj.id % 11) :] + COLOURS if colour not in has)
        yield "is it: no", reasoner.select(f"is the {obj.label} {other}?", home).text.startswith("No")


def _nearest(obj: MapObject, true: list[MapObject]) -> MapObject | None:
    """The real object of an object's label that is nearest to it."""
    near = [(math.dist(obj.position, each.position), each.id, each) for each in true if each.label == obj.label]
    return min(near)[2] if near and min(near)[0] <= MATCH_M else None


if __name__ == "__main__":
    run_script(main)
