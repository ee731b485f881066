"""Hints for a path that is no recording: a recording nearby or in an archive, or pictures without poses.

Folders are looked into two levels down, archives by their names only, both within bounds. Nothing is unpacked.
"""

from __future__ import annotations

import itertools
import re
import shlex
import stat
import tarfile
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePath, PurePosixPath

from cartier.errors import brief

Formats = Callable[[Path], list[str]]
"""The formats whose recordings a path may be."""

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm")
PICTURES = (".jpg", ".jpeg", ".png", ".heic", ".heif", ".dng", ".tif", ".tiff", ".webp")
KINDS = {"a picture": PICTURES, "a video": VIDEOS}
TARS = (".tar", ".tgz", ".tar.gz", ".tar.bz2", ".tar.xz")
NO_POSES = (
    "no camera poses and no intrinsics: COLMAP or nerfstudio's ns-process-data work them out from pictures (without "
    "depth and scale), and Record3D, Stray Scanner, Polycam and RTAB-Map record them with depth (docs/phone.md)"
)
POSES = ("*pose*.json", "*pose*.txt", "*pose*.csv", "*traj*.json", "*traj*.txt", "*traj*.csv")
OWN_LAYOUT = (
    "in a layout of their own: write them as transforms.json (nerfstudio) or as the four plain files of the README, or "
    "name a reader of your own, --format ./mine.py (CONTRIBUTING.md)"
)
SPLIT = re.compile(r"transforms_(train|val|test|eval)\.json")
ARKITSCENES = "lowres_wide.traj"
SENS = (
    "ScanNet's packed scan: unpack it with ScanNet's own SensReader (reader.py --filename SCAN.sens --output_path OUT "
    "--export_depth_images --export_color_images --export_poses --export_intrinsics), and give OUT"
)
MOST_ENTRIES, MOST_PATHS, MOST_ARCHIVES = 100, 300, 5  # looked at: in a folder, in all, and archives of those
MOST_NAMES, MOST_TAR_BYTES, MOST_LINK_BYTES = 20_000, 256 << 20, 4096
MOST_ALIKE, MOST_PARTS = 20, 6  # of an archive's names: with one suffix in one folder, and parts of a name


def what_else(path: Path, formats: Formats) -> str | None:
    """What a path is that is no recording, and what to do about it; None if there is nothing to say."""
    if (path / "home.json").is_file():
        return "it is a home that was mapped already: 'cartier show' and 'cartier ask' take it"
    parent = path.absolute().parent
    above = next(iter(formats(parent)), None)
    this = f"{parent} is one ({above}): give that"
    if path.is_file():
        if _is_archive(path):
            return _archive(path, formats)[0]
        if above:
            return f"but {this}"
        if (unread := _unread([path])) is not None:
            return f"it is {unread}"
        kind = next((kind for kind, suffixes in KINDS.items() if path.suffix.lower() in suffixes), None)
        return f"{kind} alone has {NO_POSES}" if kind else None
    below = list(itertools.islice(_below(path), MOST_PATHS))
    for other in below:
        if found := formats(other):
            return f"but {other} is one ({found[0]}): give that"
    archived = itertools.islice(filter(_is_archive, below), MOST_ARCHIVES)
    archives = [(file, *_archive(file, formats)) for file in archived]
    for file, says, is_recording in archives:
        if is_recording:
            return f"it holds {file.relative_to(path)}: {says}"
    if (unread := _unread(below)) is not None:
        return f"it holds {unread}"
    for kind, suffixes in KINDS.items():
        shown = next((file for file in below if file.suffix.lower() in suffixes), None)
        if shown is not None:
            holds = f"it holds {kind}, {shown.relative_to(path)}"
            if (poses := next((file.name for name in POSES for file in below if file.match(name)), None)) is not None:
                return f"{holds}, and {poses}, {OWN_LAYOUT}"
            return f"{holds}: but {this} if it is its; alone it has {NO_POSES}" if above else f"{holds}, but {NO_POSES}"
    if archives:
        return f"it holds {archives[0][0].relative_to(path)}: {archives[0][1]}"
    return f"but {this}" if above else None


def _unread(paths: Sequence[PurePath]) -> str | None:
    """What files are that hold poses in a layout which cartier does not read, and what to do about it."""
    if splits := sorted({path.name for path in paths if SPLIT.fullmatch(path.name)}):
        merge = f"jq -s '.[0] + {{frames: map(.frames) | add}}' {' '.join(splits)} > transforms.json"
        mend = f"in its folder, 'cp {splits[0]} transforms.json'" if len(splits) == 1 else f"in their folder, {merge}"
        return (
            f"{' and '.join(splits)}, parts of a recording in nerfstudio's format, whose frames belong in one: {mend}"
        )
    for path in paths:
        if path.suffix == ".sens":
            return f"{brief(path.name, 60)}, {SENS}"
        if path.name == ARKITSCENES:
            return f"{path.name}, the poses of ARKitScenes, {OWN_LAYOUT}"
    return None


