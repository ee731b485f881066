"""Report of a run folder: tables, pictures and the failure page; and the labels of a person, with the agreement."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cartier.errors import InputError
from cartier.io.atomic import replaced_folder, write_file, write_json
from cartier.io.files import read_json, read_text
from cartier_bench._figure import distance_png, match_png
from cartier_bench._markdown import report
from cartier_bench.page import FOLDER, Photo, failure_kind, page, take_photos
from cartier_bench.rows import Row, check_rows, objects_from, read_rows
from cartier_bench.summary import summarise
from cartier_bench.tables import latex, made_by, tidy_csv

PHOTOS_LIST = "photos.json"
MARK = "served"
COLUMNS = ("key", "home", "type", "request", "robot_went_to", MARK)
YES, NO = ("yes", "y", "1", "true"), ("no", "n", "0", "false")
MAX_MARKING_BYTES = 256 * 2**20


def write_report(folder: Path, photo: Photo | None = None, beside: Sequence[Path] = ()) -> dict[str, Any]:
    """Write the report of a run folder from its ``results.jsonl`` and ``settings.json``, and return the summary.

    ``beside`` are folders of finished runs, of which a report is written already: their numbers stand beside these.

    ``results.json``, ``report.md``, ``tables.csv``, ``table.tex``, ``distance.png``, ``object_match.png``,
    ``failures.html`` and the photos in ``failures/``. ``photo(home, frame)`` gives the image of an evidence frame, or
    None. Each file takes the place of an older one whole or not at all; the same input gives the same bytes. Raises
    InputError for broken input.
    """
    settings = read_json(folder / "settings.json")
    if not isinstance(settings, dict):
        raise InputError(f"{folder / 'settings.json'} is no object of settings")
    rows = check_rows(read_rows(folder / "results.jsonl"))
    seed = settings.get("seed", 0)
    if type(seed) is not int or seed < 0:
        raise InputError(f"{folder / 'settings.json'}: the seed must be a whole number from 0 on")
    who = made_by(rows)
    summary = {"made_by": who, "objects_from": objects_from(rows)} | summarise(rows, seed)
    others = {other.name: read_json(other / "results.json") for other in beside}
    failed = [row for row in rows if failure_kind(row)]
    photos = take_photos(failed, photo)
    names = {key: f"{FOLDER}/{number:04d}.jpg" for number, key in enumerate(photos, start=1)}
    files = {
        "distance.png": distance_png(summary, who),
        "object_match.png": match_png(summary, who),
        "tables.csv": tidy_csv(summary).encode(),
        "table.tex": latex(summary, rows).encode(),
        "failures.html": page(rows, failed, names, who).encode(),
        "report.md": report(summary, rows, settings, len(failed), others).encode(
            "utf-8", "replace"
        ),  # settings may hold anything
        "results.json": (json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode(),
    }
    _write_photos(folder, [(names[key], *key, data) for key, data in photos.items()])
    for name, data in files.items():
        write_file(folder / name, data)
    return summary


def export_marking(rows: Iterable[Mapping[str, Any] | Row], file: Path) -> int:
    """Write a CSV for a person to mark: does the object serve the request? Returns the number of lines.

    One line per home, request and object, however many methods named it; neither the methods nor the automatic verdict
    are in it. The person writes yes or no into the column ``served``; what is left empty does not count.
    """
    buffer = io.StringIO()
    out = csv.writer(buffer, lineterminator="\r\n")
    out.writerow(COLUMNS)
    verdicts = _verdicts(rows)
    for key, row in sorted(verdicts.items(), key=lambda item: (item[1].home, item[1].query_id, item[0])):
        out.writerow([key, *(_spreadsheet(text) for text in (row.home, row.type, row.text, row.object or "")), ""])
    write_file(file, buffer.getvalue().encode("utf-8-sig"))  # the mark at its start tells spreadsheets that it is UTF-8
    return len(verdicts)


def agreement(rows: Iterable[Mapping[str, Any] | Row], file: Path) -> dict[str, Any]:
    """How far the automatic object match agrees with a marked CSV of ``export_marking``.

    ``n`` lines that were marked, ``agree`` the share on which both say the same (null if n is 0), ``kappa`` Cohen's
    kappa, that is the agreement beyond chance (null where chance alone agrees always), ``unmarked`` lines left empty.
    Raises InputError with the number of the first line that cannot be read, or that is of another run.
    """
    verdicts = _verdicts(rows)
    marks: dict[str, bool | None] = {}
    for number, line in _marked_lines(file):
        key, word = (line.get("key") or "").strip(), (line.get(MARK) or "").strip().lower()
        if key not in verdicts:
            raise InputError(f"{file} line {number}: {key[:40]!r} is no answer of this run")
        if key in marks:
            raise InputError(f"{file} line {number}: this answer was marked on a line before")
        if word and word not in YES + NO:
            raise InputError(
                f"{file} line {number}: {word[:40]!r} in the column {MARK}; write yes or no, or leave it empty"
            )
        marks[key] = word in YES if word else None
    pairs = [(verdicts[key].match, mark) for key, mark in marks.items() if mark is not None]
    n = len(pairs)
    numbers: dict[str, Any] = {"n": n, "agree": None, "kappa": None, "unmarked": len(marks) - n}
    if n:
        agree = sum(a == b for a, b in pairs) / n
        ours, theirs = (sum(side) / n for side in zip(*pairs, strict=True))
        chance = ours * theirs + (1 - ours) * (1 - theirs)
        numbers["agree"] = round(agree, 6)
        numbers["kappa"] = round((agree - chance) / (1 - chance), 6) if chance < 1 else None
    return numbers


def _verdicts(rows: Iterable[Mapping[str, Any] | Row]) -> dict[str, Row]:
    """One row per (home, request, object), by a key that no spreadsheet takes for a number."""
    verdicts: dict[str, Row] = {}
    for row in check_rows(rows):
        if row.object is not None:
            text = json.dumps([row.home, row.query_id, row.object])
            key = f"answer-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
            if verdicts.setdefault(key, row).match != row.match:
                raise InputError(
                    f"{row.object!r} for {row.query_id!r} in {row.home!r} is right in one row and wrong in another: "
                    "these are results of two runs, report each by itself"
                )
    return verdicts


def _marked_lines(file: Path) -> list[tuple[int, dict[str, str]]]:
    """The lines of a marked CSV with their numbers, whichever separator the spreadsheet left between the cells."""
    text = read_text(file, MAX_MARKING_BYTES)
    head = text.split("\n", 1)[0]
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=max(",;\t", key=head.count))
    try:
        if not {"key", MARK} <= set(reader.fieldnames or ()):
            raise InputError(f"{file} has no columns key and {MARK}: mark a file that was exported for this")
        return [(reader.line_num, line) for line in reader]
    except csv.Error as error:
        raise InputError(f"{file} line {reader.line_num}: {error}") from error


def _spreadsheet(text: str) -> str:
    """Text that a spreadsheet shows and never runs: a leading =, +, - or @ would be a formula."""
    return f"'{text}" if text.lstrip().startswith(("=", "+", "-", "@")) else text


def _write_photos(folder: Path, photos: Sequence[tuple[str, str, int, bytes]]) -> None:
    """Photos as (file, home, frame, JPEG), and a list of them; those of an older report go."""
    with replaced_folder(folder / FOLDER, PHOTOS_LIST) as new:
        for name, _, _, data in photos:
            (new / Path(name).name).write_bytes(data)
        listed = [{"file": Path(name).name, "home": home, "frame": frame} for name, home, frame, _ in photos]
        write_json(new / PHOTOS_LIST, listed)
