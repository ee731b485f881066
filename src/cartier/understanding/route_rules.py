"""Route rules from words: the clauses whose nouns the parser marks as what the way is to avoid, pass and so on.

Kind and noun come from the parser (``assembly.routed`` resolves the noun as any other); strength and how long a rule
holds from small tables of words.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from cartier.labels import name_key, plain, singular, words
from cartier.spatial.expressions import EntityVocabulary, ReferringExpression
from cartier.spatial.query import DOORS, Scene
from cartier.types import Selection
from cartier.types.route_rules import RouteRule, RouteTarget, RuleKind, Strength, echo
from cartier.understanding.assembly import routed
from cartier.understanding.dialogue_state import ASKING, DialogueState, same
from cartier.understanding.rule_scope import STANDING, scope_of
from cartier.understanding.tags import ROUTE_NOUNS, ROUTING, Clause, Span
from cartier.understanding.utterance import ENDS

KIND_OF: dict[str, RuleKind] = {
    "va": "avoid", "vk": "keep-away", "vs": "slow-near", "vp": "prefer", "vo": "only-through", "vv": "via",
}  # fmt: skip
FLOOR_WORDS = {
    "tiles": "tile tiling ceramic stone lino linoleum",
    "planks": "plank planking board floorboard parquet laminate wood woodwork hardwood timber",
    "carpet": "carpet carpeting moquette",
    "rug": "rug mat doormat runner",
}
FLOOR_OF = {word: kind for kind, said in FLOOR_WORDS.items() for word in said.split()}
ADJECTIVES = {"tiled": "tiles", "wooden": "planks", "carpeted": "carpet", "laminated": "planks"}
"""Before "floor", "part", "bit"."""
SOFT = re.compile(
    r"\b(rather|sooner|just as soon|prefer\w*|preferabl[ye]|ideally|better|possible|possibly|try|maybe|perhaps|wish"
    r"|fancy|nicer|best|where alternatives|minimi[sz]e|as (?:far|much|little) as|a (?:little|bit|touch|kindness)"
    r"|suggest|(?:if|when|where|wherever|whenever) (?:you|ye|it|there|that) (?:can|could|is|s|may|might|works|suits"
    r"|goes|would|wouldn|have|feels|doesn|makes no)"
    r"|if (?:it|its|it s|that s|that) (?:isn|not|no|all the same|cool|not too)"
    r"|(?:glad|grateful|obliged|kind|nice|magic|lovely|fine|good enough) (?:if|of you)"
    r"|(?:be|were) (?:kind|nice|fine|magic|lovely)"
    r"|(?:i|we) (?:should|would|d) (?:like|be|ask|take)|mean a lot|please me|no odds|free choice|being equal)\b"
)
HARD = re.compile(r"\b(never|must|have to|has to|not allowed|forbid\w*|forbidden|whatever you do|absolutely|only|always"
                  r"|under no|strictly|nothing but)\b")  # fmt: skip
YES = re.compile(
    r"(?:oh |well |ok |okay )*(?:yes|yeah|yep|yup|sure|ok|okay|go|do|please do|fine|alright|all right|of course"
    r"|go ahead|go on|do it|go anyway|drive|by all means)"
    r"(?: (?:please|then|go|do|it|ahead|on|anyway|thanks?|that is fine|that s fine|drive|all the same))*"
)
NO = re.compile(r"(?:oh |well )*(?:no|nope|nah|don t|do not|stop|leave it|never|better not|rather not)\b.*")
ABOUT = "That is about how I drive, but what am I to keep off, pass or use: which room, floor or object?"
GO_ANYWAY = "Shall I go all the same?"
"""How the robot's question ends when a rule stands in the way."""
NEAR_WORDS = 12
TO, TO_WORDS = ("until", "till", "til", "to"), 4
WISHES = ("if", "when", "where", "wherever", "preferably", "ideally")
"""Words after a comma that still go with the noun before it."""


class Driving(NamedTuple):
    """What one clause says of the way: rules for it, and what is taken back."""

    rules: tuple[RouteRule, ...] = ()
    lifts: tuple[RouteRule, ...] = ()

    @property
    def unknown(self) -> tuple[RouteRule, ...]:
        """The rules about what the home does not have."""
        return tuple(r for r in (*self.rules, *self.lifts) if r.target is not None and r.target.kind == "none")


def says_how(clause: Clause) -> bool:
    """Whether a clause says how to drive."""
    return clause.act in ROUTING or any(span.role in (*ROUTE_NOUNS, "vh") for span in clause.spans)


