"""``cartier live`` as people run it: in another process, ended by signals and kills, served meanwhile."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from cartier import Live, plugins
from cartier.cli import app
from cartier.errors import CartierError
from cartier.home import Home
from cartier.io.spool import Spool
from cartier.pipeline import map_home
from cartier.plugins import open_recording
from cartier.sources import open_source
from cartier.specs import detector, detector_for
from serving.browsing import chromium
from serving.conftest import free_port
from studio import saved_studio

ENV = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
DOLLHOUSE = "dollhouse:studio@max"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the dollhouse, whose objects the default detector knows."""
    return saved_studio(tmp_path_factory.mktemp("live") / "studio")


def begun(*args: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "cartier", "live", *map(str, args)]
    return subprocess.Popen(command, env=ENV, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def until(done: Any, process: subprocess.Popen[str], limit_s: float = 60) -> None:
    end = time.monotonic() + limit_s
    while not done():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.05)


def kept(spool: Path) -> int:
    return len(Spool(spool).keyframes()) if spool.exists() and spool.stat().st_size else 0


def test_a_played_recording_gives_the_home_of_map(folder: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["live", str(tmp_path / "home"), "--from", f"bag:{folder}@max", "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout.splitlines()[-1])
    recording = open_recording(folder)
    mapped = map_home(recording, detector(detector_for(recording)[0], recording))
    assert told["phase"] == "ended" and told["frames_in"] == len(recording) and not told["dropped"]
    home = Home.load(tmp_path / "home")
    assert [(o.label, o.position, o.box_max) for o in home.objects] == [
        (o.label, o.position, o.box_max) for o in mapped.objects
    ]
    assert told["id"] == home.id and told["names"] == list(home.names)


def test_it_goes_on_after_a_kill(folder: Path, tmp_path: Path) -> None:
    home, spool = tmp_path / "home", tmp_path / "home.spool"
    process = begun(home, "--from", f"bag:{folder}@4")
    until(lambda: kept(spool) >= 3, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    before = kept(spool)
    assert before >= 3 and not Spool(spool).ended
    result = CliRunner().invoke(app, ["live", str(home), "--from", f"bag:{folder}@max"])
    assert result.exit_code == 0, result.output
    assert f"{before} keyframes of {spool}" in result.stderr
    assert "detector: embedded" in result.stderr and "WRONG DETECTOR" not in result.stderr
    assert Spool(spool).ended and kept(spool) > before
    assert Home.load(home).objects
    again = CliRunner().invoke(app, ["live", str(home), "--from", f"bag:{folder}@max"])
    assert again.exit_code == 1 and "session that ended: --append goes on" in str(again.exception)


def test_it_serves_the_latest_map_and_ends_by_a_signal(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("uvicorn", reason="needs cartier[serve]")
    port = free_port()
    process = begun(
        tmp_path / "home", "--from", f"bag:{folder}@0.2", "--serve", "--port", port, "--reasoner", "embedded"
    )
    url = f"http://127.0.0.1:{port}/api/homes/home"
    state: dict[str, Any] = {}

    def answers() -> bool:
        try:
            state.update(httpx.get(f"{url}/live").json()["live"])
        except httpx.HTTPError:
            return False
        return bool(state["confirmed"])

    until(answers, process)
    assert state["phase"] == "mapping" and len(state["camera"]) == 3
    asked = httpx.post(f"{url}/ask", json={"words": "is there a swimming pool?"}, timeout=30).json()
    assert asked["as_of"]["not_seen_yet"] and asked["text"].startswith("Not seen yet")
    assert asked["notes"][0].startswith("as of ")
    assert httpx.get(f"{url}/objects").json()["as_of"]["floor_seen"] < 0.9
    refused = httpx.get(f"{url}@0123456789ab/objects")
    assert refused.status_code >= 400 and "has grown" in refused.text
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "cartier ask" in out
    assert Spool(tmp_path / "home.spool").ended and Home.load(tmp_path / "home").objects


def test_the_page_follows_the_map_and_the_camera(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("uvicorn", reason="needs cartier[serve]")
    port = free_port()
    with chromium() as browser:
        process = begun(
            tmp_path / "flat", "--from", f"bag:{folder}@0.12", "--serve", "--port", port, "--reasoner", "embedded"
        )
        until(lambda: reachable(f"http://127.0.0.1:{port}/api/homes"), process)
        tab = browser.new_page()
        tab.goto(f"http://127.0.0.1:{port}/")
        tab.wait_for_selector("html[data-ready]")
        until(lambda: tab.text_content("#live").startswith("Mapping now"), process)
        assert tab.title() == "flat · cartier"
        assert not tab.locator("#name-home").is_visible(), "it cannot be corrected before it is whole"
        objects = "data.objects.filter((t) => t.confirmed).map((t) => t.id)"
        first, before, (one, *_) = (tab.evaluate(what) for what in ("data.home_id", "plan.camera", objects))
        assert tab.locator("#plan .sight").count() == 1
        tab.evaluate(f"choose({one})")
        tab.evaluate("plan.zoom(0.5)")
        width = tab.evaluate("plan.view.w")
        until(lambda: tab.evaluate("data.home_id") != first and tab.evaluate("plan.camera") != before, process)
        assert tab.evaluate("chosen") == one, "what was chosen stays chosen"
        assert tab.evaluate("plan.view.w") == width, "the plan keeps its size"
        tab.evaluate("choose(null)")
        tab.fill("#words", "is there a swimming pool?")
        tab.press("#words", "Enter")
        until(lambda: tab.text_content("#turns .robot:last-child").startswith("Not seen yet"), process)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        tab.locator("#live.past", has_text="does not answer").wait_for()


def reachable(url: str) -> bool:
    try:
        return httpx.get(url).status_code == 200
    except httpx.HTTPError:
        return False


@pytest.mark.parametrize(
    ("args", "fault"),
    [
        (["--from", "bag:{tmp}/none"], "none"),
        (["--from", "rtsp://camera"], "rtsp"),
        (["--from", "teleport:x"], "teleport"),
        (["--from", DOLLHOUSE, "--append"], "home"),
        (["--from", f"exec:{shlex.quote(sys.executable)} -c 1", "--detector", "ground_truth"], "simulator"),
    ],
)
def test_what_cannot_be_mapped_is_one_line(args: list[str], fault: str, tmp_path: Path) -> None:
    given = [word.format(tmp=tmp_path) for word in args]
    result = CliRunner().invoke(app, ["live", str(tmp_path / "home"), *given])
    assert result.exit_code == 1 and isinstance(result.exception, CartierError), result.output
    assert fault in str(result.exception) and "\n" not in str(result.exception)
    assert not (tmp_path / "home").exists()


def test_the_recording_of_a_simulator_stays_one(tmp_path: Path) -> None:
    source = open_source(DOLLHOUSE, width=64, height=48, max_frames=4)
    live = Live(source, plugins.make("detectors", "embedded"), spool=tmp_path / "home.spool")
    live.start()
    live.wait()
    spooled = open_recording(tmp_path / "home.spool")
    assert any(note.startswith("a simulation") for note in spooled.notes)
    assert detector_for(spooled)[0] == "embedded"
