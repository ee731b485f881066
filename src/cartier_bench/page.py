"""Failure page: ``failures.html``, one page for browsing the failed answers with their photos, without a network."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier_bench.rows import Row, ordered, title

Photo = Callable[[str, int], npt.NDArray[np.uint8] | None]
"""(home, frame) → the image (H, W, 3) that was seen there, or None."""

FAR_M = 1.0
MAX_PHOTOS = 200
MAX_LISTED = 5000
PHOTO_SIDE_PX = 640
FOLDER = "failures"
HERE = Path(__file__).parent


def failure_kind(row: Row) -> str | None:
    """What went wrong with an answer, or None: it names the wrong object, gives no place, or is more than 1 m off."""
    if row.distance_m is None:
        return "no place"
    if not row.match:
        return "wrong object"
    return f"right object, more than {FAR_M:g} m off" if row.distance_m > FAR_M else None


def take_photos(failed: Sequence[Row], photo: Photo | None) -> dict[tuple[str, int], bytes]:
    """JPEG files of at most ``MAX_PHOTOS`` frames, those first that show most failures."""
    if photo is None:
        return {}
    wanted = Counter((row.home, row.frame) for row in failed[:MAX_LISTED] if row.frame is not None)
    taken: dict[tuple[str, int], bytes] = {}
    for home, frame in sorted(wanted, key=lambda key: (-wanted[key], key)):
        if len(taken) == MAX_PHOTOS:
            break
        rgb = photo(home, frame)
        if rgb is not None:
            taken[home, frame] = _jpeg(rgb)
    return taken


def page(
    rows: Sequence[Row], failed: Sequence[Row], photos: Mapping[tuple[str, int], str], made_by: Mapping[str, str]
) -> str:
    """The page. ``photos`` has the file of each (home, frame), relative to the page."""
    listed = failed[:MAX_LISTED]
    number = {case: n for n, case in enumerate(dict.fromkeys(row.case for row in listed))}
    cases: list[dict[str, Any]] = [{} for _ in number]
    for row in rows:
        if row.case in number:
            case = cases[number[row.case]]
            if not case:
                case |= {"home": row.home, "query": row.query_id, "type": row.type, "text": row.text}
                case |= {"target": row.target, "accept": list(row.accept), "answers": []}
            case["answers"].append([row.method, row.object, row.match, row.distance_m, row.status])
    left_out = f" · only the first {MAX_LISTED} of {len(failed)} are here" if len(failed) > MAX_LISTED else ""
    return _fill(
        {
            "methods": {name: title(name) for name in ordered({row.method for row in rows})},
            "made_by": " · ".join(f"{part}: {name}" for part, name in made_by.items()),
            "left_out": left_out,
            "cases": cases,
            "failures": [_failure(row, number[row.case], photos) for row in listed],
        }
    )


def _failure(row: Row, case: int, photos: Mapping[tuple[str, int], str]) -> dict[str, Any]:
    return {
        "case": case, "method": row.method, "kind": failure_kind(row), "object": row.object, "match": row.match,
        "status": row.status, "distance": row.distance_m, "floor": row.distance_floor_m,
        "reachable": row.goal_reachable, "note": row.note, "position": row.position, "frame": row.frame,
        "photo": None if row.frame is None else photos.get((row.home, row.frame)),
    }  # fmt: skip


def _fill(data: Mapping[str, Any]) -> str:
    """The template with its data: nothing in the data can end the block that it stands in, and only our script may
    run."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for mark in "<>&\u2028\u2029":
        text = text.replace(mark, f"\\u{ord(mark):04x}")  # such marks stand only inside JSON strings
    script = (HERE / "failures.js").read_text(encoding="utf-8")
    template = (HERE / "failures.html").read_text(encoding="utf-8")
    style = re.search(r"<style>(.*?)</style>", template, re.DOTALL)
    assert style is not None
    policy = (
        f"default-src 'none'; img-src 'self' file:; script-src {_hash(script)}; style-src {_hash(style[1])}; "
        "base-uri 'none'; form-action 'none'"
    )
    parts = {"__POLICY__": policy, "__SCRIPT__": script, "__DATA__": text}
    return re.sub("|".join(parts), lambda found: parts[found[0]], template)  # in one go: data may hold a mark's name


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _jpeg(rgb: npt.NDArray[np.uint8]) -> bytes:
    from PIL import Image

    image = Image.fromarray(rgb)
    image.thumbnail((PHOTO_SIDE_PX, PHOTO_SIDE_PX))
    buffer = io.BytesIO()
    image.save(buffer, format="JPEG", quality=82)
    return buffer.getvalue()
