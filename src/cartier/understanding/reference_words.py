"""Tables of words: colours, sizes, superlatives, ordinals, stand-ins and words of place."""

from __future__ import annotations

import re

from cartier.labels import words


def _words(text: str) -> frozenset[str]:
    return frozenset(words(text))


COLOURS = {
    "black": ("black",), "white": ("white",), "grey": ("grey",), "gray": ("grey",), "red": ("red",),
    "green": ("green",), "blue": ("blue",), "yellow": ("yellow",), "orange": ("orange",), "brown": ("brown",),
    "pink": ("pink",), "purple": ("purple",), "violet": ("purple",), "beige": ("brown", "white", "yellow"),
    "cream": ("white", "yellow"), "navy": ("blue",), "turquoise": ("blue", "green"), "golden": ("yellow", "orange"),
    "silver": ("grey", "white"), "wooden": ("brown", "orange"), "maroon": ("red", "brown"),
    "rust": ("red", "orange", "brown"), "rusty": ("red", "orange", "brown"), "gold": ("yellow", "orange"),
    "chrome": ("grey", "white"), "steel": ("grey",), "tan": ("brown", "orange"), "teal": ("blue", "green"),
    "lilac": ("purple", "pink"), "crimson": ("red",), "scarlet": ("red",), "burgundy": ("red", "brown"),
    "ivory": ("white", "yellow"), "charcoal": ("grey", "black"), "olive": ("green",), "mint": ("green",),
}  # fmt: skip
SIZES = {
    "big": "biggest", "large": "biggest", "huge": "biggest", "small": "smallest", "little": "smallest",
    "tiny": "smallest", "tall": "tallest", "high": "highest", "low": "lowest", "short": "shortest", "long": "longest",
    "bigger": "biggest", "larger": "biggest", "smaller": "smallest", "taller": "tallest", "higher": "highest",
    "lower": "lowest", "nearer": "nearest", "closer": "nearest", "farther": "farthest", "further": "farthest",
    "shorter": "shortest", "longer": "longest", "wider": "widest", "broader": "widest", "wide": "widest",
    "thicker": "biggest", "deeper": "biggest", "giant": "biggest", "enormous": "biggest", "massive": "biggest",
    "wee": "smallest", "teeny": "smallest", "mini": "smallest", "slim": "smallest", "thin": "smallest",
    "near": "nearest", "close": "nearest", "far": "farthest", "upper": "highest", "top": "highest", "bottom": "lowest",
    "left": "leftmost", "right": "rightmost",
}  # fmt: skip
MOST = {
    "biggest": "biggest", "largest": "biggest", "longest": "longest", "widest": "widest", "smallest": "smallest",
    "tiniest": "smallest", "littlest": "smallest", "tallest": "tallest", "highest": "highest", "lowest": "lowest",
    "shortest": "shortest", "nearest": "nearest", "closest": "nearest", "farthest": "farthest", "furthest": "farthest",
    "leftmost": "leftmost", "rightmost": "rightmost",
}  # fmt: skip
ORDER = {"first": 1, "second": 2, "third": 3, "fourth": 4, "former": 1, "latter": -1, "last": -1}
GENERIC = _words("""
    one ones thing things something anything it them they stuff everything object objects item items somewhere place
    spot anywhere
    """)
STANDS_FOR = _words("it them they one ones")  # what was named before
PLURAL = _words("ones things them they objects items everything")
NEEDY = _words(
    "something anything everything somewhere anywhere place spot"
)  # a need of its own follows, no word for what was said before
HURRY = re.compile(
    r"\b(?:quick|quickly|hurry|asap|immediately|urgent|urgently|fast|right away|at once|no time|whichever"
    r"|any will do|any (?:one )?of them|either|(?:don|doesn)'t (?:mind|care|matter))\b"
    r"|^(?:the )?(?:nearest|closest)(?: one)?$"
)
PLACING = _words("""
    above adjacent against alongside around at atop behind belonging below beneath beside between by carrying
    close closer closest farther farthest from front further furthest has have having holding in inside into
    left near nearby nearer nearest next of off on onto opposite outside right side to top under underneath upon
    where which with within
    """)
"""Words of relations."""
