"""Command that joins two homes that were mapped apart: join."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier import plugins, specs
from cartier.cli.common import AsJson, HomeFolder, progress, say
from cartier.errors import InputError
from cartier.io.spool import SUFFIX

if TYPE_CHECKING:
    from cartier.contracts import Recording
    from cartier.home import Home

app = typer.Typer()


@app.command()
def join(
    home: HomeFolder,
    other: Annotated[Path, typer.Argument(metavar="OTHER", help="A home of another day, in a pose frame of its own.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="BOTH", help="The folder to write; HOME and OTHER stay as they are."),
    ],
    recording: Annotated[
        Path | None, typer.Option(help="What OTHER was mapped from. Default: OTHER.spool, of a live session.")
    ] = None,
    detector: Annotated[str | None, typer.Option(help="As for 'cartier map'; that of HOME.")] = None,
    as_json: AsJson = False,
) -> None:
    """Join two homes that were mapped apart into one, in the pose frame of the first.

    Objects and walls must agree on how the two lie; else nothing is written.
    """
    from cartier.home import Home
    from cartier.home.store import MANIFEST
    from cartier.io.atomic import check_ours, locked
    from cartier.pipeline import map_home
    from cartier.render.mapped_frames import as_mapped

    if output.resolve() in (home.resolve(), other.resolve()):
        raise InputError(f"{output} is one of the two homes: name another folder")
    check_ours(output, MANIFEST)
    old, new = Home.load(home), Home.load(other)
    source = _frames(other, new, recording)
    detects = specs.detector(detector or specs.detector_for(source)[0], source)
    with locked(output, wait_s=0.0), progress("mapping") as step:
        both = map_home(as_mapped(new, source), detects, onto=old, align=new, mend_poses=False, progress=step)
        both.save(output)
    if as_json:
        print(json.dumps({"home": str(output), "id": both.id, "names": both.names, "notes": list(both.notes)}))
        return
    for note in both.notes:
        say(note)
    print(f"{output}: {sum(obj.confirmed for obj in both.objects)} objects of {len(both.names)} kinds, of both homes")


def _frames(folder: Path, home: Home, path: Path | None) -> Recording:
    """The recording that a home was mapped from. Raises InputError if it is another one, or none is there."""
    spool = folder.with_name(f"{folder.resolve().name}{SUFFIX}")
    if path is None and not spool.exists():
        raise InputError(f"the frames of {folder} are needed: name what it was mapped from with --recording")
    source = plugins.open_recording(path or spool)
    mapped = [row["sha256"] for row in home.settings["recordings"]]
    if path is not None and source.fingerprint() not in mapped:
        raise InputError(f"{folder} was not mapped from {path}: name its own recording")
    return source
