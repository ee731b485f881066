"""Reply parser: from a model's reply to the list. No text can lead to an object outside the list."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from cartier.labels import object_ref
from cartier.llm.lookup import NOTHING, Listed, Pick, names_of
from cartier.llm.route_rules import with_rules
from cartier.llm.thoughts import without_thoughts
from cartier.types import Fact, Inventory, Selection, Status

# The prompts' words for each status; all published figures of language models were measured with these.
REPLY_STATUSES: Mapping[str, Status] = {
    "found": "found", "near": "likely_near", "absent": "not_found", "clarify": "clarify", "told": "answered",
}  # fmt: skip
MAX_REPLY_CHARS = 20_000
MAX_LINE_CHARS = 300
MAX_FURTHER = 3
MAX_WORD_CHARS = 80
SAY_AGAIN = "Could you say that in other words?"


def read_reply(reply: str, inventory: Inventory, *, model: str = "", prompt: str = "") -> Selection | None:
    """A reply to any of the prompts as an answer; None if it is unreadable, truncated or not about this home.

    The last JSON object with a status or an object counts; one that is cut off is no answer. All that it names must be
    in the inventory: names, numbers of objects with their own names, and rooms; an answer for programs that does not
    fit is left out. A reply without JSON is free text, in which ``parse_object`` looks for the name. A further need (at
    most ``MAX_FURTHER``) that names nothing in the home becomes a question.
    """
    said = without_thoughts(reply)
    if said is None:
        return None
    text, listed = said[-MAX_REPLY_CHARS:], Listed(inventory)
    rows, is_cut = _rows(text)
    if is_cut:  # what is missing may change all of it
        return None
    if not rows:
        stated = {status.lower() for status in _JSON_STATUS.findall(text)} or {"found"}
        if len(stated) > 1 or text.count("{") > text.count("}"):
            return None
        rows = [{"status": stated.pop(), "object": _named(text, inventory.names)}]
    first = _need(rows[-1], listed, model)
    if first is None:
        return None
    further = rows[-1].get("then")
    then: list[Selection] = []
    for row in [row for row in further if isinstance(row, dict)][:MAX_FURTHER] if isinstance(further, list) else []:
        need = _need(row, listed, model) or no_answer("", model=model)
        if need.object is None or all(_goal(need) != _goal(earlier) for earlier in (first, *then)):
            then.append(need)  # models repeat themselves
    ruled = with_rules(first, rows[-1], inventory)
    if ruled is None:
        return None
    chosen = replace(ruled, next=tuple(then), reply=reply, prompt=prompt)
    return chosen if all(map(inventory.contains, (chosen, *then))) else None


def no_answer(reply: str, *, model: str = "", prompt: str = "") -> Selection:
    """The message to the person where ``read_reply`` found no answer."""
    reason = "the model's reply names nothing in the list"
    return Selection("clarify", reason=reason, question=SAY_AGAIN, reply=reply, model=model, prompt=prompt)


def _need(row: Mapping[str, Any], listed: Listed, model: str) -> Selection | None:
    """One need as a model states it; None if it names an unknown entity or status."""
    status, stated = row.get("status", "found"), row.get("object")
    status = REPLY_STATUSES.get(status.strip().lower()) if isinstance(status, str) else None
    stated = stated[0] if isinstance(stated, list) and len(stated) == 1 else stated
    pick = listed.find(stated) if isinstance(stated, str) else None
    is_nothing = pick == Pick(NOTHING) and NOTHING not in listed.names.listed
    reason, question = _line(row.get("reason")), _line(row.get("question"))
    if status == "answered":
        is_stranger = pick is None and stated not in (None, "")
        return None if is_stranger else _told(row, listed, None if is_nothing else pick, model)
    if status == "clarify":
        return Selection("clarify", reason=reason or "the model asks back", question=question or SAY_AGAIN, model=model)
    if status == "not_found" or (status is not None and is_nothing):
        return Selection("not_found", reason=reason or "the model says that nothing here serves this", model=model)
    if status is None or pick is None:
        return None
    candidates = ((pick.name, 1.0),) if pick.room is None else ()
    reason = reason or "chosen by the model"
    return Selection(
        status, pick.name, reason, candidates=candidates, model=model, object_id=pick.object_id, room=pick.room
    )


def _told(row: Mapping[str, Any], listed: Listed, about: Pick | None, model: str) -> Selection | None:
    """An answer in words; None without a sentence. An answer for programs that is not about this home is left out."""
    say, reason = _line(row.get("say")), _line(row.get("reason"))
    stated = row.get("answer")
    try:
        fact = None if stated is None else _fact(stated, listed)
    except (KeyError, TypeError, ValueError, OverflowError):
        fact = None  # the sentence stays
    if not (say or reason):
        return None
    name, number, room = about or (None, None, None)
    told = Selection("answered", name, reason or "told by the model", object_id=number, room=room, fact=fact)
    return replace(told, text=say or reason, model=model)


def _fact(stated: Any, listed: Listed) -> Fact:
    """An answer for programs; where an object is comes from the map, not from the model.

    Raises KeyError, TypeError, ValueError or OverflowError for an invalid answer or one that is not about this home.
    """
    kind, value, numbers = stated["kind"], stated.get("value"), stated.get("objects") or []
    if any(type(number) is not int for number in numbers):
        raise TypeError("objects are numbers")
    objs = [listed.objects[number] for number in dict.fromkeys(numbers)]
    rooms = [listed.rooms.get(obj.room) for obj in objs if obj.room is not None]
    if kind == "count":
        value = _whole(value, len(objs), max(len(listed.objects), len(listed.rooms)))
    elif kind == "exists":
        if type(value) is not bool:
            raise TypeError("there is, or there is not")
    elif kind == "where":
        value = (rooms[0] if rooms else None) if objs or value is None else _listed_as(value, listed)
    elif kind == "list":
        if not isinstance(value, list):
            raise TypeError("names are a list")
        value = list(dict.fromkeys([_listed_as(name, listed) for name in value] or [obj.label for obj in objs]))
    elif kind == "compare":
        value = _listed_as(value, listed)
        if objs and value not in [obj.label for obj in objs]:
            raise ValueError("what it names is not among what it compares")
    elif kind == "tell":
        value = _line(value)[:MAX_WORD_CHARS] if isinstance(value, str) else _number(value)
    else:
        raise ValueError("no kind of answer")
    return Fact(kind, value, tuple(obj.id for obj in objs))


def _listed_as(name: Any, listed: Listed) -> str:
    pick = listed.find(name) if isinstance(name, str) else None
    if pick is None or (pick == Pick(NOTHING) and NOTHING not in listed.names.listed):
        raise ValueError("not of this home")
    return pick.name


def _whole(value: Any, least: int, most: int) -> int:
    number = _number(value)
    if number != int(number) or not least <= number <= most:
        raise ValueError("no such number")
    return int(number)


def _number(value: Any) -> float | int:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError("no number")
    number: float | int = value
    return number


def _goal(need: Selection) -> tuple[Any, ...]:
    """The key that distinguishes needs."""
    return need.status == "answered", need.object, need.object_id, need.room


def _named(text: str, names: Sequence[str]) -> str | None:
    """The entity that free text names, with its object's number if given; None if the text names two."""
    name, numbers = parse_object(_NUMBER.sub("", text), names), set(_NUMBER.findall(text))
    if name is None or not numbers:
        return name
    return object_ref(name, int(numbers.pop())) if len(numbers) == 1 else None


