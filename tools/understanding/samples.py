"""Samples that the parser is trained on: marked lines, templates, and lines of which only the act is known."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random

sys.path.append(str(Path(__file__).parent))
from check_marks import fault, home
from templates import NAMES, PLACES, ROOM_NAMES, Templates

from cartier.errors import InputError
from cartier.labels import name_key, object_ref, plain
from cartier.understanding.answers import answer
from cartier.understanding.assembly import query
from cartier.understanding.dialogue_state import DialogueState, resolve
from cartier.understanding.parser import MOST_TOKENS
from cartier.understanding.tags import ALARMS, DIALOGUE_ACTS, NOTHING_ASKED
from cartier.understanding.utterance import TOKEN
from cartier_bench.marked_lines import Line, read, unmarked
from cartier_bench.things_made import plural

TOOLS = Path(__file__).parents[1]
HELD_BACK = ("grumpy", "hosts", "newcomer", "night_kitchen", "others_past", "sunday", "transcript", "wheels")
DRIVING = re.compile(
    r"\b(?:go(?:es|in|ing)?|drive|driving|enter|come|cross|near|off|out of|past|away|clear|close to)\b"
)
"""Words of a prohibition that may be read as a route rule."""
JOINING = (
    "and", "and", "and", "then", "then", "and then", "and then", "and also", "and after that", "after that", "also",
    "plus", "oh and", "and afterwards", "next", "afterwards", "but before that", "and now", "and from there",
    "followed by",
)  # fmt: skip
"""What people put between two requests, the usual ones more often."""
JOINED_TOKENS = 26  # a request of at most so many words is joined with another
HIDDEN, FRAMED = 3500, 24  # alarms amid ordinary sentences; sentences of each frame
PERSONS = (
    "Ben", "Anna", "Tom", "Lena", "Mia", "Grandma", "Grandpa", "Mum", "Dad", "Mom", "Leo", "Emma", "Noah", "Paul",
    "Sara", "Lukas", "Ida", "Omar", "Fatima", "Chen", "Yuki", "Olga", "Ivan", "Rosa", "Max", "Julia", "Peter",
    "Karen", "Mike", "Lily", "the baby", "my brother", "my sister", "my son", "my daughter", "our guest",
)  # fmt: skip
REPLIES = ("another", "correct", "choose", "confirm", "deny")


@dataclass(frozen=True)
class Sample:
    """Tokens with their tags (None where they are not known), the allowed acts of each clause, and the turn before."""

    tokens: tuple[str, ...]
    tags: tuple[str, ...] | None
    acts: tuple[frozenset[str], ...]
    before: tuple[str, str] | None = None
    source: str = ""
    home: str = ""


def written(files: list[Path], checked: bool = True) -> list[Sample]:
    """The good lines of files, with what the robot said before as it would have said it."""
    found: list[Sample] = []
    for file in files:
        states: dict[str, DialogueState] = {}
        said = ""
        for line in read(file):
            before = (line.context[-1][0], _robot(line, said)) if line.context else None
            wrong = fault(line, states) if checked else ""
            if not wrong:
                acts = tuple(frozenset([act]) for act in line.acts)
                tags = tuple("O" if tag.endswith("-z") else tag for tag in line.tags)  # a need is judged as a whole
                either = line.acts == ("prohibit",) and DRIVING.search(" ".join(line.tokens))
                acts = (frozenset(["prohibit", "rule"]),) if either else acts
                found.append(Sample(line.tokens, None if either else tags, acts, before, file.stem, line.home))
            said = _told(line, states) if checked else ""
    return found


def _robot(line: Line, said: str) -> str:
    """The robot's last turn: as written, the object that it went to, or its answer in words."""
    robot = line.context[-1][1]
    if robot.startswith("@") and line.home:
        obj = home(line.home)[0].by_id.get(int(robot[1:]))
        return object_ref(obj.label, obj.id) if obj is not None else "all right"
    return said if robot == "all right" and said else robot


def _told(line: Line, states: dict[str, DialogueState]) -> str:
    """What the program answers to a question, for the turn after it."""
    scene, names = home(line.home)
    asked = resolve(query(line.clauses()[0], names), states["now"])
    if line.acts[0] not in ("count", "exists", "where", "list", "compare", "far", "colour", "size"):
        return ""
    try:
        chosen = answer(asked, scene, states["now"].last, "")
    except (KeyError, ValueError):
        return ""
    return chosen.text if chosen is not None else ""


