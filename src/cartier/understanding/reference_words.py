"""Tables and patterns for references and questions: colours, sizes, spatial relations, kinds of question."""

from __future__ import annotations

import re

from cartier.spatial.expressions import Kind

FIND: Kind = "find"


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


ARTICLES = _words("the a an my our your his her their this that these those some any another one's")
DEFINITE = _words("the my our your his her their this that these those")
FILLERS = ARTICLES | _words("""
    that which who is are s was were be it standing stands stand sitting sits sit lying lies lie placed located right
    just over there directly somewhere kept left-behind hanging hangs currently still you we i see have very down up out
    been please should must may might could would will ought be somebody someone anybody people put placed forgot keeps
    keep kept
    """)
COLOURS = {
    "black": ("black",), "white": ("white",), "grey": ("grey",), "gray": ("grey",), "red": ("red",),
    "green": ("green",), "blue": ("blue",), "yellow": ("yellow",), "orange": ("orange",), "brown": ("brown",),
    "pink": ("pink",), "purple": ("purple",), "violet": ("purple",), "beige": ("brown", "white", "yellow"),
    "cream": ("white", "yellow"), "navy": ("blue",), "turquoise": ("blue", "green"), "golden": ("yellow", "orange"),
    "silver": ("grey", "white"), "wooden": ("brown", "orange"), "maroon": ("red", "brown"),
}  # fmt: skip
SIDES = _words("top side left right front back middle bottom")  # "on top of", "the left side"
SIZES = {
    "big": "biggest", "large": "biggest", "huge": "biggest", "small": "smallest", "little": "smallest",
    "tiny": "smallest", "tall": "tallest", "high": "highest", "low": "lowest", "short": "shortest", "long": "biggest",
    "bigger": "biggest", "larger": "biggest", "smaller": "smallest", "taller": "tallest", "higher": "highest",
    "lower": "lowest", "nearer": "nearest", "closer": "nearest", "farther": "farthest", "further": "farthest",
    "shorter": "shortest", "longer": "biggest", "wider": "biggest", "broader": "biggest", "wide": "biggest",
    "thicker": "biggest", "deeper": "biggest", "giant": "biggest", "enormous": "biggest", "massive": "biggest",
    "wee": "smallest", "teeny": "smallest", "mini": "smallest", "slim": "smallest", "thin": "smallest",
    "near": "nearest", "close": "nearest", "far": "farthest", "upper": "highest", "top": "highest", "bottom": "lowest",
    "left": "leftmost", "right": "rightmost",
}  # fmt: skip
MOST = {
    "biggest": "biggest", "largest": "biggest", "longest": "biggest", "widest": "biggest", "smallest": "smallest",
    "tiniest": "smallest", "littlest": "smallest", "tallest": "tallest", "highest": "highest", "lowest": "lowest",
    "shortest": "shortest", "nearest": "nearest", "closest": "nearest", "farthest": "farthest", "furthest": "farthest",
    "leftmost": "leftmost", "rightmost": "rightmost",
}  # fmt: skip
ORDER = {"first": 1, "second": 2, "third": 3, "fourth": 4, "former": 1, "latter": 2}
GENERIC = _words("""
    one ones thing things something anything it them they stuff everything object objects item items somewhere place
    spot anywhere
    """)
