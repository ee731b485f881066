"""Command that shows the contents of a home: show."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import plugins
from cartier.cli.common import AsJson, IndexName, progress, say
from cartier.cli.places import HomePlace, home_at
from cartier.cli.reader_options import as_mapped
from cartier.errors import InputError, MissingExtra
from cartier.home.dates import date_of
from cartier.llm.prompts import check_query

if TYPE_CHECKING:
    from cartier.home import Home

app = typer.Typer()


@app.command()
def show(
    home: HomePlace,
    obj: Annotated[
        int | None,
        typer.Option("--object", metavar="ID", help="Only this object, its evidence, and with --plot its best views."),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="List tentative objects, too.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw the floor plan with rooms and objects.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Draw a contact sheet: one photo of each object.")] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="With --recording: draw the boxes of objects on frames that show them.")
    ] = None,
    rrd: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a file for the viewer of rerun.io (extra viz).")
    ] = None,
    recording: Annotated[
        Path | None, typer.Option(help="The mapped recording, for --overlay; to --rrd it adds frames, depth and path.")
    ] = None,
    format: Annotated[str | None, typer.Option(help="With --recording: its format, as for map.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write the home as a web page that opens from disk.")] = None,
    find: Annotated[
        str | None, typer.Option(metavar="WORDS", help="Find the place that fits any words best (index vlmaps).")
    ] = None,
    index: IndexName = None,
    as_json: AsJson = False,
) -> None:
    """Show the objects of a home and their evidence."""
    mapped = home_at(home)
    if recording is not None and rrd is None and overlay is None:
        raise InputError("--recording adds frames to --rrd FILE and --overlay FILE: give one of them, too")
    if overlay is not None and recording is None:
        raise InputError("--overlay draws on frames: give the mapped recording with --recording")
    if find is not None:
        _find(mapped, check_query(find), index, plot, as_json)
        return
    rows = mapped.to_dict()
    if obj is not None:
        rows["objects"] = [row for row in rows["objects"] if obj in (row["id"], *row["aliases"])]
        if not rows["objects"]:
            raise InputError(f"{home} has no object {obj}: cartier show {home} lists them with their ids")
    if plot:
        from cartier.render.floor_plan import draw_home, draw_object

        draw_home(mapped, plot) if obj is None else draw_object(mapped, plot, obj)
        say(f"image: {plot}")
    if sheet:
        from cartier.render.sheet import draw_sheet

        draw_sheet(mapped, sheet)
        say(f"image: {sheet}")
    if overlay and recording is not None:
        from cartier.render.overlay import draw_overlay

        draw_overlay(mapped, as_mapped(mapped, recording, format), overlay)
        say(f"image: {overlay}")
    if rrd:
        _write_rrd(mapped, rrd, recording, format)
    if html:
        from cartier.io.atomic import write_file
        from cartier.serving.page import one_file

        write_file(html, one_file(mapped))
        say(f"page: {html}")
    if as_json:
        print(json.dumps(rows, ensure_ascii=False))
    elif obj is not None:
        _print_object(rows["objects"][0], rows["scale_guessed"])
    else:
        _print_rooms(rows, everything)


def _write_rrd(home: Home, file: Path, recording: Path | None, format: str | None) -> None:
    try:
        from cartier.render.rerun_file import write_rrd
    except ModuleNotFoundError as error:
        raise MissingExtra(f"--rrd needs the package 'rerun-sdk': {plugins.install('viz', 'rerun-sdk')}") from error
    source = None if recording is None else as_mapped(home, recording, format)
    with progress("writing") as step:
        write_rrd(home, file, source, step)
    say(f"open it: rerun {file}")


def _find(home: Home, words: str, index: str | None, plot: Path | None, as_json: bool) -> None:
    name, searched = home.searchable(index)
    place = searched.locate(words)
    assert place is not None  # an index that holds nothing is not saved
    if plot:
        from cartier.render.floor_plan import draw_find

        draw_find(home, words, plot, name)
    for note in searched.notes:
        say(note)
    about = {"home": home.name, "index": name, "encoder": searched.encoder, "detector": home.detector}
    if as_json:
        found = {"words": words, "place": place.to_dict(), "picture": str(plot) if plot else None}
        print(json.dumps(about | found, ensure_ascii=False))
        return
    x, y, z = place.position
    print(f"best   x {x:.2f}  y {y:.2f}  z {z:.2f} m   (cosine {place.score:.2f}, frame {place.frame})")
    print(f"  by     {name}, {searched.encoder}, {home.detector}")
    print(f"  image  {plot}" if plot else "  image  with --plot FILE.png")


def _print_rooms(home: dict[str, Any], everything: bool) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 110, markup=False)
    rows = [row for row in home["objects"] if row["confirmed"] or everything]
    names = {row["id"]: row["label"] for row in home["objects"]}
    rooms = {room["id"]: f"{room['name']}, {room['area_m2']:.0f} m²" for room in home["rooms"]}
    size = "size (cm, scale guessed)" if home["scale_guessed"] else "size (cm)"
    columns = ("id", "object", "certainty", "seen", size, "colour", "stands", "last seen")
    for room in [*rooms, None]:
        here = [row for row in rows if row["room"] == room]
        if not here:
            continue
        title = rooms.get(room, "not in a room" if rooms else home["home"])
        table = Table(*columns, box=box.SIMPLE, title=title, title_justify="left")
        for row in sorted(here, key=lambda row: (not row["confirmed"], row["label"], row["id"])):
            on = row["on"]
            table.add_row(
                str(row["id"]), ", ".join([*row["names"], row["label"]]) + ("" if row["confirmed"] else " ?"),
                f"{row['probability']:.0%}", f"{row['n_detected']} of {row['n_observable']}", _size(row),
                ", ".join(name for name, _ in row["colours"][:2]),
                "" if on is None else f"{on['relation']} {names[on['id']]}", _when(row["last_seen_s"]),
            )  # fmt: skip
        console.print(table)
    sure = sum(row["confirmed"] for row in home["objects"])
    rest = len(home["objects"]) - sure
    hint = "" if everything or not rest else " (--all lists them)"
    console.print(f"{sure} objects confirmed, {rest} tentative{hint}")
    console.print(f"detector: {home['detector']}", highlight=False)
    for note in home["notes"]:
        console.print(f"note: {note}", highlight=False)


def _when(time_s: float) -> str:
    """A frame's time: its date, or the seconds since the recording began."""
    date = date_of(time_s, time.time())
    return f"{time_s:.1f} s" if date is None else f"{date:%Y-%m-%d %H:%M} UTC"


