"""A fleet's homes served over HTTP and MCP: read when they are asked about, and shown to their own tokens alone."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow", reason="needs pip install '.[test-fleet]'")
pytest.importorskip("duckdb", reason="needs pip install '.[test-fleet]'")
pytest.importorskip("fastapi", reason="needs pip install '.[test-fleet]'")
pytest.importorskip("mcp", reason="needs pip install '.[test-fleet]'")

import httpx
from mcp import Client

import cartier
import cartier_fleet
from cartier import plugins
from cartier.blob_stores import open_store
from cartier.cli.places import home_at
from cartier.errors import InputError
from cartier.home import Home
from cartier.serving import http, mcp_server
from cartier.serving.access import ACCESS, Access
from cartier.serving.operations import Operations
from cartier.serving.over_homes import ask_fleet, overview
from cartier_fleet import served as fleet_homes
from cartier_fleet.jobs import MapSettings, find_tasks
from cartier_fleet.publishing import key_of
from cartier_fleet.served import FleetHomes
from cartier_fleet.worker import Worker
from fleet.tiny import make_recordings, work
from serving.conftest import starting

NAMES = ["flat-1", "flat-2", "nested/flat-0"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rec")
    make_recordings(folder, 3)
    return folder


@pytest.fixture
def filled(recorded: Path, place: str) -> str:
    assert work(open_store(place), find_tasks(recorded)) == ["mapped"] * 3
    return place


def operations(place: str, max_bytes: int = 2**30) -> Operations:
    return Operations(FleetHomes(cartier_fleet.Fleet(place), max_bytes), plugins.make("reasoners", "embedded"))


def asked(ops: Operations, work: Callable[[httpx.AsyncClient], Awaitable[Any]]) -> Any:
    async def run() -> Any:
        transport = httpx.ASGITransport(http.make(ops))
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as web:
            return await work(web)

    return asyncio.run(run())


def test_each_home_answers_as_it_does_alone(filled: str) -> None:
    ops = operations(filled)

    async def check(web: httpx.AsyncClient) -> None:
        assert (await web.get("/api/homes")).json() == {"homes": NAMES}
        for name in NAMES:
            home = cartier_fleet.Fleet(filled).home(name)
            got = (await web.get(f"/api/homes/{name.replace('/', '%2F')}/objects", params={"tentative": True})).json()
            assert (got["home"], got["home_id"]) == (name, home.id) and got["total"] == len(home.objects)
            said = (await web.post(f"/api/homes/{name}/ask", json={"words": "where is the table?"})).json()
            alone = cartier.ask(home, "where is the table?")
            assert said["status"] == alone.selection.status and said.get("text") == alone.selection.text
        for wrong in ("flat-9", "../flat-1", "names", ops.homes._stamp("flat-1")):
            assert (await web.get(f"/api/homes/{wrong}/view")).status_code == 404, wrong
        refused = await web.post("/api/homes/flat-1/corrections", json={"what": "forget", "entity": "chair"})
        assert refused.status_code == 400 and "is published and stays as it is: pull it" in refused.json()["error"]

    asked(ops, check)


def test_questions_over_all_homes_are_those_of_the_fleet(filled: str) -> None:
    async def check(web: httpx.AsyncClient) -> None:
        for words in ("which homes have a table?", "how many tables per home?", "where is the biggest table?"):
            got = (await web.post("/api/fleet/ask", json={"words": words})).json()
            found = cartier_fleet.Fleet(filled).ask(words)
            assert got["text"] == found.text and got["has"] == list(found.has)
            assert got["cannot_tell"] == found.cannot_tell and got["has_none"] == list(found.has_none)
        for bad, status in (({"words": "what is love"}, 400), ({"words": ""}, 400), ({"query": "x"}, 422)):
            got = await web.post("/api/fleet/ask", json=bad)
            assert got.status_code == status and "\n" not in got.json()["error"]

    asked(operations(filled), check)


def test_no_answer_speaks_of_homes_that_a_token_may_not_see(filled: str) -> None:
    ops = operations(filled)
    ops.homes.guarded = True
    whole = cartier_fleet.Fleet(filled).ask("how many tables per home?")
    for pattern, seen in (("flat-*", NAMES[:2]), ("nested/*", NAMES[2:]), ("attic", []), ("*", NAMES)):
        held = ACCESS.set(Access("me", (pattern,)))
        try:
            assert ops.homes.names == seen
            if not seen:
                with pytest.raises(InputError, match="no homes that you may ask about"):
                    ask_fleet(ops, "how many tables per home?")
                continue
            told = ask_fleet(ops, "how many tables per home?")
            assert told["value"] == {home: whole.value[home] for home in seen}
            assert {*told["has"], *told["has_none"], *told["cannot_tell"]} == set(seen)
            assert all(name not in json.dumps(told) for name in set(NAMES) - set(seen))
            biggest = ask_fleet(ops, "where is the biggest table?")
            assert biggest["value"] is None or biggest["value"][0] in seen
            for name in set(NAMES) - set(seen):
                with pytest.raises(InputError, match="there is no home"):
                    overview(ops, name)
        finally:
            ACCESS.reset(held)


def test_homes_are_loaded_on_demand_and_put_away(filled: str, monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = list[str]()
    real = fleet_homes.read
    monkeypatch.setattr(fleet_homes, "read", lambda store, kind: (loaded.append(store.place), real(store, kind))[1])
    homes = FleetHomes(cartier_fleet.Fleet(filled), max_bytes=1)
    assert homes.names == NAMES and loaded == [], "a list of names reads no home"
    for name in NAMES * 2:
        homes.get(name)
        assert sum(slot.home is not None for slot in homes._slots.values()) == 1
    assert len(loaded) == 6
    homes.get(NAMES[-1])
    assert len(loaded) == 6, "the last one is still there"


def test_a_home_that_is_mapped_again_is_read_again(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = open_store(str(tmp_path / "store"))
    task = find_tasks(recorded)[0]
    work(store, [task])
    homes = FleetHomes(cartier_fleet.Fleet(str(tmp_path / "store")))
    assert list(homes.get(task.name).indexes) == ["object_depth", "object_viewpoint"]
    again = MapSettings("ground_truth", every=1, indexes=("object_depth",))
    assert Worker(store, again, "two", 60.0).map(task).state == "mapped"
    monkeypatch.setattr(fleet_homes, "FRESH_S", 0.0)
    assert list(homes.get(task.name).indexes) == ["object_depth"]


def test_agents_read_homes_as_resources(filled: str) -> None:
    ops = operations(filled)

    async def run() -> None:
        async with Client(mcp_server.make(ops)) as client:
            rows = {row.name: str(row.uri) for row in (await client.list_resources()).resources}
            assert [name for name in rows if name in NAMES] == NAMES
            about = json.loads((await client.read_resource(rows["nested/flat-0"])).contents[0].text)
            home = cartier_fleet.Fleet(filled).home("nested/flat-0")
            sure = [obj.label for obj in home.objects if obj.confirmed]
            assert about["home_id"] == home.id and about["objects"] == {n: sure.count(n) for n in sorted(set(sure))}
            with pytest.raises(Exception, match="there is no home 'attic'"):
                await client.read_resource("home://attic")
            got = (await client.call_tool("ask_homes", {"words": "which homes have a table?"})).structured_content
            found = cartier_fleet.Fleet(filled).ask("which homes have a table?")
            assert got == {
                "text": found.text, "has": len(found.has), "has_none": len(found.has_none),
                "cannot_tell": len(found.cannot_tell),
            }  # fmt: skip
            wrong = await client.call_tool("ask_homes", {"words": "what is love"})
            assert wrong.is_error and "no question that I understand" in wrong.content[0].text

    asyncio.run(run())


def test_both_servers_start_from_a_store(filled: str, tmp_path: Path) -> None:
    import httpx2
    from mcp.client.streamable_http import streamable_http_client

    file = tmp_path / "tokens"
    mine, other = "mine-correct-horse-battery", "other-correct-horse-battery"
    file.write_text(f"{mine} flat-1\n{other} nested/*\n")
    file.chmod(0o600)
    with starting(tmp_path) as begin:
        at = begin("serve", filled, "--token-file", file).url
        for token, seen in ((mine, ["flat-1"]), (other, ["nested/flat-0"])):
            headers = {"authorization": f"Bearer {token}"}
            assert httpx.get(f"{at}/api/homes", headers=headers).json() == {"homes": seen}
            question = {"words": "how many tables per home?"}
            got = httpx.post(f"{at}/api/fleet/ask", json=question, headers=headers, timeout=60).json()
            assert list(got["value"]) == seen
        agents = begin("mcp", filled, "--http", "--token-file", file).url

        async def names(token: str) -> list[str]:
            async with (
                httpx2.AsyncClient(headers={"authorization": f"Bearer {token}"}, timeout=60) as web,
                Client(streamable_http_client(f"{agents}/mcp", http_client=web)) as client,
            ):
                listed = [row.name for row in (await client.list_resources()).resources]
                refused = await client.call_tool("list_rooms", {"home": "flat-2"})
                assert refused.is_error and "there is no home 'flat-2'" in refused.content[0].text
                one = await client.call_tool("list_rooms", {})
                assert not one.is_error, "with one home it need not be named"
                return [name for name in listed if name in NAMES]

        assert asyncio.run(names(mine)) == ["flat-1"] and asyncio.run(names(other)) == ["nested/flat-0"]


def cli(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "cartier", *map(str, words)], capture_output=True, text=True)


def test_commands_take_a_home_of_a_store(filled: str, tmp_path: Path) -> None:
    home = cartier_fleet.Fleet(filled).home("nested/flat-0")
    shown = cli("show", f"{filled}#nested/flat-0", "--json")
    assert json.loads(shown.stdout) == json.loads(json.dumps(home.to_dict()))
    version = f"{filled}/homes/{key_of(open_store(filled), 'nested/flat-0')}"
    assert cli("show", version, "--json").stdout == shown.stdout
    asked = json.loads(cli("ask", f"{filled}#nested/flat-0", "where is the table?", "--json").stdout)
    assert asked["text"] == cartier.ask(home, "where is the table?").selection.text
    written = cli("export", f"{filled}#nested/flat-0", "--to", tmp_path / "home.csv")
    assert written.returncode == 0 and len((tmp_path / "home.csv").read_text().splitlines()) == len(home.objects) + 1
    for place, line in ((filled, "name one of its homes"), (f"{filled}#attic", "has no home called attic")):
        wrong = cli("show", place)
        assert wrong.returncode == 1 and line in wrong.stderr and len(wrong.stderr.splitlines()) == 1
    assert "no rules hold" in cli("rules", f"{filled}#nested/flat-0").stdout
    for words, line in (
        (("forget", f"{filled}#nested/flat-0", home.objects[0].label), "is published and stays as it is"),
        (("verify", f"{filled}#nested/flat-0"), "cartier fleet pull STORE NAME -o HOME"),
    ):
        wrong = cli(*words)
        assert wrong.returncode == 1 and line in wrong.stderr and len(wrong.stderr.splitlines()) == 1
    both = cli("serve", filled, tmp_path)
    assert both.returncode == 1 and "serve it alone" in both.stderr


def test_a_folder_with_a_hash_in_its_name_is_a_folder(recorded: Path, tmp_path: Path) -> None:
    store = open_store(str(tmp_path / "store"))
    work(store, find_tasks(recorded)[:1])
    cartier_fleet.Fleet(str(tmp_path / "store")).pull("flat-1", tmp_path / "flat#1")
    assert isinstance(home_at(str(tmp_path / "flat#1")), Home)