def templated(count: int, seed: int) -> list[Sample]:
    """Templates, as samples."""
    return _read(Templates(seed).lines(count), Random(seed))


def routed(count: int, seed: int) -> list[Sample]:
    """Templates about the way, as samples; some beside a need of those in tools/requests."""
    wants = [" ".join(sample.tokens) for sample in needs() if not sample.tags or set(sample.tags) == {"O"}]
    return _read(Templates(seed).routed(count, [want for want in wants if len(want) < 90]), Random(seed))


def _read(rows: list[str], rng: Random) -> list[Sample]:
    found, before, said = list[Sample](), "", ""
    for row in rows:
        if row.startswith("?"):
            said = row[2:]
            continue
        head, _, marked = row.lstrip("+~ ").partition(" :: ")
        _, tokens, tags = unmarked(marked, row)
        acts = tuple(frozenset([part.split()[0]]) for part in head.split("/"))
        turn = (before, said or rng.choice(NAMES)) if row.startswith("+") else None
        found.append(Sample(tokens, tags, acts, turn, "templates"))
        before, said = " ".join(tokens), ""
    return found


def joined(learnt: list[Sample], count: int, rng: Random) -> list[Sample]:
    """Two requests of one home in one breath: few of the written lines have more than one."""
    alone: dict[str, list[Sample]] = {}
    for sample in learnt:
        one = sample.tags is not None and len(sample.acts) == 1 and sample.before is None and sample.tokens
        if one and len(sample.tokens) <= JOINED_TOKENS and not sample.acts[0] & {*NOTHING_ASKED, *REPLIES}:
            alone.setdefault(sample.home, []).append(sample)
    homes = [some for some in alone.values() if len(some) > 1]
    pairs = (rng.sample(rng.choice(homes), 2) for _ in range(count))
    return [_joined(one, other, rng) for one, other in pairs]


def _joined(one: Sample, other: Sample, rng: Random) -> Sample:
    assert one.tags is not None and other.tags is not None
    tokens, tags = one.tokens, one.tags
    if tokens[-1] in ".!?" and rng.random() < 0.6:
        tokens, tags = tokens[:-1], tags[:-1]
    if tokens[-1].isalnum() and rng.random() < 0.35:
        tokens, tags = (*tokens, rng.choice(",,.")), (*tags, "O")
    link = tuple(rng.choice(JOINING).split())
    marks = ("B-/", *["I-/"] * (len(link) - 1))
    return replace(
        one, tokens=(*tokens, *link, *other.tokens), tags=(*tags, *marks, *other.tags), acts=one.acts + other.acts
    )


def needs() -> list[Sample]:
    """Requests that name nothing that is wanted (tools/requests), some with a room at their end; no word has a role."""
    found, rng = [], Random(0)
    for file in sorted((TOOLS / "requests").glob("*.jsonl")):
        for row in map(json.loads, file.read_text(encoding="utf-8").splitlines()):
            if file.stem in HELD_BACK or row["kind"] not in ("implicit", "conversational"):
                continue
            text, many = row["text"], len(row["text"].split())
            if many <= 14 and rng.random() < 0.5:
                room = rng.choice(["[in:in] the", "[in:in] our", "somewhere [in:in] the", "and [in:in] the"])
                text = f"{text.rstrip('.!?')}{rng.choice([', ', ' '])}{room} [{rng.choice(ROOM_NAMES)}:r]"
            try:
                _, tokens, tags = unmarked(text, file.name)
            except InputError:
                continue
            if many <= 100:
                found.append(Sample(tokens, tags, (frozenset(["need"]),), None, "templates"))
    return found