def driving(
    clause: Clause,
    names: EntityVocabulary,
    scene: Scene,
    state: DialogueState,
    said: str = "",
    standing: Sequence[RouteRule] = (),
) -> Driving:
    """The typed rules of a clause; ``said`` is the sentence that they are kept with.

    The zones that the ``standing`` rules name are known by those names.
    """
    found = list[RouteRule]()
    nouns = routed(clause, names)
    marked = sorted([span for span, _ in nouns] + [s for s in clause.spans if s.role == "vh"], key=lambda s: s.start)
    of = {span.start: noun for span, noun in nouns}
    for span in marked:
        strength, scope = _strength(span, clause, marked), _scope(span, clause, marked, state)
        if span.role == "vh":
            found.append(RouteRule("shortest", None, strength, scope, said))
        else:
            target = _zone_of(span, clause, standing) or target_of(of[span.start], names, scene, state)
            found.append(RouteRule(KIND_OF[span.role], target, strength, scope, said))
    rules = tuple(dict.fromkeys(found))
    return Driving(lifts=rules) if clause.act == "lift" else Driving(rules)


def target_of(noun: ReferringExpression, names: EntityVocabulary, scene: Scene, state: DialogueState) -> RouteTarget:
    """What a noun means for a route: a room, a kind of floor, all objects that it may mean, a door, or nothing."""
    if noun.generic and noun.bare and state.last is not None:  # "don't drive over it"
        noun = same(state.last)
    said = noun.said or "that"
    if numbers := noun.rooms or (_rooms_called(said, names) if noun.bare else ()):
        # a way goes through rooms: here "the bathroom" is not the toilet
        rooms = tuple(scene.rooms[number].name for number in numbers)
        very = tuple(name for name in rooms if name_key(name) == name_key(said))  # not "bedroom 2" for "the bedroom"
        return RouteTarget("room", very or rooms, said=said)
    doors = scene.doors(noun)
    if doors and not scene.meant(noun)[0]:
        pairs = (scene.rooms[number].name for door in doors for number in door.rooms)
        return RouteTarget("door", tuple(pairs), said=_with_places(noun))
    floor = _floor(noun)
    if floor and noun.bare:
        return RouteTarget("floor", (floor,), said=said)
    objects = scene.meant(noun)[0] if not noun.generic or not noun.bare else []
    if objects:
        return RouteTarget("object", ids=tuple(sorted(obj.id for obj in objects)), said=_with_places(noun))
    if floor:
        return RouteTarget("floor", (floor,), said=said)
    return RouteTarget("none", (said,))


def _rooms_called(said: str, names: EntityVocabulary) -> tuple[int, ...]:
    """The rooms of a name; for somebody's bedroom the only one, if nobody's is known."""
    rooms = names.rooms.get(name_key(said), ())
    only = names.rooms.get(name_key(said.rpartition("'s ")[2]), ()) if "'s " in said and not rooms else ()
    return rooms or (only if len(only) == 1 else ())


def _zone_of(span: Span, clause: Clause, standing: Sequence[RouteRule]) -> RouteTarget | None:
    """The zone that a rule has named, if the words around a noun are its name: "the play corner"."""
    for rule in standing:
        if rule.target is None or rule.target.kind != "zone" or not rule.target.names:
            continue
        name = tuple(words(plain(rule.target.names[0])))
        for k in range(len(clause.tokens) - len(name) + 1):
            if clause.tokens[k : k + len(name)] == name and k < span.end and span.start < k + len(name):
                return replace(rule.target, said=" ".join(name))
    return None


def _with_places(noun: ReferringExpression) -> str:
    """The noun with what is said of it, for the echo: "red chair in the kitchen"."""
    told = [*noun.colours[:1], noun.said]
    for relation in noun.relations:
        if relation.target is not None and not relation.target.generic:
            told.append(f"{relation.kind} the {relation.target.said}")
    return " ".join(told)


def _floor(noun: ReferringExpression) -> str:
    """The kind of floor that a noun names, or "": "parquet", "the wooden floor", "bath mat"."""
    said = [singular(word) for word in words(noun.said)]
    if not said or name_key(noun.said) in DOORS:
        return ""
    if said[-1] in ("floor", "flooring", "part", "bit"):
        return next(
            (ADJECTIVES.get(w) or FLOOR_OF.get(w, "") for w in said[:-1] if w in ADJECTIVES or w in FLOOR_OF), ""
        )
    return FLOOR_OF.get(said[-1], "")


def _strength(span: Span, clause: Clause, marked: Sequence[Span]) -> Strength:
    """Whether the words around a noun order or wish; to prefer is a wish unless they order."""
    near = _around(span, clause, marked)
    if span.role == "vp":
        return "hard" if HARD.search(near) and not SOFT.search(near.replace("prefer", "")) else "soft"
    return "soft" if SOFT.search(near) else "hard"


