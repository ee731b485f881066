"""Order of a fleet's tasks: each to one worker at a time; what others have claimed is looked at again later."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from cartier_fleet.jobs import Task
from cartier_fleet.worker import Outcome

MAX_TRIES = 30  # of one task in one run; a claim or a failure in the store ends it long before


@dataclass
class Watched:
    """A claim of somebody else's: which version was seen, and since when (s, of this process's own clock)."""

    version: str
    since_s: float


@dataclass
class Scheduler:
    """Gives out tasks and takes their outcomes. Times are seconds of any clock that never goes back."""

    tasks: Iterable[Task]
    lease_s: float
    outcomes: dict[str, Outcome] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._waiting = deque(self.tasks)
        self._watched = dict[str, Watched]()
        self._tries = dict[str, int]()
        self.total, self._out = len(self._waiting), 0

    @property
    def ended(self) -> bool:
        return not self._waiting and not self._out

    def next(self, now_s: float) -> tuple[Task, str | None] | None:
        """A task to try now, with the version of a claim that is stale; None where there is none at the moment."""
        for _ in range(len(self._waiting)):
            task = self._waiting.popleft()
            watched = self._watched.get(task.name)
            if watched is None or now_s - watched.since_s >= self.lease_s:
                self._out += 1
                return task, None if watched is None else watched.version
            self._waiting.append(task)
        return None

    def took(self, task: Task, outcome: Outcome, now_s: float) -> None:
        """What became of a task that was given out."""
        self._out -= 1
        tries = self._tries[task.name] = self._tries.get(task.name, 0) + 1
        if outcome.state == "busy":
            self._watched[task.name] = Watched(outcome.version, now_s)
        elif outcome.state not in ("again", "died", "unplaced") or tries >= MAX_TRIES:
            self.outcomes[task.name] = outcome
            return
        else:
            self._watched.pop(task.name, None)
        self._waiting.append(task)
