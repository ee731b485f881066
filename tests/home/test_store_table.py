"""The store: what a damaged file is answered with, and what a second put writes, keeps and deletes."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cartier.home.store
from cartier.errors import InputError
from cartier.home.store import MANIFEST, Store, blob_file, digest_of
from cartier.io.atomic import locked, write_file

ABOUT = {"schema": 3, "name": "flat"}
BLOBS = {"objects.json": b"[1, 2]", "photos/0001.jpg": b"\xff\xd8 a photo", "map.npz": b"\x00" * 64}
table = pytest.mark.parametrize
Change = Callable[[dict[str, Any]], object]


@pytest.fixture
def home(tmp_path: Path) -> Store:
    store = Store(tmp_path / "home")
    store.put(ABOUT, BLOBS, {"plan.yaml": b"for others"})
    return store


def blob(store: Store, name: str, data: bytes | None = None) -> Path:
    return store.folder / blob_file(name, digest_of(BLOBS[name] if data is None else data))


def rewritten(store: Store, change: Change, signed: bool = True) -> None:
    """The manifest after a change, with its checksum made anew or left as it was."""
    about = json.loads((store.folder / MANIFEST).read_text())
    change(about)
    if signed:
        rest = {key: value for key, value in about.items() if key != "sha256"}
        about["sha256"] = digest_of(json.dumps(rest, sort_keys=True).encode())
    (store.folder / MANIFEST).write_text(json.dumps(about))


def test_what_was_put_is_got(home: Store) -> None:
    about = home.manifest()
    assert {key: about[key] for key in ABOUT} == ABOUT and set(about["blobs"]) == set(BLOBS)
    assert {name: home.get(name, about) for name in BLOBS} == BLOBS
    assert home.faults() == [] and (home.folder / "plan.yaml").read_bytes() == b"for others"
    files = {path.relative_to(home.folder).as_posix() for path in home.folder.rglob("*") if path.is_file()}
    assert files == {blob(home, name).relative_to(home.folder).as_posix() for name in BLOBS} | {MANIFEST, "plan.yaml"}


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def linked(path: Path) -> None:
    path.rename(path.with_suffix(".elsewhere"))
    path.symlink_to(path.with_suffix(".elsewhere"))


DAMAGES: dict[str, Callable[[Path], object]] = {
    "gone": Path.unlink, "cut": cut, "a bit": flipped, "a link": linked,
    "longer": lambda path: path.write_bytes(b"x" * 999),
}  # fmt: skip


@table("damage", DAMAGES.values(), ids=DAMAGES.keys())
@table("name", BLOBS)
def test_damaged_blob_is_named(home: Store, name: str, damage: Callable[[Path], object]) -> None:
    about = home.manifest()
    damage(blob(home, name))
    with pytest.raises(InputError, match=blob(home, name).name):
        home.get(name, about)
    (told,) = home.faults()
    assert blob(home, name).name in told and "\n" not in told
    assert all(home.get(other, about) == BLOBS[other] for other in BLOBS if other != name)


MANIFESTS: dict[str, tuple[Change, bool]] = {
    "another name": (lambda about: about.update(name="palace"), False),
    "a blob less": (lambda about: about["blobs"].pop("map.npz"), False),
    "no checksum": (lambda about: about.pop("sha256"), False),
    "a path out of the folder": (lambda about: about["blobs"].update({"../x.json": "0" * 64}), True),
    "an absolute path": (lambda about: about["blobs"].update({"/etc/x.json": "0" * 64}), True),
    "a digest that is none": (lambda about: about["blobs"].update({"map.npz": "../../x"}), True),
    "blobs that are a list": (lambda about: about.update(blobs=[]), True),
}  # fmt: skip


@table(("change", "signed"), MANIFESTS.values(), ids=MANIFESTS.keys())
def test_damaged_manifest_is_refused(home: Store, change: Change, signed: bool) -> None:
    rewritten(home, change, signed)
    with pytest.raises(InputError, match="damaged"):
        home.manifest()
    assert len(home.faults()) == 1


def test_manifest_signed_anew_is_read(home: Store) -> None:
    rewritten(home, lambda about: about.update(name="palace"))
    assert home.manifest()["name"] == "palace"


@table("text", ["[]", "{", "\x00", ""], ids=["a list", "cut", "binary", "empty"])
def test_manifest_of_rubbish_is_refused(home: Store, text: str) -> None:
    (home.folder / MANIFEST).write_text(text)
    with pytest.raises(InputError):
        home.manifest()
    assert len(home.faults()) == 1


def test_no_home_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cartier map RECORDING"):
        Store(tmp_path).manifest()


def test_unknown_blob_is_said(home: Store) -> None:
    with pytest.raises(InputError, match=r"names no depth\.npz"):
        home.get("depth.npz", home.manifest())


# ---- a second put


def test_second_put_replaces_and_sweeps(home: Store) -> None:
    part = home.folder / ".map.npz-0123abcd.part"
    strangers = [
        home.folder / "notes-0123456789ab.txt",
        home.folder / "photos" / "mine.jpg",
        home.folder / "answers.jsonl",
    ]
    for path in (part, *strangers):
        path.write_bytes(b"x")
    newer = {"objects.json": b"[3]", "map.npz": BLOBS["map.npz"]}
    home.put(ABOUT | {"name": "grown"}, newer, {})
    about = home.manifest()
    assert about["name"] == "grown" and {name: home.get(name, about) for name in newer} == newer
    assert not blob(home, "objects.json").exists() and not blob(home, "photos/0001.jpg").exists() and not part.exists()
    assert all(path.read_bytes() == b"x" for path in strangers)


def test_same_blob_is_not_written_again(home: Store) -> None:
    before = blob(home, "map.npz").stat()
    home.put(ABOUT, BLOBS, {})
    after = blob(home, "map.npz").stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)


def test_damaged_blob_is_written_again(home: Store) -> None:
    flipped(blob(home, "map.npz"))
    assert home.faults()
    home.put(ABOUT, BLOBS, {})
    assert home.faults() == []


def test_manifest_is_written_last(home: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full at the second blob leaves the old home."""
    written: list[str] = []

    def full(path: Path, data: bytes) -> None:
        written.append(path.name)
        if len(written) == 2:
            raise InputError("the disk is full")
        write_file(path, data)

    monkeypatch.setattr(cartier.home.store, "write_file", full)
    with pytest.raises(InputError, match="full"):
        home.put(ABOUT | {"name": "new"}, {"objects.json": b"new", "map.npz": b"also new"}, {})
    assert home.manifest()["name"] == "flat" and home.faults() == []


def test_second_writer_waits_for_the_first(home: Store) -> None:
    done = threading.Event()

    def write() -> None:
        home.put(ABOUT | {"name": "second"}, BLOBS, {})
        done.set()

    with locked(home.folder):
        writer = threading.Thread(target=write, daemon=True)
        writer.start()
        assert not done.wait(0.3) and home.manifest()["name"] == "flat"
    assert done.wait(20)
    writer.join()
    assert home.manifest()["name"] == "second"


def test_folder_of_a_stranger_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("precious")
    with pytest.raises(InputError, match="not ours"):
        Store(tmp_path / "thesis").put(ABOUT, BLOBS, {})
    assert [path.name for path in (tmp_path / "thesis").iterdir()] == ["chapter.tex"]


def test_log_outlives_a_put(home: Store) -> None:
    home.append("answers.jsonl", "1")
    home.put(ABOUT, {}, {})
    home.append("answers.jsonl", "2")
    assert (home.folder / "answers.jsonl").read_text() == "1\n2\n"