def _around(span: Span, clause: Clause, marked: Sequence[Span]) -> str:
    """The words that go with a noun: from the noun before, or the sentence's begin, to a pause after it."""
    tokens = clause.tokens
    if clause.act == "rule" and len(marked) == 1:  # the whole sentence is about it
        return " ".join(words(" ".join(tokens)))
    before = [other.end for other in marked if other.end <= span.start]
    ends = [k + 1 for k in range(span.start) if tokens[k] in ENDS or tokens[k] == "but"]
    begin = max([0, span.start - NEAR_WORDS, *before, *ends])
    goals = [s.end for s in clause.spans if s.role in ("t", "b", "p") and begin < s.end <= span.start]
    begin = max([begin, *goals])
    end = span.end
    while end < len(tokens) and tokens[end] not in ENDS and tokens[end] not in ("and", "but"):
        wish = end + 1 < len(tokens) and tokens[end + 1] in WISHES
        if (tokens[end] == "," and not wish) or any(s.start == end for s in marked):
            break
        end += 1
    return " ".join(words(" ".join(tokens[begin:end])))


def _scope(span: Span, clause: Clause, marked: Sequence[Span], state: DialogueState) -> str:
    """How long the rule of a noun holds, by the words for it that stand nearest; what goes on with a conversation is
    about the drive that it is of."""
    alone = state.last is None and state.before is None
    default = "standing" if clause.act in ("rule", "prohibit") and alone else "drive"
    times = [s for s in clause.spans if s.role == "vt"]
    if not times:
        told = " ".join(words(" ".join(clause.tokens)))
        return "standing" if clause.act == "rule" and STANDING.search(told) else default
    own = [t for t in times if _meant_by(t, clause, marked) == span]
    if len(times) == 1 and not marked[0].start < times[0].start < marked[-1].start:
        own = times  # said before all of them, or after
    if not own:
        return default
    end = own[0].end
    if clause.tokens[end : end + 1] and clause.tokens[end] in TO:  # "from nine at night" is followed by "until seven"
        end += TO_WORDS
    return scope_of(" ".join(clause.tokens[own[0].start : end]), default, " ".join(clause.tokens))


def _meant_by(time: Span, clause: Clause, marked: Sequence[Span]) -> Span:
    """The noun that words of time go with: the one right before them, else the one that follows."""
    before = [s for s in marked if s.end <= time.start]
    after = [s for s in marked if s.start >= time.end]
    close = bool(before) and all(token == "," for token in clause.tokens[before[-1].end : time.start])
    return before[-1] if before and (close or not after) else after[0]


def agrees(text: str) -> bool | None:
    """Whether words say yes or no to a question; None for any other words."""
    said = " ".join(words(plain(text)))
    return True if YES.fullmatch(said) else False if NO.fullmatch(said) else None


def asks_of_rules(clause: Clause) -> bool:
    """Whether words about rules name nothing and ask: "which rules are there?" takes none back."""
    named = any(span.role in (*ROUTE_NOUNS, "vh") for span in clause.spans)
    return not named and bool(ASKING & set(clause.tokens[:2]))


def told(how: Driving, standing: Sequence[RouteRule], model: str, asked: bool = False, lifts: bool = True) -> Selection:
    """The answer to words that only say how to drive, that take rules back (``lifts``), or that ask how; ``standing``
    are the rules that hold."""
    if asked:
        which = "; ".join(rule.in_words() for rule in standing)
        say = f"These rules hold: {which}." if which else "No rule holds."
        return Selection("answered", reason="the rules were asked for", text=say, model=model)
    if how.unknown:
        return asked_back(how, model)
    if how.rules:
        say = echo(how.rules)
        return Selection("answered", reason="understood: how to drive", text=say, model=model, rules=how.rules)
    if not lifts:
        return Selection("clarify", reason="a rule about nothing", question=ABOUT, text=ABOUT, model=model)
    ended = ended_by(how.lifts, standing)
    if not ended:
        which = "; ".join(rule.in_words() for rule in standing)
        say = f"There is no such rule. These hold: {which}." if which else "There is no such rule: none holds."
        return Selection("answered", reason="no rule to take back", text=say, model=model)
    say = echo((), ended)
    return Selection("answered", reason="understood: a rule ends", text=say, model=model, lifts=ended)


def ended_by(lifts: Sequence[RouteRule], standing: Sequence[RouteRule]) -> tuple[RouteRule, ...]:
    """The rules that end: of the same kind and target, else of the same target; all of them where none is named."""
    if not lifts:
        return tuple(standing)
    ended = [rule for rule in standing if any(lift.ends(rule) for lift in lifts)]
    if not ended:  # "you may go over the carpet again", after "keep away from the carpet"
        about = [lift for lift in lifts if lift.target is not None]
        named = [rule for rule in standing if rule.target is not None]
        ended = [rule for rule in named if any(replace(lift, kind=rule.kind).ends(rule) for lift in about)]
    return tuple(ended)


def asked_back(how: Driving, model: str) -> Selection:
    """The question about a rule whose object is not known."""
    name = " and ".join(name for rule in how.unknown if rule.target is not None for name in rule.target.names)
    wish = how.unknown[0].wish.replace(name, f"the {name}")
    question = f"I know of no {name} here: what do you mean by “{wish}”?"
    return Selection(
        "clarify", reason=f"no {name} is known", question=question, text=question, model=model,
        rules=tuple(rule for rule in how.rules if rule not in how.unknown),
    )  # fmt: skip
