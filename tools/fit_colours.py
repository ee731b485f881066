"""Fits the prototypes of colour names (mapping/colours.py), and measures how often an object's first colour is right.

python tools/fit_colours.py fit 75011 75012 75013 75014 75015 75016       (generated homes; prints the prototypes)
python tools/fit_colours.py measure 75021 75022 75023 75024

Chips of the xkcd colour survey (CC0; matplotlib ships them) get the basic name that ends their name, or that of SAID.
They are lit as surfaces of the homes are and white-balanced as frames are; then prototypes of their names are fitted
(k-means, and generalised learning vector quantisation). The homes' materials take no part, only their light. Of 80 fits
the one is printed that is right most often in these homes; most are right for 90 to 94 % of the objects.

Measured over what ground-truth detections map: an object is right if its first colour is one that a person may call
what is seen of its materials without light: by the names of the dollhouse's materials, else by the nearest chips.
Mustard must be yellow. Ochre is what people call yellow as well as brown, by its chips: those take no part in the fit.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import matplotlib.colors
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import numpy.typing as npt
from command_line import Parser, run_script
from scipy.cluster.vq import kmeans2

from cartier import plugins
from cartier.detectors.ground_truth import GroundTruth
from cartier.mapping.colours import COLOURS, LEVELS, LIGHTNESS_WEIGHT, PROTOTYPES, colour_table, lab_of, table_of
from cartier.mapping.object_map import ObjectMap
from cartier.mapping.observation import lift, white_balance
from cartier.types import Array, Frame
from cartier_bench import true_home
from cartier_dollhouse import light
from cartier_dollhouse.atlas import Atlas
from cartier_dollhouse.materials import KINDS, material
from cartier_dollhouse.render import Renderer

SAID = {
    "brown": "tan beige khaki ochre sienna umber rust terracotta chocolate coffee camel mocha sepia copper bronze "
    "caramel mahogany chestnut mud dirt taupe fawn sandstone sand wheat toffee clay leather puce hazel mushroom",
    "white": "cream ivory eggshell ecru",
    "red": "maroon crimson scarlet burgundy brick cherry tomato vermillion ruby claret carmine wine",
    "yellow": "gold mustard goldenrod lemon sunflower maize buff straw custard butter banana",
    "green": "olive sage forest mint lime moss avocado pine emerald jade kelly pea leaf fern asparagus hunter spruce "
    "celery pistachio",
    "blue": "navy teal turquoise cyan aqua azure sky sapphire cerulean denim petrol indigo cobalt cornflower",
    "purple": "violet lavender lilac mauve plum eggplant aubergine grape orchid amethyst heather mulberry",
    "pink": "salmon rose magenta fuchsia blush",
    "orange": "pumpkin tangerine apricot mango",
    "grey": "gray",
}
MAY_CALL = {
    "cream": "white yellow", "dark grey": "grey black", "rust": "brown red orange", "light wood": "brown",
    "beige": "brown white yellow",
}  # fmt: skip
"""Of the names of the dollhouse's materials, those that are no basic ones."""
MAY_TOO = {"darkgoldenrod": "brown", "darkred": "brown", "brown": "red", "petrol": "green"}
MAY_TOO |= {"sage": "grey"}
PER_NAME = (2, 3, 3, 3, 3, 3, 5, 4, 4, 3, 5)  # prototypes, as COLOURS
GREYS = {"black": (40, 4, 22, 3), "grey": (60, 30, 75, 4), "white": (40, 84, 96, 5)}  # chips, L* from and to, chroma
VIVID, PALE, WHITE = 75, 7, 15  # chroma: dye and paint stay below; below, only a white chip; a white one stays below
OCHRE_DEG, OCHRE_CHROMA, OCHRE_L = (75, 100), 45, 45  # hue of, and least chroma and L* of what some call brown
LIGHTS, PER_HOME, PER_DETECTION = 20, 4000, 8  # drawn for each chip; kept of each home and of each detection
ROUNDS, RATE, STEEP = 6, 100.0, 4.0
GREY_WEIGHT = 0.6  # of chips of no hue, which are many in a small part of the space
CHIP_SPREAD, OF_MATERIAL, LEAST_VOTE = 9.0, 9.0, 0.3  # L*a*b*
MIN_PIXELS, FITS = 200, 80
SURE = GroundTruth.score_model


