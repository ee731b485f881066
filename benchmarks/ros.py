"""ROS 2 as it runs: which topics and goals pass, and whether every drive that is interrupted is cancelled.

    python benchmarks/ros.py                  the table of tests/ros, a row a distribution
    python benchmarks/ros.py --stop 40        SIGINT at 40 random moments of drives, over rclpy and over DDS, and at 10
                                              random moments from before the robot is found
    python benchmarks/ros.py --transcript     a drive that is stopped at four moments
    python benchmarks/ros.py --delay          seconds from an image's stamp until the map of ``live`` answers with it:
                                              640x480 at 10 Hz by rclpy, of a walk that was rendered before
    python benchmarks/ros.py --received       images of the played robot that rclpy gets as sensor data (best effort),
                                              as it renders them, and at 10 Hz of pictures that were rendered before

``python tests/ros/build.py`` builds the distributions, once. Each process has a DDS domain of this machine alone.
"""

from __future__ import annotations

import itertools
import math
import os
import random
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests/ros"), str(ROOT / "tests/robots"), str(ROOT / "tests")]
import pytest  # noqa: E402
from command_line import Parser, run_script  # noqa: E402

if TYPE_CHECKING:
    from rospeers import Ros

CELLS = ("raw", "compressed", "compressedDepth", "16UC1", "32FC1", "CameraInfo", "Odometry", "tf", "tf_static",
         "detections", "objects out", "ask", "goal out", "accepted", "refused", "aborted", "cancelled")  # fmt: skip
LATEST_S = 1.0  # a server must have the request to cancel by then
COUNT_S, LEAST = 12, 0.8  # how long images are counted, and the share that must come
WALK_S, P50_S, P95_S = 30.0, 1.5, 3.0  # how long the robot sends, and how late its frames may be


def main() -> int:
    parser = Parser(__doc__)
    parser.add_argument("--stop", type=int, metavar="N", help="interrupt so many drives by each way")
    parser.add_argument("--transcript", action="store_true", help="show a drive that is stopped at four moments")
    parser.add_argument("--delay", action="store_true", help="measure how late the map of live is")
    parser.add_argument("--received", action="store_true", help="count the images that rclpy gets of the played robot")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    options = parser.parse_args()
    from rospeers import DISTRIBUTIONS, missing

    there = [name for name in DISTRIBUTIONS if not missing(name)]
    if not there:
        sys.exit(f"{sys.argv[0]}: {missing(DISTRIBUTIONS[0])}")
    if options.transcript:
        return transcript(there[-1])
    if options.received:
        return received(there)
    if options.delay:
        return delay(there)
    if options.stop is not None:
        return stop(there, options.stop, random.Random(options.seed))
    return table(there)


class Cells:
    """How the tests of each cell of the table ended."""

    def __init__(self) -> None:
        self.ended: dict[tuple[str, str], bool] = {}
        self.failed: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        _, _, name = report.nodeid.rstrip("]").partition("[")
        distribution, _, rest = name.partition("-")
        for cell in CELLS:
            if report.when == "call" and cell in rest.replace("+", "-").split("-"):
                key = distribution, cell
                self.ended[key] = self.ended.get(key, True) and report.passed
        if report.failed:
            self.failed.append(report.nodeid)


def table(distributions: list[str]) -> int:
    """Run the tests and print how each cell ended; 1 if any is not green."""
    cells = Cells()
    pytest.main(["-q", "-n", "0", "-m", "", "--no-header", "--tb=short", str(ROOT / "tests/ros")], [cells])
    print(f"\n{'':16}" + "".join(f"{name:>9}" for name in distributions))
    for cell in CELLS:
        ended = [cells.ended.get((name, cell)) for name in distributions]
        print(
            f"{cell:16}" + "".join(f"{'not run' if each is None else 'ok' if each else 'FAILS':>9}" for each in ended)
        )
    print(f"{len(cells.failed)} tests failed {' '.join(cells.failed)}")
    return int(bool(cells.failed) or len(cells.ended) < len(CELLS) * len(distributions))


