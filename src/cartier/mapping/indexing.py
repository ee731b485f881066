"""Spatial indices of a map: made by name, and filled with the objects of a home."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy

from cartier import plugins
from cartier.contracts import Encoder, IndexDefaults, SpatialIndex, optional
from cartier.errors import InputError
from cartier.types import MapObject


def make_indexes(names: Iterable[str], encoder: str | Encoder) -> dict[str, SpatialIndex]:
    """Empty indices by name; those that need an encoder get it."""
    options = {name: {"encoder": encoder} if plugins.takes("indexes", name, "encoder") else {} for name in names}
    return {name: plugins.make("indexes", name, **given) for name, given in options.items()}


def filled_indexes(
    indexes: Mapping[str, SpatialIndex], objects: Sequence[MapObject], required: bool, with_depth: bool
) -> tuple[dict[str, SpatialIndex], list[str], str | None]:
    """Copies of the indices that hold anything, notes on them, and the encoder that made image features, if any.

    Raises InputError if all are empty, or any that is ``required`` because it was asked for by name.
    """
    copies, notes, encoder = deepcopy(dict(indexes)), [], None
    for index in copies.values():
        index.set_objects(objects)
        if made_with := optional(index, IndexDefaults, "encoder"):
            encoder = made_with
            notes.append(f"image features: {made_with}")
    empty = [name for name, index in copies.items() if not index.names()]
    if empty and (required or len(empty) == len(copies)):
        why = f"of {len(objects)} possible objects none was seen often and surely enough"
        if any(obj.confirmed for obj in objects):
            why = "no detection has what it needs (object_depth needs depth in the boxes)"
        raise InputError(f"index {empty[0]} stayed empty: {why}")
    lack = "no detection had depth" if with_depth else "bearings told no distance"
    notes += [f"index {name} is left out: {lack}" for name in empty]
    return {name: index for name, index in copies.items() if name not in empty}, notes, encoder
