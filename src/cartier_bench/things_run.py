"""Suite things: each request with the map, with names only, and blind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cartier.contracts import Reasoner
from cartier.conversation import Conversation
from cartier.errors import BackendError, InputError
from cartier.home import Home
from cartier.types import Answer, Fact, Inventory, Selection, TrueObject
from cartier_bench.batch import PromptWriter
from cartier_bench.maps import Maps, MapSettings, encoder_for
from cartier_bench.methods import Yardstick, drawing
from cartier_bench.suite import Case, Progress, Row, Suite, silent
from cartier_bench.things import WRITTEN, Given, Item, Score, load_items, score
from cartier_bench.things_made import make_items
from cartier_bench.things_report import report
from cartier_bench.true_home import true_home

HOMES = tuple(str(number) for number in range(80001, 80013))
"""Generated homes that nothing was fitted on; the requests written by hand are about these."""
DETECTORS = ("ground_truth", "embedded")
RUNS = ("map", "names only", "blind")
SETS = ("all", "made", "written")


@dataclass(frozen=True)
class ThingsSettings:
    """What is asked, of whom, where."""

    homes: tuple[str, ...] = HOMES
    detectors: tuple[str, ...] = DETECTORS
    queries: str = "all"
    world: str = "dollhouse"
    seed: int = 0
    suite: str = "things"
    runs: tuple[str, ...] = RUNS


class NamesOnly:
    """A reasoner that sees the names of a home's objects and nothing else; of several of a name, the index takes
    one."""

    def __init__(self, reasoner: Reasoner) -> None:
        self._reasoner, self.name = reasoner, f"{reasoner.name}, names only"

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        chosen = self._reasoner.select(query, Inventory.of(inventory.names), dialogue)
        fact = replace(chosen.fact, objects=()) if chosen.fact else None  # its ids are of no map
        return replace(chosen, object_id=None, fact=fact, next=())

    def propose(self, query: str) -> list[str]:
        return self._reasoner.propose(query)


def blind(item: Item, seed: int) -> Yardstick:
    """No reasoner and no map: any of the home's objects; to a question the likeliest answer, or any of the names it
    could be."""
    rng = drawing(seed, item.id)

    def choose(query: str, inventory: Inventory) -> Selection:
        objs = [obj for obj in inventory.objects if obj.confirmed]
        obj = objs[int(rng.integers(len(objs)))]
        rooms = [room.name for room in inventory.rooms] or ["room"]
        named = [name for name in inventory.names if name in query] or [obj.label]
        guesses: dict[str, Any] = {
            "count": 1, "exists": True, "where": rooms[int(rng.integers(len(rooms)))], "list": (obj.label,),
            "compare": named[int(rng.integers(len(named)))],
        }  # fmt: skip
        if item.kind in guesses:
            return Selection("answered", text="a guess", fact=Fact(item.kind, guesses[item.kind]))  # type: ignore[arg-type]
        return Selection("found", obj.label, "drawn at random", object_id=obj.id)

    return Yardstick("blind", choose)


def homes_of(queries: str) -> tuple[str, ...]:
    """The homes that a set of requests, or a file of them, is about."""
    return HOMES if queries in SETS else tuple(dict.fromkeys(item.home for item in load_items(queries)))


def requests(settings: ThingsSettings, maps_folder: Path, progress: Progress = silent) -> list[Item]:
    """What is asked: requests made from the truth of each home, and those written by hand for it; or a file's, in its
    homes.

    Raises InputError if a file's request is of another home, or accepts what is not in its home.
    """
    world = Maps(maps_folder, MapSettings(settings.world)).world
    if settings.queries not in SETS:
        items = load_items(settings.queries)
        lost = [item for item in items if item.home not in settings.homes]
        if lost:
            raise InputError(
                f"request {lost[0].id!r} is about {lost[0].home}: add that to --homes ({','.join(settings.homes)})"
            )
    else:
        items = []
        for home in settings.homes if settings.queries != "written" else ():
            items += make_items(true_home(world, home, settings.seed, maps_folder, progress), settings.seed)
        if settings.queries != "made":
            items += [item for item in load_items(WRITTEN) if item.home in settings.homes]
    for home in settings.homes:
        known = {obj.id for obj in world.objects(home)}
        for item in items:
            strange = set(item.accept_ids) - known if item.home == home else ()
            if strange:
                raise InputError(f"request {item.id!r}: {home} has no object with the id {min(strange)}")
    if not items:
        raise InputError(f"there is nothing to ask in {', '.join(settings.homes)}")
    return items


def things(settings: ThingsSettings, items: Sequence[Item], reasoner: Reasoner, maps_folder: Path) -> Suite:
    """The suite: each request by each detector's map, with names only, and blind."""
    maps = {
        detector: Maps(
            maps_folder, MapSettings(settings.world, detector, encoder_for(detector), settings.seed), ("object_depth",)
        )
        for detector in settings.detectors
    }
    truth = _truths(settings, maps_folder)
    return _suite(
        settings, items, reasoner.name,
        [
            Case((detector, item.id, how), (detector, item.home), item, how)
            for detector in settings.detectors for item in items for how in settings.runs
        ],
        lambda place, progress: maps[place[0]].get(place[1], progress),
        lambda home, case: answer_row(home, case.item, case.method, reasoner, settings.seed, truth[case.item.home]),
    )  # fmt: skip


