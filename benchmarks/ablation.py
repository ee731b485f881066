"""Ablation of the embedded reasoner: all its measures, with one rule removed at a time.

python benchmarks/ablation.py REFERENCE MAPS THINGS_MAPS [RULE …]

REFERENCE as for tools/train_scorer.py; MAPS and THINGS_MAPS are folders of mapped homes, as ``cartier bench``
keeps them (made where they are missing). Per line: the bench's paper and extended splits over the built-in homes
(ground truth, explicit / implicit / conversational, % right), those of ``bench things`` made from the truth (%
of finds right, of "nothing serves" with a goal), the held-back voices (% right; with a goal where nothing serves, and
where all that serves was taken away), and the sentences of tests/reasoners/nothing_asked.py (a goal for what asks for
nothing; no goal for what asks).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from command_line import Parser, run_script

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "tests/reasoners")]

from fit_decision import REPORTED  # noqa: E402
from nothing_asked import ASKED, FRESH_ASKED, FRESH_TOLD, HOME, LATER_ASKED, LATER_TOLD, TOLD  # noqa: E402
from scorer_report import SERVED, put  # noqa: E402
from scorer_requests import Homes, read_requests  # noqa: E402

from cartier.labels import display_name  # noqa: E402
from cartier.reasoners import embedded  # noqa: E402
from cartier.types import Inventory  # noqa: E402
from cartier.understanding import (  # noqa: E402
    candidates,
    need_scorer,
    outcome_classifier,
    spelling,
    utterance,
)
from cartier.understanding.cards import SHIPPED, read_deck  # noqa: E402
from cartier.understanding.need_scorer import Scorer  # noqa: E402
from cartier_bench import suite, things_run  # noqa: E402
from cartier_bench.maps import Maps, MapSettings  # noqa: E402
from cartier_bench.metrics import matches  # noqa: E402
from cartier_bench.queries import cases, load_queries  # noqa: E402
from cartier_bench.things import FIND  # noqa: E402

SENTENCE = utterance._sentence
RULES: dict[str, tuple[tuple[Any, str, Any], ...]] = {
    "nothing": (),
    "spelling": ((spelling.Spelling, "__call__", lambda self, word: word),),
    "sentence weights": ((utterance, "_sentence", lambda tokens, part, weight: SENTENCE(tokens, part, 1.0)),),
    "alone": ((need_scorer, "ALONE", 0.0),),
    "word matching": ((need_scorer.Lexicon, "fits", lambda self, said, out: {}),),
    "general words": ((candidates.Candidates, "_ends", lambda *args: ()),),
    "near_synonyms": ((candidates.Candidates, "near_synonyms", lambda *args: frozenset()),),
    "the decision": ((outcome_classifier.Choice, "decide", lambda *args: "found"),),
}  # fmt: skip


class Remembered:
    """The layers of the scorer, run once for the same states."""

    def __init__(self, scorer: Scorer) -> None:
        self._layers, self._known = scorer._layers, dict[bytes, Any]()
        vars(scorer)["_layers"] = self

    def run(self, names: None, given: dict[str, Any]) -> Any:
        key = given["states"].tobytes()
        if key not in self._known:
            self._known[key] = self._layers.run(names, given)
        return self._known[key]


class Measures:
    """All that a reasoner is measured by, ready to be asked."""

    def __init__(self, reference: Path, maps: Path, candidates: Path) -> None:
        self.deck = read_deck(SHIPPED)
        self.lists = Homes(self.deck, reference)
        kept = Maps(maps, MapSettings())
        self.homes = {name: kept.get(name).inventory() for name in kept.world.homes()}
        self.truth = {n: {display_name(t.label) for t in kept.world.objects(n)} for n in self.homes}
        self.requests = [r for r in read_requests(self.deck) if r.style in REPORTED]
        self.things, self.settings = candidates, things_run.ThingsSettings(detectors=("ground_truth",), queries="made")
        self.items = things_run.requests(self.settings, candidates)

    def of(self, reasoner: embedded.Embedded) -> Iterator[str]:
        for split in ("paper", "extended"):
            yield self._bench(reasoner, split)
        with tempfile.TemporaryDirectory() as folder:
            of = things_run.things(self.settings, self.items, reasoner, self.things)
            rows = suite.run(Path(folder) / "run", of)
        rows = [row for row in rows if row["run"] == "map"]
        yield _percents(
            [row["right"] for row in rows if row["kind"] in FIND],
            [not row["right"] for row in rows if row["kind"] == "nothing"],
        )
        told = put(reasoner, self.requests, self.lists)
        right = [[o.right for o in told if o.kind == kind and o.serves] for kind in SERVED]
        nothing = [bool(o.goals) for o in told if o.kind == "nothing"]
        removed = [bool(o.goals) for o in told if o.kind in SERVED and not o.serves]
        yield f"{_percents(*right)} | {_percents(nothing, removed)}"
        tells, asks = ([*TOLD, *LATER_TOLD, *FRESH_TOLD], [*ASKED, *LATER_ASKED, *FRESH_ASKED])
        goal = [
            [reasoner.select(words, Inventory.of(HOME)).object is not None for words in some] for some in (tells, asks)
        ]
        yield _percents(goal[0], [not g for g in goal[1]])

    def _bench(self, reasoner: embedded.Embedded, split: str) -> str:
        right: dict[str, list[bool]] = {kind: [] for kind in SERVED}
        for home, query in cases(load_queries(split), self.truth):
            chosen = reasoner.select(query.text, self.homes[home])
            right[query.type].append(matches(chosen.object, set(query.accept) & self.truth[home]))
        return _percents(*right.values())


def _percents(*groups: list[bool]) -> str:
    return " / ".join(f"{100 * float(np.mean(group)):.1f}" for group in groups)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("reference", type=Path, help="folder with thor_object_types.json and lvis_v1_categories.json")
    parser.add_argument("maps", type=Path, help="folder of mapped homes of the bench")
    parser.add_argument("things", type=Path, help="folder of mapped homes of bench things")
    parser.add_argument("rules", nargs="*", help=f"{', '.join(RULES)}; default: all")
    options = parser.parse_args()
    if unknown := set(options.rules) - set(RULES):
        parser.error(f"no rule {', '.join(sorted(unknown))}")
    measures, reasoner = Measures(options.reference, options.maps, options.things), embedded.make()
    Remembered(reasoner.needs.scorer)
    print(
        "| without | paper | extended | things: find, nothing | voices | nothing, removed | told, asked |", flush=True
    )
    print("|---|---|---|---|---|---|---|")
    for rule in options.rules or RULES:
        reasoner.needs.forget()
        with ExitStack() as stack:
            for where, name, value in RULES[rule]:
                stack.enter_context(patch.object(where, name, value))
            print(f"| {rule} | {' | '.join(measures.of(reasoner))} |", flush=True)


if __name__ == "__main__":
    run_script(main)
