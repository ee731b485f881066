"""Builder of ready-made knowledge cards: ``python tools/build_cards.py`` after each change of a card; a test checks.

Without it cards are read from their TOML files: the same answers, a fifth of a second later.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

from cartier.understanding.cards import BUILT, SHIPPED, read_cards, source, work_out

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script


def built() -> bytes:
    """The file's bytes, from the TOML files alone."""
    cards = read_cards(SHIPPED)
    rows = [dataclasses.astuple(card) for card in cards]
    return json.dumps({"sha256": source(), "cards": rows, **work_out(cards)}, separators=(",", ":")).encode()


def main() -> None:
    Parser(__doc__).parse_args()
    BUILT.write_bytes(built())


if __name__ == "__main__":
    run_script(main)
