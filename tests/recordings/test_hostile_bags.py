"""Hostile bags, truncated, empty, unindexed or damaged: one line each, quickly, in little memory."""

from __future__ import annotations

import os
import sqlite3
import struct
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bags import FRAME, START_NS, BagFile, Messages, write_bag, write_images
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from layouts import room

from cartier.errors import InputError
from cartier.io import bounded_file as file
from cartier_ros import rosbag

pytest.importorskip("rosbags", reason="the bag reader needs cartier[ros]")
MAX_BYTES, MAX_SECONDS = 64 << 20, 5.0
KINDS = {
    "mcap": ("mcap", ""), "mcap-zstd": ("mcap", "storage"), "sqlite3": ("sqlite3", ""), "ros1": ("ros1", ""),
    "ros1-bz2": ("ros1", "bz2"),
}  # fmt: skip
MCAP_END = struct.Struct("<BQQQI8s")


@contextmanager
def frugal(seconds: float = MAX_SECONDS) -> Iterator[None]:
    """The block must take little memory and time."""
    tracemalloc.start()
    begun = time.process_time()
    try:
        yield
        assert time.process_time() - begun < seconds
        assert tracemalloc.get_traced_memory()[1] < MAX_BYTES
    finally:
        tracemalloc.stop()


def refused(path: Path, fault: str) -> None:
    with frugal(), pytest.raises(InputError, match=fault) as caught:
        rosbag.open(path)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of one good file of each kind, and rosbags' types loaded, so that no test pays for that."""
    root = tmp_path_factory.mktemp("bags")
    for name, (kind, compression) in KINDS.items():
        write_bag(room(frames=2), root / name, kind, compression)
        assert len(rosbag.open(root / name)) == 2
    return {name: file_of(root / name).read_bytes() for name in KINDS}


def file_of(folder: Path) -> Path:
    return next(file for file in folder.iterdir() if file.suffix in (".mcap", ".db3", ".bag"))


def put(tmp_path: Path, name: str, data: bytes) -> Path:
    suffix = {"mcap": ".mcap", "sqlite3": ".db3", "ros1": ".bag"}[name.split("-")[0]]
    path = tmp_path / f"hostile{suffix}"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
@pytest.mark.parametrize(("data", "fault"), [(b"", "is empty"), (b"a shopping list, perhaps", "is no ")])
def test_empty_and_foreign_files(tmp_path: Path, suffix: str, data: bytes, fault: str) -> None:
    (tmp_path / f"a{suffix}").write_bytes(data)
    refused(tmp_path / f"a{suffix}", fault)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("share", [0.01, 0.3, 0.9, 0.999])
def test_truncated_files(tmp_path: Path, bags: dict[str, bytes], name: str, share: float) -> None:
    data = bags[name]
    fault = {
        "mcap": "truncated .*mcap recover",
        "ros1": "truncated.*rosbag reindex|damaged or truncated",
        "sqlite3": "truncated|damaged",
    }
    path = put(tmp_path, name, data[: int(len(data) * share)])
    with frugal(), pytest.raises(InputError, match=fault[name.split("-")[0]]) as caught:
        for _ in rosbag.open(path):  # a cut database is noticed where its pages are missed
            pass
    assert "\n" not in str(caught.value)


def test_files_without_an_index(tmp_path: Path, bags: dict[str, bytes]) -> None:
    mcap = bags["mcap"]
    opcode, size, _, _, _, magic = MCAP_END.unpack(mcap[-MCAP_END.size :])
    bare = mcap[: -MCAP_END.size] + MCAP_END.pack(opcode, size, 0, 0, 0, magic)
    refused(put(tmp_path, "mcap", bare), "has no index: write one with 'mcap recover hostile.mcap -o INDEXED.mcap'")
    bag = bags["ros1"]
    at = bag.index(b"index_pos=") + len(b"index_pos=")
    refused(
        put(tmp_path, "ros1", bag[:at] + bytes(8) + bag[at + 8 :]), "has no index .*'rosbag reindex hostile.bag' mends"
    )