def _size(row: dict[str, Any]) -> str:
    return " x ".join(f"{100 * side:.0f}" for side in row["size_m"]) if row["located"] else "distance unknown"


def _print_object(row: dict[str, Any], scale_guessed: bool) -> None:
    state = "confirmed" if row["confirmed"] else "tentative"
    print(f"{row['label']} {row['id']}: {state}, {row['probability']:.0%} probable")
    guess = ", by a guessed scale" if scale_guessed else ""
    if row["located"]:
        x, y, z = row["position"]
        print(f"  place  x {x:.2f}  y {y:.2f}  z {z:.2f} m, {_size(row)} cm{guess}")
    else:
        (x0, y0, _), (x1, y1, _) = row["box_min"], row["box_max"]
        print(f"  place  x {x0:.2f} to {x1:.2f}  y {y0:.2f} to {y1:.2f} m: its distance is unknown{guess}")
    frames = f"{row['n_detected']} of {row['n_observable']} frames in which it was observable"
    when = _when(row["last_seen_s"])
    print(f"  seen   in {frames}, last {'on' if when.endswith('UTC') else 'at'} {when}")
    print(f"  labels {', '.join(f'{name} ({weight:.2f})' for name, weight in row['labels'])}")
    if row["colours"]:
        print(f"  colour {', '.join(f'{name} {share:.0%}' for name, share in row['colours'])}")
    for view in row["views"]:
        print(f"  view   frame {view['frame']}, score {view['score']:.2f}, box {[round(v) for v in view['box_xyxy']]}")