@dataclass
class Seen:
    """Samples of the surface of one detection: what was seen (N, 3) and without light (N, 3), and the frame's gains."""

    id: int
    rgb: npt.NDArray[np.uint8]
    unlit: npt.NDArray[np.uint8]
    gains: Array


def walk(home: str, into: ObjectMap) -> Iterator[Seen]:
    """Maps a home with ground-truth detections, and yields each with the id of its object."""
    world: Any = plugins.make("worlds", "dollhouse")
    recording = world.explore(home)
    detector = plugins.make("detectors", "ground_truth", truth=recording.truth, source=home)
    with patch.object(light, "plain", _even):
        renderer = Renderer(world.scene(home), recording.camera, light=False)
        renderer.render(np.eye(4))  # looks are made by the first picture
    for frame in recording:
        found = detector.detect(frame)
        ids = into.add(frame, found)
        unlit, gains = renderer.render(frame.world_from_camera).rgb, white_balance(frame.rgb)
        assert isinstance(frame, Frame) and frame.depth_m is not None
        if len(found.labels):
            lifted = lift(frame, frame.depth_m, found.boxes_xyxy.astype(float), found.masks)
            for k, id in enumerate(ids.tolist()):
                chosen = lifted.pixels[k][lifted.surface_mask[k]]
                yield Seen(id, frame.rgb.reshape(-1, 3)[chosen], unlit.reshape(-1, 3)[chosen], gains)


def _even(atlas: Atlas) -> npt.NDArray[np.uint32]:
    """Light 1 everywhere: a picture shows the materials alone."""
    return np.full(len(atlas.texel_nodes), light.UNIT * 0x010101, np.uint32)


def chips() -> tuple[Array, npt.NDArray[np.intp]]:
    """The survey's chips (N, 3), L*a*b*, and the numbers of their names."""
    basic = {word: name for name, words in SAID.items() for word in words.split()} | {name: name for name in COLOURS}
    named = [(basic.get(name.split()[-1], ""), code) for name, code in matplotlib.colors.XKCD_COLORS.items()]
    pairs = [(name, code) for name, code in named if name]
    lab = lab_of(np.array([matplotlib.colors.to_rgb(code) for _, code in pairs]))
    return lab, np.array([COLOURS.index(name) for name, _ in pairs])


@dataclass
class Objects:
    """What the fit and the measure need of a home: the lights on its surfaces, and its objects."""

    gains: Array
    """(N, 3): what a surface shows over what it is, after the white balance."""
    objects: list[tuple[list[str], npt.NDArray[np.intp], Array]]
    """Of each object: its right names; the balanced colours seen, as places in the table of names; their weights."""

    @classmethod
    def of(cls, home: str, called: Called) -> Objects:
        mapped, rng, gains = ObjectMap(SURE), np.random.default_rng(int(home)), []
        may = defaultdict[int, Array](lambda: np.zeros(len(COLOURS) + 1))
        weight = defaultdict[int, Counter[int]](Counter)
        for seen in walk(home, mapped):
            if not len(seen.unlit):
                continue
            may[seen.id] += [*called.may(seen.unlit).mean(0), len(seen.unlit)]
            levels = np.minimum(seen.rgb * (seen.gains * (LEVELS / 256)), LEVELS - 1).astype(np.intp)
            places, counts = np.unique(levels @ (LEVELS**2, LEVELS, 1), return_counts=True)
            weight[seen.id].update(dict(zip(places.tolist(), (counts / len(levels)).tolist(), strict=True)))
            some = rng.integers(len(seen.rgb), size=PER_DETECTION)
            rgb, unlit = seen.rgb[some], seen.unlit[some]
            fit = (unlit > 25).all(1) & (rgb < 250).all(1)  # what is black or burnt out tells no light
            gains.append(rgb[fit] * seen.gains / unlit[fit])
        mapped.merge_and_prune()
        found = []
        for obj in mapped.objects():
            *shares, pixels = may[obj.id]
            if obj.colours and pixels >= MIN_PIXELS:
                every = sum((weight[id] for id in (obj.id, *obj.aliases)), Counter[int]())
                names = [n for n, share in zip(COLOURS, shares, strict=True) if share >= 0.8 * max(shares)]
                found.append((names, np.array(list(every)), np.array(list(every.values()), float)))
        return cls(np.concatenate(gains), found)

    def told(self, table: npt.NDArray[np.integer]) -> list[tuple[list[str], str]]:
        """The right names of each object, and the one that the table of names gives it."""
        return [
            (names, COLOURS[np.bincount(table[places], weights, len(COLOURS)).argmax()])
            for names, places, weights in self.objects
        ]