STANDS_FOR = _words("it them they one ones")  # what was named before
PLURAL = _words("ones things them they objects items everything")
RELATIONS = {
    "on": "on", "on top of": "on", "top of": "on", "upon": "on", "onto": "on", "atop": "on", "off": "on",
    "from": "from", "in": "in", "inside": "in", "inside of": "in", "within": "in", "into": "in", "under": "under",
    "underneath": "under", "below": "under", "beneath": "under", "above": "above", "next to": "next to",
    "beside": "next to", "by": "next to", "alongside": "next to", "near": "near", "near to": "near", "close to": "near",
    "close by": "near", "nearby": "near", "at": "near", "against": "next to", "opposite": "near", "in front of": "near",
    "behind": "near", "around": "near", "nearest": "nearest", "nearest to": "nearest", "closest to": "nearest",
    "closest": "nearest", "farthest from": "farthest", "furthest from": "farthest", "between": "between",
    "in between": "between", "left of": "left of", "to left of": "left of", "on left of": "left of",
    "on left side of": "left of", "right of": "right of", "to right of": "right of", "on right of": "right of",
    "further from": "farthest", "farther from": "farthest", "closer to": "nearest", "nearer to": "nearest",
    "outside": "not in", "outside of": "not in", "has": "with", "have": "with", "having": "with", "holding": "with",
    "carrying": "with", "where": "with", "on which": "with", "in which": "with", "on right side of": "right of",
    "with": "with", "of": "of", "adjacent to": "next to", "belonging to": "of",
}  # fmt: skip
RELATIONS |= {f"not {words}": f"not {kind}" for words, kind in RELATIONS.items() if kind not in ("of", "not in")}
NEED = re.compile(r"\b(?:something|anything|somewhere|anywhere|(?:a|any) (?:place|spot)|someplace)\b")
CUE = re.compile(
    r"\b(?:bring|drive|fetch|find|get|give|go|going|grab|head|lead|locate|move|navigate|need|needs|pass|pick|reach"
    r"|roll|show|take|want|like|use"
    r"|point|visit|run|walk|hand|carry|choose|i mean|i meant|over to|toward|towards|prefer|look for|looking for|wheel"
    r"|guide|bringing|fetching"
    r"|approach|check|deliver|collect|have|rather|approach|park|stop|wait)\b"
)
GO_THERE = re.compile(
    r"^(?!.*\b(?:do not|not|never)\b)(?:.*\b)?(?:go|drive|take me|bring me|lead me|guide me|head|roll|stand|get|fetch"
    r"|show me|bring(?= (?:it|that|them)\b))\b.*\b(?:there|it|them|one|that)\b"
)
PUTTING = re.compile(r"\b(?:put|throw|drop|place|lay|hang|pour|toss|dump|stick|leave|chuck)\b")
NOT_THAT = re.compile(
    r"(?! not (?:in|on)\b),? \b(?:and not|but not|not|rather than|instead of"
    r"|except)(?= (?:for |on |in |at |from )?(?:the|a|an|my|that|this|those|our) )[^,.!?;\n]*"
)
NOT_FIRST = re.compile(r"^(?:no )?not ((?:the|that|my) [^,.;]+?) ?[,.;] ?(?=(?:the|that|my) )")
SOMEBODY = _words("somebody someone i we you people they")
HURRY = re.compile(
    r"\b(?:quick|quickly|hurry|asap|immediately|urgent|urgently|fast|right away|at once|no time|whichever"
    r"|any will do)\b"
)
QUESTIONS: tuple[tuple[Kind, re.Pattern[str]], ...] = (
    ("rooms", re.compile(
        r"\b(?:which|what|how many|list (?:all )?the|name the) rooms\b(?! (?:is|are|has|have|does) (?:the|my|our"
        r"|an?)\b)"
    )),
    ("count", re.compile(
        r"\b(?:how many|(?:what is|whats|what s|tell me) the number of|number of|count"
        r"|how much(?= \w+s (?:is|are|do|have)))\b"
    )),
    ("compare", re.compile(
        r"^(?=.*\b(?:or|than)\b).*\b(bigger|larger|smaller|taller|higher|lower|shorter|nearer|closer|farther|further"
        r"|longer)\b"
    )),
    ("sure", re.compile(
        r"\b(?:are you (?:really |quite |very |absolutely )?(?:sure|certain|positive)|how (?:sure|certain) are you"
        r"|how do you know)\b"
    )),
    ("which", re.compile(
        r"^which (?:one |of them |of those |of these |of the \w+ |\w+ )?(?:is|are) (?:the )?(?:bigg|small|larg|tall"
        r"|high|low|short|near|clos|far|furth|left|right)\w*\b(?!.* or )"
    )),
    ("far", re.compile(r"\bhow (?:far|many met\w+)\b")),
    ("when", re.compile(r"\bwhen (?:did|was|were|have|had) \b.*\b(?:see|saw|seen|spot|spotted|look|looked|there)\b")),
    ("colour", re.compile(r"\b(?:what|which) colou?rs? \b")),
    ("size", re.compile(r"\bhow (?:big|large|tall|high|wide|long|small) \b")),
    ("room", re.compile(r"\b(?:which|what) room\b|^(?:tell me |name )?(?:the )?room (?:that|where|in which|of)\b")),
    ("where", re.compile(
        r"\b(?:where|wheres|whereabouts)\b(?! (?:in the \w+ )?(?:should|shall"
        r"|(?:do i|do we)(?! (?:usually )?(?:keep|have|store))|can i put|could i put|to (?:put|sit|sleep|lie)"
        r"|i (?:can|could|may)|can (?:i|we) (?!find|get|see)))|\bon what (?:is|are|does)\b|\bany idea where\b"
    )),
    ("list", re.compile(
        r"\b(?:is|are) there anything\b.* what\b|\b(?:what|which)(?: (?:else|all|things|objects|stuff|items"
        r"|sort of things))?(?: is| are| s|s)? ?(?:all |else )?(?:there |standing |stands |stand |lying (?:around )?"
        r"|lies |lie |kept |placed |sitting |sits |sit |stored |to be found |to be seen )?(?:on|in|inside|under"
        r"|underneath|below|next to|beside|near|by|around|at|behind|above|beneath|between)\b"
    )),
    ("list", re.compile(r"^(?:list|enumerate)\b")),
    ("list", re.compile(
        r"^(?:all )?(?:the |your )?(?:things|stuff|items|objects|everything|contents)(?: that| which)?(?: is| are"
        r"| stands?| lies?)? (?:on|in|inside|under|of)\b"
    )),
    ("list", re.compile(
        r"\b(?:what|which)(?: (?:things|objects|items|stuff|else))? (?:do|can|did|have|does|could) (?:you|we"
        r"|i)\b.*\b(?:see|seen|saw|find|found|have|got|know|there|keep)\b|\binventory of\b"
        r"|\b(?:list|name|enumerate|tell me|show me) (?:me )?(?:all|everything|every|the things|the objects"
        r"|the contents|what)\b|\bwhat is (?:here|there)\b(?! to\b)"
    )),
    ("exists", re.compile(
        r"\b(?:(?:is|are|was|were) there|(?:would|could|might|should|will) there be)\b(?! (?:something|anything"
        r"|somewhere|anywhere) (?:to|i|we|that)\b)"
    )),
    ("exists", re.compile(
        r"^(?:do|does|have|has|did) (?:we|i|you|they|it|this \w+|the \w+|any\w*|some\w*|an? \w+|my \w+)\b.*\b(?:have"
        r"|got|own|see|seen|find|found|spot|spotted|come|put|leave|left|keep|stand|lie|a|an|any)\b"
    )),
    ("exists", re.compile(
        r"^(?:any|got any|got an?|is any|are any)\b|\bcan you see\b|^(?:if|whether)\b|^have i got\b|^am i right\b"
        r"|^(?:can|could|will|would|might) (?:i|we) (?:find|see)\b"
    )),
    ("exists", re.compile(
        r"\b(?:know|wonder|sure|remember|check|check for me|find out|tell me|like to know|ask myself|true) (?:if"
        r"|whether|that) (?:there|we|you|i|the|my|an?|any)\b|\bhappen to (?:know|see|have)\b"
    )),
    ("exists", re.compile(
        r"^(?!how|what|who|when|where|why|which)(?=.*\b(?:is it(?: not)?"
        r"|(?:is|are|do|does|have|has) not (?:it|there|we|you|they|i)|isn t it|are they|aren t they|is there(?: not)?"
        r"|isn t there|do we(?: not)?|don t we|have (?:we|you)(?: not)?|haven t (?:we|you)|has it|hasn t it|does it"
        r"|doesn t it|yes or no|is that (?:right|true|correct)|am i right)$)"
    )),
    ("exists", re.compile(
        r"^(?:is|are|was|were) (?:the|my|our|any\w*|something|nothing|one|an?|that|those|it|there|all)\b"
    )),
)  # fmt: skip
COMMANDS: tuple[tuple[Kind, re.Pattern[str]], ...] = (
    ("come", re.compile(r"^(?:please )?(?:come (?:here|over(?: here)?|to me|back to me|closer)|over here|here boy)\b")),
    ("back", re.compile(
        r"^(?:please )?(?:(?:go|drive|head|roll|move) back|return"
        r"|back)(?: please)?(?: (?:to )?(?:where you (?:were|started|came from)|the start|your (?:base|dock|place)"
        r"|home|again))?$"
    )),
    ("stop", re.compile(
        r"^(?=.*\b(?:stop|halt|freeze|wait|never ?mind|forget it|cancel|leave it|that is all|abort|changed my mind)\b)"
        r"(?:(?:stop|halt|freeze|wait|never ?mind|forget it|cancel|leave it|that is all|abort"
        r"|i(?: have| ve)? changed my mind|it|that|now|there|here|please|moving"
        r"|thanks|thank you|ah|oh|no|ok|okay|robot|a moment|a second) ?)+$"
    )),
    ("follow", re.compile(r"^(?:please )?(?:follow|come with|stay with|come along with) (?:me|us|him|her)\b")),
    ("able", re.compile(
        r"^(?:what (?:can|do) you do|what is your name|who are you|what are you|how can you help(?: me)?|help"
        r"|what are you (?:able to do|for))$"
    )),
    ("bye", re.compile(
        r"^(?:thanks |thank you |ok |okay )*(?:bye(?: bye)?|goodbye|good night|see you(?: later| soon)?"
        r"|that was all)$"
    )),
    ("thanks", re.compile(
        r"^(?:ok |okay |great |good |perfect )*(?:thanks|thank you|thank you so much|many thanks|cheers)(?: a lot"
        r"| so much| very much| robot| dear| you are .*)?$"
    )),
)  # fmt: skip
POLITE = _words("""
    please thanks thank you robot hey hi hello ok okay so well oh um uh er ah now then and but just dear no yes i mean
    """)
