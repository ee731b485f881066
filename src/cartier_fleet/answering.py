"""Answers to questions over many homes, with three values: has, has none though it was looked for, cannot tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

from cartier.errors import InputError
from cartier.spatial.expressions import ReferringExpression
from cartier.spatial.floor_seen import WHOLE
from cartier_fleet.answer import (
    NO_FLOOR,
    NO_ROOM,
    TENTATIVE,
    UNKNOWN_NAMES,
    UNNAMED,
    UNSEEN,
    FleetAnswer,
    counted,
)
from cartier_fleet.catalog import Tables
from cartier_fleet.database import Database
from cartier_fleet.matching import MEASURES, extreme, find, find_tentative, without_extreme
from cartier_fleet.questions import FleetQuestion, read_question
from cartier_fleet.reading import Vocabulary, read_phrase, rooms_of, union

MOST_NAMED = 20  # homes that a sentence lists


@dataclass(frozen=True)
class HomeFacts:
    """What decides whether "none" means anything in a home.

    Args:
        vocabulary: What its detector can name.
        blind: Why things may be in it that were never looked for; "" where all of it was seen.
        kinds: The kinds of its rooms.
        names: The labels of its objects, and what people call them.
    """

    vocabulary: Vocabulary
    blind: str
    kinds: frozenset[str]
    names: frozenset[str]


@dataclass(frozen=True, eq=False)
class Loaded:
    """A catalog in memory."""

    database: Database
    homes: Mapping[str, HomeFacts]
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, tables: Tables) -> Loaded:
        """A catalog's tables, and the vocabularies of its homes."""
        database = Database(tables)
        most = max(1, tables["homes"].num_rows, tables["rooms"].num_rows, tables["objects"].num_rows)
        rooms = dict[str, set[str]]()
        for home, kind in database.query("select distinct home, kind from rooms", (), most).rows:
            rooms.setdefault(home, set()).add(kind)
        names = dict[str, set[str]]()
        labels = "select home, list(distinct label) from objects join homes using (home, version) group by home"
        called = "select home, list(distinct name) from (select home, unnest(names) as name from objects join homes "
        for sql in (labels, f"{called}using (home, version)) group by home"):
            for home, found in database.query(sql, (), most).rows:
                names.setdefault(home, set()).update(found)
        homes = {}
        sql = "select home, knows, with_depth, coalesce(floor_seen, 0) from homes order by home"
        for home, knows, with_depth, floor in database.query(sql, (), most).rows:
            blind = NO_FLOOR if not with_depth else UNSEEN if floor < WHOLE else ""
            alone = Vocabulary(tuple(knows), frozenset(), ())
            kinds = frozenset(rooms.get(home, ()))
            homes[home] = HomeFacts(alone, blind, kinds, frozenset(names.get(home, ())))
        return cls(database, *_together(homes))

    @cached_property
    def by_vocabulary(self) -> list[tuple[Vocabulary, list[str]]]:
        """The homes of each vocabulary. Comparing long lists of names once a home would take longer than the query."""
        found = dict[int, tuple[Vocabulary, list[str]]]()
        for home, facts in self.homes.items():
            found.setdefault(id(facts.vocabulary), (facts.vocabulary, []))[1].append(home)
        return list(found.values())

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """All vocabularies together. Its inventory has a thousand names, and is made once, not for each question."""
        return union([vocabulary for vocabulary, _ in self.by_vocabulary])

    def only(self, may_see: Callable[[str], bool]) -> Loaded:
        """The same for some of the homes, without the words of others. Raises InputError if these are none."""
        homes = {home: facts for home, facts in self.homes.items() if may_see(home)}
        if not homes:
            raise InputError("there are no homes that you may ask about")
        return self if len(homes) == len(self.homes) else _of_some(self, tuple(homes))


