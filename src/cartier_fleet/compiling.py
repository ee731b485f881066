"""Phrases about objects as SQL over a fleet's catalog: names, rooms, colours, and what stands on, by or near what.

It gives what ``Scene.meant`` gives in each home, by the same distances; a test holds them against each other. All other
phrases have no SQL, and are resolved home by home.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from cartier.labels import name_key
from cartier.spatial import relations
from cartier.spatial.colour_shares import BESIDE
from cartier.spatial.expressions import ReferringExpression, SpatialRelation
from cartier.spatial.query import CLEARLY, LEAST_SHARE, MAIN_SHARE

GAP_M = "sqrt({})".format(" + ".join(f"greatest(f.{a}_min - l.{a}_max, l.{a}_min - f.{a}_max, 0) ** 2" for a in "xyz"))
APART = " and ".join(f"f.{a}_min - l.{a}_max <= {{0}} and l.{a}_min - f.{a}_max <= {{0}}" for a in "xyz")
"""No farther than that along each axis: cheaper than ``GAP_M``, which only the pairs that are left need."""
WITHIN = " and ".join(f"f.{a} between l.{a}_min and l.{a}_max" for a in "xy")


COLUMNS = ", ".join(
    ["home", "object", "room", "room_kind", "x", "y", *(f"{a}_{end}" for end in ("min", "max") for a in "xyz")]
)


class NoSql(Exception):
    """A phrase that has no SQL."""


def named(labels: Collection[str]) -> str:
    """The condition that an object has one of the names, as its label or given by people."""
    listed = ", ".join(map(_quoted, sorted(labels)))
    own = f"label in ({listed})" if listed else "false"
    return f"({own} or len(names) > 0 and list_has_any(names, [{listed}]::varchar[]))"


class Compiler:
    """Makes one query of common table expressions, each of rows of the table ``placed``.

    Args:
        kinds: The kinds of rooms, which phrases name by their places.
        unsure: The labels of tentative objects.
    """

    def __init__(self, kinds: Sequence[str], unsure: Collection[str]) -> None:
        self._kinds, self._unsure, self._parts = kinds, unsure, dict[str, str]()

    def __call__(self, phrase: ReferringExpression) -> str:
        """The query of ``home`` (its number) and ``object`` of what is meant. Raises NoSql."""
        met = self._meant(phrase)
        parts = ", ".join(f"{name} as ({sql})" for sql, name in self._parts.items())
        return f"with {parts} select home, object from {met} order by home, object"

    def _add(self, sql: str) -> str:
        """The name of a table; the same one for the same SQL, as of a landmark of two names."""
        return self._parts.setdefault(sql, f"t{len(self._parts)}")

    def _meant(self, phrase: ReferringExpression) -> str:
        told = phrase.size or phrase.most or phrase.order or phrase.other or phrase.also
        if phrase.generic or phrase.obj is not None or phrase.usually is not None or told:
            raise NoSql
        met = self._of(phrase, phrase.labels)
        return self._else(met, self._of(phrase, phrase.similar)) if phrase.similar else met

    def _of(self, phrase: ReferringExpression, labels: Collection[str]) -> str:
        columns = f"{COLUMNS}, colours" if phrase.colours else COLUMNS
        found = self._add(f"select {columns} from placed where confirmed and {named(labels)}")
        for relation in phrase.relations:
            found = self._related(found, relation)
        return self._coloured(found, phrase.colours) if phrase.colours else found

    def _else(self, first: str, then: str) -> str:
        """The first in each home where it has rows, else the second."""
        return self._add(f"from {first} union all from {then} anti join {first} using (home)")

    def _related(self, found: str, relation: SpatialRelation) -> str:
        kind, target = relation.kind, relation.target
        if target is None:
            raise NoSql
        if kind.startswith("not "):
            there = self._related(found, SpatialRelation(kind[4:], target, relation.other))
            return self._add(f"from {found} f anti join {there} r on r.home = f.home and r.object = f.object")
        if target.rooms is not None:
            inside = ", ".join(_quoted(self._kinds[place]) for place in target.rooms)
            there = f"coalesce(list_contains([{inside}]::varchar[], room_kind), false)"
            return self._add(f"from {found} where {'not ' if kind == 'farthest' else ''}{there}")
        ways: dict[str, Callable[[str, str], str]] = {
            **dict.fromkeys(("on", "in", "from"), self._on), "next to": self._next,
            "near": lambda found, beside: self._close(found, beside, relations.ASKED_NEAR_M),
            "of": lambda found, beside: self._close(found, beside, relations.ASKED_NEXT_M),
        }  # fmt: skip
        if kind not in ways:
            raise NoSql
        return ways[kind](found, self._landmarks(target))

    def _landmarks(self, phrase: ReferringExpression) -> str:
        likely = [label for label in self._unsure if name_key(label) == name_key(phrase.said)]
        if not likely:
            return self._meant(phrase)
        perhaps = self._add(f"select {COLUMNS} from unsure where label in ({', '.join(map(_quoted, likely))})")
        return self._else(self._meant(phrase), perhaps)

    def _on(self, found: str, beside: str) -> str:
        def at(condition: str) -> str:
            return self._add(f"from {found} f semi join ({_above(beside)} where {condition}) r using (home, object)")

        close = f"{APART.format(relations.ASKED_ON_M)} and {GAP_M} <= {relations.ASKED_ON_M}"
        stands = f"l.home = f.home and l.object <> f.object and {WITHIN} and {close}"
        loosely = self._add(f"from {found} f semi join {beside} l on {stands}")
        return self._else(self._else(at("deep = 1"), at("true")), loosely)

    def _next(self, found: str, beside: str) -> str:
        below = f"select home, below from held semi join {beside} using (home, object)"
        touching = f"({_above(beside)} union all {below}) r(home, object)"
        apart = self._add(f"from {found} f anti join {touching} using (home, object)")
        most_m = relations.ASKED_NEXT_M
        return self._else(self._close(apart, beside, most_m), self._close(found, beside, most_m))

    def _close(self, found: str, beside: str, most_m: float) -> str:
        near = self._add(
            f"select f.home, f.object, any_value(f.room) as room, min({GAP_M}) as far from {found} f join {beside} l "
            f"on l.home = f.home and l.object <> f.object and {APART.format(most_m)} "
            f"group by f.home, f.object having far <= {most_m}"
        )
        there = f"(select distinct home, room from {beside})"
        roomed = self._add(
            f"select n.*, r.home is not null as same from {near} n left join {there} r "
            "on r.home = n.home and r.room is not distinct from n.room"
        )
        same = self._add(f"from {roomed} qualify same or not bool_or(same) over (partition by home)")
        kept = self._add(f"from {same} qualify far <= min(far) over (partition by home) + {relations.ASKED_TIE_M}")
        return self._add(f"from {found} f semi join {kept} k using (home, object)")

    def _coloured(self, found: str, colours: Sequence[str]) -> str:
        beside = {other for colour in colours for other in BESIDE.get(colour, ())} - set(colours)
        rated = self._add(
            f"select home, object, {_share(colours)} as own, own + {_share(beside)} / 3 as fit, own >= {MAIN_SHARE} "
            f"as exact, len(colours) > 0 and fit = 0 as unlike from {found}"
        )
        chosen = self._add(
            f"select *, case when bool_or(exact) over h then exact when bool_or(fit >= {LEAST_SHARE}) over h "
            f"then fit >= {LEAST_SHARE} else count(*) over h = 1 and not bool_or(unlike) over h end as chosen "
            f"from {rated} window h as (partition by home)"
        )
        best = self._add(
            f"select home, object, fit, max(fit) over h as best, nth_value(fit, 2) over h as second from {chosen} "
            "where chosen window h as (partition by home order by fit desc "
            "rows between unbounded preceding and unbounded following)"
        )
        clear = f"coalesce(best > {CLEARLY} * second, false)"
        kept = self._add(f"from {best} where not {clear} or fit = best")
        return self._add(f"select {COLUMNS} from {found} f semi join {kept} k using (home, object)")


def _above(beside: str) -> str:
    """What stands on or in the landmarks, or on what does."""
    return f"select h.home, h.object from held h join {beside} l on l.home = h.home and l.object = h.below"


def _share(colours: Collection[str]) -> str:
    listed = ", ".join(map(_quoted, sorted(colours)))
    shares = f"[c.share for c in colours if list_contains([{listed}]::varchar[], c.name)]"
    return f"coalesce(list_sum({shares}), 0)"


def _quoted(text: str) -> str:
    doubled = text.replace("'", "''")
    return f"'{doubled}'"