def lit_swatches(homes: Sequence[Objects], rng: np.random.Generator) -> tuple[Array, npt.NDArray[np.intp]]:
    """L*a*b* (N, 3) of chips under the homes' lights after the white balance, and the numbers of their names."""
    lights = np.concatenate([home.gains[rng.integers(len(home.gains), size=PER_HOME)] for home in homes])
    lab, names = chips()
    chroma, hue = np.hypot(lab[:, 1], lab[:, 2]), np.degrees(np.arctan2(lab[:, 2], lab[:, 1]))
    ochre = (names == COLOURS.index("brown")) & (OCHRE_DEG[0] < hue) & (hue < OCHRE_DEG[1])
    ochre &= (chroma > OCHRE_CHROMA) & (lab[:, 0] > OCHRE_L)
    white = names == COLOURS.index("white")
    fit = ~ochre & (chroma < VIVID) & ~np.isin(names, [COLOURS.index("black"), COLOURS.index("grey")])
    fit &= np.where(white, chroma <= WHITE, chroma >= PALE)
    labs, numbers = [lab[fit]], [names[fit]]
    for name, (count, low, high, most) in GREYS.items():
        turn, far = rng.uniform(0, 2 * np.pi, count), most * np.sqrt(rng.random(count))
        labs.append(np.stack([rng.uniform(low, high, count), far * np.cos(turn), far * np.sin(turn)], 1))
        numbers.append(np.full(count, COLOURS.index(name)))
    srgb = srgb_of(np.concatenate(labs))
    lit = np.clip(srgb[:, None] * lights[rng.integers(len(lights), size=(len(srgb), LIGHTS))], 0, 1)
    return lab_of(lit.reshape(-1, 3)), np.repeat(np.concatenate(numbers), LIGHTS)