def answered(
    settings: ThingsSettings, items: Sequence[Item], answers: Mapping[str, Given], name: str, maps_folder: Path
) -> Suite:
    """The suite of another system's answers; a request without one counts as wrong."""
    truth = _truths(settings, maps_folder)
    return _suite(
        settings, items, name,
        [Case((name, item.id, "answers"), item.home, item) for item in items],
        lambda place, progress: truth[place],
        lambda known, case: _row(case.item, answers.get(case.item.id, Given(case.item.id, "none")), known),
    )  # fmt: skip


def _suite(
    settings: ThingsSettings, items: Sequence[Item], who: str, cases: Sequence[Case],
    open: Callable[[Any, Progress], Any], answer: Callable[[Any, Case], Row],
) -> Suite:  # fmt: skip
    return Suite(
        who=who, settings=settings, items=items, keys=("detector", "id", "run"), cases=cases, open=open,
        row=lambda there, case: {"detector": case.key[0], "run": case.key[2]} | answer(there, case),
        report=lambda rows: report(rows, items, who),
    )  # fmt: skip


def _truths(settings: ThingsSettings, maps_folder: Path) -> dict[str, dict[int, TrueObject]]:
    world = Maps(maps_folder, MapSettings(settings.world)).world
    return {home: {obj.id: obj for obj in world.objects(home)} for home in settings.homes}


def answer_row(home: Home, item: Item, how: str, reasoner: Reasoner, seed: int, truth: Mapping[int, TrueObject]) -> Row:
    """A row of the results: the answer to one request in a home (``how`` is one of ``RUNS``), and whether it is
    right."""
    thinks = {"map": reasoner, "names only": NamesOnly(reasoner), "blind": blind(item, seed)}[how]
    talk, answers = Conversation(home, thinks), list[Answer]()
    before = reasoner.unanswered if isinstance(reasoner, PromptWriter) else 0
    try:
        for turn in item.turns:
            answers.append(talk.say(turn))
            if isinstance(reasoner, PromptWriter) and reasoner.unanswered > before:
                break  # what the next turn is asked with depends on the reply
    except BackendError as error:  # it chose what it was not shown: wrong, and the run goes on
        return _row(item, Given(item.id, "refused"), truth) | {"note": str(error)}
    return _row(item, _given(item, answers, home), truth) | {
        "object": answers[-1].selection.object, "object_id": answers[-1].selection.object_id,
        "goal_reachable": None if answers[-1].place is None else answers[-1].goal is not None,
        "seconds": round(answers[-1].timing_ms.get("select", 0.0) / 1e3, 4), "note": answers[-1].selection.reason,
    }  # fmt: skip


def _given(item: Item, answers: Sequence[Answer], home: Home) -> Given:
    """Our own answer in the form in which any system's is scored."""
    last, chosen = answers[-1], answers[-1].selection
    before = answers[-2].place.position if len(answers) > 1 and answers[-2].place else None
    at = last.place.position if last.place and chosen.status in ("found", "likely_near") else None
    told = _value(chosen.fact, home) if chosen.fact and chosen.fact.kind == item.kind else None
    say = f"{chosen.text} {chosen.reason}".strip()
    return Given(item.id, chosen.status, at, told, chosen.question or "", say, before)


def _value(fact: Fact, home: Home) -> Any:
    """What a fact says; of an object without a room, the names of what holds it."""
    if fact.kind == "where" and fact.value is None:
        labels = {obj.id: obj.label for obj in home.objects}
        return [labels[i] for i in fact.objects[1:] if i in labels]
    return list(fact.value) if isinstance(fact.value, tuple) else fact.value


def _row(item: Item, given: Given, truth: Mapping[int, TrueObject]) -> Row:
    result: Score = score(item, given, truth)
    at = list(given.at) if isinstance(given.at, tuple) else given.at
    far = None if result.distance_m is None or not np.isfinite(result.distance_m) else round(result.distance_m, 4)
    return {
        "id": item.id, "home": item.home, "kind": item.kind, "status": given.status, "right": result.right, "at": at,
        "answer": given.answer, "question": given.question, "text": given.text, "distance_m": far, "f1": result.f1,
    }  # fmt: skip
