"""Templated requests with their marks, for coverage of relations, measures and acts; at most half of what is learnt.

The frames stand in templates.toml; the marks come with what is filled in.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from random import Random

from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.entity_vocabulary import ROOMS
from cartier.understanding.reference_words import COLOURS
from cartier.understanding.tags import ROUTE_NOUNS
from cartier_bench.things_made import plural

NAMES = sorted(
    {name for card in read_deck(SHIPPED).cards for name in card.names if re.fullmatch(r"[a-z ]{3,18}", name)}
)
ROOM_NAMES = sorted({*ROOMS, *(name for more in ROOMS.values() for name in more)})
TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
PLACES, MOST, SIZES, MORE = (TABLES[key] for key in ("places", "most", "sizes", "more"))
ASIDES, OPENINGS, ENDS = (TABLES[key] for key in ("asides", "openings", "ends"))
SAY, NOT, FRAMES, REPLIES, ROUTES, RULES = (
    TABLES[key] for key in ("say", "not", "frames", "replies", "routes", "rules")
)
GERUNDS = {
    "avoid": "avoiding", "bypass": "bypassing", "call": "calling", "come": "coming", "crawl": "crawling",
    "creep": "creeping", "dodge": "dodging", "drive": "driving", "ease": "easing", "give": "giving", "glide": "gliding",
    "go": "going", "inch": "inching", "keep": "keeping", "leave": "leaving", "make": "making", "pass": "passing",
    "pop": "popping", "roll": "rolling", "skirt": "skirting", "slow": "slowing", "stay": "staying", "steer": "steering",
    "stick": "sticking", "stop": "stopping", "swing": "swinging", "take": "taking", "tiptoe": "tiptoeing",
    "tread": "treading", "use": "using",
}  # fmt: skip
BIDS = (
    "please", "would you", "could you", "you're to", "i want you to", "i need you to", "i'd like you to",
    "make sure you", "see that you", "remember to", "be a dear and", "be so good as to", "kindly", "and mind you",
    "you will", "you must", "you'd better", "you should", "try to", "if you can", "if you would",
    "if you wouldn't mind", "maybe", "do", "i'd be glad if you'd", "i'd ask you to", "let me ask you to",
    "tell him to", "robot,", "now then,", "from here",
)  # fmt: skip
"""Before a frame that begins with a verb."""


class Templates:
    """Marked texts by chance."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)

    def lines(self, count: int) -> list[str]:
        """``ACT ? :: words`` lines, some of them conversations of two turns."""
        made: list[str] = []
        while len(made) < count:
            draw = self.rng.random()
            if draw < 0.2:
                made += self._conversation()
            elif draw < 0.27:
                made.append(self._sequence())
            elif draw < 0.41:
                made.append(self._routed())
            else:
                act, words = self._one()
                made.append(f"{act} ? :: {self._dressed(words, act)}")
        return made

    def _one(self, only: tuple[str, ...] = ()) -> tuple[str, str]:
        often = (
            ["go"] * 16 + ["count", "exists", "where", "list", "compare", "compare"] * 3 + ["prohibit", "remark"] * 2
        )
        act = self.rng.choice(only or (*often, *FRAMES))
        words = self._filled(self.rng.choice(FRAMES[act]))
        return {"room": "go", "nearer": "compare"}.get(act, act), words

    def _sequence(self) -> str:
        (a, one), (b, two) = self._one(("go",)), self._one(("go", "go", "count", "exists", "where"))
        if b == "go" and self.rng.random() < 0.5:
            two = self._target()
        then = self.rng.choice(
            ["and then", "then", "and after that", "and afterwards", "after that", "and also", "and", "next", "; then",
             ", then", ". then", "plus", "on the way back", "and when you're done"]
        )  # fmt: skip
        return f"{a} ? / {b} ? :: {self._dressed(f'{one} [{then}:/] {two}', a)}".replace("[, ", "[").replace("[. ", "[")

    def _routed(self) -> str:
        """A route rule alone, one taken back, or a goal with how to drive there."""
        rng, kind = self.rng, self.rng.random()
        if kind < 0.4:
            act = "rule" if kind < 0.28 else "lift"
            words, when = self._filled(rng.choice(FRAMES[act])), f"[{rng.choice(ROUTES['times'])}:vt]"
            if act == "rule" and rng.random() < 0.35:
                words = f"{when}{rng.choice([' ', ', '])}{words}" if rng.random() < 0.5 else f"{words} {when}"
            return f"{act} ? :: {self._dressed(words, act)}"
        if kind < 0.7:
            words = self._filled(rng.choice(ROUTES["ways"]))
            words = f"{rng.choice(['', '', 'go to ', 'bring me ', 'take me to ', 'drive to '])}{words}"
        else:
            goal, way = self._one(("go",))[1], self._filled(rng.choice(FRAMES["rule"]))
            words = f"{goal}{rng.choice(ROUTES['joins'])}{way}" if rng.random() < 0.8 else f"{way}. {goal}"
        return f"go ? :: {self._dressed(words, 'go')}"

    def routed(self, count: int, wants: Sequence[str] = ()) -> list[str]:
        """Lines about the way: rules alone, beside a goal, beside one of ``wants``, taken back, or only told of.

        A line of ``wants`` is a request that names nothing.
        """
        return [self._route_line(wants) for _ in range(count)]

    def _route_line(self, wants: Sequence[str]) -> str:
        rng, kind = self.rng, self.rng.random()
        if kind < 0.05:
            return f"remark ? :: {self._dressed(self._filled(rng.choice(RULES['told'])), 'remark')}"
        if kind < 0.17:
            return f"lift ? :: {self._reasoned(self._filled(rng.choice(RULES['lift'])))}"
        rule = self._rule()
        if rng.random() < 0.12:
            rule = f"{rule}{rng.choice([' and ', ', and ', ', ', '. ', ' but '])}{self._rule()}"
        if kind < 0.5:
            if rng.random() < 0.3:
                when = f"[{rng.choice(ROUTES['times'])}:vt]"
                rule = f"{when}{rng.choice([' ', ', '])}{rule}" if rng.random() < 0.5 else f"{rule} {when}"
            return f"rule ? :: {self._reasoned(rule)}"
        act, goal = "go", self._one(("go",))[1] if rng.random() < 0.6 else self._target()
        if kind > 0.82 and wants:
            act, goal = "need", rng.choice(wants).rstrip(".!?")
        join = rng.choice(ROUTES["joins"])
        told = (
            f"{goal}{join}{rule}" if rng.random() < 0.75 else f"{rule}{rng.choice(['. ', ', ', ' and ', '; '])}{goal}"
        )
        return f"{act} ? :: {self._reasoned(told)}"

    def _rule(self) -> str:
        """A route rule of any kind, as an order, a wish or a gerund."""
        frame = self.rng.choice(RULES[self.rng.choice([*ROUTE_NOUNS, "vh"])])
        verb, _, rest = frame.partition(" ")
        if verb in GERUNDS and self.rng.random() < 0.3:
            frame = f"{self.rng.choice(BIDS)} {frame}"
        elif verb in GERUNDS and self.rng.random() < 0.2:
            frame = f"{GERUNDS[verb]} {rest}"
        return self._filled(frame)

    def _reasoned(self, words: str) -> str:
        """With a reason before or after, sometimes; dressed as other lines."""
        rng = self.rng
        if rng.random() < 0.5:
            reason = rng.choice(RULES["reasons"])
            mark = rng.choice([", ", ". ", " ", "; ", ", because ", ", since ", " because ", ", you see "])
            words = (
                f"{reason}{rng.choice([', ', '. ', ', so ', ' so '])}{words}"
                if rng.random() < 0.5
                else (f"{words}{mark}{reason}")
            )
        return self._dressed(words, "rule")

    def _way(self, role: str) -> str:
        """What a route rule is about: a kind of floor, a room or an object."""
        rng, kind = self.rng, self.rng.random()
        floor = {"va": 0.45, "vp": 0.7, "vo": 0.4, "vv": 0.05}.get(role, 0.05)
        if kind < floor:
            return f"the [{rng.choice(ROUTES['floors'])}:{role}]"
        if kind < floor + (0.35 if role in ("va", "vo", "vv") else 0.1):
            return f"the [{self._room()}:{role}]"
        name = rng.choice(PLACES) if rng.random() < 0.6 else rng.choice(NAMES)
        colour = f"[{rng.choice(list(COLOURS))}:c] " if rng.random() < 0.1 else ""
        told = f"{rng.choice(['the', 'the', 'the', 'my', 'that', 'our'])} {colour}[{name}:{role}]"
        return f"{told} {self._where()}" if rng.random() < 0.15 else told

    def _conversation(self) -> list[str]:
        first, words = self._one(("go", "go", "go", "where", "exists", "count"))
        act = self.rng.choice(["another", "correct", "correct", "choose", *REPLIES])
        reply = self._filled(self.rng.choice(REPLIES[act]))
        asked = []
        if act in ("choose", "confirm", "deny"):
            name = self.rng.choice(NAMES)
            asked = [f"? Which {name}: the one in the {self._room()} or the one on the {self.rng.choice(PLACES)}?"]
            asked = asked if act == "choose" else [f"? Shall I go to the {name}?"]
        short = reply if self.rng.random() < 0.6 else self._dressed(reply, act)
        return [f"~ {first} ? :: {words}", *asked, f"+ {act} ? :: {short}"]

    def _dressed(self, words: str, act: str) -> str:
        """With an opening, an aside before or after, and an end, sometimes."""
        rng = self.rng
        if rng.random() < 0.3:
            words = f"{rng.choice(OPENINGS)}{rng.choice([', ', ' '])}{words}"
        if rng.random() < 0.15:
            words = f"{words}{rng.choice([', ', ' '])}{rng.choice(ENDS)}"
        if rng.random() < 0.4:
            aside = rng.choice(ASIDES).format(n0=rng.choice(NAMES), r0=self._room())
            mark = rng.choice([". ", ", ", " ", "... "])
            words = f"{aside}{mark}{words}" if rng.random() < 0.7 else f"{words}{mark}{aside}"
        if act in ("count", "exists", "where", "list", "compare", "far") and rng.random() < 0.5:
            words += "?"
        return words if rng.random() < 0.7 else words[:1].upper() + words[1:] + rng.choice([".", "", "!"])

    def _filled(self, frame: str) -> str:
        rng, filled = self.rng, frame
        makers: dict[str, Callable[[], str]] = {
            "{X}": lambda: self._target(), "{Y}": lambda: self._target("b"), "{aX}": lambda: self._target(article="a"),
            "{Xs}": lambda: self._target(many=True), "{W}": self._where, "{R}": lambda: f"[{self._room()}:r]",
            "{t}": lambda: f"[{rng.choice(NAMES)}:t]", "{at}": lambda: self._a(rng.choice(NAMES)),
            "{ts}": lambda: f"[{plural(rng.choice(NAMES))}:t]", "{l}": lambda: f"[{rng.choice(PLACES)}:l]",
            "{n}": lambda: f"[{rng.choice(NAMES)}:n]", "{c}": lambda: f"[{rng.choice(list(COLOURS))}:c]",
            "{S}": lambda: f"[{rng.choice(MOST + SIZES)}:s]", "{m}": lambda: f"[{rng.choice(MORE)}:s]",
            "{S1}": lambda: rng.choice(MOST + SIZES), "{N}": lambda: rng.choice(NAMES),
            "{R1}": self._room, "{C}": lambda: rng.choice(list(COLOURS)),
            "{vh}": lambda: f"the [{rng.choice(ROUTES['short'])}:vh]",
            "{vhn}": lambda: f"[{rng.choice(ROUTES['short'])}:vh]",
            **{f"{{{role}}}": partial(self._way, role) for role in ROUTE_NOUNS},
            "{p}": lambda: f"[{rng.choice(['it', 'it', 'that', 'them', 'there', 'this'])}:p]",
        }  # fmt: skip
        for mark, make in makers.items():
            while mark in filled:
                filled = filled.replace(mark, make(), 1)
        if " [on the " in filled:
            return filled
        return filled.replace("closer to the", "[closer to:nearest] the").replace(
            "nearer to the", "[nearer to:nearest] the"
        )

    def _room(self) -> str:
        return self.rng.choice(ROOM_NAMES)

    def _a(self, name: str) -> str:
        return f"{'an' if name[0] in 'aeiou' else 'a'} [{name}:t]"

    def _target(self, role: str = "t", article: str = "the", many: bool = False) -> str:
        """A noun phrase with attributes and a place, as often as not."""
        rng, name = self.rng, self.rng.choice(NAMES)
        before: list[str] = []
        kind = rng.random()
        if kind < 0.18:
            before.append(f"[{rng.choice(list(COLOURS))}:c]")
        elif kind < 0.3 and not many:
            before.append(f"[{rng.choice(MOST + SIZES)}:s]")
        elif kind < 0.34:
            before.append(f"[{rng.choice(['other', 'other', 'different'])}:x]")
        elif kind < 0.38 and not many:
            before.append(f"[{rng.choice(['first', 'second', 'third'])}:o]")
        elif kind < 0.44 and role == "t":
            before.append(f"[{self._room()}:r]")
        said = f"[{plural(name) if many else name}:{role}]"
        which = article if article == "a" else rng.choice(["the", "the", "the", "my", "that", "our", "your"])
        which = "" if many and rng.random() < 0.6 else which
        phrase = " ".join([*([which] if which else []), *before, said])
        if article == "a" and re.match(r"a \[[aeiou]", phrase):
            phrase = "an" + phrase[1:]
        if role == "t" and rng.random() < 0.5:
            phrase = (
                f"{phrase} {rng.choice(['', '', 'that is ', 'that stands ', 'which is ', 'lying '])}{self._where()}"
            )
        if role == "t" and rng.random() < 0.06:
            phrase = f"{phrase}, the [{rng.choice(list(COLOURS))}:c] [one:t]"
        return phrase

    def _where(self) -> str:
        """A relation to a landmark, or a room."""
        rng, kind = self.rng, self.rng.random()
        if kind < 0.25:
            return f"[{rng.choice(['in', 'in', 'inside', 'from'])}:in] the [{self._room()}:r]"
        if kind < 0.35:
            relation = rng.choice(list(NOT))
            what = f"[{self._room()}:r]" if relation == "in" else f"[{rng.choice(PLACES)}:l]"
            return f"[{rng.choice(NOT[relation])}:!{relation}] the {what}"
        if kind < 0.42:
            one, two = rng.sample(PLACES, 2)
            return f"[{rng.choice(['between', 'in between'])}:between] the [{one}:l] and the [{two}:l]"
        if kind < 0.47:
            how = rng.choice(["with", "with", "that has", "holding", "carrying"])
            return f"[{how}:with] the [{rng.choice(NAMES)}:l]{rng.choice([' on it', ' in it', '', ' on top'])}"
        relation = rng.choice(list(SAY))
        landmark = rng.choice(PLACES) if rng.random() < 0.6 else rng.choice(NAMES)
        adjective = f"[{rng.choice(list(COLOURS) + SIZES)}:c] " if rng.random() < 0.1 else ""
        adjective = re.sub(rf"\[({'|'.join(SIZES)}):c\]", r"[\1:s]", adjective)
        told = f"[{rng.choice(SAY[relation])}:{relation}] {rng.choice(['the', 'the', 'my', 'our'])} {adjective}"
        told += f"[{landmark}:l]"
        if rng.random() < 0.1:
            more = rng.choice(["by", "near", "next to", "under", "on"])
            role = {"by": "next", "next to": "next"}.get(more, more)
            told += f" [{more}:{role}] the [{rng.choice(PLACES)}:m]"
        elif rng.random() < 0.1:
            told += f" in the [{self._room()}:r]"
        return told
