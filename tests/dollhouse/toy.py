"""Two rooms and simple shapes, so that the laws of scenes do not depend on the catalogue."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cartier.errors import InputError
from cartier_dollhouse import shapes
from cartier_dollhouse.mesh import slab
from cartier_dollhouse.model import Shape, Surface

SIZES = {"Block": (0.1, 0.1, 0.1), "Table": (1.2, 0.8, 0.75), "Chair": (0.45, 0.45, 0.9), "Rack": (0.8, 0.4, 1.8),
         "Picture": (0.6, 0.02, 0.5), "Lamp": (0.4, 0.4, 0.3), "Rug": (2.0, 1.5, 0.02)}  # fmt: skip
STANDS = {"Block": "surface", "Picture": "wall", "Lamp": "ceiling"}


def build(type: str, size: tuple | None = None, colour: str | None = None, variant: int = 0) -> Shape:
    if type not in SIZES:
        raise InputError(f"unknown type {type!r}")
    w, d, h = size or SIZES[type]
    top = Surface("top", h, (-w / 2, -d / 2), (w / 2, d / 2))
    leg = 0.4 if type == "Chair" else h
    legs = [slab(0.04, 0.04, 0, leg, "oak", x * (w / 2 - 0.02), y * (d / 2 - 0.02)) for x in (-1, 1) for y in (-1, 1)]
    if type == "Table":
        return Shape((slab(w, d, h - 0.04, h, colour or "oak"), *legs), (top,))
    if type == "Chair":
        return Shape((slab(w, d, 0.4, 0.45, "oak"), slab(w, 0.04, 0.45, h, "oak", 0, d / 2 - 0.02), *legs))
    if type == "Rack":
        shelves = [Surface(f"shelf {i}", 0.5 * i + 0.02, top.low_xy, top.high_xy, 0.4) for i in (0, 1)]
        return Shape((slab(w, d, 0, 0.02, "oak"), slab(w, d, 0.5, 0.52, "oak"), *legs), tuple(shelves))
    return Shape((slab(w, d, 0, h, "oak"),), (top,) if type in ("Block", "Rug") else ())


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "build", build)
    monkeypatch.setattr(shapes, "info", lambda type: SimpleNamespace(stands=STANDS.get(type, "floor")))


HEAD = """\
name: toy
start: [0.5, 0.5]
rooms:
  - {name: big, kind: living room, box: [0, 0, 4, 3], floor: oak, walls: "paint:cream"}
  - {name: small, kind: bathroom, box: [4.1, 0, 6, 2], floor: "tiles:white", walls: "tiles:blue"}
doors:
  - {between: [big, small], at: 1.0, width: 0.9}
windows:
  - {room: big, side: north, at: 2.0, width: 1.2}
front_door: {room: big, side: south, at: 1.5}
"""


def home(*things: str, head: str = HEAD) -> str:
    """A home's text; each thing is one line of YAML, the first in line 12 where the head is the usual one."""
    return head + "things:\n" + "".join(f"  - {thing}\n" for thing in things) if things else head
