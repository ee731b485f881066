"""Report of the suite look: its tables, looked-at failures, and the pictures that they rest on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cartier_bench.look_items import KINDS
from cartier_bench.look_modes import MODES
from cartier_bench.tables import markdown

SIZES_PX = (256, 128, 64, 0)
"""The classes of apparent size: from so many pixels on the shorter side."""
FAILURES = 10
LOOKS = ("list + look", "mirrored", "frames only")
Row = Mapping[str, Any]


def report(rows: Sequence[Row], who: str) -> dict[str, Any]:
    """The figures, tables to read, and the failures of the look."""
    figures = results(rows)
    return {
        "results.json": {"vision_model": who} | figures,
        "report.md": f"{_tables(rows, figures, who)}\n",
        "failures.md": f"{failures(rows)}\n",
    }


def results(rows: Sequence[Row]) -> dict[str, Any]:
    """The shares of right, wrong and untold answers, by kind and mode and by apparent size, and what it cost."""
    counted = [row for row in rows if not row["unanswered"]]
    by_mode = {mode: [row for row in counted if row["mode"] == mode] for mode in MODES}
    looked = by_mode["list + look"]
    return {
        "by_kind": {mode: {kind: shares(_of(some, kind)) for kind in ("all", *KINDS)}
                    for mode, some in by_mode.items() if some},
        "by_size": {mode: {str(low): shares(_sized(by_mode[mode], k)) for k, low in enumerate(SIZES_PX)}
                    for mode in ("list + look", "frames only") if by_mode[mode]},
        "wrong_instance": _share(_of(looked, "which"), lambda row: not row["right"] and not row["cannot_tell"]),
        "changed_by_mirroring": _changed(looked, by_mode["mirrored"]),
        "calls_a_question": round(sum(row["calls"] for row in looked) / len(looked), 3) if looked else None,
        "most_calls": max((row["calls"] for row in looked), default=0),
        "image_tokens_a_look": _mean([row["image_tokens"] for row in looked if row["calls"]]),
        "pictures_a_look": _mean([len(row["pictures"]) for row in looked if row["calls"]]),
        "unanswered": sum(row["unanswered"] for row in rows),
    }  # fmt: skip


def shares(rows: Sequence[Row]) -> dict[str, Any]:
    """n, the shares of right, wrong and untold answers, and LLM-Match; None where nothing was asked or judged."""
    return {
        "n": len(rows), "right": _share(rows, lambda row: row["right"]),
        "wrong": _share(rows, lambda row: not row["right"] and not row["cannot_tell"]),
        "cannot_tell": _share(rows, lambda row: row["cannot_tell"]),
        "llm_match": _match([row["llm_match"] for row in rows if row["llm_match"] is not None]),
    }  # fmt: skip


def _tables(rows: Sequence[Row], figures: Mapping[str, Any], who: str) -> str:
    modes = [mode for mode in MODES if mode in figures["by_kind"]]
    parts = [
        f"# Questions about looks: {who}",
        "Rooms of the dollhouse made for the questions; the lists are mapped by ground truth. Right, with wrong "
        "answers in brackets, in percent; the rest is “cannot tell”, which is right where the side is hidden."
        + (" After the stroke OpenEQA's LLM-Match, in percent." if any(row["llm_match"] for row in rows) else ""),
        markdown(["", "n", *modes], [_line(figures["by_kind"], kind, modes) for kind in ("all", *KINDS)]),
    ]
    if sized := figures["by_size"]:
        head = ["apparent size", *(f"{mode} (n)" for mode in sized)]
        body = [
            [_class(k), *(f"{_cell(sized[mode][str(low)])} ({sized[mode][str(low)]['n']})" for mode in sized)]
            for k, low in enumerate(SIZES_PX)
        ]
        cost = [
            f"- wrong instance: {_percent(figures['wrong_instance'])}",
            f"- answers changed by mirroring the pictures: {_percent(figures['changed_by_mirroring'])}",
            f"- calls a question: {figures['calls_a_question']} (at most {figures['most_calls']})",
            f"- a look: {figures['pictures_a_look']} pictures, {figures['image_tokens_a_look']} image tokens",
            f"- without a reply, and not counted: {figures['unanswered']} of {len(rows)}",
        ]
        parts += [markdown(head, body), "\n".join(cost)]
    return "\n\n".join(parts)


def failures(rows: Sequence[Row]) -> str:
    """The looks whose answer was not the truth, with their photographs; wrong answers before untold ones."""
    bad = [row for row in rows if row["mode"] in LOOKS and not row["right"] and not row["unanswered"]]
    bad.sort(key=lambda row: (row["cannot_tell"], LOOKS.index(row["mode"])))
    parts = ["# Looks that failed"]
    for row in bad[:FAILURES]:
        shown = "" if row["mode"] == "frames only" else "".join(
            f"\n![crop {k}](looks/{row['id']}-{k}-crop.jpg) ![context {k}](looks/{row['id']}-{k}-context.jpg)"
            for k in range(1, len(row["pictures"]) + 1)
        )  # fmt: skip
        parts.append(
            f"## {row['id']}, {row['mode']}: {row['words']}\n\ntruth: {row['truth']}; answer: {row['answer']} "
            f"({row['why']}); {row['apparent_px']:.0f} px\n{shown}"
        )
    return "\n\n".join(parts)


def _line(by_kind: Mapping[str, Any], kind: str, modes: Sequence[str]) -> list[str]:
    return [kind, str(by_kind[modes[0]][kind]["n"]), *(_cell(by_kind[mode][kind]) for mode in modes)]


def _of(rows: Sequence[Row], kind: str) -> list[Row]:
    return [row for row in rows if kind in ("all", row["kind"])]


def _sized(rows: Sequence[Row], k: int) -> list[Row]:
    """The rows of a class of apparent size; hidden sides are none of it, for no size shows them."""
    high = SIZES_PX[k - 1] if k else float("inf")
    visible = [row for row in rows if row["kind"] not in ("hidden side", "exists on")]
    return [row for row in visible if SIZES_PX[k] <= row["apparent_px"] < high]


def _changed(looked: Sequence[Row], mirrored: Sequence[Row]) -> float | None:
    """The share of questions that are answered otherwise in the mirror, of those that were looked at both times."""
    before = {row["id"]: row["answer"] for row in looked if row["calls"]}
    return _share([row for row in mirrored if row["id"] in before], lambda row: row["answer"] != before[row["id"]])


def _share(rows: Sequence[Row], so: Callable[[Row], bool]) -> float | None:
    return round(sum(map(so, rows)) / len(rows), 4) if rows else None


def _mean(values: Sequence[float]) -> float | None:
    return round(sum(values) / len(values), 2) if values else None


def _match(scores: Sequence[int]) -> float | None:
    """OpenEQA's correctness of scores from 1 to 5."""
    return round(sum((score - 1) / 4 for score in scores) / len(scores), 4) if scores else None


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def _cell(found: Mapping[str, Any]) -> str:
    if found["right"] is None:
        return "–"
    match = "" if found["llm_match"] is None else f" / {100 * found['llm_match']:.0f}"
    return f"{100 * found['right']:.0f} ({100 * found['wrong']:.0f}){match}"


def _class(k: int) -> str:
    low = SIZES_PX[k]
    return f"≥ {low} px" if low else f"< {SIZES_PX[-2]} px"
