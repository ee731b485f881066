"""Markdown report of a run, ``report.md``: the tables, and how to read them."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cartier_bench.queries import TYPES
from cartier_bench.rows import PARTS, Row, ordered, title
from cartier_bench.summary import BASE, FAULTS, RADII_M
from cartier_bench.tables import PAPER_MEAN_M, Summary, made_by, markdown, said

PAPER_NOTE = (
    "*paper* is the paper's own mean (arXiv 2307.11865, with GPT-4): **other scenes, other requests and another "
    "detector**, so its numbers say how the paper's methods stand among themselves, not whether ours are better."
)


def report(
    summary: Summary, rows: Sequence[Row], settings: Mapping[str, Any], failed: int, others: Mapping[str, Summary]
) -> str:
    """The whole ``report.md``; ``others`` are the summaries of runs that stand beside this one, by their folder's
    name."""
    methods, head = summary["methods"], f"method ({summary['objects_from']})"
    parts = [
        "# The paper's evaluation: a run",
        _head(settings, rows),
        _gaps(methods),
        _beside(summary, others),
        "## How far from the object: Table I",
        "Mean distance in metres, in 3-D, from the place that a method gives to the nearest acceptable true box, over "
        f"the answers that give a place, with its 95 % interval. {PAPER_NOTE}",
        _table_one(methods, head),
        "![Mean distance by method and type of request](distance.png)",
        _spread(methods, head),
        "## How often the right object: object match",
        "Share of answers that name an acceptable object, by the published table of synonyms "
        "(`cartier_bench/matching.toml`). The paper has this as a bar chart judged by hand, without numbers, so it has "
        "no column here. *VLMaps, words alone* names nothing itself: the object whose place is nearest to its spot "
        "counts.",
        _matched(methods, head),
        "![Share of answers that name an acceptable object](object_match.png)",
        "## How often near enough: success",
        "Share of all answers whose place is within a radius of an acceptable true box (3-D). An answer without a "
        "place is a miss. *goal reachable* is the share of goals that the robot can reach, among the answers for which "
        "one was sought.",
        *(_success(methods, kind, head) for kind in TYPES),
        _faults(summary, head),
        _paired(summary),
        "## What it costs",
        f"Means per request ({' / '.join(TYPES)}); the seconds are a median, and depend on the machine.",
        _costs(methods, head),
        "## How to read this",
        _reading(summary, failed),
        "## Made by",
        _made_by(rows, head),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(settings: Mapping[str, Any], rows: Sequence[Row]) -> str:
    first = ["queries", "homes", "methods", "maps", "nlmap_threshold", "seed", "date", "commit", "versions"]
    keys = [key for key in first if key in settings] + sorted(key for key in settings if key not in first)
    plain = {"queries": "requests", "nlmap_threshold": "NLMap's threshold", "versions": "software"}
    who = made_by(rows)
    lines = list(who.items())
    lines += [(plain.get(key, key.replace("_", " ")), said(settings[key])) for key in keys if key not in who]
    return markdown(["", ""], [[_cell(name), _cell(value)] for name, value in lines], words=2)


def _gaps(methods: Summary) -> str:
    """Said aloud where methods were not asked the same number of pairs: such numbers do not compare."""
    short = []
    for kind in TYPES:
        asked = {name: kinds.get(kind, {}).get("n", 0) for name, kinds in methods.items()}
        most = max(asked.values())
        short += [f"{title(name)} answered {n} of {most} {kind} pairs" for name, n in asked.items() if n < most]
    return f"> **Not complete:** {'; '.join(short)}. The columns below do not compare." if short else ""


def _beside(summary: Summary, others: Mapping[str, Summary]) -> str:
    """This run and the others in one table: what the detector costs."""
    if not others:
        return ""
    runs = {"this run": summary, **others}
    origins = [one["objects_from"] for one in runs.values()]
    heads = [
        _cell(origin if origins.count(origin) == 1 else f"{origin}, {name}")
        for origin, name in zip(origins, runs, strict=True)
    ]
    columns: dict[str, Callable[[Summary], str]] = {
        "match": lambda x: _share(x["match"]), "within 1 m": lambda x: _share(x["success"]["1"]),
        "distance, m": lambda x: _metres(x["distance_mean_m"]),
    }  # fmt: skip
    body = []
    for method in ordered({name for one in runs.values() for name in one["methods"]}):
        for kind in TYPES:
            cells = [one["methods"].get(method, {}).get(kind) for one in runs.values()]
            told = ["–" if x is None else tell(x) for tell in columns.values() for x in cells]
            body.append([title(method), kind, *told])
    listed = "\n".join(
        f"- {_cell(name)}: {one['objects_from']}, {_cell(one['made_by']['detector'])}" for name, one in runs.items()
    )
    return (
        "## Side by side\n\nThe same requests, homes and methods; only who found the objects differs. Distances are "
        "means over the "
        f"answers that give a place. Each run's own report is in its folder.\n\n{listed}\n\n"
        + markdown(["method", "type", *(f"{what} ({head})" for what in columns for head in heads)], body, words=2)
    )


def _by_type(
    methods: Summary, head: str, columns: Sequence[str], cells: Callable[[str, str, Summary | None], Sequence[str]]
) -> str:
    """A table with a line a method, in which ``cells`` (method, type, numbers) fills the columns of each type."""
    body = [
        [title(name), *(cell for kind in TYPES for cell in cells(name, kind, kinds.get(kind)))]
        for name, kinds in methods.items()
    ]
    return markdown([head, *columns], body)


def _table_one(methods: Summary, head: str) -> str:
    def cells(name: str, kind: str, x: Summary | None) -> list[str]:
        paper = PAPER_MEAN_M.get(name, {}).get(kind)
        ours = "–" if x is None else _metres(x["distance_mean_m"], x["distance_mean_ci"])
        return [ours, "" if paper is None else f"*{paper:.2f}*"]

    return _by_type(methods, head, [word for kind in TYPES for word in (kind, "*paper*")], cells)


def _spread(methods: Summary, head: str) -> str:
    """Median, floor plan and how many gave a place at all: what a mean alone hides."""

    def cells(name: str, kind: str, x: Summary | None) -> list[str]:
        metres = ("distance_median_m", "distance_floor_mean_m")
        return ["–"] * 3 if x is None else [*(_metres(x[key]) for key in metres), f"{x['n_placed']} / {x['n']}"]

    columns = [f"{kind}: {what}" for kind in TYPES for what in ("median", "floor plan", "placed")]
    return (
        "The median in 3-D, the mean on the floor plan (heights left out), and how many answers gave a place:\n\n"
        + _by_type(methods, head, columns, cells)
    )


def _matched(methods: Summary, head: str) -> str:
    return _by_type(
        methods, head, TYPES, lambda name, kind, x: ["–" if x is None else _share(x["match"], x["match_ci"])]
    )


def _success(methods: Summary, kind: str, head: str) -> str:
    body = [
        [
            title(name), *(_share(x["success"][r]) for r in RADII_M),
            _share(x["success"]["1"], x["success_ci"]["1"]), _share(x["goal_reachable"]),
        ]
        for name in methods
        if (x := methods[name].get(kind)) is not None
    ]  # fmt: skip
    columns = [*(f"{radius} m" for radius in RADII_M), "1 m with interval", "goal reachable"]
    return _section(f"**{kind}**", [head, *columns], body)


def _section(said: str, head: Sequence[str], body: Sequence[Sequence[str]], words: int = 1) -> str:
    """A text and its table; nothing where the table has no line."""
    return f"{said}\n\n{markdown(head, body, words)}" if body else ""


def _faults(summary: Summary, head: str) -> str:
    """Whose fault a wrong answer is."""
    return _section(
        f"## Detector, index or words?\n\nAnswers by type ({' / '.join(TYPES)}): *right* is the right object within 1 "
        "m; *detector*: no right object was in the list; *index*: the right name, but the place is more than 1 m off "
        "(a viewpoint, a look-alike); *words*: it was listed, and the answer was something else.",
        [head, "right", "detector", "index", "words"],
        [
            [title(name), *(" / ".join(str(kinds[kind][fault]) for kind in TYPES) for fault in FAULTS)]
            for name, kinds in summary["faults"].items()
        ],
    )


def _paired(summary: Summary) -> str:
    differences = (("match", 100, "%"), ("success_1m", 100, "%"), ("distance_m", 1, "m"))
    columns = ["type", "pairs", "match (points)", "success at 1 m (points)", "distance (m)"]
    return _section(
        "## ObjectDepth against the others\n\nObjectDepth minus the other, on the same (home, request) pairs: "
        "percentage points for match and success, metres for distance "
        "(negative: ObjectDepth is nearer; over the pairs in which both gave a place). **Bold** where the interval "
        "excludes zero.",
        [f"against ({summary['objects_from']})", *columns],
        [
            [
                title(name), kind, str(x["n"]),
                *(_difference(x[key], x[f"{key.removesuffix('_m')}_ci"], by, unit) for key, by, unit in differences),
            ]
            for name, kinds in summary["paired"].get(BASE, {}).items() for kind, x in kinds.items()
        ],
        words=2,
    )  # fmt: skip


def _costs(methods: Summary, head: str) -> str:
    forms = ("{llm_calls:.2f}", "{tokens:.0f}", "{seconds_median:.3f}")
    body = [
        [
            title(name),
            *(" / ".join(form.format(**kinds[kind]) if kind in kinds else "–" for kind in TYPES) for form in forms),
        ]
        for name, kinds in methods.items()
    ]
    return markdown([head, "LLM calls", "tokens", "seconds"], body)


def _reading(summary: Summary, failed: int) -> str:
    return "\n".join(
        [
            f"- Intervals: {summary['interval']}, {summary['resamples']} draws, seed {summary['seed']}. They say how "
            "the result could differ with other requests of this kind, not with other homes, detectors or language "
            "models.",
            "- A mean distance leaves out answers without a place, so a method that gives up on hard requests looks "
            "nearer than it is: read it together with *placed* and with success, which counts them as misses.",
            "- Yardsticks use ObjectDepth's places: *random object* and *nearest name* need no language model; *LLM "
            "without the list* must guess what is there; *true object* is told the answer, so what is left is the cost "
            "of localising it.",
            "- Detections that a simulator gives away (\"ground truth\") flatter every method that uses a list of "
            "objects: nothing is missed, misnamed or seen where it is not.",
            f"- {failed} answers failed (wrong object, no place, or more than 1 m off). Leaf through them in "
            "[failures.html](failures.html).",
            "- The same numbers for programs: `results.json`, `tables.csv`, `table.tex`; every answer is in "
            "`results.jsonl`.",
        ]
    )  # fmt: skip


def _made_by(rows: Sequence[Row], head: str) -> str:
    names: dict[str, dict[str, dict[str, None]]] = {}  # by method and part, in the order of the rows
    for row in rows:
        for part in PARTS:
            names.setdefault(row.method, {}).setdefault(part, {})[row.made_by(part)] = None
    body = [[title(method), *(_cell(", ".join(parts[part])) for part in PARTS)] for method, parts in names.items()]
    return markdown([head, *PARTS], body, words=4)


def _metres(value: float | None, ends: Sequence[float] | None = None) -> str:
    if value is None:
        return "–"
    return f"{value:.2f}" if ends is None else f"**{value:.2f}** [{ends[0]:.2f}, {ends[1]:.2f}]"


def _share(value: float | None, ends: Sequence[float] | None = None) -> str:
    if value is None:
        return "–"
    share = f"{100 * value:.0f} %"
    return share if ends is None else f"**{share}** [{100 * ends[0]:.0f}, {100 * ends[1]:.0f}]"


def _difference(value: float | None, ends: Sequence[float] | None, factor: float, unit: str) -> str:
    if value is None or ends is None:
        return "–"
    digits = 2 if unit == "m" else 0
    low, high = (factor * end + 0.0 for end in ends)
    sure = low > 0 or high < 0
    number = f"{factor * value:+.{digits}f}"
    return f"{f'**{number}**' if sure else number} [{low:+.{digits}f}, {high:+.{digits}f}]"


def _cell(text: str) -> str:
    """Text from outside for a Markdown cell: one line, no table, no HTML, no link."""
    flat = " ".join(text.split())
    flat = html.escape(flat if len(flat) <= 500 else flat[:499] + "…", quote=False)
    for mark in "\\`*_[]|#!$":
        flat = flat.replace(mark, f"\\{mark}")
    return flat