@lru_cache(maxsize=64)
def _of_some(loaded: Loaded, homes: tuple[str, ...]) -> Loaded:
    """A catalog of some homes: whoever may see these alone learns no name or room of others from an answer."""
    return Loaded(loaded.database, *_together({home: loaded.homes[home] for home in homes}))


def _together(homes: Mapping[str, HomeFacts]) -> tuple[dict[str, HomeFacts], tuple[str, ...]]:
    """Homes with the vocabulary that those of equal detectors share, and the kinds of all their rooms."""
    kinds = tuple(sorted({kind for facts in homes.values() for kind in facts.kinds}))
    seen = dict[tuple[str, ...], set[str]]()
    for facts in homes.values():
        seen.setdefault(facts.vocabulary.knows, set()).update(facts.names)
    shared = {knows: Vocabulary(knows, frozenset(names), kinds) for knows, names in seen.items()}
    return {home: replace(facts, vocabulary=shared[facts.vocabulary.knows]) for home, facts in homes.items()}, kinds


@dataclass(frozen=True)
class Matches:
    """The objects that were meant in each home, and why their number may be too small."""

    objects: Mapping[str, list[int]]
    doubts: Mapping[str, str]


def answer(query: str, loaded: Loaded) -> FleetAnswer:
    """The answer to a question over all homes. Raises InputError for words that ask something else."""
    asked = read_question(query)
    phrases = read_phrase(asked.about, [vocabulary for vocabulary, _ in loaded.by_vocabulary], loaded.vocabulary)
    wishes = {phrase.most for phrase in phrases.values()}
    if asked.form == "extreme":
        if not wishes <= MEASURES.keys():
            raise InputError(f"over many homes I can tell {', '.join(MEASURES)}, not {', '.join(sorted(wishes))}")
        phrases = {vocabulary: without_extreme(phrase) for vocabulary, phrase in phrases.items()}
    found = _matches(loaded, phrases)
    if asked.form == "extreme":
        return _extreme(query, asked, found, loaded, next(iter(wishes)))
    return _told(query, asked, found, loaded)


def _matches(loaded: Loaded, phrases: Mapping[Vocabulary, ReferringExpression]) -> Matches:
    """What each phrase means in the homes of its vocabulary; equal phrases are looked for once."""
    objects, doubts = dict[str, list[int]](), dict[str, str]()
    for phrase in set(phrases.values()):
        met, maybe = find(loaded.database, phrase, loaded.kinds), find_tentative(loaded.database, phrase)
        rooms = {loaded.kinds[place] for place in rooms_of(phrase)}
        for vocabulary, homes in loaded.by_vocabulary:
            if phrases[vocabulary] != phrase:
                continue
            unnamed = _unnamed(vocabulary, phrase)
            for home in homes:
                if home in met:
                    objects[home] = met[home]
                if doubt := unnamed or _doubt(loaded.homes[home], rooms, home in maybe):
                    doubts[home] = doubt
    return Matches({home: objects[home] for home in loaded.homes if home in objects}, doubts)


def _unnamed(vocabulary: Vocabulary, phrase: ReferringExpression) -> str:
    """Why a detector would not have named what is meant; "" if it would have."""
    if not vocabulary.knows:
        return UNKNOWN_NAMES
    return "" if vocabulary.could_name(phrase) else UNNAMED


def _doubt(facts: HomeFacts, rooms: set[str], maybe: bool) -> str:
    """Why there may be more in a home than was found; "" where it was looked for."""
    if facts.blind:
        return facts.blind
    if rooms and not rooms & facts.kinds:
        return NO_ROOM
    return TENTATIVE if maybe else ""


def _told(query: str, asked: FleetQuestion, found: Matches, loaded: Loaded) -> FleetAnswer:
    counts = {home: len(found.objects.get(home, ())) for home in loaded.homes}
    has, none, unsure = list[str](), list[str](), dict[str, str]()
    for home, count in counts.items():
        too_many = asked.most is not None and count > asked.most
        enough = count >= asked.least and asked.most is None
        if too_many:
            none.append(home)
        elif not enough and (doubt := found.doubts.get(home)):
            unsure[home] = doubt
        else:
            (has if enough or count >= asked.least else none).append(home)
    text, value = _in_words(asked, counts, has, none, unsure)
    return FleetAnswer(query, text, value, tuple(has), tuple(none), unsure, found.objects)


