"""Check of marked requests: the executor, run on a home's truth with the marks as the parse, must give what is written.

python tools/understanding/check_marks.py FILE... [--keep]
Prints each line that does not, and why; ``--keep`` takes them out of the files.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

from cartier.spatial.expressions import EntityVocabulary, ParsedUtterance, ReferringExpression
from cartier.spatial.query import Scene
from cartier.types import MapObject
from cartier.understanding.answers import answer
from cartier.understanding.assembly import query, routed
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.dialogue_state import DialogueState, resolve
from cartier.understanding.entity_vocabulary import lexicon
from cartier.understanding.route_rules import target_of
from cartier.understanding.tags import Clause
from cartier_bench.marked_lines import Line, read
from cartier_bench.true_home import perfect_map

FINDS = ("go", "correct", "another", "choose", "where", "far", "colour", "size", "when", "which")
YES = {"yes": True, "no": False}
RULE = re.compile(
    r"!?(?P<kind>avoid|keep-away|slow-near|prefer|only-through|via|shortest)(?: (?P<sort>room|floor|object|door|none):"
    r"(?P<names>.+?))?(?: (?P<strength>hard|soft))?(?: (?P<scope>drive|standing|until:\S+|daily:\S+))?"
)
ROLE_OF = {
    "avoid": "va", "keep-away": "vk", "slow-near": "vs", "prefer": "vp", "only-through": "vo", "via": "vv",
    "shortest": "vh",
}  # fmt: skip
FLOORS = {
    "tiles": "tile tiles tiling", "planks": "plank planks board boards floorboards parquet wood planking laminate",
    "carpet": "carpet carpets carpeting", "rug": "rug rugs mat",
}  # fmt: skip


@cache
def home(name: str) -> tuple[Scene, EntityVocabulary]:
    known = perfect_map(name)
    return Scene(known), lexicon(read_deck(SHIPPED), known)


def fault(line: Line, states: dict[str, DialogueState]) -> str:
    """Why a line is no good; "" if it is."""
    scene, names = home(line.home)
    state = states.get("now", DialogueState()) if line.context else DialogueState()
    wrong = ""
    for clause, told, rules in zip(line.clauses(), line.answers, line.rules, strict=True):
        asked = scene.with_rooms(resolve(query(clause, names), state), state.last)
        ids = [int(i) for i in re.findall(r"\d+", told)] if clause.act != "count" else []
        gone = [i for i in ids if i not in scene.by_id]
        wrong = wrong or (f"no object #{gone[0]} here" if gone else _fault(clause.act, asked, told, ids, scene, state))
        wrong = wrong or _rule_fault(clause, rules, scene, names)
        served = [scene.by_id[i] for i in ids[:1] if i in scene.by_id]
        if clause.act in ("exists", "count", "compare") and asked.head is not None:
            chosen = answer(asked, scene, state.last, "")
            served = [scene.by_id[chosen.object_id]] if chosen is not None and chosen.object_id in scene.by_id else []
        state = state.then(asked, served if clause.act not in ("list", "rooms") else [])
    states["now"] = state
    return wrong


def _fault(act: str, asked: ParsedUtterance, told: str, ids: list[int], scene: Scene, state: DialogueState) -> str:
    if told[:1] in ("?", "!") or act not in (*FINDS, "count", "exists", "list", "compare"):
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
    if not found and head.other:
        found = scene.meant(replace(head, relations=()), out)[0]
    elif not found and head.relations:
        found = scene.meant(head)[0]
    got = [obj.id for obj in found]
    if told.strip() == "none":
        return f"the marks give {got}" if got else ""
    return "" if got and set(got) <= set(ids) else f"the marks give {got[:6]}"


def _rule_fault(clause: Clause, rules: Sequence[str], scene: Scene, names: EntityVocabulary) -> str:
    """Why the route rules of a clause are not what its marks give; "" if they are."""
    nouns, left = routed(clause, names), [span.role for span in clause.spans if span.role in ROLE_OF.values()]
    for text in rules:
        rule = RULE.fullmatch(text)
        if rule is None:
            return f"no route rule: {text!r}"
        role = ROLE_OF[rule["kind"]]
        if role not in left:
            return f"nothing is marked as {role}"
        left.remove(role)
        if (rule["scope"] or "")[:5] in ("until", "daily") and not any(span.role == "vt" for span in clause.spans):
            return "nothing is marked as vt"
        if role != "vh":
            noun = nouns.pop(next(k for k, (span, _) in enumerate(nouns) if span.role == role))[1]
            executed = target_of(noun, names, scene, DialogueState()).text
            found = list(dict.fromkeys([*_meant(noun, scene), executed]))
            ids = sorted(rule["names"].split(","), key=int) if rule["sort"] == "object" else [rule["names"]]
            if not text.startswith("!") and f"{rule['sort']}:{','.join(ids)}" not in found:
                return f"the marks give {' or '.join(found)}"
    return f"{left[0]} is marked without a rule" if left else ""


def _meant(noun: ReferringExpression, scene: Scene) -> list[str]:
    """The targets that a rule about a noun may have."""
    floors = [f"floor:{kind}" for kind, said in FLOORS.items() if noun.said.split()[-1] in said.split()]
    rooms = [f"room:{scene.rooms[number].name}" for number in noun.rooms or ()]
    ids = [str(number) for number in sorted(obj.id for obj in scene.meant(noun)[0])] if noun.rooms is None else []
    pairs = [[scene.rooms[number].name for number in door.rooms] for door in scene.doors(noun)]
    doors = [f"door:{one}|{other}" for pair in pairs for one, other in (pair, pair[::-1])]
    objects = [f"object:{','.join(ids)}"] if ids else []
    return [*floors, *rooms, *objects, *doors] or [f"none:{noun.said}"]


def kept(file: Path, wrong: set[int]) -> str:
    """A file without its wrong lines (numbers from 1) and what goes on with them."""
    rows, dropping = list[str](), False
    for number, row in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        goes_on = row.startswith(("+", "?"))
        dropping = number in wrong or (dropping and goes_on)
        rows += [] if dropping else [row]
    return "\n".join(rows) + "\n"


def main() -> None:
    """Check files."""
    parser = Parser(__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="marked requests")
    parser.add_argument("--keep", action="store_true", help="write the files again without the wrong lines")
    options = parser.parse_args()
    acts, bad = Counter[str](), 0
    for file in options.files:
        states: dict[str, DialogueState] = {}
        wrong: dict[int, str] = {}
        for line in read(file):
            told = fault(line, states)
            acts[line.acts[0]] += not told
            if told:
                wrong[int(line.where.rpartition(":")[2])] = told
                print(f"{line.where} [{'/'.join(line.acts)} {' / '.join(line.answers)}] {line.text[:90]!r}: {told}")
        bad += len(wrong)
        if options.keep and wrong:
            file.write_text(kept(file, set(wrong)), encoding="utf-8")
    print(f"{sum(acts.values())} good, {bad} wrong;", ", ".join(f"{a} {n}" for a, n in acts.most_common()))


if __name__ == "__main__":
    run_script(main)