def act_only() -> list[Sample]:
    """Lines of which only the act is known: requests by name, alarms, prohibitions, quotes."""
    found = []
    for file in sorted((TOOLS / "requests").glob("*.jsonl")):
        if file.stem in HELD_BACK:
            continue
        for row in map(json.loads, file.read_text(encoding="utf-8").splitlines()):
            if row["kind"] == "explicit":
                found.append(_act_sample(row["text"], {"go", "need"}, "requests"))
    asks = {*DIALOGUE_ACTS} - {*NOTHING_ASKED}
    kinds: dict[str, set[str]] = {kind: {kind} for kind in ALARMS}
    kinds |= {
        "asks": {"go", "need", "where"},
        "ordinary": asks,
        "past": {"remark"},
        "quote": {"remark"},
        "alike": {*DIALOGUE_ACTS},
    }
    kinds |= {"prohibition": {"prohibit", "remark"}}
    for kind, acts in kinds.items():
        for text in alarm_lines(kind):
            either = {"rule"} if kind == "prohibition" and DRIVING.search(text.lower()) else set[str]()
            found.append(_act_sample(text, acts | either, "alarms"))
    rng, asks_or_tells = Random(0), {*DIALOGUE_ACTS}
    for frame in alarm_lines("frames") * FRAMED:  # "this is Ben's room" is none
        text = frame.format(who=rng.choice(PERSONS), room=rng.choice(ROOM_NAMES), thing=rng.choice(NAMES))
        found.append(_act_sample(text, asks_or_tells, "alarms"))
    return found


def alarm_lines(kind: str) -> list[str]:
    """The lines of one file of tools/alarms."""
    return (TOOLS / "alarms" / f"{kind}.txt").read_text(encoding="utf-8").splitlines()


def hidden_alarms(rng: Random) -> list[Sample]:
    """Alarms before, after or amid ordinary sentences."""
    ordinary = [*alarm_lines("alike"), *alarm_lines("ordinary"), *(" ".join(sample.tokens) for sample in needs())]
    alarms = [(text, kind) for kind in ALARMS for text in alarm_lines(kind)]
    found = []
    for text, kind in rng.choices(alarms, k=HIDDEN):
        around = rng.sample(ordinary, rng.choice((1, 1, 2)))
        at = rng.randint(0, len(around))
        parts = [part.rstrip(" .") for part in (*around[:at], text, *around[at:])]
        found.append(_act_sample(rng.choice((". ", ". ", " ... ", " ", ", ")).join(parts), {kind}, "alarms"))
    return [sample for sample in found if len(sample.tokens) <= MOST_TOKENS]


def _act_sample(text: str, acts: set[str], source: str) -> Sample:
    return Sample(tuple(TOKEN.findall(plain(text))), None, (frozenset(acts),), None, source)


def varied(sample: Sample, rng: Random) -> Sample:
    """A sample with other nouns, without punctuation, or with slips of the keyboard, by chance."""
    tokens, tags = list(sample.tokens), list(sample.tags or ["?"] * len(sample.tokens))
    if sample.tags is not None and sample.source != "templates" and rng.random() < 0.35:
        tokens, tags = _other_nouns(tokens, tags, rng)
    if rng.random() < 0.25:
        keep = [k for k, token in enumerate(tokens) if token[0].isalnum() or tags[k] not in ("O", "?")]
        tokens, tags = [tokens[k] for k in keep], [tags[k] for k in keep]
    if rng.random() < 0.15 and tokens:
        k = rng.randrange(len(tokens))
        word = tokens[k]
        if len(word) > 4 and word.isalpha():
            at = rng.randrange(1, len(word) - 2)
            tokens[k] = word[:at] + word[at + 1] + word[at] + word[at + 2 :]
    return replace(sample, tokens=tuple(tokens), tags=tuple(tags) if sample.tags is not None else None)


def _other_nouns(tokens: list[str], tags: list[str], rng: Random) -> tuple[list[str], list[str]]:
    new_tokens, new_tags, k = list[str](), list[str](), 0
    stand_ins = {"one", "ones", "thing", "things", "it", "something", "anything", "everything", "somewhere", "stuff"}
    while k < len(tokens):
        end = k + 1
        while end < len(tokens) and tags[end].startswith("I-"):
            end += 1
        role = tags[k][2:]
        if role in ("t", "b", "l", "n", "vk", "vs") and tags[k].startswith("B") and not stand_ins & set(tokens[k:end]):
            name = rng.choice(PLACES if role == "l" and rng.random() < 0.5 else NAMES)
            name = plural(name) if name_key(tokens[end - 1]) != tokens[end - 1] and role != "l" else name
            words = name.split()
            new_tokens += words
            new_tags += [f"B-{role}", *([f"I-{role}"] * (len(words) - 1))]
        else:
            new_tokens += tokens[k:end]
            new_tags += tags[k:end]
        k = end
    return new_tokens, new_tags