def _in_words(
    asked: FleetQuestion, counts: Mapping[str, int], has: list[str], none: list[str], unsure: Mapping[str, str]
) -> tuple[str, Any]:
    """A sentence, and the same for programs."""
    what, total = asked.about, sum(counts.values())
    cannot = f"; cannot tell in {_homes(len(unsure))} ({counted(unsure)})" if unsure else ""
    if asked.form in ("which", "count_homes"):
        wanted = none if asked.negated else has
        listed = f": {_list(wanted)}" if asked.form == "which" and wanted else ""
        parts = [
            f"{_homes(len(has))} {_has(len(has))} {_bounds(asked)}it",
            f"{_homes(len(none))} {_has(len(none))} not",
        ]
        parts[1] += " (looked for)"
        parts[asked.negated] += listed
        parts = parts[::-1] if asked.negated else parts
        return f"{what}: {'; '.join(parts)}{cannot}.", wanted if asked.form == "which" else len(wanted)
    if asked.form == "per_home":
        listed = ", ".join(f"{home} {count}" for home, count in list(counts.items())[:MOST_NAMED])
        more = f" and {len(counts) - MOST_NAMED} more homes" if len(counts) > MOST_NAMED else ""
        return f"{what} per home: {listed}{more}; {total / max(1, len(counts)):.2f} on average{cannot}.", dict(counts)
    if asked.form in ("most", "fewest"):
        ranked = {home: n for home, n in counts.items() if asked.form == "most" or home not in unsure}
        if not ranked:
            return f"Nobody can tell{cannot}.", None
        best = (max if asked.form == "most" else min)(ranked.values())
        homes = [home for home, n in ranked.items() if n == best]
        return f"{_list(homes)}: {best} {what}{cannot}.", homes
    where = {home: n for home, n in counts.items() if n}
    if asked.form == "list":
        listed = ", ".join(f"{home} ({n})" for home, n in list(where.items())[:MOST_NAMED])
        return f"{total} {what} in {_homes(len(where))}{': ' + listed if listed else ''}{cannot}.", where
    return f"{total} {what} in {_homes(len(where))} of {len(counts)}{cannot}.", total


def _extreme(query: str, asked: FleetQuestion, found: Matches, loaded: Loaded, wish: str) -> FleetAnswer:
    best = extreme(loaded.database, found.objects, wish)
    unsure = {home: why for home, why in found.doubts.items() if home not in found.objects}
    has = tuple(found.objects)
    none = tuple(home for home in loaded.homes if home not in found.objects and home not in unsure)
    cannot = f"; cannot tell in {_homes(len(unsure))} ({counted(unsure)})" if unsure else ""
    said = "No such object was seen" if best is None else f"{asked.about} is in {best[0]} (object {best[1]})"
    text = f"{said[:1].upper()}{said[1:]}{cannot}."
    return FleetAnswer(query, text, best, has, none, unsure, found.objects)


def _bounds(asked: FleetQuestion) -> str:
    if asked.most is None:
        return f"at least {asked.least} of " if asked.least > 1 else ""
    return f"{asked.least} of " if asked.least == asked.most else f"at most {asked.most} of "


def _homes(count: int) -> str:
    return f"{count} home" if count == 1 else f"{count} homes"


def _has(count: int) -> str:
    return "has" if count == 1 else "have"


def _list(homes: list[str]) -> str:
    more = f" and {len(homes) - MOST_NAMED} more" if len(homes) > MOST_NAMED else ""
    return f"{', '.join(homes[:MOST_NAMED])}{more}"
