"""Suite routes of ``cartier bench``: drives under rules in true homes, and sentences against the rules they mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cartier.contracts import Reasoner
from cartier.io.atomic import write_file, write_json
from cartier_bench import route_drives, route_sentences
from cartier_bench.asked import Asked
from cartier_bench.look_report import table
from cartier_bench.route_homes import home_names

DRIVES = 240


def run(
    folder: Path,
    homes: Sequence[str],
    files: Sequence[Path],
    reasoner: Reasoner,
    seed: int = 0,
    drives: int = DRIVES,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[str, Any]:
    """Drive, ask, and write results.json and report.md into a folder; answers are kept there, and asked for once.

    Raises InputError for a home that does not exist and for files without rules.
    """
    lines, names = route_sentences.sentence_lines(files), home_names(homes)
    driven = route_drives.figures(route_drives.drive(names, drives, seed, progress))
    folder.mkdir(parents=True, exist_ok=True)
    asked = Asked(reasoner, folder / "answers.jsonl")
    read = route_sentences.figures(list(route_sentences.judged(lines, asked, progress)))
    results = {"reasoner": reasoner.name, "homes": list(names), "seed": seed, "driving": driven, "sentences": read}
    write_json(folder / "results.json", results)
    write_file(folder / "report.md", (report(results) + "\n").encode())
    return results


def report(results: Mapping[str, Any]) -> str:
    """The tables as Markdown."""
    driven, read = results["driving"], results["sentences"]
    columns = [verdict for verdict in route_drives.VERDICTS if any(verdict in of for of in driven["verdicts"].values())]
    rows = [[name, *(str(of.get(c, "")) for c in columns)] for name, of in driven["verdicts"].items()]
    parts = ("exact", *route_sentences.PARTS)
    said = [[sort, str(of["lines"]), *(f"{100 * of[part]:.0f}" for part in parts)] for sort, of in read.items()]
    return "\n\n".join([
        f"# Routes: {results['reasoner']}",
        f"{driven['drives']} drives in {len(results['homes'])} homes on their true floor plans (ground truth)",
        table(["rule", *columns], rows),
        f"Hard rules broken without having asked: {driven['hard_rules_broken']}; drives that hit something: "
        f"{driven['collided']}; asked: {driven['asked']}. Detours: {driven['detours']}, {driven['median_detour_m']} m "
        f"at the median. Planning: {driven['median_ms']:.0f} ms at the median, {driven['most_ms']:.0f} ms at most.",
        "Sentences of which all is exact, and whose parts are right, in percent:",
        table(["sentences", "lines", *parts], said),
    ])  # fmt: skip