CONTRACTIONS = (
    (re.compile(
        r"\b(?:i guess|i think|kind of|sort of|um+|uh+|erm?|hmm+)\b|(?:^|,) ?you (?:know|see)(?= ?(?:,|$))"
    ), " "),
    (re.compile(r"\b(what|where|there|that|it|who|which|he|she|how)'?s\b"), r"\1 is"),
    (re.compile(r"\b(\w+)'re\b"), r"\1 are"),
    (re.compile(
        r"\b(?:that |which )?(?:it is|its|it s) (?:standing |sitting |lying )?(?:on|in|inside)(?= *(?:$|[.!?;\n]))"
    ), "with it"),
    (re.compile(r"n't\b|\b(?<=isn) t\b|\b(?<=aren) t\b"), " not"),
    (re.compile(r"\b(?:is|are|wa)n not\b"), "is not"),
    (re.compile(r"\bmost distant\b"), "farthest"),
    (re.compile(r"\bpieces? of furniture\b"), "thing"),
    (re.compile(r"\bwhats\b"), "what is"),
    (re.compile(r"\bwheres\b"), "where is"),
)  # fmt: skip
AROUND = _words("""
    quick quickly off right left to me us over way for at now with of on in up it i you we here there straight hurry
    then away
    """)
WHICH_IS = _words("that which is are s it over right just there standing lying sitting located")
NEEDY = _words(
    "something anything everything somewhere anywhere place spot"
)  # a need of its own follows, no word for what was said before
VERBS = _words(
    "light book water iron watch plant box table chair dish mirror vacuum park place bin cup fan screen plate switch "
    "sink"
)
UP_OR_DOWN = (["over"], ["to"], ["on"], ["off"], ["into"], ["up"], ["down"], ["away"])
OPEN_STATEMENT = re.compile(
    r"^(?:there (?:is|are)|(?:you|we|i|they) (?:have|got|have got|own|saw)"
    r"|(?:the|my|our|your) .*\b(?:is|are|has|have)\b)(?!.*\b(?:right|left)$)"
)
STATED = re.compile(r"^(?:it|that|this|there|here|they|those|these) (?:is|are|was|were)\b")
VERB_BEFORE = _words("i we you they can could should would will let lets must")
WISHING = _words("want wants need needs like love how going have got time trying used wanted")
PLACING = frozenset(word for relation in RELATIONS for word in relation.split())
BEFORE = re.compile(
    r"^(?:(?:please|hey|hi|hello|ok|okay|so|well|oh|um|uh|er|ah|now|then|and|but|robot|just|dear|excuse me|sorry|yes"
    r"|yeah|quick question|say|listen|also"
    r"|(?:can|could|would|will) you(?! see\b)(?: please| kindly)?(?: tell me| say| check| let me know)?|tell me"
    r"|do you know|do you happen to know|let me know"
    r"|i wonder|i was wondering|i would like to know|i want to know|remind me|i ask myself|by the way"
    r"|kindly)\s+)+(?=\w)"
)
AFTER = re.compile(
    r"(?:\s+(?:please|thanks|thank you|robot|now|dear|by the way|at all|anyway|again|then|here"
    r"|in this (?:home|house|flat|place)))+$"
)
LEFT = re.compile(r"\bleft (?!of\b|side\b)(?=\w)")  # "that somebody left by the sink"
SIDE = re.compile(
    r"(?:(?:on|to)(?: my| your)? (left|right)(?: side| hand side)?$"
    r"|(closest|nearest|farthest|furthest)(?: away)?(?: by)?(?: (?:to|from) (?:me|you|us|here|robot))?(?! (?:to"
    r"|from))\b|(biggest|bigger|largest|larger|smallest|smaller|tallest|taller|highest|higher|lowest|lower)\b)"
)
ENDS = re.compile(
    r"(?<=\?)|[.!;\n]+|:(?= *(?:do|does|did|is|are|have|has|how|where|what|which|who|can|could|take|bring|go|drive"
    r"|show|find|get|fetch|please)\b)"
)
WORD = re.compile(r"[^\W_]+")
