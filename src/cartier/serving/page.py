"""Web page of a home: its data as JSON, its own files, and both in one file that opens from disk."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Iterable
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.home import Home
from cartier.home.correction_log import in_force
from cartier.home.photos import photo_of
from cartier.home.point_cloud import STEP_M, PointCloud
from cartier.navigation.planning import plan
from cartier.pipeline import plan_for
from cartier.render.extent import shown_extent
from cartier.render.floor_plan import label_cell
from cartier.serving.operations import Operations
from cartier.serving.values import crop, place_of, pose, rule_row
from cartier.spatial.relations import supports
from cartier.types import FREE, OCCUPIED, MapObject, RobotModel
from cartier.understanding.cards import SHIPPED, read_deck

WEB = Path(__file__).with_name("web")
SCRIPTS = (
    "parts.js", "data.js", "labels.js", "plan.js", "scene.js", "doubt.js", "live.js", "rules.js", "app.js",
    "corrections.js",
)  # fmt: skip
ANSWER_SCRIPTS = ("parts.js", "labels.js", "plan.js", "answer.js")
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
THUMB_PX, THUMB_QUALITY = 300, 72
UNSURE_PHOTOS = 30  # of the likeliest tentative objects, in the page as one file
HEIGHT_M = 0.05  # step of the heights of the floor plan


@cache
def files() -> dict[str, tuple[str, bytes]]:
    """The page's files by the path of their URL: media type and bytes. No other file is served."""
    names = ("index.html", "style.css", "docs.css", *SCRIPTS)
    served = {f"/{name}": (KINDS[Path(name).suffix], (WEB / name).read_bytes()) for name in names}
    return {"/": served["/index.html"]} | served


def view(home: Home) -> dict[str, Any]:
    """Floor plan, rooms, objects and route rules of a home as JSON; the cells row by row as runs of (code, count)."""
    sure = [obj for obj in home.objects if obj.confirmed]
    held = {k: r for k, r in supports(home.objects).items() if k not in {t.id for t in sure}} | dict(supports(sure))
    about: dict[str, Any] = {
        "title": home.name, "home_id": home.id, "detector": home.detector, "start": _rounded(home.start_xy),
        "extent": _rounded(shown_extent(home)),
        "notes": home.to_dict()["notes"], "corrections": len(in_force(home.corrected.log)) if home.corrected else 0,
        "objects": [_object(obj, held) for obj in home.objects], "rooms": [], "grid": None,
        "rules": [rule_row(rule, datetime.now().astimezone()) for rule in home.rules],
    }  # fmt: skip
    grid = home.grid
    if grid is not None:
        code = np.zeros(grid.cells.shape, np.int64)
        code[grid.cells == FREE], code[grid.cells == OCCUPIED] = 1, 2
        for number, room in enumerate(home.rooms):
            code[tuple(room.cells.T)] += 3 * (number + 1)
            area = round(len(room.cells) * grid.resolution_m**2, 1)
            row = {"id": room.id, "name": room.name, "kind": room.kind, "area": area}
            about["rooms"].append(row | {"at": _rounded(grid.centre(label_cell(grid, room)).tolist())})
        steps = np.round(np.clip(grid.height_m.astype(np.float32), 0, 4) / HEIGHT_M).astype(np.int64)
        about["grid"] = {
            "rows": grid.cells.shape[0], "cols": grid.cells.shape[1], "side": grid.resolution_m,
            "origin": _rounded(grid.origin_xy), "cells": _runs(code),
            "heights": _runs(np.where(grid.cells == OCCUPIED, steps, 0)), "step": HEIGHT_M,
        }  # fmt: skip
    return about


def cloud(home: Home) -> dict[str, Any] | None:
    """The point cloud: ``points`` is base64 of x, y, z (uint16, in ``step`` metres from ``low``), RGB, and widths.

    A width (uint8, in ``step`` metres) is that of a drawn point that closes the surface around it.
    """
    seen = home.cloud()
    if seen is None:
        return None
    low = seen.xyz_m.min(0)
    places, widths = np.round((seen.xyz_m - low) / STEP_M).astype("<u2"), np.round(_widths(seen) / STEP_M)
    data = places.tobytes() + seen.rgb.tobytes() + widths.clip(1, 255).astype(np.uint8).tobytes()
    about = {"count": len(seen.rgb), "low": _rounded(low), "step": STEP_M, "side": round(seen.side_m, 3)}
    return about | {"points": base64.b64encode(data).decode()}


def _widths(seen: PointCloud) -> npt.NDArray[np.float64]:
    """The widths (N,) of drawn points (m): on a lattice, the sixth neighbour is as far as its diagonal is long."""
    from scipy.spatial import cKDTree

    far = np.asarray(cKDTree(seen.xyz_m).query(seen.xyz_m, k=[min(7, len(seen.xyz_m))])[0])[:, 0]
    stray = far > 4 * seen.side_m  # with no neighbour there is no surface to close
    return np.asarray(np.where(stray, seen.side_m, np.clip(1.4 * far, 1.4 * seen.side_m, 4 * seen.side_m)))


