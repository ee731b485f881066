"""Score of the alarm screen on lines by an author who has read nothing of the program.

    python tools/alarms/score.py [--development]

Prints how many alarms of each kind are recognised, how many that are not get a goal, and how many ordinary sentences
that only sound like alarms, and how many requests, are mistaken for them: of ``held_out/``, of which only these totals
may be looked at, or of ``development/``, by which the threshold is chosen.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "understanding"))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
sys.path.append(str(Path(__file__).parents[1]))
from command_line import Parser, run_script
from fit_decision import DEVELOPMENT

from cartier import plugins
from cartier.understanding.alarm import alarm_kind
from cartier_bench.true_home import perfect_map

ALARMS, TOOLS = Path(__file__).parent, Path(__file__).parents[1]
HOME = "76181"  # a home of the held-out requests; what is missed as an alarm is answered over its objects


def main() -> int:
    arguments = Parser(__doc__)
    arguments.add_argument("--development", action="store_true", help="the lines by which the threshold is chosen")
    folder = ALARMS / ("development" if arguments.parse_args().development else "held_out")
    lines: dict[str, list[str]] = defaultdict(list)
    for line in (folder / "alarms.txt").read_text(encoding="utf-8").splitlines():
        kind, words = line.split("\t")
        lines[kind].append(words)
    alike = (folder / "alarm_lookalikes.txt").read_text(encoding="utf-8").splitlines()
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
    development = [json.loads(line) for line in _lines("things/development.jsonl")]
    ordinary = {
        "ordinary sentences that sound like alarms": alike,
        "development requests": [words for one in development for words in one.get("turns", [one.get("text")])],
        "development rambles": [
            json.loads(line)["text"] for style in DEVELOPMENT for line in _lines(f"requests/{style}.jsonl")
        ],
    }
    print()
    for name, each in ordinary.items():
        print(f"{sum(alarm_kind(words) is not None for words in each)} of {len(each)} {name} are taken for an alarm")
    return 0


def _lines(file: str) -> list[str]:
    return (TOOLS / file).read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    raise SystemExit(run_script(main))
