"""Live session: frames in, a home that grows, snapshots that answer meanwhile.

Five threads: one listens, one takes in depth and picks keyframes, one detects, one makes snapshots, one maps again what
corrected poses moved. A frame that comes while the computer is busy is left out and counted, and a keyframe for which
the detector has no time is looked at when the stream has ended; a source that can wait is held up instead. Keyframes
are on the disk before they are counted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from cartier.contracts import Detector, Encoder, Reasoner, Source, SourceDefaults, optional
from cartier.errors import InputError, brief
from cartier.home import Home
from cartier.live.answers import as_of, check_epoch
from cartier.live.growing import GrowingMap
from cartier.live.level import Level
from cartier.live.queues import Bounded
from cartier.live.state import LiveState, Tally, planar
from cartier.mapping.config import MappingConfig
from cartier.mapping.keyframes import sharpness
from cartier.pipeline import ask
from cartier.spatial.floor_seen import floor_seen
from cartier.types import Answer, AsOf, Goal
from cartier.types.streams import Fault, PoseUpdate, Stamped

INBOX, KEYFRAMES = 8, 2  # frames and keyframes that wait
DEPTH_HZ, DEPTH_BURST = 10.0, 3.0  # how often depth is taken, and how many frames may come close together
SNAPSHOT_S, SNAPSHOT_SHARE = 1.0, 0.25  # how often a snapshot is made, and which share of the time it may take
TICK_S = 0.05
CLOSE_S = 10.0  # how long a source may take to end once it was closed
ALIGN_FROM, ALIGN_MORE = 10, 1.5  # keyframes from which aligning is tried, and times as many before it is again


class Live:
    """Maps a home while its frames are taken.

    Args:
        source: Where the frames come from: ``make("sources", …)``, or ``cartier.sources.open_source``.
        detector: Detects the objects.
        spool: A file in which each keyframe is kept. If a session was cut off, it goes on from there.
        onto: A home to grow; its pose frame must be that of the source.
        indexes, encoder, config: As for ``Mapper``.
        every: As for ``map_home``.
        align: Whether the source has a frame of its own, and its map is to be moved onto ``onto`` as soon as objects
            and walls agree where it lies. Until then, answers come from it alone.

    Raises:
        InputError: The spool or ``onto`` belongs to another detector.

    Example:
        >>> import cartier
        >>> source = cartier.make("sources", "dollhouse", model="studio", speed=0, width=160, height=120, max_frames=12)
        >>> truth = cartier.make("detectors", "ground_truth", truth=source.recording.truth, source="dollhouse")
        >>> live = cartier.Live(source, truth)
        >>> live.start()
        >>> home = live.wait()
        >>> live.state().frames_in, "bed" in home.names
        (12, True)
    """

    def __init__(
        self,
        source: Source,
        detector: Detector,
        *,
        spool: str | Path | None = None,
        onto: Home | None = None,
        indexes: Sequence[str] | None = None,
        encoder: str | Encoder = "embedded",
        config: MappingConfig | None = None,
        every: int | None = None,
        align: bool = False,
    ) -> None:
        self.source = source = Level(source, detector, () if onto is None or align else onto.settings["recordings"])
        path = None if spool is None else Path(spool)
        self._map = GrowingMap(source, detector, path, onto, every, indexes, encoder, config, align)
        self._tally, self._waits = Tally(), bool(optional(source, SourceDefaults, "waits"))
        self._inbox = Bounded[Stamped](INBOX, waits=self._waits)
        self._keyframes = Bounded[Stamped](KEYFRAMES, lambda s: sharpness(s.frame.rgb), waits=self._waits)
        self._threads: list[threading.Thread] = []
        self._changed, self._stopped = threading.Condition(), threading.Event()
        self._home: Home | None = None if align else onto
        self._floor_seen, self._in_map_s, self.frame_epoch = 0.0, list[float](), 0
        self._newest_s: float | None = None
        self._newest: Stamped | None = None
        self._failed: BaseException | None = None
        self._done, self._resumed = False, 0
        self._to_repose, self._correcting = threading.Event(), False

    def start(self, progress: Callable[[int, int], None] | None = None) -> None:
        """Begin to listen. A session that was cut off is mapped from its spool first.

        Args:
            progress: Called after each of its keyframes with their number so far and in all.

        Raises:
            InputError: The spool is damaged.
        """
        self._resumed = self._map.resume(progress)
        steps = (self._listen, self._measure, self._look, self._snapshots, self._reposes)
        self._threads = [threading.Thread(target=self._guarded, args=(step,), daemon=True) for step in steps]
        for thread in self._threads:
            thread.start()

    def home(self) -> Home:
        """The latest snapshot of the map; never waits.

        Returns:
            The home.

        Raises:
            InputError: There is no map yet.
        """
        if self._home is None:
            raise InputError(f"nothing was mapped yet: {self.state().message or 'the first objects are still awaited'}")
        return self._home

    def ask(self, query: str, reasoner: Reasoner | None = None, **options: Any) -> Answer:
        """Answer from the latest snapshot, as ``cartier.ask`` does.

        Args:
            query: What the person says.
            reasoner: Chooses the object; by default the embedded reasoner.
            **options: Those of ``cartier.ask``; ``from_xy`` is where the robot is now, unless it is given.

        Returns:
            The answer. ``as_of`` says of when it is, and how much of the floor was looked at; until that is 90 %, it
            says "not seen yet" where another home's would deny that something is there.

        Raises:
            InputError: There is no map yet, or as ``cartier.ask``.
            ReasonerError, BackendError: As ``cartier.ask``.
        """
        moment = self.moment()  # first, so that a goal is of no older epoch than it says
        home = self.home()
        here = {"from_xy": self.robot_xy() or home.start_xy}
        return as_of(ask(home, query, reasoner, **(here | options)), moment)

    def moment(self) -> AsOf:
        """Of when the latest snapshot is.

        Returns:
            Its age, and how much of the floor was looked at.
        """
        age_s = 0.0 if self._newest_s is None else time.monotonic() - self._newest_s
        return AsOf(round(age_s, 3), round(self._floor_seen, 3), self.frame_epoch, self._correcting)

    def goal_of(self, answer: Answer) -> Goal:
        """The goal of an answer, to drive there.

        Args:
            answer: What ``ask`` gave.

        Returns:
            Its goal.

        Raises:
            InputError: It has none, or the map was moved by corrected poses since.
        """
        if answer.goal is None:
            raise InputError(f"the answer to {brief(answer.query, 60)!r} has no goal")
        check_epoch(answer.as_of.frame_epoch if answer.as_of is not None else 0, self.frame_epoch)
        return answer.goal

    def camera_pose(self) -> list[float] | None:
        """Where the newest frame was taken.

        Returns:
            x, y (m) and yaw (rad) of the camera in the map, or None before the first frame.
        """
        newest = self._newest
        return None if newest is None else planar(self._map.placed(newest))

    def robot_xy(self) -> tuple[float, float] | None:
        """Where the robot is.

        Returns:
            x, y (m) of the newest frame in the map; None before the first one, and until the map is aligned.
        """
        here = None if self._map.apart else self.camera_pose()
        return None if here is None else (here[0], here[1])

    def state(self) -> LiveState:
        """How the session is doing; never waits.

        Returns:
            The state.
        """
        counts, objects = self._tally.counts(), () if self._home is None else self._home.objects
        going = "mapping" if counts.get("frames_in") else "waiting"
        phase = "failed" if self._failed is not None else "ended" if self._done else going
        return LiveState(
            phase=phase, waiting=len(self._keyframes), floor_seen=round(self._floor_seen, 3), objects=len(objects),
            world_frame=optional(self.source, SourceDefaults, "world_frame"),
            confirmed=sum(obj.confirmed for obj in objects), frame_epoch=self.frame_epoch, resumed=self._resumed,
            as_of_s=None if self._newest_s is None else round(time.monotonic() - self._newest_s, 3), **counts,
        )  # fmt: skip

    def stop(self, progress: Callable[[int, int], None] | None = None) -> Home:
        """End the session and the source; frames that wait are still mapped.

        Args:
            progress: As for ``wait``.

        Returns:
            As ``wait``.

        Raises:
            CartierError: As ``wait``.
        """
        self._stopped.set()
        self.source.close()
        return self.wait(progress)

    def wait(self, progress: Callable[[int, int], None] | None = None) -> Home:
        """Wait until the stream ends; then the keyframes are looked at for which there was no time.

        Args:
            progress: Called with how many steps of that are done, and of how many.

        Returns:
            The whole home. If all frames of a recording were mapped, it is that of ``map_home``.

        Raises:
            CartierError: What the source or the detector raised, or nothing was detected.
        """
        if self._threads:
            self._join()
        if self._failed is not None:
            self._map.close()
            raise self._failed
        if not self._done:
            self._tally.add("looked", self._map.catch_up(progress))
            counts = self._tally.counts()
            self._swap(lambda: self._map.finish(counts["dropped"], counts.get("thinned", 0)))
            self._done = True
        assert self._home is not None
        return self._home

    def saved(self) -> None:
        """Say that the home that ``wait`` returned was saved: the spool has ended and is its recording."""
        self._map.end_spool(self.home().id)
        self._map.close()

    def running(self) -> bool:
        """Whether frames are still taken in.

        Returns:
            False once the stream has ended and all is mapped, or if it failed.
        """
        return self._failed is None and any(thread.is_alive() for thread in self._threads)

    def _join(self) -> None:
        """Wait for the threads; for a source that was closed and does not end, only so long."""
        listener, *others = self._threads
        while listener.is_alive() and not self._stopped.is_set():
            listener.join(TICK_S)
        listener.join(CLOSE_S)
        if listener.is_alive():
            self._tally.fault(Fault("ended", f"{self.source.name} was closed and does not end: it is left alone"))
            self._inbox.close()
        for thread in others:
            thread.join()

    def _guarded(self, step: Callable[[], None]) -> None:
        """Run a thread's work; what it raises ends the session."""
        try:
            step()
        except BaseException as error:
            self._failed = self._failed or error
            self._stopped.set()
            self._inbox.close()
            self._keyframes.close()
            self.source.close()
        finally:
            {"_listen": self._inbox.close, "_measure": self._keyframes.close}.get(step.__name__, lambda: None)()

    def _listen(self) -> None:
        for event in self.source:
            if isinstance(event, Stamped):
                self._tally.add("frames_in")
                self._map.heard(event)
                self._newest = event
                if self._inbox.put(event) is not None:
                    self._tally.fault(Fault("busy", "a frame came before the last ones were taken in", 1))
            elif isinstance(event, PoseUpdate):
                self._tally.add("pose_updates")
                if self._map.correct_poses(event):
                    self._correcting = True
                    self._to_repose.set()
            else:
                self._tally.fault(event)
            if self._stopped.is_set():
                return

    def _measure(self) -> None:
        credit, last_s = DEPTH_BURST, 0.0
        while (stamped := self._inbox.get()) is not None:
            credit = min(credit + (stamped.received_s - last_s) * DEPTH_HZ, DEPTH_BURST)
            last_s = stamped.received_s
            if not self._waits and credit < 1:
                self._tally.add("thinned")
                continue
            credit -= 1
            self._queue(self._map.measure(stamped))
            self._tally.add("measured")
        self._queue(self._map.flush())

    def _queue(self, keyframes: Sequence[Stamped]) -> None:
        for keyframe in keyframes:
            self._map.record(keyframe)
            self._tally.add("keyframes")
            gone = self._keyframes.put(keyframe)
            if gone is not None:
                self._map.postpone(gone)
                self._tally.add("postponed")

    def _look(self) -> None:
        while (stamped := self._keyframes.get()) is not None:
            self._map.look(stamped)
            self._tally.add("looked")
            with self._changed:
                self._in_map_s.append(stamped.received_s)

    def _reposes(self) -> None:
        """Map again, in the background, what corrected poses have moved."""
        tried = ALIGN_FROM / ALIGN_MORE
        while self._goes_on():
            if self._map.apart and self._map.version >= tried * ALIGN_MORE:
                tried = self._map.version
                with suppress(InputError):  # nothing was detected yet
                    if self._map.align():
                        self._swap(self._map.snapshot)
            if self._to_repose.wait(TICK_S):
                self._to_repose.clear()
                while self._map.repose():
                    with suppress(InputError):  # nothing was detected yet
                        self._swap(self._map.snapshot)
                self._correcting = self._to_repose.is_set()
        while self._failed is None and self._map.repose():
            pass
        self._correcting = False

    def _goes_on(self) -> bool:
        """Whether frames may still come into the map."""
        return self._failed is None and any(thread.is_alive() for thread in self._threads[1:3])

    def _snapshots(self) -> None:
        version, due_s = self._map.version - 1, 0.0
        while self._goes_on():
            begin = time.monotonic()
            if self._map.version == version or self._stopped.is_set() or begin < due_s:
                time.sleep(TICK_S)
                continue
            version = self._map.version
            with suppress(InputError):  # nothing was detected yet
                self._swap(self._map.snapshot)
            took_s = time.monotonic() - begin
            due_s = begin + max(SNAPSHOT_S, took_s / SNAPSHOT_SHARE) if self._home is not None else 0.0

    def _swap(self, make: Callable[[], tuple[Home, int]]) -> None:
        """Make a home, and answer from it from now on."""
        with self._changed:
            count = len(self._in_map_s)
        home, epoch = make()
        seen = floor_seen(home.grid)
        with self._changed:
            received_s, self._in_map_s = self._in_map_s[:count], self._in_map_s[count:]
            self._home, self._floor_seen, self.frame_epoch = home, seen, epoch
            self._newest_s = max([*received_s, *([] if self._newest_s is None else [self._newest_s])], default=None)
        now_s = time.monotonic()
        self._tally.answerable([now_s - each for each in received_s])
