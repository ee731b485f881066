"""Score of the alarm screen on lines by an author who has read nothing of the program (``held_out/``).

    python tools/alarms/score.py

Prints totals, which is all that may be looked at: how many alarms of each kind are recognised, how many that are not
get a goal, and how many ordinary sentences that only sound like alarms are mistaken for them.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "understanding"))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from command_line import Parser, run_script

from cartier import plugins
from cartier.evaluation.true_home import perfect_map
from cartier.understanding.act_classifier import alarm_kind

HELD_OUT = Path(__file__).parent / "held_out"
DEVELOPMENT = Path(__file__).parents[1] / "things" / "development.jsonl"
HOME = "76181"  # a home of the held-out requests; what is missed as an alarm is answered over its objects


def main() -> int:
    Parser(__doc__).parse_args()
    lines: dict[str, list[str]] = defaultdict(list)
    for line in (HELD_OUT / "alarms.txt").read_text(encoding="utf-8").splitlines():
        kind, words = line.split("\t")
        lines[kind].append(words)
    alike = (HELD_OUT / "alarm_lookalikes.txt").read_text(encoding="utf-8").splitlines()
    reasoner, home = plugins.make("reasoners", "embedded"), perfect_map(HOME)
    print("| kind | lines | recognised | as this kind | given a goal |\n|---|---:|---:|---:|---:|")
    rows = []
    for kind, each in lines.items():
        kinds = [alarm_kind(words) for words in each]
        missed = [words for words, found in zip(each, kinds, strict=True) if found is None]
        goals = sum(reasoner.select(words, home).object is not None for words in missed)
        rows.append((kind, len(each), len(each) - len(missed), sum(found == kind for found in kinds), goals))
    rows.append(("all", *(sum(column) for column in list(zip(*rows, strict=True))[1:])))
    for row in rows:
        print("|", " | ".join(map(str, row)), "|")
    mistaken = sum(alarm_kind(words) is not None for words in alike)
    requests = [json.loads(line) for line in DEVELOPMENT.read_text(encoding="utf-8").splitlines()]
    development = [words for one in requests for words in one.get("turns", [one.get("text")])]
    set_by = sum(alarm_kind(words) is not None for words in development)
    print(f"\n{set_by} of the {len(development)} development requests, which set the threshold, are taken for an alarm")
    print(f"{mistaken} of {len(alike)} ordinary sentences that sound like alarms are taken for one")
    return 0


if __name__ == "__main__":
    raise SystemExit(run_script(main))
