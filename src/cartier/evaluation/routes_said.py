"""Sentences with route rules: lines of ``ACT ANSWER + RULE … :: words``, and how many rules a reasoner understands.

The form is that of ``tools/understanding/README.md``, section "Routes"; marks of words are taken out. A rule is right if
kind, target, strength and scope are; a line if its rules are exactly those written.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cartier.contracts import Reasoner
from cartier.errors import InputError, ReasonerError
from cartier.io.files import read_text
from cartier.route_rules import RouteRule
from cartier.types import Inventory, Selection

MARK = re.compile(r"\[([^\[\]]+):[^\[\]:]+\]")
MAX_BYTES = 10_000_000
STANDING = ("avoid room:cellar hard standing", "slow-near floor:rug soft standing")
"""Rules that hold besides, where words take one back."""


@dataclass(frozen=True)
class Sentence:
    """One line: the words, the turns before them, and the rules that they make (``lift``: that they take back)."""

    where: str
    home: str
    voice: str
    text: str
    rules: tuple[RouteRule, ...]
    lift: bool
    dialogue: tuple[tuple[str, str], ...] = ()

    @property
    def unknown(self) -> bool:
        """Whether a rule is about what the home does not have: a reasoner has to ask."""
        return any(rule.target is not None and rule.target.kind == "none" for rule in self.rules)


def sentences(file: Path) -> list[Sentence]:
    """The lines of a file whose answer is sure.

    Raises InputError at the first that is broken.
    """
    found, home, voice, before, last = list[Sentence](), "", "", list[tuple[str, str]](), ""
    reply = "all right"
    for number, row in enumerate(read_text(file, MAX_BYTES).splitlines(), 1):
        row, where = row.strip(), f"{file.name}:{number}"
        if not row or row.startswith("//"):
            continue
        if row.startswith("#"):
            key, _, value = row[1:].strip().partition(" ")
            home, voice = (value.strip(), voice) if key == "home" else (home, value.strip())
            continue
        if row.startswith("?"):
            reply = row[1:].strip()
            continue
        head, divider, marked = row.lstrip("+~ ").partition("::")
        if not divider:
            raise InputError(f"{where}: no '::' in {row[:60]!r}")
        before = [*before, (last, reply)] if row.startswith("+") and last else []
        last, reply = MARK.sub(r"\1", marked).strip(), "all right"
        parts = [part.strip().split(" + ") for part in head.split(" / ")]
        acts = [part[0].split()[0] for part in parts if part[0]]
        told = [rule for part in parts for rule in _rules_of(part)]
        if any(text.lstrip().startswith(("!", "?")) for text in told):
            continue  # the writer and the map are of two opinions about the geometry
        try:
            rules = tuple(RouteRule.parse(text) for text in told)
        except (InputError, ValueError) as error:
            raise InputError(f"{where}: {error}") from error
        found.append(Sentence(where, home, voice, last, rules, "lift" in acts, tuple(before)))
    return found


def _rules_of(part: Sequence[str]) -> list[str]:
    act, _, answer = part[0].partition(" ")
    return [*([answer] if act in ("rule", "lift") else []), *part[1:]]


def told(reasoner: Reasoner, sentence: Sentence, home: Inventory) -> list[Selection]:
    """What a reasoner makes of a sentence; where it takes a rule back, that rule and others hold."""
    if sentence.lift:
        standing = [replace(rule, scope="standing") for rule in sentence.rules if not sentence.unknown]
        others = [RouteRule.parse(text) for text in STANDING]
        home = replace(home, rules=tuple([*others[:1], *standing, *others[1:]]))
    chosen = reasoner.select(sentence.text, home, sentence.dialogue)
    return [chosen, *chosen.next]


def judged(sentence: Sentence, parts: Sequence[Selection]) -> dict[str, bool]:
    """Whether the rules are right as a whole (``exact``), and their kinds, targets, strengths and scopes by themselves."""
    if sentence.unknown:
        return {"exact": parts[0].status == "clarify"}
    got = [rule for part in parts for rule in (part.lifts if sentence.lift else part.rules)]
    fields: Mapping[str, Callable[[RouteRule], object]] = {
        "kind": lambda rule: rule.kind, "target": _target,
        **({} if sentence.lift else {"strength": lambda rule: rule.strength, "scope": lambda rule: rule.scope}),
    }  # fmt: skip
    right = {name: _alike(map(field, sentence.rules), map(field, got)) for name, field in fields.items()}
    whole = (tuple(field(rule) for field in fields.values()) for rule in sentence.rules)
    return right | {"exact": _alike(whole, (tuple(field(rule) for field in fields.values()) for rule in got))}


def _alike(one: Iterable[object], other: Iterable[object]) -> bool:
    return sorted(map(repr, one)) == sorted(map(repr, other))


def _target(rule: RouteRule) -> object:
    target = rule.target
    if target is None:
        return None
    if target.kind == "door":
        return "door", sorted(sorted(pair) for pair in zip(target.names[::2], target.names[1::2], strict=True))
    return target.kind, sorted(target.names), sorted(target.ids)


def score(
    files: Sequence[Path], reasoner: Reasoner, inventory: Callable[[str], Inventory]
) -> dict[str, dict[str, tuple[int, int]]]:
    """How many lines are right: by what they say, of each part (right, all). Their words are not kept.

    Args:
        files: Files of sentences.
        reasoner: What reads them.
        inventory: Gives the home of a name.

    Returns:
        For each kind of rule, "no rule" and "all": for "exact", "kind", "target", "strength" and "scope" how many lines
        are right, and how many there are. A sentence without an answer (a reply that is missing) counts as wrong.
    """
    counts: dict[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(lambda: [0, 0]))
    for sentence in (one for file in files for one in sentences(file)):
        try:
            right = judged(sentence, told(reasoner, sentence, inventory(sentence.home)))
        except ReasonerError:
            right = {"exact": False}
        sort = "take back" if sentence.lift else sentence.rules[0].kind if sentence.rules else "no rule"
        for row in (sort, "all"):
            for part, ok in right.items():
                counts[row][part][0] += ok
                counts[row][part][1] += 1
    return {row: {part: (n, of) for part, (n, of) in parts.items()} for row, parts in counts.items()}


def table(found: Mapping[str, Mapping[str, tuple[int, int]]]) -> str:
    """The score as a Markdown table."""
    parts = ("exact", "kind", "target", "strength", "scope")
    rows = ["| what a sentence says | sentences | " + " | ".join(parts) + " |", "|---|---:|" + "---:|" * len(parts)]
    for row, of in sorted(found.items(), key=lambda item: item[0] == "all"):
        shares = [f"{of[part][0] / of[part][1]:.1%}" if part in of else "" for part in parts]
        rows.append(f"| {row} | {of['exact'][1]} | " + " | ".join(shares) + " |")
    return "\n".join(rows)