def test_lengths_of_4_gigabytes(tmp_path: Path, bags: dict[str, bytes]) -> None:
    """Places in the head and in the index in turn claim as much as they can."""
    faults = 0
    for name in ("mcap", "ros1"):
        data = bags[name]
        ros1_index = int.from_bytes(data[data.find(b"index_pos=") + 10 :][:8], "little")
        index = ros1_index if name == "ros1" else len(data) - 700
        for start in [*range(8, 120, 9), *range(index, index + 300, 13), *range(len(data) - 60, len(data) - 8, 5)]:
            claim = b"\xff\xff\xff\xff\0\0\0\0" if start % 2 else b"\xff\xff\xff\xff"
            path = put(tmp_path, name, data[:start] + claim + data[start + len(claim) :])
            with frugal(1.0):
                try:
                    rosbag.open(path)[0]
                except InputError as error:
                    assert "\n" not in str(error)
                    faults += 1
    assert faults > 20


@pytest.mark.parametrize("name", KINDS)
def test_any_damage_is_an_input_error_or_none(
    tmp_path_factory: pytest.TempPathFactory, bags: dict[str, bytes], name: str
) -> None:
    data, folder = bags[name], tmp_path_factory.mktemp("any")
    near_ends = st.one_of(st.integers(0, 3000), st.integers(len(data) - 9000, len(data) - 1))
    hits = st.lists(st.tuples(near_ends.map(lambda i: i % len(data)), st.integers(0, 255)), min_size=1, max_size=8)

    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
    @given(hits)
    def damage(places: list[tuple[int, int]]) -> None:
        broken = bytearray(data)
        for place, value in places:
            broken[place] = value
        path = put(folder, name, bytes(broken))
        try:
            for _ in rosbag.open(path):
                pass
        except InputError as error:
            assert "\n" not in str(error)

    damage()


def test_a_million_topics_in_sqlite(tmp_path: Path) -> None:
    base = sqlite3.connect(tmp_path / "a.db3")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    base.executemany(
        "INSERT INTO topics VALUES(?, ?, 'sensor_msgs/msg/Image', 'cdr')", ((i, f"/t{i}") for i in range(10**6))
    )
    base.commit()
    base.close()
    refused(tmp_path / "a.db3", "claims 10001 topics; cartier reads bags of up to 10000")


def test_a_million_topics_in_ros1(tmp_path: Path) -> None:
    def record(data: bytes, **fields: bytes) -> bytes:
        head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in fields.items())
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    count = struct.pack("<I", 10**6)
    head = record(b"", op=b"\3", index_pos=struct.pack("<Q", 13), conn_count=count, chunk_count=bytes(4))
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + head)
    refused(tmp_path / "a.bag", "claims 1000000 topics")


def test_more_topics_in_mcap_than_any_robot_has(tmp_path: Path) -> None:
    """MCAP numbers its channels with 16 bits: 65,536 is its million."""
    magic = b"\x89MCAP0\r\n"

    def text(value: bytes) -> bytes:
        return struct.pack("<I", len(value)) + value

    def channel(i: int) -> bytes:
        body = struct.pack("<HH", i, 0) + text(b"/t%d" % i) + text(b"cdr") + bytes(4)
        return b"\4" + struct.pack("<Q", len(body)) + body

    data = magic + b"".join(map(channel, range(1 << 16)))
    (tmp_path / "a.mcap").write_bytes(data + MCAP_END.pack(2, 20, len(magic), 0, 0, magic))
    refused(tmp_path / "a.mcap", "claims 10001 topics")