def srgb_of(lab: Array) -> Array:
    """sRGB values (N, 3) of L*a*b* (N, 3), clipped to 0 to 1."""
    y = (lab[:, 0] + 16) / 116
    f = np.stack([y + lab[:, 1] / 500, y, y - lab[:, 2] / 200], 1)
    xyz = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29)) * (0.9505, 1.0, 1.089)
    back = np.linalg.inv(np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T)
    linear = np.clip(xyz @ back, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def prototypes(lab: Array, names: npt.NDArray[np.intp], rng: np.random.Generator) -> dict[str, list[tuple[int, ...]]]:
    """GLVQ from k-means: of each swatch the nearest prototype of its name comes nearer, that of another goes away."""
    scale = np.array((LIGHTNESS_WEIGHT, 1, 1))
    points = lab * scale
    begun = [_means(points[names == number], count) for number, count in enumerate(PER_NAME)]
    at, of = np.concatenate(begun), np.repeat(np.arange(len(COLOURS)), PER_NAME)
    weight = (1 / np.bincount(names)[names]) * np.where(names < 3, GREY_WEIGHT, 1)
    weight /= weight.max()
    for turn in range(ROUNDS):
        for some in np.array_split(rng.permutation(len(points)), len(points) // 200):
            x, far = points[some], np.square(points[some, None] - at).sum(-1)
            own = of == names[some, None]
            i, j = np.where(own, far, np.inf).argmin(1), np.where(own, np.inf, far).argmin(1)
            near, other = far[np.arange(len(x)), i], far[np.arange(len(x)), j]
            both = near + other + 1e-9
            sure = 1 / (1 + np.exp(-STEEP * (near - other) / both))
            step = RATE * 0.6**turn * STEEP * sure * (1 - sure) * weight[some] / both**2
            np.add.at(at, i, (step * other)[:, None] * (x - at[i]))
            np.add.at(at, j, -(step * near)[:, None] * (x - at[j]))
    whole = np.rint(at / scale).astype(int)
    return {name: [tuple(map(int, p)) for p in whole[of == number]] for number, name in enumerate(COLOURS)}


def _means(points: Array, count: int) -> Array:
    tries = [kmeans2(points, count, seed=seed, minit="++") for seed in range(5)]
    return np.asarray(min(tries, key=lambda found: float(np.square(points - found[0][found[1]]).sum()))[0])


class Called:
    """What a person may call a material: one of the dollhouse's own names, else the survey's nearest chips."""

    def __init__(self) -> None:
        self._chips, self._names = chips()
        labs, may = [], []
        for name, tints in true_home.COLOURS.items():
            for tint in tints:
                texture = material(tint if tint in KINDS else f"plastic:{tint}").texture
                words = f"{MAY_CALL.get(name, name)} {MAY_TOO.get(tint, '')}".split()
                labs.append(texture.reshape(-1, 3).mean(0) / 255)
                may.append([colour in words for colour in COLOURS])
        self._labs, self._may = lab_of(np.array(labs)), np.array(may)

    def may(self, rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
        """(N, 11) of RGB values (N, 3)."""
        codes, back = np.unique(rgb // 4 * 4 + 2, axis=0, return_inverse=True)
        lab = lab_of(codes / 255)
        far = np.linalg.norm((lab[:, None] - self._labs) * (0.5, 1, 1), axis=-1)
        result = self._may[far.argmin(1)]
        for k in np.flatnonzero(far.min(1) > OF_MATERIAL):
            weight = np.exp(-np.square(lab[k] - self._chips).sum(1) / 2 / CHIP_SPREAD**2)
            votes = np.bincount(self._names, weight, len(COLOURS)) / max(weight.sum(), 1e-300)
            result[k] = votes >= min(LEAST_VOTE, votes.max())
        return np.asarray(result[back.ravel()])


def measure(homes: Sequence[Objects]) -> None:
    told = [(" or ".join(true), name) for home in homes for true, name in home.told(colour_table())]
    right = sum(name in true.split() for true, name in told)
    print(f"first colour right: {right} of {len(told)} mapped objects, {right / len(told):.1%}")
    for (true, name), count in Counter(told).most_common():
        print(f"  {true:28} told {name:8}{count:4}{'' if name in true.split() else '  wrong'}")


def fit(homes: Sequence[Objects]) -> None:
    best, most = dict[str, list[tuple[int, ...]]](), -1
    for seed in range(FITS):
        rng = np.random.default_rng(seed)
        found = prototypes(*lit_swatches(homes, rng), rng)
        table = table_of(found)
        right = sum(name in true for home in homes for true, name in home.told(table))
        if right > most:
            best, most = found, right
    print(f"right: {most} of {sum(len(home.objects) for home in homes)} objects")
    for name, labs in best.items():
        print(f"{name:8}{labs}{'' if tuple(labs) == PROTOTYPES[name] else '   now ' + str(PROTOTYPES[name])}")


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument(
        "what",
        metavar="what",
        choices=("fit", "measure"),
        help="fit the prototypes, or measure how often they are right",
    )
    parser.add_argument("homes", nargs="+", help="generated homes, by number")
    options = parser.parse_args()
    called = Called()
    homes = [Objects.of(home, called) for home in options.homes]
    (measure if options.what == "measure" else fit)(homes)


if __name__ == "__main__":
    run_script(main)
