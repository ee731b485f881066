"""Marked requests: ``go 14 :: over to the [small:s] [table:t]``; tools/understanding/README.md has the form."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cartier.errors import InputError
from cartier.labels import plain
from cartier.spatial.expressions import Kind
from cartier.understanding.decoding import clauses
from cartier.understanding.tags import DIALOGUE_ACTS, ROLES, ROUTING, Clause
from cartier.understanding.utterance import TOKEN

NEED = "z"
"""Writers mark the words of a need; the parser does not learn it, the scorer reads the whole clause."""
MARKED = re.compile(r"\[([^\[\]]+):([^\[\]:]+)\]")


@dataclass(frozen=True)
class Line:
    """One turn: its acts and answers, its text, tokens and the role of each token (``B-t``, ``I-t``, ``O``).

    ``context`` are the (person, robot) turns before it; ``answers`` are as written, one a clause, without the route
    rules that stand after them, which are in ``rules``: "avoid floor:carpet hard drive".
    """

    where: str
    home: str
    voice: str
    acts: tuple[Kind, ...]
    answers: tuple[str, ...]
    text: str
    tokens: tuple[str, ...]
    tags: tuple[str, ...]
    context: tuple[tuple[str, str], ...] = ()
    rules: tuple[tuple[str, ...], ...] = ()

    def clauses(self) -> list[Clause]:
        """The clauses as the parser would give them."""
        return clauses(self.tokens, self.tags, [[(act, 1.0)] for act in self.acts])


def unmarked(marked: str, where: str) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """The text, its tokens and their tags."""
    marked = "".join(c for c in unicodedata.normalize("NFKD", marked) if not unicodedata.combining(c))
    text, spans, end = "", list[tuple[int, int, str]](), 0
    for found in MARKED.finditer(marked):
        text += marked[end : found.start()]
        role = found[2].strip()
        if role not in (*ROLES, NEED):
            raise InputError(f"{where}: there is no role {role!r}")
        spans.append((len(text), len(text) + len(found[1]), role))
        text, end = text + found[1], found.end()
    text += marked[end:]
    if re.search(r"[\[\]]", text):
        raise InputError(f"{where}: a bracket that is no mark: {text[:80]}")
    lower = plain(text)
    tokens, tags = [], []
    for token in TOKEN.finditer(lower):
        inside = next((s for s in spans if s[0] <= token.start() < s[1]), None)
        first = inside is not None and not any(
            inside[0] <= other.start() < token.start() for other in TOKEN.finditer(lower, inside[0], token.start())
        )
        tokens.append(token[0])
        tags.append("O" if inside is None else f"{'B' if first else 'I'}-{inside[2]}")
    return text, tuple(tokens), tuple(tags)


def read(file: Path) -> Iterator[Line]:
    """The lines of a file. Raises InputError at the first that is broken."""
    home = voice = ""
    context: tuple[tuple[str, str], ...] = ()
    said = answer = None
    for number, row in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        where, row = f"{file.name}:{number}", row.strip()
        if not row or row.startswith("//"):
            continue
        if row.startswith("# home"):
            home = row.split()[2]
        elif row.startswith("# voice"):
            voice = row.split(":", 1)[-1].strip()
        elif row.startswith("?"):
            answer = row[1:].strip()
        else:
            line = _line(row, where, home, voice)
            if row.startswith("+"):
                if said is None:
                    raise InputError(f"{where}: '+' continues nothing")
                context = (*context, (said, answer or "all right"))
            else:
                context = ()
            yield Line(**{**line.__dict__, "context": context})
            said, answer = line.text, _reply(line)


def _line(row: str, where: str, home: str, voice: str) -> Line:
    head, found, marked = row.lstrip("+~ ").partition("::")
    if not found:
        raise InputError(f"{where}: no '::' in {row[:60]!r}")
    parts, rules = list[list[str]](), list[tuple[str, ...]]()
    for goal, *wishes in (part.split(" + ") for part in head.split("/")):
        act, _, answer = goal.strip().partition(" ")
        parts.append([act, "" if act in ROUTING else answer.strip()])
        rules.append(tuple(wish.strip() for wish in ([answer] if act in ROUTING else []) + wishes))
    acts = tuple(act for part in parts for act in DIALOGUE_ACTS if part[0] == act)
    if len(acts) != len(parts):
        raise InputError(f"{where}: no act {head.strip()!r}")
    text, tokens, tags = unmarked(marked.strip(), where)
    if set(tags) != {"O"} and tags.count("B-/") != len(acts) - 1:  # a line of a test has no marks
        raise InputError(f"{where}: {len(acts)} acts need {len(acts) - 1} marks [...:/]")
    answers = tuple(" ".join(answer.split()) for _, answer in parts)
    return Line(where, home, voice, acts, answers, text, tokens, tags, rules=tuple(rules))


def _reply(line: Line) -> str:
    """What the robot is taken to have said to a line that no ``?`` line follows."""
    ids = [part for answer in line.answers for part in re.findall(r"\d+", answer)]
    if line.acts[0] in ("go", "need", "correct", "another", "choose") and ids:
        return f"@{ids[0]}"
    return "@" + ids[0] if line.acts[0] == "where" and ids else ""
