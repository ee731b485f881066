"""Measures what ``cartier verify`` does to the lists of the built-in homes, mapped from pixels.

python benchmarks/look_verify.py studio family_flat --vision replay:replies.jsonl --maps maps
python benchmarks/look_verify.py studio family_flat --write-prompts prompts.jsonl --maps maps

Precision is the share of the confirmed objects that are there under their label, recall the share of the objects that
the walk shows in at least 400 pixels and that are listed. Homes are verified on copies: the maps stay as they are.
"""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from command_line import Parser, run_script

from cartier import specs
from cartier.home import Home
from cartier.home.looking import ask_about_doubts, verify
from cartier.types import MapObject
from cartier.vision.batch import PictureWriter
from cartier.vision.permission import Look
from cartier_bench.maps import Maps, MapSettings, encoder_for
from cartier_bench.true_home import SHOWN_PX, true_home

NEAR_M = 0.3
"""How far from the true box the middle of an object may lie."""


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("homes", nargs="+", help="homes of the dollhouse")
    parser.add_argument("--maps", type=Path, required=True, help="the folder of mapped homes")
    parser.add_argument("--vision", default="openai", help="the vision model, as for cartier verify")
    parser.add_argument("--base-url", help="its server")
    parser.add_argument("--write-prompts", type=Path, help="only write the prompts and photographs")
    given = parser.parse_args()
    maps = Maps(given.maps, MapSettings("dollhouse", "embedded", encoder_for("embedded")), ("object_depth",))
    mapped = {name: maps.get(name) for name in given.homes}
    if given.write_prompts is not None:
        writer = PictureWriter()
        for home in mapped.values():
            ask_about_doubts(home, Look(writer))
        print(f"{len(writer.requests)} prompts; photographs in {writer.save(given.write_prompts)}")
        return
    allowed = specs.look("auto", given.vision, base_url=given.base_url)
    assert allowed is not None
    print(f"{'home':14} {'doubtful':>8} {'asked':>6} {'yes':>4} {'no':>4}   precision, after    recall, after    wrong")
    totals, shown_in = [0] * 6, dict[str, list[MapObject]]()
    for name, home in mapped.items():
        truth = true_home(maps.world, name, 0, given.maps)
        true = shown_in[name] = [obj for obj in truth.objects if truth.pixels.get(obj.id, 0) >= SHOWN_PX]
        with tempfile.TemporaryDirectory() as folder:
            assert home.store is not None
            copy = Home.load(shutil.copytree(home.store.folder, Path(folder) / "home"))
            _, checked = verify(copy, allowed)
            after = Home.load(Path(folder) / "home").objects
        said = [each.said for each in checked]
        told = [(e.said, replace(e.obj, label=e.label or e.obj.label)) for e in checked if e.said != "cannot tell"]
        wrong = [(answer, obj) for answer, obj in told if (answer == "yes") is not _real(obj, truth.objects)]
        before, later = _counts(home.objects, truth.objects, true), _counts(after, truth.objects, true)
        totals = [total + count for total, count in zip(totals, (*before, *later), strict=True)]
        asked = sum(each.trace.reply is not None for each in checked)
        counts = f"{len(said):8} {asked:6} {said.count('yes'):4} {said.count('no'):4}"
        print(f"{name:14} {counts}   {_shares(before, later, len(true))}    {len(wrong)}")
        for answer, obj in wrong:
            print(f"    {answer} to {obj.label} {obj.id}")
    shown = sum(len(true) for true in shown_in.values())
    print(f"all: precision {totals[0] / totals[1]:.1%}, after {totals[3] / totals[4]:.1%}; "
          f"recall {totals[2] / shown:.1%}, after {totals[5] / shown:.1%}")  # fmt: skip


def _counts(objects: Sequence[MapObject], every: Sequence[MapObject], shown: Sequence[MapObject]) -> tuple[int, ...]:
    """How many listed objects are real, how many are listed, and how many of those shown are listed."""
    listed = [obj for obj in objects if obj.confirmed]
    found = sum(any(_is(obj, real) for obj in listed) for real in shown)
    return sum(_real(obj, every) for obj in listed), len(listed), found


def _real(obj: MapObject, true: Sequence[MapObject]) -> bool:
    return any(_is(obj, real) for real in true)


def _is(obj: MapObject, real: MapObject) -> bool:
    outside = [
        max(low - at, at - high, 0.0)
        for at, low, high in zip(obj.position, real.box_min, real.box_max, strict=True)
    ]  # fmt: skip
    return obj.label == real.label and math.hypot(*outside) <= NEAR_M


def _shares(before: Sequence[int], after: Sequence[int], shown: int) -> str:
    parts = [f"{real / listed:.1%} ({real} of {listed})" for real, listed, _ in (before, after)]
    recall = [f"{found / shown:.1%}" for _, _, found in (before, after)]
    return f"{', '.join(parts)}    {', '.join(recall)}"


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parent))
    run_script(main)