def test_a_million_topics_in_the_metadata(tmp_path: Path) -> None:
    write_bag(room(frames=1), tmp_path / "a")
    with (tmp_path / "a/metadata.yaml").open("a") as file:
        file.writelines(f"    - topic_metadata: {{name: /t{i}}}\n" for i in range(10**6))
    refused(tmp_path / "a", r"metadata\.yaml is larger than 4 MiB")


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{", "metadata.yaml line 2: not valid YAML: did not find expected node content"),
        ("", "metadata.yaml is damaged or describes no bag"),
        ("rosbag2_bagfile_information: {relative_file_paths: 7}", "metadata.yaml is damaged"),
        ("rosbag2_bagfile_information: " + "[" * 50_000, "line 1: nested deeper than 40 levels"),
        (f"rosbag2_bagfile_information: {{{'a: {' * 50_000}", "line 1: nested deeper than 40 levels"),
        ("\n".join(f"{c}: &{c} [{f'*{b}, ' * 9}x]" for b, c in pairwise("abcdefghijk")), r"line 1: .*alias"),
        ("- \n" * 250_000, "line 200000: more than 200000 entries"),
        ("a: 1\na: 2", "line 2: 'a' is given twice"),
        ("just: this", "metadata.yaml is damaged or describes no bag"),
        ("rosbag2_bagfile_information: [1]", "metadata.yaml is damaged"),
        ("rosbag2_bagfile_information: !!python/object/apply:os.system ['false']", "the YAML tag .* is not allowed"),
        ("rosbag2_bagfile_information: {compression_mode: FILE}", "holds compressed files: unpack them with 'zstd -d'"),
        (
            "rosbag2_bagfile_information: {relative_file_paths: [../../b_1.mcap]}",
            r"a/b_1\.mcap is missing, but metadata",
        ),
        (
            "rosbag2_bagfile_information: {compression_mode: message, compression_format: rar}",
            "'rar'; cartier reads zstd",
        ),
    ],
)
def test_metadata_that_is_none(tmp_path: Path, text: str, fault: str) -> None:
    write_bag(room(frames=1), tmp_path / "a")
    (tmp_path / "a/metadata.yaml").write_text(text)
    refused(tmp_path / "a", fault)


def test_a_number_to_the_base_of_60_is_not_computed(tmp_path: Path) -> None:
    write_bag(room(frames=1), tmp_path / "a")
    (tmp_path / "a/metadata.yaml").write_text("rosbag2_bagfile_information: {version: 1" + ":1" * 500_000 + "}")
    with frugal():
        assert len(rosbag.open(tmp_path / "a")) == 1


def test_pipes_are_no_files_of_a_bag_and_links_out_of_it_are_noted(tmp_path: Path) -> None:
    write_bag(room(frames=1), tmp_path / "a")
    bag = file_of(tmp_path / "a")
    bag.rename(tmp_path / bag.name)
    bag.symlink_to(tmp_path / bag.name)
    note = f"1 file is a link that leads out of the recording's folder, such as {bag.name}"
    assert note in rosbag.open(tmp_path / "a").notes
    assert note not in rosbag.open(bag).notes  # a link that the person names is what they mean
    bag.unlink()
    (tmp_path / "a/metadata.yaml").unlink()
    for suffix in (".mcap", ".db3", ".bag"):
        os.mkfifo(bag.with_suffix(suffix))
        refused(tmp_path / "a", "is a pipe")
        bag.with_suffix(suffix).unlink()
    (tmp_path / bag.name).rename(bag)
    os.mkfifo(tmp_path / "a/metadata.yaml")
    refused(tmp_path / "a", "metadata.yaml is a pipe")


@pytest.mark.parametrize(
    ("table", "fault"),
    [
        (
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
            "SELECT i AS id, 1 AS topic_id, i AS timestamp, x'' AS data FROM n",
            "holds more than table, index, unique index",
        ),
        (
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, data BLOB, "
            "timestamp TEXT AS (printf('%.*c', 200000000, 'x')))",
            "columns of its table 'messages' are computed",
        ),
        ("CREATE TABLE letters(id INTEGER)", "has no tables 'topics' and 'messages'"),
    ],
)
def test_a_database_that_computes_without_end(tmp_path: Path, table: str, fault: str) -> None:
    base = sqlite3.connect(tmp_path / "a.db3")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    base.execute(table)
    base.execute("INSERT INTO topics VALUES(1, '/camera/image', 'sensor_msgs/msg/Image', 'cdr')")
    base.commit()
    base.close()
    refused(tmp_path / "a.db3", fault)


