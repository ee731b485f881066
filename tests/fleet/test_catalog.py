"""Catalog of a fleet: the latest version of each home once, whoever compacts, is killed, or sends damaged rows."""

from __future__ import annotations

import io
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow", reason="needs pip install '.[fleet]'")

from cartier.blob_stores import Blob, BlobStore, open_store
from cartier.errors import InputError
from cartier.spatial.floor_seen import floor_seen
from cartier_fleet import status
from cartier_fleet.catalog import Tables, compact, read_catalog
from cartier_fleet.catalog_rows import TABLES, schemas
from cartier_fleet.publishing import NEW
from cartier_fleet.status import speed
from flat import FLAT
from fleet.catalogued import enter, grid, home
from fleet.test_jobs import Crash, CrashingStore

pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def store(tmp_path: Path) -> BlobStore:
    return open_store(str(tmp_path / "store"))


def seen(store: BlobStore) -> dict[str, tuple[str, int]]:
    """The version of each home, and how many of its objects the catalog has; every row belongs to one of them."""
    tables = read_catalog(store)
    versions = dict(zip(tables["homes"]["home"].to_pylist(), tables["homes"]["version"].to_pylist(), strict=True))
    assert len(versions) == tables["homes"].num_rows
    for name in TABLES:
        rows = zip(tables[name]["home"].to_pylist(), tables[name]["version"].to_pylist(), strict=True)
        assert all(versions[of] == version for of, version in rows)
    return {name: (version, tables["objects"]["home"].to_pylist().count(name)) for name, version in versions.items()}


def test_rows_are_those_of_the_home(store: BlobStore) -> None:
    enter(store, "a", home())
    tables = read_catalog(store)
    objects = {row["object"]: row for row in tables["objects"].to_pylist()}
    assert set(objects) == {obj.id for obj in FLAT.objects}
    for obj in FLAT.objects:
        row = objects[obj.id]
        assert (row["label"], row["confirmed"], row["room"]) == (obj.label, obj.confirmed, obj.room)
        assert (row["x_min"], row["y_max"], row["z"]) == (obj.box_min[0], obj.box_max[1], obj.position[2])
        assert [(c["name"], c["share"]) for c in row["colours"]] == list(obj.colours)
    assert objects[12]["on_object"] == 3 and objects[12]["on_relation"] == "on"
    assert objects[12]["room_kind"] == "kitchen" and objects[3]["on_object"] is None
    (about,) = tables["homes"].to_pylist()
    assert (about["frames"], about["looked"], about["floor_seen"], about["core_s"]) == (9, 4, 1.0, 1.5)
    assert about["floor_m2"] == 20.0 and about["start_x"] == 0.0
    assert [row["kind"] for row in tables["rooms"].to_pylist()] == ["kitchen", "bedroom", "bedroom"]


def test_what_was_seen_and_can_be_named(store: BlobStore) -> None:
    enter(store, "a", home(seen=0.5))
    enter(store, "b", replace(home(knows=()), detector="ground truth (dollhouse)"))
    a, b = sorted(read_catalog(store)["homes"].to_pylist(), key=lambda row: row["home"])
    assert a["floor_seen"] == pytest.approx(floor_seen(grid(0.5)), abs=1e-3) and 0.6 < a["floor_seen"] < 0.8
    assert b["floor_seen"] == 1.0 and b["knows"] == ["*"]


def test_speed_is_of_all_workers_and_of_now(store: BlobStore, monkeypatch: pytest.MonkeyPatch) -> None:
    assert speed(store) == {}
    for number, at_s in enumerate((0.0, 1000.0, 1001.0, 1002.0)):
        monkeypatch.setattr("time.time", lambda at_s=at_s: at_s)
        enter(store, f"home-{number}", home())
    monkeypatch.setattr(status, "LATEST", 3)
    cost = {"homes": 4, "frames": 36, "core_s_per_home": 1.5, "frames_per_core_s": 6.0}
    assert speed(store) == cost | {"frames_per_s": 6.8}, "27 frames from 998 s, when the first of three began, to 1002"
    compact(store)
    assert speed(store)["homes"] == 4


def test_the_latest_version_counts_before_and_after_compaction(store: BlobStore) -> None:
    enter(store, "a", home(), "one", 1)
    enter(store, "b", home(), "other", 1)
    enter(store, "a", home(FLAT.objects[:2]), "two", 2)
    expected = {"a": ("two", 2), "b": ("other", 7)}
    assert seen(store) == expected
    assert compact(store) == {"compacted": 3, "homes": 2, "rooms": 6, "objects": 9}
    assert store.list(NEW) == [] and seen(store) == expected
    enter(store, "a", home(FLAT.objects[:3]), "three", 3)
    assert seen(store) == {"a": ("three", 3), "b": ("other", 7)}
    compact(store)
    assert seen(store) == {"a": ("three", 3), "b": ("other", 7)}
    assert len(store.list("catalog/")) == 4, "old snapshots are gone"


def test_an_entry_that_arrives_again_counts_once(store: BlobStore) -> None:
    enter(store, "a", home(), "one", 1)
    compact(store)
    enter(store, "a", home(), "one", 1)
    assert seen(store) == {"a": ("one", 7)}
    enter(store, "a", home(FLAT.objects[:1]), "zero", 0)
    assert seen(store) == {"a": ("one", 7)}, "an older version came late"