def _below(folder: Path) -> Iterator[Path]:
    """What lies in a folder by name, then what lies in its folders."""
    entries = _entries(folder)
    yield from entries
    for entry in entries:
        if entry.is_dir() and not entry.is_symlink():
            yield from _entries(entry)


def _entries(folder: Path) -> list[Path]:
    try:
        return [entry for entry in sorted(folder.iterdir()) if entry.name[0] != "."][:MOST_ENTRIES]
    except OSError:  # not ours to read
        return []


def _is_archive(path: Path) -> bool:
    return path.name.lower().endswith((".zip", *TARS)) and path.is_file()


def _archive(path: Path, formats: Formats) -> tuple[str, bool]:
    """What to say of a file with an archive's name, and whether a recording is in it."""
    try:
        names, whole, link = _names(path)
    except Exception as error:  # zipfile's, tarfile's and zlib's share no base class
        says = f"by its name it is an archive, but it is none, or it is damaged ({brief(error, 80)}): fetch it again"
        return says, False
    if link is not None:
        trust = "and what it leads to would get into your map: unpack it only if you trust who made it"
        return f"{brief(link, 80)} in it is a link that may lead to other files of yours, {trust}", False
    target = path.with_name(path.name[: -len(next(s for s in (".zip", *TARS) if path.name.lower().endswith(s)))])
    source, folder = shlex.quote(str(path)), shlex.quote(str(target))
    is_zip = path.suffix.lower() == ".zip"
    unpack = f"unzip {source} -d {folder}" if is_zip else f"mkdir {folder} && tar -xf {source} -C {folder}"
    found = _recording_of(names, formats)
    if found is not None:
        inside, format = found
        give = shlex.quote(str(target / inside))
        return f"a recording ({format}) is in it: unpack it ({unpack}), and give {give}", True
    if (unread := _unread([PurePosixPath(name) for name in names])) is not None:
        return f"unpack it ({unpack}); it holds {unread}", False
    pictures = next((name for name in names if PurePosixPath(name).suffix.lower() in (*PICTURES, *VIDEOS)), None)
    seen = f"{len(names)} names" if whole else f"first {len(names)} names"
    if pictures is not None:
        such = f"only pictures such as {brief(pictures, 80)}, with {NO_POSES}"
        return f"by its {seen} no recording is in it, {such}", False
    return f"by its {seen} no recording is in it" + (f" (such as {brief(names[0], 80)})" if names else ""), False


def _names(path: Path) -> tuple[list[str], bool, str | None]:
    """The files' names in an archive, whether these are all, and the first that is a link which may lead out."""
    names, link = [], None
    if path.suffix.lower() == ".zip":
        with zipfile.ZipFile(path) as packed:
            every = [info for info in packed.infolist() if not info.is_dir()]
            for info in every[:MOST_NAMES]:
                names.append(info.filename)
                if link is None and stat.S_ISLNK(info.external_attr >> 16) and _may_lead_out(_start(packed, info)):
                    link = info.filename
        return names, len(every) <= MOST_NAMES, link
    with tarfile.open(path) as packed_tar:
        for member in packed_tar:
            names += [member.name] if member.isfile() else []
            if link is None and (member.issym() or member.islnk()) and _may_lead_out(member.linkname):
                link = member.name
            if len(names) == MOST_NAMES or member.offset_data + member.size > MOST_TAR_BYTES:
                return names, False, link
    return names, True, link


def _start(packed: zipfile.ZipFile, info: zipfile.ZipInfo) -> str:
    """What a link in a zip file leads to."""
    with packed.open(info) as file:
        return file.read(MOST_LINK_BYTES).decode(errors="replace")


def _may_lead_out(target: str) -> bool:
    """Whether a link may lead out of its archive: one with .. in it can, through other links."""
    return target.startswith("/") or ".." in PurePosixPath(target).parts


def _recording_of(names: list[str], formats: Formats) -> tuple[str, str] | None:
    """The recording in an archive and its format, found by empty files of the same names in a temporary folder."""
    alike: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(prefix="cartier-") as temporary:
        root, folders = Path(temporary), {Path(temporary)}
        files: list[Path] = []
        for name in names:
            path = PurePosixPath(name)
            alike[str(path.parent), path.suffix] += 1
            strange = path.is_absolute() or ".." in path.parts or "\0" in name or len(path.parts) > MOST_PARTS
            if strange or alike[str(path.parent), path.suffix] > MOST_ALIKE or len(files) == MOST_PATHS * 10:
                continue
            file = root / path
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.touch()
            except (OSError, ValueError):  # a name that this system does not have
                continue
            files.append(file)
            folders.update(parent for parent in file.parents if parent.is_relative_to(root))
        outer_first = sorted(folders, key=lambda folder: (len(folder.parts), folder))
        for other in outer_first[:MOST_PATHS] + files[:MOST_PATHS]:
            if found := formats(other):
                return other.relative_to(root).as_posix(), found[0]
    return None
