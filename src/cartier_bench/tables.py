"""Tables for other programs: a tidy CSV file, Table I for a LaTeX paper, and the paper's own numbers."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cartier_bench.queries import TYPES
from cartier_bench.rows import GROUPS, PARTS, TITLES, Row, title
from cartier_bench.summary import RADII_M

PAPER_MEAN_M: dict[str, dict[str, float]] = {
    method: dict(zip(("conversational", "implicit", "explicit"), metres, strict=True))
    for method, metres in {
        "object_depth": (1.20, 1.17, 1.09),
        "vlmaps": (1.70, 1.66, 1.70),
        "object_viewpoint": (1.94, 1.89, 1.91),
        "nlmap": (2.11, 2.09, 2.02),
        "vlmaps_query": (2.35, 2.27, 1.93),
    }.items()
}
"""Mean distances (m) with GPT-4 in Table I of arXiv 2307.11865: AI2-THOR homes, detections from pixels."""

Summary = Mapping[str, Any]


def tidy_csv(summary: Summary) -> str:
    """One line per method and type: whence the objects come, every number of the summary and the paper's mean, with a
    header."""
    lines = [
        {"objects": summary["objects_from"]} | _tidy(name, kind, x)
        for name, kinds in summary["methods"].items()
        for kind, x in kinds.items()
    ]
    buffer = io.StringIO()
    out = csv.DictWriter(buffer, list(lines[0]), lineterminator="\n")  # None is written as an empty cell
    out.writeheader()
    out.writerows(lines)
    return buffer.getvalue()


def _tidy(method: str, kind: str, x: Summary) -> dict[str, Any]:
    line = {"method": method, "type": kind, "n": x["n"], "n_placed": x["n_placed"], "match": x["match"]}
    line["match_low"], line["match_high"] = x["match_ci"]
    line["distance_mean_m"] = x["distance_mean_m"]
    line["distance_mean_low_m"], line["distance_mean_high_m"] = x["distance_mean_ci"] or (None, None)
    line |= {key: x[key] for key in ("distance_median_m", "distance_floor_mean_m")}
    for radius in RADII_M:
        key = f"success_{radius}_m"
        line[key] = x["success"][radius]
        line[f"{key}_low"], line[f"{key}_high"] = x["success_ci"][radius]
    line |= {key: x[key] for key in ("goal_reachable", "llm_calls", "tokens", "seconds_median")}
    return line | {"paper_distance_mean_m_other_scenes_and_detector": PAPER_MEAN_M.get(method, {}).get(kind)}


def latex(summary: Summary, rows: Iterable[Row]) -> str:
    """Table I with booktabs, ready to be \\input: mean distance with interval, success within 1 m, object match."""
    by = ", ".join(f"{part}: {name}" for part, name in made_by(rows).items())
    lines = [
        "% needs \\usepackage{booktabs}",
        "\\begin{table}",
        "\\centering",
        "\\caption{Mean distance $d$ in metres to the nearest acceptable object with its 95\\,\\% bootstrap interval "
        "over requests, share $s$ of answers within 1\\,m, and share $m$ that name an acceptable object. Objects: "
        f"{_tex(summary['objects_from'])}. {_tex(by)}.}}",
        "\\begin{tabular}{l" + "rrr" * len(TYPES) + "}",
        "\\toprule",
        " & ".join(["", *(f"\\multicolumn{{3}}{{c}}{{{kind}}}" for kind in TYPES)]) + " \\\\",
        "".join(f"\\cmidrule(lr){{{2 + 3 * n}-{4 + 3 * n}}}" for n in range(len(TYPES))),
        " & ".join(["method", *["$d$", "$s$", "$m$"] * len(TYPES)]) + " \\\\",
    ]
    for group in grouped(summary["methods"]).values():
        lines.append("\\midrule")
        for method in group:
            cells = [_tex(title(method))]
            for kind in TYPES:
                cells += _latex_cells(summary["methods"][method].get(kind))
            lines.append(" & ".join(cells) + " \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", "\\end{table}", ""])


def _latex_cells(x: Summary | None) -> list[str]:
    if x is None:
        return ["--"] * 3
    shares = [f"{x['success']['1']:.2f}", f"{x['match']:.2f}"]
    if x["distance_mean_m"] is None:
        return ["--", *shares]
    low, high = x["distance_mean_ci"]
    return [f"{x['distance_mean_m']:.2f} {{\\scriptsize [{low:.2f}, {high:.2f}]}}", *shares]


def made_by(rows: Iterable[Row]) -> dict[str, str]:
    """Who detected, encoded and reasoned, in plain words; the reasoner is the one under test, not a yardstick's own."""
    rows = list(rows)
    tested = [row for row in rows if row.method in (*GROUPS["the paper's method"], "nlmap")] or rows
    return {
        part: ", ".join(dict.fromkeys(name for row in of if (name := row.made_by(part)) != "none")) or "none"
        for part, of in zip(PARTS, (rows, rows, tested), strict=True)
    }


def grouped(methods: Summary) -> dict[str, list[str]]:
    """The methods there are by the name of their group, both in the fixed order."""
    groups = {words: [name for name in methods if name in names] for words, names in GROUPS.items()}
    groups["others"] = [name for name in methods if name not in TITLES]
    return {words: names for words, names in groups.items() if names}


def said(value: Any) -> str:
    """A setting in plain words."""
    if value is None or value in ("", [], {}):
        return "none"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {said(part)}" for key, part in sorted(value.items(), key=str))
    if isinstance(value, list | tuple):
        return ", ".join(said(part) for part in value)
    return value if isinstance(value, str) else json.dumps(value)


def _tex(text: str) -> str:
    """Text from outside for LaTeX: no command gets through."""
    special = {c: f"\\{c}" for c in "&%$#_{}"} | {
        "\\": "\\textbackslash{}",
        "~": "\\textasciitilde{}",
        "^": "\\textasciicircum{}",
    }
    return "".join(special.get(c, c) for c in " ".join(text.split())[:500])


def markdown(head: Sequence[str], body: Sequence[Sequence[str]], words: int = 1) -> str:
    """A table as Markdown, whose first columns hold words; the others, numbers, stand at the right."""
    rule = ["---"] * words + ["---:"] * (len(head) - words)
    return "\n".join("| " + " | ".join(line) + " |" for line in [head, rule, *body])
