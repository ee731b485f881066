"""Measures what views of further sides give: how large objects appear in the kept photographs, and from how many sides.

python benchmarks/look_views.py studio family_flat --maps maps                   (the built-in homes by default)
python benchmarks/look_views.py studio --maps maps --detector ground_truth

Each home is mapped once. "best" counts the views that are kept by score and size together and their photographs,
"all" those of further sides, too. Sides differ by 30 degrees or more.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from command_line import Parser, run_script

from cartier.home import Home
from cartier.types import MapObject, View
from cartier.vision.verification import doubts
from cartier.vision.views import MIN_APPARENT_PX, SAME_SIDE_RAD, apparent_px
from cartier_bench.maps import Maps, MapSettings, encoder_for
from cartier_dollhouse.scene import homes

KEPT: dict[str, Callable[[MapObject], Sequence[View]]] = {
    "best": lambda obj: obj.views, "all": lambda obj: obj.all_views,
}  # fmt: skip


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("homes", nargs="*", help="homes of the dollhouse")
    parser.add_argument("--maps", type=Path, required=True, help="the folder of mapped homes")
    parser.add_argument("--detector", default="embedded", help="the detector of the maps (default: embedded)")
    given = parser.parse_args()
    maps = Maps(given.maps, MapSettings("dollhouse", given.detector, encoder_for(given.detector)), ("object_depth",))
    print(f"{'objects':10} {'kept':5} {'number':>6} {'at least 64 px':>15} {'sides':>6} {'photographs':>12} {'MB':>6}")
    mapped = [maps.get(name) for name in given.homes or homes()]
    for kind, of in ASKED.items():
        for kept, views in KEPT.items():
            found = [_seen(home, obj, views(obj)) for home in mapped for obj in of(home)]
            frames = [_frames(home, views) for home in mapped]
            megabytes = sum(len(home.photos[f]) for home, some in zip(mapped, frames, strict=True) for f in some) / 1e6
            large = sum(pixels >= MIN_APPARENT_PX for pixels, _ in found) / max(1, len(found))
            sides = sum(count for _, count in found) / max(1, len(found))
            print(
                f"{kind:10} {kept:5} {len(found):6} {large:15.1%} {sides:6.2f} {sum(map(len, frames)):12} "
                f"{megabytes:6.1f}"
            )


def _confirmed(home: Home) -> list[MapObject]:
    return [obj for obj in home.objects if obj.confirmed]


def _doubtful(home: Home) -> list[MapObject]:
    return doubts(home.objects)


ASKED: dict[str, Callable[[Home], list[MapObject]]] = {"confirmed": _confirmed, "doubtful": _doubtful}


def _seen(home: Home, obj: MapObject, views: Sequence[View]) -> tuple[float, int]:
    """The largest apparent size (px) in photographs of a home, and how many sides are large enough."""
    size = home.camera.width, home.camera.height
    stored = [view for view in views if view.frame in home.photos]
    large = [view for view in stored if apparent_px(view, size) >= MIN_APPARENT_PX]
    return max((apparent_px(view, size) for view in stored), default=0.0), _sides(large)


def _sides(views: Sequence[View]) -> int:
    """From how many sides views show an object."""
    yaws: list[float] = []
    for view in views:
        if all(abs(math.remainder(view.yaw - yaw, math.tau)) >= SAME_SIDE_RAD for yaw in yaws):
            yaws.append(view.yaw)
    return len(yaws)


def _frames(home: Home, views: Callable[[MapObject], Sequence[View]]) -> set[int]:
    """The photographs of a home that show these views of its confirmed objects, and the best one of the others."""
    return {
        view.frame for obj in home.objects for view in (views(obj) if obj.confirmed else obj.views[:1])
        if view.frame in home.photos
    }  # fmt: skip


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parent))
    run_script(main)
