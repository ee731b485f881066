"""Templated requests with their marks, for coverage of relations, measures and acts; at most half of what is trained on.

A frame holds ``{X}`` for a target phrase, ``{t}`` for its bare name, ``{ts}`` for its plural, and so on; the marks come
with them.
"""

from __future__ import annotations

import re
from random import Random

from cartier.evaluation.things_made import plural
from cartier.understanding.cards import SHIPPED, read_deck
from cartier.understanding.entity_vocabulary import ROOMS
from cartier.understanding.reference_words import COLOURS

NAMES = sorted(
    {name for card in read_deck(SHIPPED).cards for name in card.names if re.fullmatch(r"[a-z ]{3,18}", name)}
)
PLACES = """table bed sofa couch desk shelf counter sink fridge window door wardrobe cupboard chair armchair bathtub toilet
    stove oven tv television lamp plant dresser sideboard bench stool radiator mirror carpet rug fireplace washing machine
    bookcase bedside table coffee table dining table worktop microwave heater basket bin painting front door""".split(
    "\n"
)
PLACES = sorted({p for p in re.split(r"\s+", " ".join(PLACES)) if p not in ("", "front", "washing", "dining")} | {
    "bedside table", "coffee table", "dining table", "washing machine", "front door", "book shelf", "kitchen table",
})  # fmt: skip
ROOM_NAMES = sorted({*ROOMS, *(name for more in ROOMS.values() for name in more)})
SAY = {
    "on": "on|on top of|upon|up on|sitting on|standing on|lying on|atop",
    "in": "in|inside|inside of|within",
    "under": "under|underneath|beneath|below",
    "above": "above|over|hanging over",
    "next": "next to|beside|by|right by|right next to|alongside|at the side of",
    "near": "near|close to|not far from|around|somewhere near|over by",
    "left": "to the left of|left of|on the left of|on the left side of",
    "right": "to the right of|right of|on the right of|on the right side of",
    "nearest": "closest to|nearest to|nearest|nearer to",
    "farthest": "farthest from|furthest from|furthest away from",
    "behind": "behind|at the back of",
    "front": "in front of|opposite",
}
"""Wordings of the relations."""
NOT = {
    "on": "not on|not lying on|isn't on|aren't on", "under": "not under|isn't under",
    "in": "not in|outside|outside of|not inside|isn't in|aren't in|that isn't in", "next": "not next to|not by|isn't by",
    "near": "not near|nowhere near", "with": "without|with no", "behind": "not behind",
}
MOST = """leftmost rightmost biggest largest smallest tiniest tallest highest lowest longest shortest nearest closest farthest furthest
    widest""".split()
