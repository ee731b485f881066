"""Suite routes: drives under rules in true homes, and sentences about the way against the rules they mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cartier.contracts import Reasoner
from cartier_bench import route_drives, route_sentences
from cartier_bench.batch import PromptWriter
from cartier_bench.marked_lines import Line
from cartier_bench.route_drives import Outcome
from cartier_bench.route_sentences import Judged
from cartier_bench.suite import Case, Progress, Row, Suite, silent
from cartier_bench.tables import markdown

DRIVES = 240
DRIVING, READING = "drive", "sentence"


@dataclass(frozen=True)
class RouteSettings:
    """What is asked, and where is driven."""

    homes: tuple[str, ...]
    seed: int = 0
    drives: int = DRIVES
    suite: str = "routes"


def routes(
    settings: RouteSettings, lines: Sequence[Line], reasoner: Reasoner, progress: Progress = silent
) -> Suite:  # fmt: skip
    """The suite; for who writes prompts the sentences alone, since no drive depends on a language model.

    Raises InputError for a home that does not exist.
    """
    count = 0 if isinstance(reasoner, PromptWriter) else settings.drives
    drives = route_drives.drawn(settings.homes, count, settings.seed, progress)
    asked = {DRIVING: drives, READING: lines}
    return Suite(
        who=reasoner.name, settings=settings, items=lines, keys=("method", "number"),
        cases=[Case((how, str(n)), how, each, how) for how, some in asked.items() for n, each in enumerate(some, 1)],
        open=lambda how, progress: None,
        row=lambda _, case: dict(zip(("method", "number"), case.key, strict=True)) | (
            route_drives.driven(case.item) if case.method == DRIVING else route_sentences.judged(case.item, reasoner)
        )._asdict(),
        report=lambda rows: report(rows, settings, reasoner.name),
    )  # fmt: skip


def report(rows: Sequence[Row], settings: RouteSettings, who: str) -> dict[str, Any]:
    """The figures, and the tables as Markdown."""

    def of(method: str, kind: Any) -> list[Any]:
        return [kind(*(row[name] for name in kind._fields)) for row in rows if row["method"] == method]

    driven = route_drives.figures(of(DRIVING, Outcome))
    read = route_sentences.figures(of(READING, Judged))
    results = {
        "reasoner": who, "homes": list(settings.homes), "seed": settings.seed, "driving": driven, "sentences": read
    }  # fmt: skip
    return {"results.json": results, "report.md": _tables(results) + "\n"}


def _tables(results: Mapping[str, Any]) -> str:
    driven, read = results["driving"], results["sentences"]
    columns = [verdict for verdict in route_drives.VERDICTS if any(verdict in of for of in driven["verdicts"].values())]
    rows = [[name, *(str(of.get(c, "")) for c in columns)] for name, of in driven["verdicts"].items()]
    parts = ("exact", *route_sentences.PARTS)
    said = [[sort, str(of["lines"]), *(f"{100 * of[part]:.0f}" for part in parts)] for sort, of in read.items()]
    return "\n\n".join([
        f"# Routes: {results['reasoner']}",
        f"{driven['drives']} drives in {len(results['homes'])} homes on their true floor plans (ground truth)",
        markdown(["rule", *columns], rows),
        f"Hard rules broken without having asked: {driven['hard_rules_broken']}; drives that hit something: "
        f"{driven['collided']}; asked: {driven['asked']}. Detours: {driven['detours']}, {driven['median_detour_m']} m "
        f"at the median. Planning: {driven['median_ms']:.0f} ms at the median, {driven['most_ms']:.0f} ms at most.",
        "Sentences of which all is exact, and whose parts are right, in percent:",
        markdown(["sentences", "lines", *parts], said),
    ])  # fmt: skip
