"""What is said of a path that is no recording, or may be two."""

from __future__ import annotations

import shlex
import shutil
import stat
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest
from layouts import LAYOUTS

from cartier import plugins
from cartier.errors import InputError


def test_a_recording_nearby_is_named(tmp_path: Path) -> None:
    (tmp_path / "outer").mkdir()
    LAYOUTS["tum"](tmp_path / "outer" / "scan")
    for wrong in (tmp_path / "outer", tmp_path / "outer" / "scan" / "rgb"):
        with pytest.raises(InputError, match=r"is no recording .*: but .*outer/scan is one \(tum\): give that"):
            plugins.open_recording(wrong)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "scan.zip",
            r"scan\.zip is no .*: by its name it is an archive, but it is none, or it is damaged .*: fetch it",
        ),
        ("scan.tar.gz", "by its name it is an archive, but it is none"),
        ("download/scan.zip", r"it holds scan\.zip: by its name it is an archive, but it is none"),
        ("walk.MOV", "a video alone has no camera poses and no intrinsics: COLMAP or nerfstudio"),
        ("IMG_1.jpg", "a picture alone has no camera poses and no intrinsics: COLMAP or nerfstudio"),
        ("photos/IMG_1.JPG", r"it holds a picture, IMG_1\.JPG, but no camera poses .*docs/phone\.md"),
        ("photos/IMG_1.dng", r"it holds a picture, IMG_1\.dng, but no camera poses"),
        ("room/images/0001.jpg", r"it holds a picture, images/0001\.jpg, but no camera poses .*COLMAP"),
        ("room/walk.mp4", r"it holds a video, walk\.mp4, but no camera poses"),
        ("letters/a.txt", "the formats are arcore, .*'cartier list' says what each one looks like"),
    ],
)
def test_what_is_nearly_a_recording_is_said(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(InputError, match=says) as caught:
        plugins.open_recording(tmp_path / name.split("/")[0])
    assert "\n" not in str(caught.value)


def pack(folder: Path, archive: Path, link: tuple[str, str] | None = None) -> None:
    if archive.suffix == ".zip":
        with zipfile.ZipFile(archive, "w") as packed:
            for file in folder.rglob("*"):
                packed.write(file, file.relative_to(folder))
            if link:
                about = zipfile.ZipInfo(link[0])
                about.external_attr = (stat.S_IFLNK | 0o777) << 16
                packed.writestr(about, link[1])
    else:
        with tarfile.open(archive, "w:gz") as packed_tar:
            packed_tar.add(folder, ".")
            if link:
                member = tarfile.TarInfo(link[0])
                member.type, member.linkname = tarfile.SYMTYPE, link[1]
                packed_tar.addfile(member)


@pytest.mark.parametrize("name", ["My Scan.zip", "My Scan.tar.gz"])
def test_archives_are_looked_into_and_the_printed_command_unpacks_them(tmp_path: Path, name: str) -> None:
    (tmp_path / "to pack").mkdir()
    LAYOUTS["arcore-without-depth"](tmp_path / "to pack" / "scan")
    (tmp_path / "down load").mkdir()
    archive = tmp_path / "down load" / name
    pack(tmp_path / "to pack", archive)
    (tmp_path / "down load" / "IMG_1.jpg").write_bytes(b"x")
    with pytest.raises(
        InputError, match=r"a recording \(arcore\) is in it: unpack it \((.*)\), and give '.*My Scan/scan'$"
    ):
        plugins.open_recording(archive)
    with pytest.raises(InputError, match=f"it holds {name}: a recording .arcore. is in it: unpack it") as caught:
        plugins.open_recording(tmp_path / "down load")
    command, _, folder = str(caught.value).partition("unpack it (")[2].partition("), and give ")
    if name.endswith(".gz") or shutil.which("unzip"):
        subprocess.run(command, shell=True, check=True, capture_output=True)
        assert len(plugins.open_recording(*shlex.split(folder))) == 4


@pytest.mark.parametrize("target", ["/etc/hostname", "../../secret.jpg", "scan/../.."])
@pytest.mark.parametrize("name", ["a.zip", "a.tar.gz"])
def test_an_archive_with_a_link_that_may_lead_out_is_not_offered(tmp_path: Path, name: str, target: str) -> None:
    """Once it is unpacked, nobody could tell it from a folder that its owner made of links."""
    (tmp_path / "in").mkdir()
    LAYOUTS["arcore-without-depth"](tmp_path / "in" / "scan")
    pack(tmp_path / "in", tmp_path / name, link=("0.jpg", target))
    with pytest.raises(InputError, match=r"0\.jpg in it is a link that may lead to other files of yours") as caught:
        plugins.open_recording(tmp_path / name)
    assert "\n" not in str(caught.value) and "a recording" not in str(caught.value)
    pack(tmp_path / "in", tmp_path / name, link=("0.jpg", "scan/1.jpg"))
    with pytest.raises(InputError, match=r"a recording \(arcore\) is in it"):
        plugins.open_recording(tmp_path / name)


def test_an_archive_without_a_recording_is_not_said_to_hold_one(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in/readme.txt").write_text("a")
    pack(tmp_path / "in", tmp_path / "a.zip")
    with pytest.raises(InputError, match=r"by its 1 names no recording is in it \(such as readme\.txt\)$"):
        plugins.open_recording(tmp_path / "a.zip")
    (tmp_path / "in/1.jpg").write_text("a")
    pack(tmp_path / "in", tmp_path / "a.tgz")
    with pytest.raises(
        InputError, match=r"no recording is in it, only pictures such as \./1\.jpg, with no camera poses"
    ):
        plugins.open_recording(tmp_path / "a.tgz")


def test_names_in_an_archive_lead_nowhere(tmp_path: Path) -> None:
    """They are tried as empty files in a folder of their own; those that would lead out of it are not."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as packed:
        for name in (
            "../rgb.txt",
            "../groundtruth.txt",
            str(tmp_path / "b/c.txt"),
            "d/" * 50 + "e",
            "x" * 300,
            "f/g",
            "f",
        ):
            packed.writestr(name, "")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match="by its 7 names no recording is in it"):
        plugins.open_recording(tmp_path / "a.zip")
    assert sorted(tmp_path.rglob("*")) == before


def test_pictures_come_before_a_recording_above(tmp_path: Path) -> None:
    LAYOUTS["tum"](tmp_path / "scan")
    (tmp_path / "scan/trip").mkdir()
    (tmp_path / "scan/trip/IMG_1.jpg").write_bytes(b"x")
    with pytest.raises(
        InputError, match=r"it holds a picture, IMG_1\.jpg: but .*scan is one \(tum\): give that if it is its"
    ):
        plugins.open_recording(tmp_path / "scan/trip")


def test_a_folder_of_two_formats_asks_which(tmp_path: Path) -> None:
    LAYOUTS["tum"](tmp_path / "a")
    LAYOUTS["arcore-without-depth"](tmp_path / "b")
    for path in (tmp_path / "b").iterdir():
        path.rename(tmp_path / "a" / path.name)
    with pytest.raises(InputError, match="may be one of arcore, tum: say which with --format"):
        plugins.open_recording(tmp_path / "a")
    assert len(plugins.open_recording(tmp_path / "a", format="tum")) == 4


def test_poses_in_a_layout_of_ones_own_are_seen_and_the_ways_are_said(tmp_path: Path) -> None:
    for name in ("0014_rgb.png", "0014_depth.png", "poses.json"):
        (tmp_path / name).write_bytes(b"{}")
    with pytest.raises(InputError, match=r"a picture, 0014_depth\.png, and poses\.json, in a layout of .*--format"):
        plugins.open_recording(tmp_path)


def test_a_home_is_said_to_be_one(tmp_path: Path) -> None:
    (tmp_path / "home.json").write_text("{}")
    with pytest.raises(
        InputError, match="it is a home that was mapped already: 'cartier show' and 'cartier ask' take it"
    ):
        plugins.open_recording(tmp_path)


UNREAD = {  # the files of a layout that is not read, and what is said of it
    "one split": (["transforms_train.json", "train/r_0.png"], "'cp transforms_train.json transforms.json'"),
    "splits": (
        ["transforms_test.json", "transforms_train.json", "train/0.png"],
        r"in their folder, jq -s .* transforms_test\.json transforms_train\.json > transforms\.json",
    ),
    "scannet": (["scene0000_00.sens", "scene0000_00.txt"], "scene0000_00.sens, ScanNet's packed scan: unpack it with"),
    "arkitscenes": (
        ["lowres_wide.traj", "lowres_wide/41_1.0.png", "lowres_depth/41_1.0.png"],
        r"lowres_wide\.traj, the poses of ARKitScenes, in a layout of their own: write them as transforms\.json",
    ),
}


@pytest.mark.parametrize("name", UNREAD)
@pytest.mark.parametrize("packed", [False, True])
def test_layouts_with_poses_are_not_called_without(tmp_path: Path, name: str, packed: bool) -> None:
    files, says = UNREAD[name]
    for file in files:
        (tmp_path / "scan" / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "scan" / file).write_text("{}")
    if packed:
        pack(tmp_path / "scan", tmp_path / "scan.zip")
    with pytest.raises(InputError, match=says) as caught:
        plugins.open_recording(tmp_path / ("scan.zip" if packed else "scan"))
    assert "no camera poses" not in str(caught.value) and "\n" not in str(caught.value)
    if name != "splits":
        with pytest.raises(InputError, match=f"it is {says}" if name != "one split" else says):
            plugins.open_recording(tmp_path / "scan" / files[0])


def test_splits_merged_as_told_are_read(tmp_path: Path) -> None:
    LAYOUTS["nerfstudio"](tmp_path / "a")
    (tmp_path / "a/transforms.json").rename(tmp_path / "a/transforms_train.json")
    with pytest.raises(InputError) as caught:
        plugins.open_recording(tmp_path / "a")
    command = str(caught.value).split("'")[-2]
    subprocess.run(command, shell=True, check=True, cwd=tmp_path / "a")
    assert len(plugins.open_recording(tmp_path / "a")) == 4
