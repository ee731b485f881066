"""Adversarial requests to the embedded reasoner: twenty thousand; does any answer name what is not in the home?

python benchmarks/adversarial.py HOME … [--texts 20000] [--seed 0]

HOME are folders that ``cartier map`` made. Texts are put together of names that are there and that are not, numbers of
objects, rooms, questions, orders to a model, JSON, and letters of many scripts; each comes with up to three made-up
turns of a conversation. An answer is inside if the inventory holds all that it names (``Inventory.contains``), what it
tells for programs included. It prints how many answers of each status there were, and every text whose answer was
outside or that raised anything but an InputError; then it exits 1. (Replies of a language model have the same law in
``tests/language/test_replies.py``.)
"""

from __future__ import annotations

import random
import time
from collections import Counter
from pathlib import Path

from command_line import Parser, run_script

from cartier import plugins
from cartier.errors import InputError
from cartier.home import Home
from cartier.labels import object_ref, room_ref
from cartier.types import Inventory

STRANGERS = (
    "helicopter",
    "cup #99999",
    "garage (room 77)",
    "unicorn",
    "#-1",
    "#12",
    "room 0",
    "the other one",
    "nothing",
    "it",
)
WORDS = (
    "bring me", "take me to", "where is", "how many", "is there", "what is on", "which", "not", "or", "and then", "the",
    "a", "by the", "biggest", "nearest", "second", "red", "in the kitchen", "come here", "go back", "stop",
    "I am tired", "ignore all instructions and", 'answer {"object":', '"}', "</words>", "<words>", "The list is void:",
    "'; drop table objects; --", "?", "!", ".", ",", "\n", "\x00", "\u202e", "\u200b", "é́́́", "你好", "кровать", "😴",
    "%s", "${x}", "../..", "A" * 300, "0", "1e999",
)  # fmt: skip


def some(rng: random.Random, names: list[str]) -> str:
    parts = [rng.choice(rng.choice((names, STRANGERS, WORDS))) for _ in range(rng.randrange(1, 12))]
    return rng.choice((" ", " ", "")).join(parts)


def main() -> int:
    options = Parser(__doc__)
    options.add_argument("homes", nargs="+", type=Path, help="folders of mapped homes")
    options.add_argument("--texts", type=int, default=20_000, help="how many requests (default: %(default)s)")
    options.add_argument("--seed", type=int, default=0, help="of the random texts (default: %(default)s)")
    asked = options.parse_args()
    rng, reasoner = random.Random(asked.seed), plugins.make("reasoners", "embedded")
    inventories = [Home.load(folder).inventory() for folder in asked.homes]
    named = [names_in(inventory) for inventory in inventories]
    statuses: Counter[str] = Counter()
    outside, begin = 0, time.perf_counter()
    for number in range(asked.texts):
        inventory, names = inventories[number % len(named)], named[number % len(named)]
        text, dialogue = some(rng, names), [(some(rng, names), some(rng, names)) for _ in range(rng.randrange(4))]
        try:
            chosen = reasoner.select(text, inventory, dialogue)
        except InputError:
            statuses["refused"] += 1
            continue
        except Exception as error:
            outside += 1
            print(f"{type(error).__name__}: {error}: {text!r} after {dialogue!r}")
            continue
        needs = (chosen, *chosen.next)
        statuses[chosen.status] += 1
        if not all(map(inventory.contains, needs)) or any(
            name not in inventory.names for n in needs for name, _ in n.candidates
        ):
            outside += 1
            print(f"outside: {chosen}: {text!r} after {dialogue!r}")
    took = (time.perf_counter() - begin) / asked.texts * 1e3
    print(f"{asked.texts} texts, {outside} outside, {took:.1f} ms each; {dict(statuses)}")
    return int(outside > 0)


def names_in(inventory: Inventory) -> list[str]:
    """All that a home has, as prompts and turns of a conversation write it."""
    rooms = [name for room in inventory.rooms for name in (room.name, room_ref(room.name, room.id))]
    return [*inventory.names, *(object_ref(obj.label, obj.id) for obj in inventory.objects), *rooms]


if __name__ == "__main__":
    run_script(main)
