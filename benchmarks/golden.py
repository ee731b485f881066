"""Golden answers of the embedded reasoner over stored inventories: whether a change of the code changed any of them.

python benchmarks/golden.py write FILE                  (three minutes; e.g. tests/data/golden_answers.jsonl.gz)
python benchmarks/golden.py compare FILE [--every N]    exits 1 if an answer differs; --every 10 looks at each tenth row

The requests are the paper's and the extended split, those made for the built-in homes, the labelled sentences, the
sentences that ask for nothing, and the held-out ones of the cards. A row is one turn in one inventory; the robot's
earlier turns are stored with it, so that a changed first answer does not change the second. Of the sentences written by
hand only the number of a row is printed.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gzip
import hashlib
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "reasoners"))

import held_out
import nothing_asked
from command_line import Parser, run_script

import stored
from cartier import plugins
from cartier.types import Inventory, Selection
from cartier_bench.queries import SPLITS, load_queries
from cartier_bench.things import WRITTEN, load_items

FIELDS = {"object": "object", "id": "object_id", "room": "room", "text": "text", "question": "question"}
"""Key of the file → attribute of Selection; ``value`` is its ``fact``, ``next`` its ``next``."""
DEVELOPMENT = Path(__file__).resolve().parents[1] / "tools" / "things" / "development.jsonl"
HIDDEN = "written"  # the set whose texts are not shown

Request = tuple[str, str, tuple[str, ...], tuple[str, ...]]
"""Set, id, the turns of a person, and the inventories in which they are said."""


def requests() -> Iterator[Request]:
    """All that is asked: of the paper's split everything everywhere, of long lists each request in one home."""
    built_in = stored.stored("pixels")
    pairs = [(f"{home}.truth", f"{home}.pixels") for home in built_in]
    everywhere = tuple(place for pair in pairs for place in pair)
    for split in SPLITS:
        for number, query in enumerate(load_queries(split)):
            yield split, query.id, (query.text,), everywhere if split == "paper" else pairs[number % len(pairs)]
    for item in load_items(stored.DATA / "made.jsonl"):
        yield "made", item.id, item.turns, (f"{item.home}.truth", f"{item.home}.pixels")
    for name, file in (("development", DEVELOPMENT), (HIDDEN, WRITTEN)):
        for item in load_items(file):
            yield name, item.id, item.turns, (f"{item.home}.truth",)
    for name, texts in vars(nothing_asked).items():
        if name.endswith(("TOLD", "ASKED")):
            for number, text in enumerate(texts):
                yield "nothing asked", f"{name} {number}", (text,), ("names.HOME", everywhere[number % len(everywhere)])
    for number, (_, names, text, _) in enumerate(held_out.HELD_OUT):
        listed = next(name for name, value in vars(held_out).items() if value is names)
        yield "held out", str(number), (text,), (f"names.{listed}",)


def inventory(place: str) -> Inventory:
    home, _, kind = place.partition(".")
    if home == "names":
        return Inventory.of(nothing_asked.HOME if kind == "HOME" else getattr(held_out, kind))
    return stored.inventory(home, kind)


def plain(chosen: Selection) -> dict[str, Any]:
    """An answer as it stands in the file: what is None or empty is left out."""
    fact = chosen.fact
    row = {"status": chosen.status}
    row |= {key: getattr(chosen, attribute) for key, attribute in FIELDS.items()}
    row["value"] = None if fact is None else [fact.kind, fact.value, list(fact.objects)]
    row["next"] = [plain(further) for further in chosen.next]
    kept = {key: value for key, value in row.items() if value is not None and value not in ("", [])}
    return dict(json.loads(json.dumps(kept)))  # tuples become lists


def digest(turns: tuple[str, ...]) -> str:
    return hashlib.sha256("\n".join(turns).encode()).hexdigest()[:8]


def write(file: Path) -> None:
    """Answer every request and keep the answers."""
    from cartier.conversation import Conversation

    reasoner, rows = plugins.make("reasoners", "embedded"), []
    for group, key, turns, places in requests():
        for place in places:
            if len(turns) == 1:
                answers, said = [reasoner.select(turns[0], inventory(place))], list[str]()
            else:
                talk = Conversation(stored.home(*place.split(".")), reasoner)
                answers = [talk.say(turn).selection for turn in turns]
                said = [robot for _, robot in talk.turns]
            for number, chosen in enumerate(answers):
                about = [place, group, key, digest(turns[: number + 1]), said[:number]]
                rows.append(json.dumps([*about, plain(chosen)], ensure_ascii=False, separators=(",", ":")))
    file.write_bytes(gzip.compress("\n".join(rows).encode(), mtime=0))
    print(f"{len(rows)} answers, {file.stat().st_size} bytes: {file}")


def compare(file: Path, every: int) -> int:
    """Print what is answered otherwise than in the file; how many rows that are."""
    asked = {(group, key): turns for group, key, turns, _ in requests()}
    rows = [json.loads(row) for row in gzip.decompress(file.read_bytes()).decode().splitlines()][::every]
    reasoner, changed = plugins.make("reasoners", "embedded"), Counter[str]()
    for place, group, key, of, said, before in rows:
        turns = asked.get((group, key), ())[: len(said) + 1]
        if digest(turns) != of:
            changed[group] += 1
            print(f"{group} {key} in {place}: the request itself is not what it was")
            continue
        dialogue = list(zip(turns[:-1], said, strict=True))
        after = plain(reasoner.select(turns[-1], inventory(place), dialogue))
        if after != before:
            changed[group] += 1
            print(f"{group} {key} in {place}" + ("" if group == HIDDEN else f": {' || '.join(turns)}"))
            for name in sorted(name for name in before | after if before.get(name) != after.get(name)):
                both = "differs" if group == HIDDEN else f"{before.get(name)!r} → {after.get(name)!r}"
                print(f"    {name}: {both}")
    by_set = ", ".join(f"{group} {number}" for group, number in changed.items())
    print(f"{changed.total()} of {len(rows)} answers differ" + (f": {by_set}" if changed else ""))
    return changed.total()


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("what", choices=("write", "compare"), metavar="what", help="write, or compare")
    parser.add_argument("file", type=Path, help="the answers, as .jsonl.gz")
    parser.add_argument("--every", type=int, default=1, help="compare each N-th row (default: all)")
    options = parser.parse_args()
    if options.what == "write":
        write(options.file)
    elif compare(options.file, options.every):
        raise SystemExit(1)


if __name__ == "__main__":
    run_script(main)