def test_compaction_without_news_keeps_the_snapshot(store: BlobStore) -> None:
    enter(store, "a", home())
    compact(store)
    before = store.list()
    assert compact(store)["compacted"] == 0
    assert store.list() == before


def test_compaction_killed_at_each_write_loses_nothing(tmp_path: Path) -> None:
    crashed = 0
    for nth in range(16):
        store = open_store(str(tmp_path / str(nth)))
        enter(store, "a", home(), "one", 1)
        compact(store)
        enter(store, "a", home(FLAT.objects[:2]), "two", 2)
        enter(store, "b", home())
        expected = {"a": ("two", 2), "b": ("v-b", 7)}
        try:
            compact(CrashingStore(store, nth))  # type: ignore[arg-type]
        except Crash:
            crashed += 1
        assert seen(store) == expected
        compact(store)
        assert seen(store) == expected
    assert crashed >= 9


def test_many_compact_and_enter_at_once(store: BlobStore) -> None:
    def work(number: int) -> None:
        enter(store, f"home-{number}", home(FLAT.objects[:2]))
        try:
            compact(store)
        except InputError as error:
            assert "compact" in str(error) or "changes faster" in str(error)

    with ThreadPoolExecutor(4) as pool:
        [*pool.map(work, range(24))]
    assert seen(store) == {f"home-{number}": (f"v-home-{number}", 2) for number in range(24)}


@pytest.mark.parametrize("kind", ["noise", "columns", "rows"])
def test_damaged_entries_are_one_line(store: BlobStore, kind: str) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    columns = {"homes": [{"home": "a"}]} if kind == "columns" else {"a": [1, 2]}
    pq.write_table(pa.table(columns), buffer)
    store.put(f"{NEW}x-1.parquet", b"noise" if kind == "noise" else buffer.getvalue())
    with pytest.raises(InputError, match=r"catalog/new/x-1.parquet is (damaged|no entry)"):
        read_catalog(store)


def test_compaction_replaces_in_a_bucket_too(s3: str) -> None:
    store = open_store(f"{s3}/catalogued")
    for number in range(3):
        enter(store, f"home-{number}", home())
    compact(store)
    enter(store, "home-0", home(FLAT.objects[:1]), "next", 2)
    compact(store)
    assert seen(store) == {"home-0": ("next", 1), "home-1": ("v-home-1", 7), "home-2": ("v-home-2", 7)}


def test_entries_are_fetched_once_and_forgotten_when_they_are_compacted(
    store: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, held = enter(store, "a", home()), dict[str, Tables]()
    read_catalog(store, held=held)
    fetched, get = list[str](), store.get

    def counting(key: str) -> Blob | None:
        fetched.append(key)
        return get(key)

    monkeypatch.setattr(store, "get", counting)
    second = enter(store, "b", home())
    assert sorted(read_catalog(store, held=held)["homes"]["home"].to_pylist()) == ["a", "b"]
    assert second in fetched and first not in fetched
    compact(store)
    assert read_catalog(store, held=held)["homes"].num_rows == 2 and not held


def changed(store: BlobStore, change: Callable[[dict[str, Any]], None], times: int = 1) -> str:
    """Enter the home "a" with another row, and its objects so many times; its key."""
    enter(store, "a", home())
    (key,) = store.list(NEW)
    blob = store.get(key)
    assert blob is not None
    (row,) = pq.read_table(io.BytesIO(blob.data)).to_pylist()
    change(row)
    one, kinds = pa.struct(list(schemas()["homes"])), schemas()
    lists = [pa.array([row[name] * (times if name == "objects" else 1)], pa.list_(pa.struct(list(kinds[name]))))
             for name in ("rooms", "objects")]  # fmt: skip
    buffer = io.BytesIO()
    pq.write_table(pa.table([pa.array([row["homes"]], one), *lists], names=list(TABLES)), buffer, compression="zstd")
    store.put(key, buffer.getvalue())
    return key


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("homes", "sequence", None), ("homes", "knows", None), ("homes", "knows", [None]), ("objects", "names", None),
        ("objects", "colours", None), ("objects", "colours", [{"name": None, "share": 1.0}]), ("rooms", "kind", None),
        ("objects", "x_min", None),
    ],
)  # fmt: skip
def test_a_missing_value_is_refused_by_name(store: BlobStore, table: str, column: str, value: Any) -> None:
    def lose(row: dict[str, Any]) -> None:
        for each in [row[table]] if table == "homes" else row[table]:
            each[column] = value

    key = changed(store, lose)
    with pytest.raises(InputError, match=f"{key} is no entry of the catalog .{column} lacks a value.: delete it"):
        read_catalog(store)


def test_a_file_that_unpacks_to_gigabytes_is_refused_unread(store: BlobStore, tmp_path: Path) -> None:
    key = changed(store, lambda row: None, times=40_000)
    blob = store.get(key)
    assert blob is not None and len(blob.data) < 500_000
    before = pa.total_allocated_bytes()
    with pytest.raises(InputError, match=f"{key} unpacks to more than a catalog should ever hold"):
        read_catalog(store)
    assert pa.total_allocated_bytes() - before < 1_000_000
    store.delete(key)
    (tmp_path / "store" / "catalog" / "²-x").write_text("what only looks like a number")
    enter(store, "a", home())
    assert compact(store)["homes"] == 1