def stop(distributions: list[str], count: int, moments: random.Random) -> int:
    """Interrupt drives, a row a way; 1 if a robot drove on, or was asked to stop too late."""
    from rospeers import WAYS, Ros

    names, widths = ("cancelled", "never sent", "arrived", "late", "lost"), (10, 12, 9, 6, 6)
    heads = "".join(f"{name:>{width}}" for name, width in zip(names, widths, strict=True))
    print(f"{'':6}{heads}   seconds until the robot is asked: median, most")
    bad = 0
    for way in WAYS:
        counts, took = dict.fromkeys(names, 0), list[float]()
        for k in range(count + count // 4):
            ros = Ros(distributions[k % len(distributions)])
            word, span_s = ("driving", 1.8) if k < count else ("made", 3.5)  # the drive takes two seconds
            ended, asked_s = _interrupted(ros, way, word, moments.uniform(0.0, span_s))
            ros.close()
            took += [asked_s] if ended == "cancelled" else []
            counts["late" if ended == "cancelled" and asked_s > LATEST_S else ended] += 1
        bad += counts["late"] + counts["lost"]
        row = "".join(f"{counts[name]:>{width}}" for name, width in zip(names, widths, strict=True))
        print(
            f"{way:6}{row}   {statistics.median(took or [math.nan]):.2f} {max(took, default=math.nan):.2f}", flush=True
        )
    return int(bad > 0)


def _interrupted(ros: Ros, way: str, word: str, after_s: float) -> tuple[str, float]:
    """How a drive ends that is interrupted so long after a word, and when the robot was asked to stop (s later)."""
    from rospeers import Drive, Event

    with ros.peer("nav_server.py", "drives", 120, 1.0) as server:
        drive = Drive(ros, way)
        drive.until(word)
        time.sleep(after_s)
        sent_s = drive.signal()
        code, said = drive.end()
        time.sleep(0.5)  # a goal that was sent all the same would begin
        robot = {event.words.split(" map")[0]: event.time_s for event in map(Event.of, server.so_far())}
    if "goal" not in robot:
        return "never sent", math.nan
    if "succeeded" in robot and "arrived" in said:
        return "arrived", math.nan
    if "cancelled" in robot and "cancelled" in said and code == 130:
        return "cancelled", robot["asked to cancel"] - sent_s
    print(f"  {ros.distribution} {way} {after_s:.2f} s after {word!r}: {code} {said}; {robot}", file=sys.stderr)
    return "lost", math.nan


def delay(distributions: list[str]) -> int:
    """Map what rclpy sends; 1 if half of the frames are late, or one in twenty is too late."""
    from dataclasses import replace

    import live_check
    from peers import LOOPBACK
    from rospeers import Ros

    from cartier import Live, plugins
    from cartier.recordings.folder import save
    from cartier.sources import open_source
    from cartier.specs import detector
    from cartier.types.streams import Stamped
    from live import Walk

    class ByStamp:
        """A source whose frames arrive when they are taken, and how long after that they are whole."""

        def __init__(self, source: Any) -> None:
            self._source, self.whole_s = source, list[float]()

        def __getattr__(self, name: str) -> Any:
            return getattr(self._source, name)

        def __iter__(self) -> Iterator[Any]:
            for event in self._source:
                if isinstance(event, Stamped):
                    self.whole_s.append(time.time() - event.stamp_ns / 1e9)
                    event = replace(event, received_s=time.monotonic() - self.whole_s[-1])
                yield event

    os.environ["CYCLONEDDS_URI"], bad = LOOPBACK, 0
    with tempfile.TemporaryDirectory() as folder:
        save(Walk("studio", WALK_S, 640, 480, hz=10), Path(folder) / "walk")
        walk = plugins.open_recording(Path(folder) / "walk")
        with live_check.Log(Path(folder) / "log") as log:
            live_check.tell(walk, live_check.SOUND["plain"], log)
        for name in distributions:
            ros = Ros(name)
            source = ByStamp(open_source("ros2", domain=ros.domain))
            session, begin = Live(source, detector("embedded", walk)), os.times()
            session.start()
            ros.cartier("rclpy", ROOT / "tests/ros/play_log.py", Path(folder) / "log").wait()
            time.sleep(1)
            state, end = session.state(), os.times()
            cores = (end.user + end.system - begin.user - begin.system) / (end.elapsed - begin.elapsed)
            session.stop()
            ros.close()
            p50_s, p95_s = state.delay_p50_s or math.inf, state.delay_p95_s or math.inf
            bad += p50_s > P50_S or p95_s > P95_S
            print(f"{name}: {state.frames_in} frames of {len(walk)}, delay p50 {p50_s:.2f} s, p95 {p95_s:.2f} s; "
                  f"{state.keyframes} keyframes, {state.looked} looked at, {state.postponed} put off; left out "
                  f"{dict(state.dropped)}; frames whole after {statistics.median(source.whole_s):.2f} s; it had "
                  f"{cores:.1f} cores", flush=True)  # fmt: skip
    return int(bad > 0)


def received(distributions: list[str]) -> int:
    """Count what rclpy gets of the played robot's images; 1 if a fifth of any is lost."""
    from types import SimpleNamespace

    from rospeers import Ros

    from cartier_dollhouse.recording import lit_renderer
    from cartier_dollhouse.scene import load_home
    from cartier_ros.robots import played

    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"], bad = "LOCALHOST", 0
    home = load_home("studio")
    renderer = lit_renderer(home, played.pinhole())
    views = itertools.cycle([renderer.render(played.look((2.0, 2.0), k * 0.6, played.DOWN)) for k in range(10)])
    looped = lambda scene, camera: SimpleNamespace(render=lambda pose: next(views))  # noqa: E731

    for makes, says in ((lit_renderer, "as it renders them"), (looped, "at 10 Hz")):
        for name in distributions:
            ros = Ros(name)
            played.lit_renderer = makes
            robot = played.PlayedRobot(home, ros.domain)
            running = threading.Thread(target=robot.run)
            running.start()
            counts = ros.cartier("rclpy", ROOT / "tests/ros/count.py", COUNT_S).communicate()[0].split()
            robot.close()
            running.join()
            colour, depth, infos, sent = map(int, counts[-4:])
            bad += min(colour, depth, infos) < LEAST * sent
            print(f"{name:7} {says:18} {sent / COUNT_S:4.1f} a second: of {sent}, {colour} images, {depth} of depth, "
                  f"{infos} CameraInfos", flush=True)  # fmt: skip
    return int(bad > 0)


def transcript(distribution: str) -> int:
    """Show what the program and the robot say of a drive that is stopped before, at and after its acceptance."""
    from rospeers import Drive, Event, Ros, heard_by

    moments = (
        ("before it is accepted", "hesitates", "made"),
        ("as it is accepted", "drives", "driving accepted"),
        ("on the way, twice", "drives", "driving 1."),
        ("of a drive that cannot be stopped", "deaf", "driving 1."),
    )
    for says, form, word in moments:
        print(f"== Ctrl-C {says}")
        ros = Ros(distribution)
        with ros.peer("nav_server.py", form, 60) as server:
            drive = Drive(ros, "rclpy")
            drive.until(word)
            robot = [heard_by(server, "hesitates")] if form == "hesitates" else []
            sent_s = drive.signal()
            if "twice" in says:
                time.sleep(0.05)
                drive.signal()
            code, _ = drive.end()
            time.sleep(0.2)
            robot += [Event.of(line) for line in server.so_far()]
        ros.close()
        lines = [(e.time_s, "cartier", e.words) for e in drive.said] + [(e.time_s, "robot", e.words) for e in robot]
        for time_s, who, words in sorted([*lines, (sent_s, "person", "Ctrl-C")], key=lambda line: line[0]):
            print(f"{time_s - sent_s:+7.2f} s  {who:8} {words}")
        print(f"exit code {code}\n", flush=True)
    return 0


if __name__ == "__main__":
    run_script(main)