def _line(value: object) -> str:
    """The model's words to the person: one short printable line, or nothing if it is no text."""
    text = value if isinstance(value, str) else ""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:MAX_LINE_CHARS]


def _rows(text: str) -> tuple[list[dict[str, Any]], bool]:
    """The JSON objects in a text that state a status or an object, and whether the last object of all is cut off."""
    rows, at, is_cut = [], 0, False
    while not is_cut and (begin := _JSON_BEGIN.search(text, at)):
        row, at, is_cut = _members(text, begin.start() + 1)
        if "status" in row or "object" in row:
            rows.append(row)
    return rows, is_cut


def _members(text: str, at: int) -> tuple[dict[str, Any], int, bool]:
    """The complete members of a JSON object after its brace, where they end, and whether the object is truncated."""
    row: dict[str, Any] = {}
    while member := _JSON_KEY.match(text, at):
        try:
            row[member[1]], at = _DECODER.raw_decode(text, member.end())
        except (ValueError, RecursionError):
            return row, at, True
    closing = _JSON_END.match(text, at)
    return row, closing.end() if closing else at, closing is None


def parse_object(reply: str, objects: Sequence[str]) -> str | None:
    """The listed object that a reply names, NOTHING if it says that nothing serves, or None if it names neither.

    The first of these that applies decides:

    1. A JSON member "object", anywhere: its value must be a listed name. One that is cut off is no answer.
    2. The whole reply, its last line or its first sentence is a name, bare or in quotes.
    3. One single name stands in quotes or bold: "... the object called `Bed'".
    4. The text holds one single name. One right after "not" does not count.
    5. One single name follows right after "go to the", "choose", "the answer is" or the like.
    6. The last sentence with a name holds one single name: who thinks aloud decides at the end.

    Else None: of two names that nothing tells apart, either would be a guess. Upper case, underscores, CamelCase and a
    plural's s do not matter where that is unambiguous, and "coffee machine" is never taken for "machine".
    """
    said = without_thoughts(reply)
    if said is None:
        return None
    reply, names = said[-MAX_REPLY_CHARS:].strip(), names_of(tuple(objects))
    if _JSON_MEMBER.search(reply):
        stated = [m[2] for m in _JSON_OBJECT.finditer(" ".join(reply.split()))]
        return names.lookup(_unescaped(stated[-1])) if stated else None
    sentences = [s for s in _SENTENCE_END.split(reply) if s.strip()]
    first = re.match(r"[^.!?;:\n]+(?![^.!;:\n])", reply)  # "Bed? No, the sofa." decides nothing
    for part in (reply, reply.rpartition("\n")[2], first[0] if first else ""):
        if (name := names.lookup(part)) is not None:
            return name
    named = [names.mentions(sentence) for sentence in sentences]
    quoted = [name for q in _QUOTED.findall(reply) if (name := names.lookup(q)) is not None]
    told = [name for sentence in named for name, chosen in sentence if chosen]
    everywhere = [name for sentence in named for name, _ in sentence]
    last = next(([name for name, _ in sentence] for sentence in reversed(named) if sentence), [])
    return next((group[0] for group in (quoted, everywhere, told, last) if len(set(group)) == 1), None)