def test_chunks_that_share_one_index(tmp_path: Path) -> None:
    """A hundred thousand chunks with one index of a thousand messages would be more of them than memory holds."""
    files = {}
    for kind in ("mcap", "ros1"):
        with BagFile(tmp_path / kind, kind) as bag:
            write_images(bag, room(frames=1))
            for i in range(500):
                ns = START_NS + i * 10**6
                bag.put("/tf", ns, bag.messages.transforms((ns, "map", FRAME, np.eye(4))))
        assert len(rosbag.open(tmp_path / kind)) == 1
        files[kind] = file_of(tmp_path / kind).read_bytes()
    mcap = files["mcap"]
    end = len(mcap) - MCAP_END.size
    at = int.from_bytes(mcap[end + 9 : end + 17], "little")
    while mcap[at] != 8:
        at += 9 + int.from_bytes(mcap[at + 1 : at + 9], "little")
    chunk = mcap[at : at + 9 + int.from_bytes(mcap[at + 1 : at + 9], "little")]
    refused(put(tmp_path, "mcap", mcap[:at] + chunk * 2_000 + mcap[at:]), "parts of it lie over each other")
    bag = files["ros1"]
    at = int.from_bytes(bag[bag.index(b"index_pos=") + 10 :][:8], "little")
    while at < len(bag):  # to the last record of all, which is about the chunk
        last, (head,) = at, struct.unpack_from("<I", bag, at)
        at += 8 + head + struct.unpack_from("<I", bag, at + 4 + head)[0]
    count = bag.index(b"chunk_count=") + len(b"chunk_count=")
    claimed = bag[:count] + struct.pack("<I", 2_000) + bag[count + 4 :]
    refused(put(tmp_path, "ros1", claimed + bag[last:] * 2_000), "parts of it lie over each other")


def test_names_are_names(tmp_path: Path) -> None:
    m = Messages()
    cases = [
        ("/a\x1b[2J/image", "cam", "is no name of a topic or a frame"),
        ("/a/image", "x" * 10**6, "has a frame_id of 1000001 bytes"),
        ("/a/image", "\x1b[2J", "is no name of a topic or a frame"),
    ]
    for number, (topic, frame, fault) in enumerate(cases):
        with BagFile(tmp_path / f"{number}") as bag:
            bag.put(topic, START_NS, m.image(START_NS, frame, np.zeros((8, 8, 3), np.uint8), "rgb8"))
        refused(tmp_path / f"{number}", fault)


@pytest.mark.parametrize("kind", ["zstd", "lz4", "bz2"])
def test_a_bomb_does_not_go_off(kind: str) -> None:
    """A gigabyte of zeros in a megabyte, which claims to be a kilobyte."""
    import bz2

    import lz4.frame
    from backports import zstd

    block = bytes(1 << 24)
    data = {"zstd": zstd.compress, "lz4": lz4.frame.compress, "bz2": bz2.compress}[kind](block)
    with frugal(), pytest.raises(InputError, match="has not the 1024 bytes that it claims"):
        file.unpacked(kind, data, 1024, Path("a"))
    with frugal(), pytest.raises(InputError, match="claims 1099511627776 bytes"):
        file.unpacked(kind, data, 1 << 40, Path("a"))
    assert file.unpacked(kind, data, len(block), Path("a")) == block


def test_an_image_that_claims_more_than_it_holds(tmp_path: Path) -> None:
    m = Messages()
    with BagFile(tmp_path / "a") as bag:
        pose = np.eye(4)
        for step in (0, 1):
            ns = START_NS + step * 10**8
            bag.put("/tf", ns, m.transforms((ns, "map", "cam", pose)))
        for topic, width, step in (("/a/image", 8000, 24000), ("/b/image", 8, 1)):
            image = m.image(START_NS, "cam", np.zeros((8, 8, 3), np.uint8), "rgb8")
            image.width, image.step, image.height = width, step, 8000
            bag.put(topic, START_NS, image)
            info = m.info(START_NS, "cam", room().camera)
            info.width, info.height = width, 8000
            info.k[[0, 4, 2, 5]] = 8000, 8000, width / 2, 4000
            bag.put(topic.replace("image", "camera_info"), START_NS, info)
    for topic in ("/a/image", "/b/image"):
        with frugal(), pytest.raises(InputError, match="an image has 192 bytes, too few"):
            rosbag.open(tmp_path / "a", colour=topic)[0]


def test_a_bag_of_other_things(tmp_path: Path) -> None:
    with BagFile(tmp_path / "a") as bag:
        bag.put("/tf", START_NS, bag.messages.transforms((START_NS, "map", "cam", np.eye(4))))
    refused(tmp_path / "a", "holds no images: it has no message of type sensor_msgs/msg/Image")


def test_parts_of_two_kinds_are_no_bag(tmp_path: Path) -> None:
    for name in ("a.bag", "b.mcap"):
        (tmp_path / name).write_bytes(b"x")
    refused(tmp_path, "is not one bag: it holds .bag, .mcap files")
