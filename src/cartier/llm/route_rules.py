"""Route rules in prompts and replies: asked for only where the words speak of the way, and checked against the home."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

from cartier.errors import InputError
from cartier.labels import plain
from cartier.types import Inventory, Selection
from cartier.types.route_rules import RouteRule, RouteTarget, RuleKind, Strength, echo

MAX_RULES = 6
WAYS = re.compile(
    r"\b(?:avoid\w*|(?:keep|stays?|steer|hands) (?:well |far )?(?:off|out|from|to)|off the|away|clear(?:ance)?"
    r"|wide berth|plenty of room|metres?|slow(?:ly|er|down)?|gently|easy|careful(?:ly)?|creep|sneak|dawdl\w*|speed"
    r"|wheels?|cross\w*|route|path|way|via|detour\w*|quick\w*|fast\w*|direct\w*|straight|hurry|chop chop"
    r"|short(?:est|er)? (?:way|route|path|cut)"
    r"|(?:go|drive|come|pass|went|roll)\w* (?:\w+ ){0,3}(?:over|through|past|by|round|around|across|on)"
    r"|(?:go|come|stay|be|drive|run|get)\w* (?:\w+ ){0,2}(?:in|into|near|by|at|against|anywhere|up)"
    r"|(?:not|never|no|only|than) (?:over|through|past|by|across|on) the|(?:past|through|over) the"
    r"|(?:stop|call)\w* (?:by|at|in)|first|touch|near(?:by)?|vicinity|restrict\w*|driv(?:e|es|ing)|drove"
    r"|until|till|again|any ?more|wherever|where there|choice|open for|is fine|s fine|out of bounds|in (?:t?here)"
    r"|mind (?:the|my|our|your|his|her|that|those)|carpets?|rugs?|tiles|parquet|planks)\b",
    re.IGNORECASE,
)
"""Words that may speak of the way: a model then is told how to state route rules. Other prompts stay as they were when
their replies were recorded, and short."""
ASKED = """

The words may also say how to drive. Then reply with two more keys, "rules": […] and "lifts": […], each rule \
{"kind": …, "target": …, "strength": …, "scope": …}; mostly one rule, and [] where nothing is said of the way.
- "kind": "avoid" (not over or through it), "keep-away" (keep a distance), "slow-near", "prefer" (rather there), \
"only-through", "via" (past or through it, in the order said), "shortest" (no detours, in a hurry; its target is "").
- "target": "room:NAME" as listed, "floor:tiles", "floor:planks", "floor:carpet" or "floor:rug" for a kind of floor, \
"object:12" with the numbers of all objects that are meant, "door:ROOM|ROOM", or "none:WORDS" if nothing here is meant.
- "strength": "hard" for orders (not, never, keep off, only, must; also via and shortest), "soft" for wishes (rather, \
if you can, prefer).
- "scope": "drive" beside a drive; "standing" if only the way is spoken of, or "from now on"; else "until:HH:MM", \
"until:tomorrow", or "daily:HH:MM-HH:MM" (between these times each day; a night ends at 06:00).
If the words only say how to drive, "status" is "told", "object" is "nothing", and "say" repeats the rule. "lifts" are \
rules that the words take back ("you may cross the bedroom again"), of those that hold: """


def asks(words: str) -> bool:
    """Whether words may say how to drive: by their words, else as the embedded parser reads them."""
    if WAYS.search(words):
        return True
    from cartier.understanding.entity_vocabulary import known_anywhere  # not before a language model is asked
    from cartier.understanding.parser import parser
    from cartier.understanding.route_rules import says_how
    from cartier.understanding.utterance import TOKEN

    clauses = parser()(TOKEN.findall(plain(words)), None, known_anywhere())
    return any(says_how(clause) for clause in clauses)


def prompt_part(inventory: Inventory) -> str:
    """What a prompt says of route rules; the rules that hold are data, in JSON."""
    return ASKED + json.dumps([rule.text for rule in inventory.rules], ensure_ascii=False)


def schema_part() -> dict[str, Any]:
    """The properties that a reply's schema has besides."""
    properties = {
        "kind": {"type": "string", "enum": list(get_args(RuleKind))}, "target": {"type": "string", "maxLength": 160},
        "strength": {"type": "string", "enum": list(get_args(Strength))}, "scope": {"type": "string", "maxLength": 20},
    }  # fmt: skip
    rule = {"type": "object", "properties": properties, "required": list(properties), "additionalProperties": False}
    return {key: {"type": "array", "items": rule, "maxItems": MAX_RULES} for key in ("rules", "lifts")}


def with_rules(chosen: Selection, row: Mapping[str, Any], inventory: Inventory) -> Selection | None:
    """A selection with the rules of a reply; None if one of them cannot be read: none may be lost without a word.

    A rule about what the home does not have becomes a question.
    """
    try:
        rules, lifts = (_read(row.get(key), inventory) for key in ("rules", "lifts"))
    except InputError:
        return None
    unknown = [rule for rule in rules if rule.target is not None and rule.target.kind == "none"]
    if unknown:
        name = " and ".join(name for rule in unknown for name in (rule.target.names if rule.target else ()))
        question = f"I know of no {name} here: what do you mean?"
        known = tuple(rule for rule in rules if rule not in unknown)
        return Selection("clarify", reason=f"no {name} is known", question=question, model=chosen.model, rules=known)
    ended = tuple(rule for rule in inventory.rules if any(lift.ends(rule) for lift in lifts))
    if not rules and not ended:
        return chosen
    text = echo(rules, ended) if chosen.status == "answered" and chosen.fact is None else chosen.text
    return replace(chosen, rules=rules, lifts=ended, text=text)


def _read(stated: Any, inventory: Inventory) -> tuple[RouteRule, ...]:
    rows = stated if isinstance(stated, list) else []
    if len(rows) > MAX_RULES:
        raise InputError("too many rules")
    return tuple(dict.fromkeys(_rule(row, inventory) for row in rows))


def _rule(row: Any, inventory: Inventory) -> RouteRule:
    """One rule of a reply, about what is in the home. Raises InputError for any other."""
    if not isinstance(row, dict) or not all(isinstance(value, str) for value in row.values()):
        raise InputError("a rule is an object of texts")
    target = RouteTarget.parse(row["target"]) if row.get("target", "").strip() else None
    rule = RouteRule(row.get("kind", ""), target, row.get("strength", "hard"), row.get("scope", "drive"))
    return rule if target is None else replace(rule, target=_listed(target, inventory))


def _listed(target: RouteTarget, inventory: Inventory) -> RouteTarget:
    """A target as the home has it, with what it is called. Raises InputError if the home has it not."""
    if target.kind in ("room", "door"):
        names = {
            name: room.name for room in inventory.rooms for name in (room.name.casefold(), _ref(room.name, room.id))
        }
        return replace(target, names=tuple(_one(names, name.casefold()) for name in target.names))
    if target.kind == "object":
        labels = {obj.id: (obj.names or (obj.label,))[0] for obj in inventory.objects}
        called = {_one(labels, number) for number in target.ids}
        return replace(target, said=" and ".join(sorted(called)))
    if target.kind == "zone":
        raise InputError("a model names no zones")
    return target


def _ref(name: str, number: int) -> str:
    return f"{name} (room {number})".casefold()


def _one(known: Mapping[Any, str], key: Any) -> str:
    if key not in known:
        raise InputError(f"the home has no {key}")
    return known[key]
