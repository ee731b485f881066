"""Check of marked requests: the executor, run on a home's truth with the marks as the parse, must give what is written.

python tools/understanding/check.py FILE... [--keep OUT]
Prints each line that does not, and why; ``--keep`` writes the good ones.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from functools import cache
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script
from home_text import inventory
from markup import Line, read

from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance
from cartier.spatial.query import Scene
from cartier.types import MapObject
from cartier.understanding.answers import answer
from cartier.understanding.assembly import query
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.dialogue_state import DialogueState, resolve
from cartier.understanding.entity_vocabulary import lexicon

FINDS = ("go", "correct", "another", "choose", "where", "far", "colour", "size", "when", "which")
YES = {"yes": True, "no": False}


@cache
def home(name: str) -> tuple[Scene, EntityVocabulary]:
    known = inventory(name)
    return Scene(known), lexicon(read_deck(SHIPPED), known)


def fault(line: Line, states: dict[str, DialogueState]) -> str:
    """Why a line is no good; "" if it is."""
    scene, names = home(line.home)
    state = states.get("now", DialogueState()) if line.context else DialogueState()
    wrong = ""
    for clause, told in zip(line.clauses(), line.answers, strict=True):
        asked = resolve(query(clause, names), state)
        ids = [int(i) for i in re.findall(r"\d+", told)] if clause.act != "count" else []
        gone = [i for i in ids if i not in scene.by_id]
        wrong = wrong or (f"no object #{gone[0]} here" if gone else _fault(clause.act, asked, told, ids, scene, state))
        served = [scene.by_id[i] for i in ids[:1] if i in scene.by_id]
        state = state.then(asked, served if clause.act in (*FINDS, "need") else [])
    states["now"] = state
    return wrong


def _fault(act: str, asked: ParsedUtterance, told: str, ids: list[int], scene: Scene, state: DialogueState) -> str:
    if told == "?" or act not in (*FINDS, "count", "exists", "list", "compare"):
        return ""
    head = asked.head
    if head is None:
        return "nothing is marked as the target"
    if act in FINDS:
        return _find_fault(asked, told, ids, scene, state)
    chosen = answer(asked, scene, state.last, "")
    if chosen is None or chosen.fact is None:
        return "the marks make no question that can be answered"
    value = chosen.fact.value
    if act == "count":
        return "" if told.strip() == str(value) else f"the marks give {value}"
    if act == "exists":
        return "" if YES.get(told.strip()) is value else f"the marks give {'yes' if value else 'no'}"
    if act == "compare":
        return "" if set(ids) & set(chosen.fact.objects) else f"the marks give {list(chosen.fact.objects)}"
    found = set(chosen.fact.objects)
    return "" if found == set(ids) else f"the marks give {sorted(found)}"


def _find_fault(asked: ParsedUtterance, told: str, ids: list[int], scene: Scene, state: DialogueState) -> str:
    head = asked.head
    assert head is not None
    if head.rooms is not None:
        names = [scene.rooms[i].name for i in head.rooms]
        return "" if any(name in told for name in names) or (told == "none") != bool(names) else f"it gives {names}"
    out = set(state.served) if head.other else set()
    out |= {obj.id for noun in asked.rejected for obj in scene.meant(noun)[0]}
    found: list[MapObject] = scene.meant(head, out)[0]
    if not found and head.relations:
        found = scene.meant(head)[0]
    got = [obj.id for obj in found]
    if told.strip() == "none":
        return f"the marks give {got}" if got else ""
    return "" if got and set(got) <= set(ids) else f"the marks give {got[:6]}"


def main() -> None:
    """Check files."""
    parser = Parser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="marked requests")
    parser.add_argument("--keep", type=Path, help="where to write the good lines, one conversation never in part")
    options = parser.parse_args()
    counts, acts = Counter[str](), Counter[str]()
    for file in options.files:
        states: dict[str, DialogueState] = {}
        for line in read(file):
            wrong = fault(line, states)
            counts["wrong" if wrong else "good"] += 1
            acts[line.acts[0]] += not wrong
            if wrong:
                print(f"{line.where} [{'/'.join(line.acts)} {' / '.join(line.answers)}] {line.text[:90]!r}: {wrong}")
    print(f"{counts['good']} good, {counts['wrong']} wrong;", ", ".join(f"{a} {n}" for a, n in acts.most_common()))


if __name__ == "__main__":
    run_script(main)