def served_json(operations: Operations, home: str, data: Callable[[Home], dict[str, Any]]) -> bytes:
    """``data`` of a served home, with its name and age, as JSON."""
    mapped = operations.homes.get(home)
    return _json(operations.about(home, mapped) | data(mapped)).encode()


def one_file(home: Home, robot: RobotModel | None = None) -> bytes:
    """The page with a home in it: it opens from disk, and its Content-Security-Policy lets it load nothing."""
    about = view(home) | {"goals": {}, "photos": {}, "home": home.name, "uses": _uses(home), "cloud": cloud(home)}
    unsure = sorted((obj for obj in home.objects if not obj.confirmed), key=lambda obj: -obj.probability)
    shown = {obj.id for obj in [*(obj for obj in home.objects if obj.confirmed), *unsure[:UNSURE_PHOTOS]]}
    now = datetime.now().astimezone()
    rules = [rule for rule in home.rules if rule.holds(now)]
    for obj in home.objects:
        if home.grid is not None:
            place, model = place_of(obj, home), robot or RobotModel()
            goal = (plan_for(home, place, home.start_xy, model, rules).goal if rules
                    else plan(home.grid, place, home.start_xy, model)[0])  # fmt: skip
            about["goals"][obj.id] = None if goal is None else pose(goal)
        if obj.id in shown and (photo := _photo(home, obj)) is not None:
            about["photos"][obj.id] = photo
    style, script = _text("style.css"), _text(*SCRIPTS)
    policy = f"default-src 'none'; img-src data: blob:; style-src '{_sha(style)}'; script-src '{_sha(script)}'; "
    policy += "base-uri 'none'; form-action 'none'"
    html = _text("index.html")
    head, _, rest = html.partition("<!-- head -->")
    _, _, body = rest.partition("<!-- /head -->")
    body, _, _ = body.partition("<!-- scripts -->")
    data = _json(about).replace("<", "\\u003c")  # so that no text in it ends the element
    return (
        f'{head}<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{style}</style>{body}'
        f'<script type="application/json" id="home-data">{data}</script>\n<script>{script}</script>\n</body>\n</html>\n'
    ).encode()


@cache
def answer_page() -> str:
    """The page that draws one answer in a host for MCP Apps: one document, which loads nothing."""
    html, style, script = _text("answer.html"), _text("style.css"), _text(*ANSWER_SCRIPTS)
    html = html.replace("<!-- style -->", f"<style>{style}</style>")
    return html.replace("<!-- scripts -->", f"<script>{script}</script>")


def answer(operations: Operations, result: dict[str, Any]) -> dict[str, Any]:
    """The data of that page: the home, the result of an operation, and the photo of its object."""
    home = operations.homes.get(result["home"])
    obj = next((t for t in home.objects if t.id == result.get("id")), None)
    return {"view": view(home), "result": result, "photo": None if obj is None else _photo(home, obj)}


def _photo(home: Home, obj: MapObject) -> dict[str, Any] | None:
    """A small photo of an object with its box; None if the home keeps none."""
    best = next((v for v in obj.views if v.frame in home.photos), None)
    photo = None if best is None else photo_of(home, best.frame)
    if best is None or photo is None:
        return None
    jpeg, box = crop(photo, best.box_xyxy, THUMB_PX, THUMB_QUALITY)
    return {"jpeg": base64.b64encode(jpeg).decode(), "box": box}


def _text(*names: str) -> str:
    return "\n".join((WEB / name).read_text(encoding="utf-8") for name in names)


def _uses(home: Home) -> dict[str, list[str]]:
    """The uses of the confirmed objects by label: the phrases of the shipped knowledge cards."""
    deck = read_deck(SHIPPED)
    labels = sorted({obj.label for obj in home.objects if obj.confirmed})
    cards = [(label, deck.cards[k]) for label in labels if (k := deck.card_of(label)) is not None]
    return {label: [*card.synonyms, *card.uses] for label, card in cards}


def _object(obj: MapObject, held: Any) -> dict[str, Any]:
    on = held.get(obj.id)
    return {
        "id": obj.id, "label": obj.label, "names": list(obj.names), "also": [n for n, _ in obj.labels[1:4]],
        "room": obj.room, "at": _rounded(obj.position), "low": _rounded(obj.box_min), "high": _rounded(obj.box_max),
        "probability": round(obj.probability, 3), "confirmed": obj.confirmed,
        "n_detected": obj.n_detected, "n_observable": obj.n_observable, "colours": [n for n, _ in obj.colours[:3]],
        "last_s": round(obj.last_seen_s, 1), "views": len(obj.views), "said": obj.by_person,
        "on": None if on is None else [on.kind, on.object],
    }  # fmt: skip


def _runs(values: np.ndarray[Any, Any]) -> list[int]:
    """Run lengths: value, count, value, count …"""
    flat = values.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=flat[:1] - 1))
    return np.stack([flat[starts], np.diff(starts, append=flat.size)], axis=1).ravel().tolist()


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(float(v), 3) for v in values]


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _sha(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