SIZES = "big small large little tiny tall huge short long wee massive low high".split()
MORE = {"bigger": "", "larger": "", "smaller": "", "taller": "", "higher": "", "longer": "", "shorter": "", "lower": ""}
FRAMES: dict[str, str] = {
    "go": """go to {X}|take me to {X}|bring me {X}|fetch {X}|get me {X} please|could you drive over to {X}|i need {X}
i want {X}|i'd like {X}|show me {X}|where's {X}, go there|head for {X}|{X}|{X}, please|drive to {X} now|find {X} for me
can you find me {X}|would you mind going to {X}|go and wait at {X}|roll over to {X}, would you|look for {X}|navigate to {X}
i am looking for {X}|i'm after {X}|over to {X}|off you go to {X}|get over to {X} quickly|turn on {X}|turn off {X}|switch {X} off|open {X}|water {X}|close {X}|clean {X}|put this on {X}|the [red:c] [one:t] of the {Xs}
the [{S1}:s] of the {ts}|{t}. [on:on] the {l}|the {t} that has a [{N}:l] [on it:with]|the [{S1}:s] {t} in the [{R1}:r]|come on, {X}|{X}, not the [{C}:n] one|the {t} that is [{C}:c]|the {t} that isn't [{C}:n]|the {t}, not the {n}
the {t} on the [left:s]|the {t} on the [right:s], please|not the {n}, {X}|not the [{C}:n] {t}, the {c} [one:t]
pass me {X}|{X} please|{X}|{X} quick
{X} now|the [{S1}:s] [{N}:t]|[{S1}:s] [{N}:t] please|go to the [{S1}:s] [{N}:t]|[{S1}:s] [{N}:t]|the [{N}:t] [{S1}:s] to me
the [one:t] {W}|take me to the [one:t] {W}|the {c} [one:t] please|hand me {X}|i can't find {X}, take me there|meet me at {X}|lead me to {X}|i was hoping you could get {X}|it's {X} i want
what i need is {X}|the thing i want is {X}|park yourself at {X}|check on {X}|have a look at {X}|i'd rather have {X}
please approach {X}|grab {X}|pick up {X}|let's go to {X}|i have to get to {X}|point me to {X}|i could do with {X}
there should be {X} somewhere, bring it|you know {X}? bring it here|give me {X}|use {X}|i'll take {X}""",
    "room": """go to the {R}|drive to the {R}|{R} please|into the {R} with you|take me to the {R}|wait in the {R}
i want to go to the {R}|off to the {R}|let's go to the {R}|move to the {R}|head over to the {R}|be in the {R} when i come""",
    "count": """how many {Xs} are there|how many {Xs} do we have|how many {Xs} have you seen|count {Xs}|count {Xs} for me
what's the number of {Xs}|how many {Xs}|how many {Xs} did you see|tell me how many {Xs} there are|do you know how many {Xs} we own
how many {ts} are not [{C}:n]|how many [{C}:c] {ts} are {W}|how many {ts} are {W}|how many {ts} stand {W}|how many {ts} have we got {W}|{W}, how many {ts} are there
i wonder how many {ts} there are {W}|the number of {ts} {W}, please""",
    "exists": """is there {aX}|are there any {Xs}|do we have {aX}|have you seen {aX}|have we got any {Xs}|is {X} there
is there {at} {W}|are there {ts} {W}|is the {t} {W}|do i still have {aX}|did you see {aX} anywhere|any {Xs} here
can you see {aX}|is the {t} still {W}|i wonder whether there is {aX}|tell me if there's {at} {W}
there's {aX}, isn't there|we don't have {aX}, do we|would there be {aX} around|i forgot if we have {aX}
do you know if there are any {Xs}|has somebody put {at} {W}|there is no {t} {W}, or is there""",
    "where": """where is {X}|where's {X}|where are {Xs}|where did i put {X}|where can i find {X}|do you know where {X} is
have you any idea where {X} is|which room is {X} in|what room is {X} in|where do we keep {Xs}|whereabouts is {X}
tell me where {X} is|in which room is {X}|on what does {X} stand|where was {X} again|where have you seen {X}""",
    "list": """what is {W}|what's {W}|what's all {W}|what do you see {W}|what stuff is {W}|list everything {W}|what things are {W}
what is there {W}|tell me what is {W}|name all the things {W}|show me all that is {W}|list the {ts}|list all {ts}|which {ts} are {W}|which [things:t] are [{C}:c]|what do you see|what else is {W}|which objects are {W}
what have you found {W}|what's lying around {W}|i'd like to know what's {W}|what's kept {W}|give me a list of what is {W}""",
    "compare": """which is {m} {X} or {Y}|what's {m} {X} or {Y}|whats {m} {t} or [{N}:b]|which is {m} the {t} or the [{N}:b]|which is {m}, {X} or {Y}|is {X} {m} than {Y}|is {X} or {Y} {m}|what is {m}, {X} or {Y}|{X} or {Y}, which is {m}
tell me which one is {m}: {X} or {Y}|would you say {X} is {m} than {Y}|which of the two is {m}, {X} or {Y}""",
    "nearer": """which is closer to the {l}, {X} or {Y}|what's nearer to the {l}: {X} or {Y}|is {X} closer to the {l} than {Y}
is {X} or {Y} nearer to the {l}|which is [farther from:farthest] the {l}, {X} or {Y}|what is [closer to:nearest] the {l}, {X} or {Y}""",
    "far": """how far is {X}|how far is {X} from {Y}|how far is it from {X} to {Y}|how many metres is {X} from {Y}
what's the distance between {X} and {Y}|how far away is {X}""",
    "colour": "what colour is {X}|which colour does {X} have|what color is {X}|tell me the colour of {X}",
    "size": "how big is {X}|how tall is {X}|how wide is {X}|what size is {X}|how large is {X}|how high is {X}",
    "when": "when did you see {X} last|when was {X} last seen|when did you last look at {X}",
    "which": "which {t} is the {S}|which is the {S} {t}|which of the {ts} is {S}|which one is the {S} {t}",
    "rooms": "which rooms are there|what rooms do we have|how many rooms does this flat have|name the rooms|list all rooms",
    "sure": "are you sure|are you certain about that|how do you know|really? are you sure|how sure are you of that",
    "prohibit": """don't bring me {X}|don't go to {X}|never touch {X}|leave {X} alone|keep away from {X}|stay away from {X}
no {t} for me, thank you|i don't want {X}|no more {ts} please|hands off {X}|you must not go near {X}|forget {X}
don't you dare touch {X}|please do not fetch {X}|i don't need {X} any more|not {X}, thanks|stay out of the {R}
do not enter the {R}|you needn't bring {X}|nobody asked for {X}|enough {ts} for today|keep out of the {R}""",
    "remark": """i bought {X} last year|{X} is lovely|i love {X}|my mother had {aX} like that|he said bring me {X}
yesterday i was looking for {X}|she told me to go to {X}|i used to have {aX}|{X} was expensive|we moved {X} last week
last night you brought me {X}|{X} is too heavy for me|what a nice {t}|i've got {X} already|they said: take {X}
grandpa always asked for {X}|i was in the {R} this morning|once i dropped {X}|{X} looks awful|i had {aX} at breakfast
the {R} is a mess|the cat sleeps {W}|i remember {X} well|my sister hates {X}|somebody sat on {X}""",
    "other": """what's the weather like|tell me a joke|how old are you|what time is it|sing a song|who won the match
how do you feel|what is two plus two|do you like me|call my brother|is the {t} clean|is {X} switched on|how much is {aX}
wo ist die Kaffeemaschine|donde esta la mesa|apporte-moi le livre|play some music|what day is it|is {X} broken
hello robot|good morning|nice to meet you|how are you today|what is {X} made of|who owns {X}""",
    "come": "come here|come to me|come over here please|over here|come back to me|come closer|come over",
    "back": "go back|drive back|go back where you were|return|go back to your place|back again please|go home",
    "follow": "follow me|come with me|stay with me|please follow me around|come along with me",
    "stop": "stop|halt|wait|never mind|forget it|cancel that|i changed my mind|leave it|stop moving|abort|no stop",
    "able": "what can you do|help|who are you|what are you able to do|how can you help me|what are you for",
    "thanks": "thanks|thank you|thank you so much|cheers|many thanks|great, thanks|thanks robot|ta very much",
    "bye": "bye|goodbye|good night|see you later|that was all, bye|see you",
}
"""Frames of each act, separated by ``|`` or line ends; ``room`` and ``nearer`` are forms of ``go`` and ``compare``."""
ALTERNATIVE = re.compile(r"[|\n]")
REPLIES: dict[str, str] = {
    "another": """the other one|another one|no, the other one|not that one|a different one|the other {t}|another {t} please
no not this one|is there another one? that one|i meant the other {t}|some other {t}|take the other|the other|next one
no, wrong one|no that's not it|not it|that's the wrong {t}|show me a different {t}|try another""",
    "correct": """no, the one {W}|no, the {c} one|i meant the {c} one|i mean the one {W}|not that, the {S} one|no, {X}
sorry, i meant {X}|actually {X}|the {c} one i said|no no, {X}|not the {n}, {X}|wrong, the {t} {W}|the {S} one|rather {X}|and the {S} one?|the {S} one|the {c} one|{W}|hmm the {c} one
no, not the {n}, the {t}|i said {X}|that is the {n}, i wanted {X}|and not the {n} but {X}|the one {W} i mean
no, in the {R}|the {c} {t}, not the {n}""",
    "choose": """the first|the first one|the second one please|the {c} one|the one {W}|in the {R}|the {R} one|either|the {S} one
whichever is closer|any of them|the latter|the {t} {W}|you choose|the one {W} please|{W}|the nearest|the {S}""",
    "confirm": "yes|yes please|yeah go on|sure|ok do that|exactly|right|yes that one|please do|that's it|go ahead",
    "deny": "no|no thanks|nope|no, leave it|neither|none of them|no don't|rather not|not now",
    "go": "show me|bring {p} here|take me to {p}|go to the {t} next to [it:l]|the {t} [beside:next] [it:l]|take me to the [one:t] {W}|go {p}|take me {p}|bring {p}|ok go {p}|drive {p} please|fetch {p}|get {p} for me|show me {p}|lead me {p}",
    "where": "where is {p}|and where is {p}|which room is {p} in|where exactly is {p}",
    "count": "how many of {p} are there|how many are {W}|and how many {ts}|how many are there",
    "colour": "what colour is {p}|and what colour is {p}",
    "size": "how big is {p}|how tall is {p}",
    "list": "what else is {W}|what's [next to:next] [it:l]|what is [on:on] [it:l]|and what's [under:under] [it:l]",
    "far": "how far is {p}|is {p} far|how far away is {p}",
    "exists": "is there another|is there one {W}|and {at}?|is there one in the {R}",
}
"""Frames of replies, which go on with a conversation."""
ASIDES = """so much work today|i'm dead on my feet|since the {n0} broke|my sister's coming|the {n0} is a mess, but never mind
after all that with the {n0}|you know how it is|i was just at the {n0}|the kids left the {n0} in the {r0} again
it's been a long day|my back is killing me|while i hold the {n0}|i've looked under the {n0} already|don't laugh
the doctor told me so|before the guests come|because the {n0} was dirty|i'm sitting on the {n0}|sorry to bother you
as my mother used to say|it's raining again|i spilled coffee on the {n0}|the {n0} can wait|i know i asked before
i have no time|somebody moved the {n0}|i just came from the {r0}|and i'm in a hurry|once the {n0} is done""".split("\n")
ASIDES = [aside for row in ASIDES for aside in row.split("|")]
OPENINGS = "hey|hi robot|ok|so|well|um|please|listen|oh|alright|er|excuse me|robot|dear|right|look|say|yes|uh".split(
    "|"
)
ENDS = "please|thanks|would you|if you can|quick|now|dear|will you|thank you|pretty please|ok|mate|love".split("|")


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
            else:
                act, words = self._one()
                made.append(f"{act} ? :: {self._dressed(words, act)}")
        return made

    def _one(self, only: tuple[str, ...] = ()) -> tuple[str, str]:
        often = ["go"] * 16 + ["count", "exists", "where", "list", "compare", "compare"] * 3 + ["prohibit", "remark"] * 2
        act = self.rng.choice(only or (*often, *FRAMES))
        words = self._filled(self.rng.choice(ALTERNATIVE.split(FRAMES[act])))
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

    def _conversation(self) -> list[str]:
        first, words = self._one(("go", "go", "go", "where", "exists", "count"))
        act = self.rng.choice(["another", "correct", "correct", "choose", *REPLIES])
        reply = self._filled(self.rng.choice(ALTERNATIVE.split(REPLIES[act])))
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
        makers = {
            "{X}": lambda: self._target(), "{Y}": lambda: self._target("b"), "{aX}": lambda: self._target(article="a"),
            "{Xs}": lambda: self._target(many=True), "{W}": self._where, "{R}": lambda: f"[{self._room()}:r]",
            "{t}": lambda: f"[{rng.choice(NAMES)}:t]", "{at}": lambda: self._a(rng.choice(NAMES)),
            "{ts}": lambda: f"[{plural(rng.choice(NAMES))}:t]", "{l}": lambda: f"[{rng.choice(PLACES)}:l]",
            "{n}": lambda: f"[{rng.choice(NAMES)}:n]", "{c}": lambda: f"[{rng.choice(list(COLOURS))}:c]",
            "{S}": lambda: f"[{rng.choice(MOST + SIZES)}:s]", "{m}": lambda: f"[{rng.choice(list(MORE))}:s]",
            "{S1}": lambda: rng.choice(MOST + SIZES), "{N}": lambda: rng.choice(NAMES),
            "{R1}": self._room, "{C}": lambda: rng.choice(list(COLOURS)),
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
            return f"[{rng.choice(NOT[relation].split('|'))}:!{relation}] the {what}"
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
        told = (
            f"[{rng.choice(SAY[relation].split('|'))}:{relation}] {rng.choice(['the', 'the', 'my', 'our'])} {adjective}"
        )
        told += f"[{landmark}:l]"
        if rng.random() < 0.1:
            more = rng.choice(["by", "near", "next to", "under", "on"])
            role = {"by": "next", "next to": "next"}.get(more, more)
            told += f" [{more}:{role}] the [{rng.choice(PLACES)}:m]"
        elif rng.random() < 0.1:
            told += f" in the [{self._room()}:r]"
        return told
