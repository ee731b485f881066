"""Commands that check and convert: convert, doctor, check-model."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier import plugins
from cartier.cli.common import AsJson, progress, say
from cartier.cli.option_groups import grouped
from cartier.cli.reader_options import Reader
from cartier.errors import CartierError, MissingExtra

if TYPE_CHECKING:
    from cartier.doctor import Report

app = typer.Typer()


@app.command()
@grouped
def convert(
    source: Annotated[str, typer.Argument(metavar="IN", help="A recording in any format that 'cartier list' shows.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT", help="The folder to write; it must not exist.")
    ],
    reader: Reader = Reader(),
) -> None:
    """Convert a recording to cartier's own format."""
    from cartier.recordings.folder import save

    recording = plugins.open_recording(source, **reader.given())
    for note in recording.notes:
        say(note)
    with progress("converting") as step:
        save(recording, output, step)
    print(f"{output}: {len(recording)} frames of {recording.name}")
    print(f"check it:  cartier doctor {output}")


@app.command()
@grouped
def doctor(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING|HOME",
            help="A recording in any format that 'cartier list' shows, or a folder that 'cartier map' made.",
        ),
    ],
    fix: Annotated[bool, typer.Option("--fix", help="Write the repaired recording to --output.")] = False,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="OUT", help="Where --fix writes.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the findings on a recording into this image.")] = None,
    as_json: AsJson = False,
    reader: Reader = Reader(),
) -> None:
    """Examine a recording or a home and report faults.

    A recording has faults in poses, depth, intrinsics or images, a home has damaged files. The exit code is 1 if
    anything is wrong.
    """
    from cartier.doctor import Report, draw_report, examine, examine_home, is_home, open_for_doctor, repair
    from cartier.recordings.folder import save

    if "://" not in source and is_home(source):
        if fix or plot:
            raise CartierError(f"{source} is a mapped home: --fix and --plot are for recordings")
        report = examine_home(source)
        _print(report, as_json)
        raise typer.Exit(0 if report.ok else 1)
    if fix and output is None:
        raise CartierError("--fix needs a folder to write to: cartier doctor RECORDING --fix -o OUT")
    recording = open_for_doctor(source, **reader.given())
    if isinstance(recording, Report):
        report = recording
    else:
        with progress("examining") as step:
            report = examine(recording, step)
        if plot:
            draw_report(recording, report, plot)
            say(f"image: {plot}")
    _print(report, as_json, () if isinstance(recording, Report) else recording.notes)
    if fix and output is not None:
        if isinstance(recording, Report):
            raise CartierError(f"{source} cannot be repaired by a program: {report.faults[0].repair}")
        with progress("repairing") as step:
            save(repair(recording, report), output, step)
        say(f"repaired: {output}")
    elif not report.ok:
        raise typer.Exit(1)


@app.command("check-model")
def check_model(
    url: Annotated[str, typer.Argument(metavar="URL", help="The server's base URL, which mostly ends in /v1.")],
    model: Annotated[str | None, typer.Option(help="The model's name on its server; default OPENAI_MODEL.")] = None,
    as_json: AsJson = False,
) -> None:
    """Check what a model on a server can do, and keep the result.

    Whether it keeps a schema, sees pictures (made ones, nothing of a home is sent), can be told not to think, and how
    fast it is.
    """
    try:
        from cartier.vision.check import check_model as check
    except ModuleNotFoundError as error:
        raise MissingExtra(f"check-model needs openai: {plugins.install('llm', error.name or '')}") from error
    from cartier.llm.capabilities import keep

    found = check(url, model)
    file = keep(found)
    if as_json:
        print(json.dumps(found.to_dict() | {"kept_in": str(file)}))
        return
    says = {True: "yes", False: "no", None: "takes no pictures"}
    print(f"{found.model} @ {found.server}")
    print(f"  keeps a schema   {says[found.keeps_schema]}, asked for as {found.form or 'none of the forms'}")
    print(f"  sees             {says[found.sees]}")
    print(f"  knows mirrored   {says[found.knows_mirrored]}")
    print(f"  thinking         {'switched off' if found.thinking == 'off' else 'cannot be switched off'}")
    print(f"  speed            {found.seconds:.2f} s a reply (median), {found.tokens_per_s:.0f} tokens a second")
    say(f"kept in {file}")


def _print(report: Report, as_json: bool, recording_notes: Sequence[str] = ()) -> None:
    if as_json:
        print(json.dumps(report.to_dict(), ensure_ascii=False))
        return
    count = len(report.faults)
    found = f"{count} fault{'s' if count > 1 else ''}" if count else "sound" if report.ok else "contradicts itself"
    print(f"{report.name}: {found}")
    for fault in report.faults:
        print(f"  {fault.fault}\n    evidence  {fault.evidence}\n    repair    {fault.how}")
    for note in (*recording_notes, *report.notes):
        print(f"  note: {note}")
