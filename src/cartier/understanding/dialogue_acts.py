"""Dialogue acts: whether words ask for anything, or only prohibit, judge, thank or chat.

Clauses are classified one by one, by their words. A clause that ends in a prohibition asks for nothing, unless another
clause asks outright or stated a need before; the rest of its sentence is its reason. Clauses that only refuse, judge or
chat ask for nothing either. All other words may state a need, but the objects that they name are not asked for.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from itertools import pairwise
from typing import Literal, NamedTuple

from cartier.labels import name_key, words
from cartier.understanding.text import STOP
from cartier.understanding.utterance import LONGEST_NAME, Utterance

Asked = Literal["outright", "perhaps", "not"]
Kind = Literal["forbids", "states", "asks", "padding", "tells"]

DO = frozenset(
    words("""
        approach block bring bringing carry check clean close come cook disturb do drive driving enter fetch fiddle
        fiddling find follow get give go going grab guide hand head heading lead lift light locate look looking make
        meet move navigate need open park pass pick play point prefer press push put reach roll run search see serve
        show sit stand start step stop switch take throw touch touching trouble turn use using vacuum visit wait wake
        walk want wash water where wheres
        """)
)
RUN_ON = frozenset(words("bring fetch get give go show take"))  # where speech recognition hears no comma
ROBOT = frozenset(words("nobody robot robots u you"))
TOLD_TO = ROBOT.union(words("a are better do is just may must need please pls re should so the to well"))
AROUND = frozenset(
    words("about again allowed any be bother dare even ever have need of supposed think to try want you")
)
LEADS_ON = STOP | AROUND
TELLING = frozenset(words("ask asked asks as better said says tell tells told"))  # "he told you not to go there"
OPENING = frozenset(
    words("""
        ah alright and but darling dear er first hello hey hi honestly honey just kindly listen look no now oh ok okay
        only please pls plz really robot seriously so sure uh um yeah yes
        """)
)
AFTER_NO = frozenset(words("do i never no not"))  # "no, no, don't" opens, "no touch" does not
AFTER = frozenset(
    words(
        """
        all any anymore at dear either here me moment more now please pls plz thank thanks the today tonight yet you
        """
    )
)
NO_NAME = frozenset(
    words("""
        about am are be been can ca could did do does enough for had has have he i in is it like look looks m may might
        must need never no nobody not nothing on re s said seems she should they to was we were what whoever will wo
        would you
        """)
)
WHOLE = re.compile(
    r"(?P<thing>(?:an?|my|our|that|the|your)(?: \w+){1,3}?) "
    r"(?:of (?P<of>(?:my|our|the|your) [\w ]+)|(?:s|(?:(?:that )?(?:is|lies|s|stands) )?(?:above|behind|beside|by|in"
    r"|near|next to|on|under) the) \w+(?: \w+)?)"
)
CONTRACTION = re.compile(r"\b(do|does|did|is|are|was|were|would|should|could|must|need|have|has|had|ca|wo)n ?t\b")
SENTENCE = re.compile(r"[.!?;:\n]")
BREAK = re.compile(
    rf"[^\w\s]|\b(?:but|because)\b|\band (?=(?:{'|'.join(sorted(DO))}|i|it|now|then|we|you)\b)"
    r"|(?= i (?:d|meant?|need|said|want|would)\b)"
)
KEEP_OFF = re.compile(
    r"(?:^|\b(?:you|please) )(?:get|go|keep|move|stay|steer) (?:back |far |right |well )?(?:away|clear of|off"
    r"|out of)\b(?! to\b)"
    r"|^avoid |^(?:hands )?off (?:that|the)\b|\bleave (?:\w+ ){1,4}(?:alone|be|in peace|off)$"
    r"|^leave (?:it|my|that|the|this)(?: \w+)?$"
    r"|\brefrain from\b|^(?:quit|stop) \w+ing\b|^(?:\w+ ){2,4}(?:forbidden|off limits"
    r"|taboo)(?: (?:for|that|to) you.*)?$|\bi forbid\b"
    r"|\byou (?:are|re) not allowed\b|\b(?:no one|nobody) (?:is to|may|must|should)\b"
    r"|\bnot (?:like|want) you (?:near|to)\b|\bmind not\b"
    r"|\b(?:if|prefer|rather|that) you (?:(?:did|do|would) not|keep|kept|leave|left|stay|stayed)\b"
    r"|\byou (?:do not (?:have|need)|need not)\b|^(?:there is )?no (?:bring|go|need|take|touch)\b"
)
UNLESS = re.compile(r"^(?:how|what|where|why)\b|\b(?:before|except|forget|make me|unless|until|without)\b")
TURNED_DOWN = re.compile(
    r"^(?:he|i|me|nobody|she|they|we) (?:really )?(?:(?:did|do|does|wo|would) not(?: be)?|never|no|no longer"
    r"|not) (?:really )?"
    r"(?:asked? for|care for|fancy|feel like|like|need(?:ing)?|want) (?:to (?:come|go|have|see|touch|use)\b.* )?(.+)"
    r"|^(?:enough(?: of| with)?|forget|never mind|no more|not|skip) (.+)|^no (.+) thank"
)
KIND = (
    r"(?:annoying|awful|beautiful|cheap|cute|elegant|expensive|funny|gorgeous|great|hideous|horrible|lovely|nice"
    r"|old fashioned|"
    r"pretty|ridiculous|silly|stupid|tasteless|terrible|ugly|wonderful)"
)
OPINION = re.compile(
    r"^(?:he|i|she|they|we) (?:(?:absolutely|always|am|do|is|just|m|never|really|s|so) )*(?:adores?|dislikes?"
    r"|hate[ds]?|like[ds]?"
    r"|love[ds]?|ca not (?:bear|stand)(?: the sight of)?|(?:sick|tired) of) (?:my|our|th\w+|your) (.+)"
    r"|^(?:my|our|th\w+|your) (.+?) (?:over there )?(?:are|is|looks?|s|was|were) "
    rf"(?:\w+ ){{0,3}}{KIND}$|^what an? {KIND} (.+)"
)
CHAT = re.compile(
    r"^(?:thanks|thank you|thx|cheers|well done|(?:good|happy) \w+"
    r"|(?:what an? )?\w+ (?:day|evening|weather)(?: today)?$|how are you"
    r"|who are you|(?:what s )?your name|do you (?:know that|like|love)|do me a favour|i love you|see you|goodbye|bye"
    r"|never mind"
    r"|forget (?:about|it)|as if|that s all|no more for me|(?:abort|cancel|go ahead|great|nothing(?: .*thanks)?|stay"
    r"|stop|wonderful)$"
    r"|you (?:are|look|re|were) (?!(?:needed|not|to|wanted)\b)|(?:i|we) (?:am|are|m|re) (?:fine|full|good|happy)$"
    r"|(?:i|we) (?:have|ve) had enough|(?:i|nobody|we) (?:did not |never )ask(?:ed)?"
    r"|(?:(?:i|we) (?:am|are|m|re)|it (?:is|s)) not (?:\w+ )?(?:bored|cold|dark|hot|hungry|ill|late|sick|thirsty"
    r"|tired)(?! enough))\b"
)
UNWISHED = re.compile(r"\b(?:never|no|no longer|no one|nobody|not)(?: \w+)? (?:needs?|wants?)\b")
ASKS = re.compile(
    r"\b(?:needs?|wants?|wish|fancy|find|where\w*|which|search|looking|seen|somewhere|missing|vanished|lost|after"
    r"|instead|anyone|lets?"
    r"|(?:d|should|would) (?:be|like|love|rather(?! not| you))|ha(?:s|ve) to|got to|(?:can|could|have|will|would) you"
    r"|(?:whether )?you could"
    r"|(?:can|could|may|might) (?:i|we)|(?:could|ll|should) (?:just )?(?:do|go|have|take|use)|it (?:s|was) the|it is$"
    r"|will do$"
    r"|(?:asked|meant?|said) (?:a|for|my|the)|i said (?!it|no|that)\w+|(?:mind going|not wait) to|long for|time for"
    r"|might there"
    r"|you (?:did not|forgot|never)|(?:are|is) there|(?:there (?:are|is|s)|got|ha(?:s|ve)) no)\b"
    r"|\b(?:please|pls|plz)(?: and thank you)?$"
    r"|^(?:an?|some|something|to|towards?|who|who is|you (?:bring|come|go)|why (?:do )?not) "
    r"|\bnot (?:\w+ ){1,6}without (?:an?|any|my|some|the) "
    r"|^(?:are|can|could|is|will|wo|would) (?:not )?(?:anybody|it|somebody|there|we|you)\b"
)
IN_NEED = re.compile(
    r"^(?:i|we) (?:am|are|ca not|feel|m|re)\b|^my \w+ (?:aches?|are|hurts?|is|s)\b|\bin here$|\b(?:must|ought|should)\b"
)


class DialogueAct(NamedTuple):
    """What was forbidden, in the words that forbade it, all else that was said, and whether anything was asked for.

    ``perhaps`` are words that may tell a need, but in which no clause asks.
    """

    forbidden: str
    rest: str
    asked: Asked


def sort_out(heard: Utterance, known: Container[str]) -> DialogueAct:
    """Sort the clauses of an utterance; ``known`` are the keys of the names of objects."""
    clauses = [(clause, begins, _kind(clause, known)) for clause, begins in _clauses(heard.tokens)]
    kinds = [kind for _, _, kind in clauses]
    forbidden = ", ".join(clause for clause, _, kind in clauses if kind == "forbids")
    rest = ", ".join(clause for clause, _, kind in clauses if kind != "forbids")
    outright = any(kind == "asks" and clause.split()[-1] not in words(forbidden) for clause, _, kind in clauses)
    if outright or set(kinds) <= {"padding"}:
        return DialogueAct(forbidden, rest, "outright")
    if not forbidden:
        said_please: Asked = "outright" if clauses[-1][0] == "please" else "perhaps"
        return DialogueAct("", rest, "not" if set(kinds) <= {"padding", "states"} else said_please)
    first = kinds.index("forbids")
    needs = any(kind == "tells" and IN_NEED.search(clause) for clause, _, kind in clauses[:first])
    goes_on = any(kind == "tells" and begins for _, begins, kind in clauses[first:])
    return DialogueAct(forbidden, rest, "outright" if needs else "perhaps" if goes_on else "not")


def _clauses(tokens: list[str]) -> Iterator[tuple[str, bool]]:
    """Each clause, in full forms and without its opening words, and whether it begins a sentence."""
    text = CONTRACTION.sub(r"\1 not", " ".join(t for t in tokens if t not in "-'")).replace("wanna", "want to")
    for sentence in SENTENCE.split(text.replace(", thank", " thank")):
        begins = True
        for part in BREAK.split(sentence):
            for clause in _run_on(part.split()):
                while len(clause) > 1 and clause[0] in OPENING and (clause[0] != "no" or clause[1] in AFTER_NO):
                    clause = clause[1:]
                yield " ".join(clause), begins
                begins = False


def _run_on(said: list[str]) -> Iterator[list[str]]:
    """What stands without a comma: "don't bring the cup bring the glass"."""
    starts = [i for i in range(1, len(said)) if said[i] in RUN_ON and said[i - 1] not in LEADS_ON]
    yield from (said[a:b] for a, b in pairwise([0, *starts, len(said)]) if a < b)


def _kind(clause: str, known: Container[str]) -> Kind:
    """What a clause does; ``tells`` is what cannot be known so."""
    if _forbids(clause):
        return "forbids"
    judged = TURNED_DOWN.search(clause) or OPINION.search(clause)
    what = next(filter(None, judged.groups()), "") if judged else ""
    if CHAT.search(clause) or (what and (_is_name(what, known) or STOP.issuperset(what.split()))):
        return "states"
    said = clause.split()
    tells_to = said[0] in DO and (said[1:2] != ["not"] or UNLESS.search(clause))  # "don't forget the coffee"
    if tells_to or _is_name(clause, known) or ASKS.search(UNWISHED.sub("", clause)):
        return "asks"
    return "padding" if STOP.issuperset(said) else "tells"


def _forbids(clause: str) -> bool:
    """Whether the words forbid the robot to do something: a "not" for nobody else, right before an action of robots."""
    said = clause.split()
    if UNLESS.search(clause):
        return False
    for i, word in enumerate(said[:-1]):
        after = next((w for w in said[i + 1 :] if w not in AROUND), "")
        if word not in ("not", "never") or after not in DO or said[max(i - 2, 0) : i] == ["you", "do"]:
            continue
        subject = max((k for k in range(i) if said[k] in ROBOT), default=0)
        if TOLD_TO.issuperset(said[subject:i]) or (said[i + 1] == "to" and not TELLING.isdisjoint(said[:i])):
            return True
    return bool(KEEP_OFF.search(clause))


def _is_name(said: str, known: Container[str]) -> bool:
    """Whether words only name an object, its part or its place: "that old chair, please", "the bin's lid"."""
    whole = WHOLE.fullmatch(said)
    if whole:
        return len(said.split()) <= 2 * LONGEST_NAME and _is_name(whole["of"] or whole["thing"], known)
    name = said.split()
    while name and name[-1] in AFTER:
        name.pop()
    known_end = any(name_key(" ".join(name[-n:])) in known for n in range(1, LONGEST_NAME + 1))
    return known_end and "the" not in name[1:] and len(name) <= LONGEST_NAME + 1 and NO_NAME.isdisjoint(said.split())
