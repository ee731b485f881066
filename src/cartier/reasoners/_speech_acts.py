"""Whether words ask for anything: prohibitions, opinions and thanks are understood, but they are no needs.

Clause by clause. Words that end in a prohibition ask for nothing, unless another clause asks outright or told a need before;
what else its sentence says is its reason. Without a prohibition, words ask for nothing only if every clause of them turns a
thing down, says what somebody thinks of it or that nothing is lacking, or is chat.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from itertools import pairwise
from typing import Literal, NamedTuple

from cartier.reasoners._listening import LONGEST_NAME, PAST, Heard
from cartier.reasoners._words import STOP, name_key, words

Kind = Literal["forbids", "states", "name", "asks", "padding", "tells"]

DO = frozenset(
    words("""approach block bring bringing carry clean close come cook disturb do drive driving enter fetch fiddle fiddling follow
    get give go going grab lift make move open park pick play press push put reach run serve show sit start step switch take
    throw touch touching turn use using vacuum visit wait wake wash water""")
)
ROBOT = frozenset(("you", "u", "robot", "nobody"))
TOLD_TO = ROBOT.union(words("a are better do is just may must need please pls re should so the to well"))  # "you must not"
AROUND = frozenset(words("about again allowed any be bother dare even ever have need of supposed think to try want you"))
TOLD = frozenset(words("ask asked asks as better said says tell tells told"))  # "he told you not to go there"
OPENING = frozenset(
    words("""ah alright and but darling dear er hello hey hi honestly honey just kindly listen look no now oh ok okay please
    pls plz really robot seriously so sure uh um yeah yes""")
)
AFTER = frozenset(words("all any anymore at dear either here me moment more now please thank thanks the today tonight yet you"))
POINTING = frozenset(words("anything it one that them there these this those"))
CONTRACTION = re.compile(r"\b(do|does|did|is|are|was|were|would|should|could|must|need|have|has|had|ca|wo)n ?t\b")
SENTENCE = re.compile(r"[.!?;:\n]")
BREAK = re.compile(rf"[^\w\s]|\b(?:but|because)\b|\band (?=(?:{'|'.join(sorted(DO))}|i|it|now|then|we|you)\b)|(?= i (?:d|meant?|need|said|want|would)\b)")
KEEP_OFF = re.compile(
    r"(?:^|\b(?:you|please) )(?:stay|keep|steer|move|go|get) (?:back |far |right |well )?(?:away|clear of|off|out of)\b(?! to\b)"
    r"|^avoid |\bhands off\b|\bleave (?:\w+ ){1,4}(?:alone|be|in peace)$|\brefrain from\b|^(?:stop|quit) \w+ing\b"
    r"|^(?:\w+ ){2,4}(?:off limits|forbidden)(?: (?:for|that|to) you.*)?$|\byou (?:are|re) not allowed\b"
    r"|\b(?:if|rather|prefer|that) you (?:(?:did|do|would) not|stay|leave|keep)\b|\byou (?:do not (?:have|need)|need not)\b"
    r"|^(?:there is )?no (?:bring|go|need|take|touch)\b|\bnot (?:like|want) you to\b|^(?:nobody|no one) (?:is to|may|must|should)\b"
)
UNLESS = re.compile(r"^(?:why|where|what|how)\b|\b(?:until|without|unless|before|except|forget|make me)\b")
KIND = (
    r"(?:annoying|awful|beautiful|cheap|cute|elegant|expensive|funny|gorgeous|great|hideous|horrible|lovely|nice|old fashioned|"
    r"pretty|ridiculous|silly|stupid|tasteless|terrible|ugly|wonderful)"
)
OF_A_THING = re.compile(
    r"^(?:i|we|nobody|he|she|they) (?:really )?(?:do not|does not|did not|would not|no longer|never|no|not) (?:really )?"
    r"(?:need|want|like|fancy|feel like|care for|asked? for) (?:to (?:come|go|have|see|touch|use)\b.* )?(.+)|^(?:not|never mind|forget|skip|leave) (.+)"
    r"|^no (.+) thank|^(?:i|we|he|she|they) (?:must|should) not (?:drink|eat|have|use) (.+)"
    r"|^(?:i|we|he|she|they) (?:absolutely |always |just |never |really |so )?(?:adores?|ca not stand|dislikes?"
    r"|(?:am |m |is |s |are |re )?(?:sick|tired) of|hate[ds]?|love[ds]?|like[ds]?) (?:the|th\w+|my|your|our) (.+)"
    rf"|^(?:the|th\w+|my|your|our) (.+?) (?:over there )?(?:is|are|s|was|were|looks?) (?:\w+ ){{0,3}}{KIND}$|^what an? {KIND} (.+)"
)
CHAT = re.compile(
    rf"^(?:thanks|thank you|thx|cheers|(?:good|happy) \w+|well done|(?:what an? )?{KIND} (?:day|evening|job|weather|work)|how are you|"
    r"(?:what s your|your) name|who are you|do you (?:like|love)|i love you|see you|goodbye|bye|never mind|forget (?:it|about)|as if|(?:i|we) (?:have|ve) had enough|no more for me|that s all"
    rf"|(?:abort|cancel|go ahead|stay|stop|nothing|nothing .*thanks|{KIND})$|you (?:are|re|were|look|did)(?! (?:needed|not|to|wanted))"
    r"|(?:i|we) (?:am|m|are|re) (?:fine|full|good|happy)$|(?:i|we|nobody) (?:never |did not )ask(?:ed)?"
    r"|(?:(?:i|we) (?:am|m|are|re)|it (?:is|s)) not (?:\w+ )?(?:bored|cold|dark|hot|hungry|ill|late|sick|thirsty|tired)(?! enough))\b"
)
LONG_AGO = re.compile(r"\b(?:ate|bought|gave|met|painted|played|read|saw|sold|used to|visited|watched|went)\b")
ASKS = re.compile(
    r"\b(?:needs?|wants?|wish|where|fancy|(?:would|d) (?:like|love|rather(?! not| you))|ha(?:ve|s) to|got to|lets?|(?:can|could|will|would) you"
    r"|(?:can|could|may) (?:i|we)|could (?:use|do)|instead|said|asked|meant?|time for)\b|\bplease$|^(?:an?|some|something|to) "
)
IN_NEED = re.compile(r"^(?:i|we) (?:am|m|are|re|feel|ca not)\b|^my \w+ (?:is|s|are|hurts?|aches?)\b|\bin here$")
REPORTED = re.compile(
    r"^(?!i |we |you )(?:(?:the|my|our|his|her) )?\w+ (?:says|said|thinks|(?:tells?|told) (?:me|us)) (?:that )?"
    r"(?=(?:he|i|it|she|that|the|they|we|you)\b)"
)
SAID_TWICE = frozenset(("do", "i", "never", "no", "not"))  # "no, no, don't"
RUN_ON = frozenset(words("bring fetch get give go show take"))  # where speech recognition hears no comma
REASON = re.compile(r"^(?:it|they|that|this|he|she|there)\b")


class Said(NamedTuple):
    """What was forbidden, in the words that forbade it, all else that was said, and whether anything was asked for."""

    forbidden: str
    rest: str
    asks: bool


def sort_out(heard: Heard, known: Container[str]) -> Said:
    """Sort the clauses of what was said; ``known`` are the keys of the names of things."""
    clauses = [(clause, begins, _kind(clause, known)) for clause, begins in _clauses(heard.tokens)]
    kinds = [k for c, begins, k in clauses if k != "padding" and (k != "tells" or begins or not REASON.search(c))]
    forbidden = ", ".join(clause for clause, _, kind in clauses if kind == "forbids")
    rest = ", ".join(clause for clause, _, kind in clauses if kind != "forbids")
    if "asks" in kinds or any(kind == "name" and clause.split()[-1] not in words(forbidden) for clause, _, kind in clauses):
        return Said(forbidden, rest, True)
    if not forbidden:
        return Said("", rest, not kinds or set(kinds) != {"states"})
    first = [kind for _, _, kind in clauses].index("forbids")
    told = any(kind == "tells" and IN_NEED.search(clause) for clause, _, kind in clauses[:first])
    goes_on = any(kind == "tells" and begins and not REASON.search(clause) for clause, begins, kind in clauses[first:])
    return Said(forbidden, rest, told or goes_on)


def _clauses(tokens: list[str]) -> Iterator[tuple[str, bool]]:
    """Each clause, in full forms and without its opening words, and whether it begins a sentence."""
    text = CONTRACTION.sub(r"\1 not", " ".join(t for t in tokens if t not in "-'")).replace("wanna", "want to")
    for sentence in SENTENCE.split(text.replace(", thank", " thank")):
        begins = True
        for part in BREAK.split(sentence):
            for clause in _run_on(REPORTED.sub("", " ".join(part.split())).split()):
                while len(clause) > 1 and clause[0] in OPENING and (clause[0] != "no" or clause[1] in SAID_TWICE):
                    clause = clause[1:]
                yield " ".join(clause), begins
                begins = False


def _run_on(said: list[str]) -> Iterator[list[str]]:
    """What stands without a comma: "don't bring the cup bring the glass"."""
    starts = [i for i in range(1, len(said)) if said[i] in RUN_ON and said[i - 1] not in STOP | AROUND]
    yield from (said[a:b] for a, b in pairwise([0, *starts, len(said)]) if a < b)


def _kind(clause: str, known: Container[str]) -> Kind:
    """What a clause does; ``tells`` is what cannot be known so."""
    if _forbids(clause):
        return "forbids"
    if CHAT.search(clause) or _judges(clause, known) or (PAST.search(clause) and LONG_AGO.search(clause)):
        return "states"
    if _is_name(clause, known):
        return "name"
    if ASKS.search(clause) or clause.split()[0] in DO:
        return "asks"
    return "padding" if STOP.issuperset(clause.split()) else "tells"


def _forbids(clause: str) -> bool:
    """Whether the robot is told not to do something: a "not", of nobody else, right before what robots do."""
    said = clause.split()
    if UNLESS.search(clause):
        return False
    for i, word in enumerate(said[:-1]):
        after = next((w for w in said[i + 1 :] if w not in AROUND), "")
        if word not in ("not", "never") or after not in DO or said[max(i - 2, 0) : i] == ["you", "do"]:
            continue
        subject = max((k for k in range(i) if said[k] in ROBOT), default=0)
        if TOLD_TO.issuperset(said[subject:i]) or (said[i + 1] == "to" and not TOLD.isdisjoint(said[:i])):
            return True
    return bool(KEEP_OFF.search(clause))


def _judges(clause: str, known: Container[str]) -> bool:
    """Whether a clause turns a thing down, or says what somebody thinks of it."""
    found = OF_A_THING.search(clause)
    what = next(filter(None, found.groups()), "") if found else ""
    return _is_name(what, known) or (bool(what) and (POINTING | AFTER).issuperset(what.split()))


def _is_name(said: str, known: Container[str]) -> bool:
    """Whether words are no more than the name of a thing: "that old chair here, please"."""
    name = said.split()
    while name and name[-1] in AFTER:
        name.pop()
    sizes = range(max(1, len(name) - 3), min(LONGEST_NAME, len(name)) + 1)
    return "the" not in name[1:] and any(name_key(" ".join(name[-n:])) in known for n in sizes)