def parse_list(reply: str, most: int = 5) -> list[str]:
    """The names in a comma-separated or numbered reply, cleaned, each once."""
    parts = re.split(r"[,\n;]", (without_thoughts(reply) or "")[:MAX_REPLY_CHARS])
    names = (_LIST_MARKS.sub("", part).strip("\"'` ") for part in parts)
    return list(dict.fromkeys(name.lower() for name in names if 0 < len(name) <= 60))[:most]


# Each pattern takes time linear in the text's length: long parts are possessive (*+, ++), and a run is entered at its
# beginning only.
_DECODER = json.JSONDecoder()
_SENTENCE_END = re.compile(r"(?<![.!?;:])[.!?;:]++(?:\s++|$)|\n++")
_LIST_MARKS = re.compile(r"^[\s\d.)*\-]++|(?<![\s.])[\s.]++$")
_JSON_BEGIN = re.compile(r"\{(?=\s*\")")
_JSON_KEY = re.compile(r'\s*+(?:,\s*+)?"((?:[^"\\]|\\.)*+)"\s*+:\s*+')
_JSON_END = re.compile(r"\s*+(?:,\s*+)?\}")
_JSON_MEMBER = re.compile(r"[\"']object[\"'] ?:")
_JSON_STATUS = re.compile(r"""[\"']status[\"']\s*:\s*[\"'](\w+)[\"']""")
_NUMBER = re.compile(r"#([0-9]{1,9})(?![0-9])")
_JSON_OBJECT = re.compile(r"""[\"']object[\"'] ?: ?\[? ?([\"'])((?:\\.|(?!\1)[^\\])*)\1""")
_QUOTED = re.compile(r"(?<![`'\"“”‘’«*])[`'\"“‘«*]{1,3}([^`'\"“”‘’«»*\n]{1,80})[`'\"”’»*]")


def _unescaped(literal: str) -> str:
    try:
        return str(json.loads(f'"{literal}"'))
    except ValueError:  # Python's quotes instead of JSON's
        return literal
