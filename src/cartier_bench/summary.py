"""Statistics of a run: per method and type of request, with bootstrap intervals and paired differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cartier.errors import InputError
from cartier_bench.queries import TYPES
from cartier_bench.rows import GROUPS, Row, check_rows, ordered

RADII_M = ("0.25", "0.5", "1", "1.5", "2")
"""Success radii, as the keys of ``success``."""
BASE = "object_depth"
"""The method that every other one is compared with."""
KNOWS = "true_object"
"""The method that names the right object whenever it is in the list: where it does not, the detector left it out."""
FAULTS = ("none", "detector", "index", "words")
DIGITS = 6
"""Decimals kept: far below anything that matters, and above what differs between two computers' sums."""
MIN_RESAMPLES = 100
CHUNK = 4_000_000

Floats = npt.NDArray[np.float64]


def summarise(rows: Iterable[Mapping[str, Any] | Row], seed: int = 0, resamples: int = 2000) -> dict[str, Any]:
    """What a program reads of a run (``results.json``): ``methods`` → name → type → numbers, and ``paired``.

    - ``n`` counts (home, request) pairs, ``n_placed`` those with a place.
    - ``match`` and ``success`` (the place is within a radius in metres, in 3-D, of an acceptable true box) are shares
      of all ``n``: an answer without a place is a miss.
    - Distances (mean, median, mean on the floor plan) are over the ``n_placed`` alone; null if there are none.
    - ``goal_reachable`` is the share among the answers with a place for which a goal was sought.
    - ``llm_calls`` and ``tokens`` are means per request, ``seconds_median`` is in seconds.
    - ``…_ci`` is a 95 % percentile bootstrap interval: whole requests are drawn with replacement, all homes of a
      request together, because one text asked in five homes is not five texts.
    - ``faults`` → method that is shown the list → type → how many answers name the right object within 1 m ("none"),
      could not because no right object was in the list ("detector"), name it and point elsewhere ("index"), or name or
      say something else ("words").
    - ``paired`` → ``object_depth`` → other → type: object_depth minus the other over the pairs that both were asked
      (for the distance: in which both gave a place), on the same draws. A negative distance means that object_depth is
      nearer.

    The order of rows does not matter. Raises InputError for rows that are broken, doubled or of two runs.
    """
    if resamples < MIN_RESAMPLES:
        raise InputError(f"{resamples} resamples give no interval; take {MIN_RESAMPLES} or more")
    checked = check_rows(rows)
    methods: dict[str, dict[str, Any]] = {name: {} for name in ordered({row.method for row in checked})}
    paired: dict[str, dict[str, Any]] = {name: {} for name in methods if name != BASE and BASE in methods}
    for kind in TYPES:
        of_kind: dict[str, list[Row]] = {name: [] for name in methods}
        for row in checked:
            if row.type == kind:
                of_kind[row.method].append(row)
        draws = _Draws(sorted({row.query_id for mine in of_kind.values() for row in mine}), seed, resamples)
        for name, mine in of_kind.items():
            if mine:
                methods[name][kind] = _numbers(mine, draws)
        for name, into in paired.items():
            pairs = _pairs(of_kind[BASE], of_kind[name])
            if pairs:
                into[kind] = _differences(pairs, draws)
        draws.fill()
    return {
        "interval": "95 % percentile bootstrap over requests, all homes of a request together",
        "seed": seed,
        "resamples": resamples,
        "methods": methods,
        "faults": _faults(checked),
        "paired": {BASE: paired} if paired else {},
    }


class _Draws:
    """Means of one type, whose intervals are filled in at once by ``fill``: every mean sees the same drawn requests."""

    def __init__(self, queries: Sequence[str], seed: int, resamples: int) -> None:
        self._place = {query: n for n, query in enumerate(queries)}
        self._seed, self._resamples = seed, resamples
        self._sums: list[Floats] = []
        self._counts: list[Floats] = []
        self._targets: list[tuple[dict[str, Any], str]] = []

    def mean(self, rows: Sequence[Row], values: Sequence[float], into: dict[str, Any], key: str) -> float | None:
        """The mean of one value per row; its interval goes to ``into[key]`` when ``fill`` is called."""
        into[key] = None
        if not rows:
            return None
        at = np.array([self._place[row.query_id] for row in rows])
        self._sums.append(np.bincount(at, np.asarray(values, float), len(self._place)).astype(float))
        self._counts.append(np.bincount(at, minlength=len(self._place)).astype(float))
        self._targets.append((into, key))
        return _mean(values)

    def fill(self) -> None:
        if not self._targets:
            return
        sums, counts = np.stack(self._sums, 1), np.stack(self._counts, 1)
        means = np.concatenate([_ratio(w @ sums, w @ counts) for w in self._weights()])
        low, high = np.nanquantile(means, (0.025, 0.975), axis=0)
        for (into, key), a, b in zip(self._targets, low, high, strict=True):
            into[key] = [_rounded(a), _rounded(b)]

    def _weights(self) -> Iterable[Floats]:
        """How often each request was drawn, (draws, requests), in chunks that bound the memory."""
        rng, queries, left = np.random.default_rng(self._seed), len(self._place), self._resamples
        while left > 0:
            many = min(left, max(1, CHUNK // queries))
            drawn = rng.integers(queries, size=(many, queries)) + queries * np.arange(many)[:, None]
            yield np.bincount(drawn.ravel(), minlength=many * queries).reshape(many, queries).astype(float)
            left -= many


def _numbers(rows: Sequence[Row], draws: _Draws) -> dict[str, Any]:
    placed = [row for row in rows if row.distance_m is not None]
    metres = [row.distance_m for row in placed if row.distance_m is not None]
    floor = [row.distance_floor_m for row in placed if row.distance_floor_m is not None]
    sought = [row.goal_reachable for row in placed if row.goal_reachable is not None]
    numbers: dict[str, Any] = {"n": len(rows), "n_placed": len(placed)}
    numbers["match"] = draws.mean(rows, [row.match for row in rows], numbers, "match_ci")
    numbers["distance_mean_m"] = draws.mean(placed, metres, numbers, "distance_mean_ci")
    numbers["distance_median_m"] = _rounded(np.median(metres)) if metres else None
    numbers["distance_floor_mean_m"] = _mean(floor)
    numbers["success"], numbers["success_ci"] = {}, {}
    for radius in RADII_M:
        within = [_within(row, float(radius)) for row in rows]
        numbers["success"][radius] = draws.mean(rows, within, numbers["success_ci"], radius)
    numbers["goal_reachable"] = _mean(sought)
    numbers["llm_calls"] = _mean([row.llm_calls for row in rows])
    numbers["tokens"] = _mean([row.tokens for row in rows])
    numbers["seconds_median"] = _rounded(np.median([row.seconds for row in rows]))
    return numbers


def _differences(pairs: Sequence[tuple[Row, Row]], draws: _Draws) -> dict[str, Any]:
    placed = [(a, b) for a, b in pairs if a.distance_m is not None and b.distance_m is not None]
    metres = [(a.distance_m or 0.0) - (b.distance_m or 0.0) for a, b in placed]
    within = [float(_within(a, 1.0)) - float(_within(b, 1.0)) for a, b in pairs]
    numbers: dict[str, Any] = {"n": len(pairs), "n_placed": len(placed)}
    matched = [float(a.match) - float(b.match) for a, b in pairs]
    numbers["match"] = draws.mean([a for a, _ in pairs], matched, numbers, "match_ci")
    numbers["success_1m"] = draws.mean([a for a, _ in pairs], within, numbers, "success_1m_ci")
    numbers["distance_m"] = draws.mean([a for a, _ in placed], metres, numbers, "distance_ci")
    return numbers


def _faults(rows: Sequence[Row]) -> dict[str, Any]:
    """Nothing where the run has no ``KNOWS`` to tell what was listed."""
    listed = {row.case: row.match for row in rows if row.method == KNOWS}
    counts: dict[str, Any] = {}
    for row in rows:
        if row.method not in GROUPS["the paper's method"] or row.case not in listed:
            continue
        fault = "words" if listed[row.case] else "detector"
        if row.match:
            fault = "none" if _within(row, 1.0) else "index"
        kinds = counts.setdefault(row.method, {kind: dict.fromkeys(FAULTS, 0) for kind in TYPES})
        kinds[row.type][fault] += 1
    return counts


def _pairs(left: Sequence[Row], right: Sequence[Row]) -> list[tuple[Row, Row]]:
    other = {row.case: row for row in right}
    return [(row, other[row.case]) for row in left if row.case in other]


def _within(row: Row, radius_m: float) -> bool:
    return row.distance_m is not None and row.distance_m <= radius_m


def _ratio(sums: Floats, counts: Floats) -> Floats:
    """Sums over counts; NaN where a draw holds nothing of a method, which the interval then leaves out."""
    return np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0)


def _mean(values: Sequence[float]) -> float | None:
    return _rounded(np.mean(values)) if values else None


def _rounded(value: Any) -> float:
    return round(float(value), DIGITS) + 0.0  # + 0.0: never -0.0
