"""Command that maps a recording into a home: map."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier import plugins, specs
from cartier.cli.common import Append, AsJson, Every, Threshold, duration, progress, say
from cartier.cli.option_groups import grouped
from cartier.cli.reader_options import Reader
from cartier.contracts import RecordingDefaults, optional
from cartier.errors import InputError
from cartier.labels import number_of

if TYPE_CHECKING:
    from cartier.contracts import Recording
    from cartier.mapping.samples import Samples

app = typer.Typer()
A_DAY_S = 86_400.0  # how long to wait for another process that maps into the same home


@app.command("map")
@grouped
def map_command(
    recording: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING",
            help="A recording in any format that 'cartier list' shows, or s3://… of one in cartier's own.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HOME", help="The folder to write; an older home is replaced.")
    ],
    detector: Annotated[
        str | None,
        typer.Option(
            help="FILE.onnx, detections in FILE.json or FILE.jsonl, transformers:MODEL, ./mine.py, or any of "
            "'cartier list'. Default: photos, or embedded for a recording of the dollhouse."
        ),
    ] = None,
    threshold: Threshold = None,
    every: Every = None,
    all_frames: Annotated[bool, typer.Option("--all", help="Process every frame.")] = False,
    vocabulary: Annotated[
        Path | None, typer.Option(help="A file of labels for a zero-shot transformers model. Default: those of LVIS.")
    ] = None,
    index: Annotated[
        str | None,
        typer.Option("--index", help="The indices to build, separated by commas. Default: all without an encoder."),
    ] = None,
    encoder: Annotated[
        str, typer.Option(help="For the index vlmaps: embedded, embedded:pixels, clip:MODEL or lseg:FILE.")
    ] = "embedded",
    append: Append = False,
    align: Annotated[
        bool,
        typer.Option("--align", help="With --append: the recording has a pose frame of its own; find where it lies."),
    ] = False,
    keep_poses: Annotated[
        bool,
        typer.Option("--keep-poses", help="Take poses and images as they are, even if they drift or lie on a side."),
    ] = False,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Map also where a first look finds that the map will be nonsense.")
    ] = False,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Numbers of the mapping that differ from the defaults, by section; docs/design.md names them.",
        ),
    ] = None,
    as_json: AsJson = False,
    reader: Reader = Reader(),
) -> None:
    """Map a recording into a home.

    Detects objects, builds the indices and the floor plan, and saves the home.
    """
    from cartier.home import Home
    from cartier.home.store import MANIFEST
    from cartier.io.atomic import check_ours, locked
    from cartier.mapping.config import config_for, read_config
    from cartier.mapping.domain import domain_warning
    from cartier.mapping.indexing import make_indexes
    from cartier.mapping.keyframes import Keyframes, forecast
    from cartier.mapping.upright import upright
    from cartier.pipeline import map_home

    if all_frames and every is not None:
        raise InputError("--all and --every exclude each other")
    if align and not append:
        raise InputError("--align goes with --append: it moves the recording into the pose frame of the home at HOME")
    every = 1 if all_frames else every
    Keyframes(every)  # refuses an invalid number before any work
    settings = read_config(config) if config else None
    check_ours(output, MANIFEST)
    names = [name.strip() for name in index.split(",")] if index else None
    make_indexes(names or (), encoder)  # what is missing is said before the work
    source = plugins.open_recording(recording, **reader.given())
    own = specs.own_detector(optional(source, RecordingDefaults, "detector"), detector, threshold)
    chosen, why = specs.detector_for(source) if detector is None else (detector, "")
    detects = own or specs.detector(chosen, source, threshold=threshold, vocabulary=vocabulary)
    first = [*source.notes, *(line for line in (domain_warning(detects, source),) if line)]
    for note in first:
        say(note)
    if detector is None:
        say(f"detector: {chosen}, {why}; --detector takes another" if own is None else f"detector: {own.name}")
    samples = _first_look(source, anyway)
    unfinished = output.parent / f".{output.name}.unfinished.jsonl"
    with locked(output, wait_s=A_DAY_S, told=say):
        onto = Home.load(output) if append else None
        settings = config_for(settings, onto)
        if not keep_poses:
            source = upright(source, detects, () if onto is None or align else onto.settings["recordings"], samples)
            for note in source.levelled.notes:
                say(f"{note}; --keep-poses takes it as it is")
        count, seconds = forecast(source, detects, every, settings) if len(source) else (0, 0.0)
        say(f"about {count} of {len(source)} frames to process, in about {duration(seconds)}")
        with progress("mapping") as step:
            home = map_home(
                source, detects, names, encoder=encoder, onto=onto, config=settings, every=every, resume=unfinished,
                mend_poses=not keep_poses, align=align, progress=step,
            )  # fmt: skip
        if home is onto:
            say(f"{source.name} is in {output} already: nothing was added")
        if onto is None:
            home = replace(home, name=output.resolve().name or home.name)
        home.save(output)
        with suppress(OSError):  # the home is complete without it
            unfinished.unlink()
    sure = sum(obj.confirmed for obj in home.objects)
    if as_json:
        about = {"home": str(output), "id": home.id, "names": home.names, "confirmed": sure, "notes": list(home.notes)}
        print(json.dumps(about | {"tentative": len(home.objects) - sure}))
    else:
        for note in (note for note in home.notes if note not in (*first, *source.notes)):
            say(note)
        row = home.settings["recordings"][-1]
        frames = f"{row.get('looked', row['frames'])} of {row['frames']} frames"
        objects, kinds = number_of(sure, "object"), number_of(len(home.names), "kind")
        print(f"{output}: {objects} of {kinds} in {frames} ({home.detector})")
        print(f"see them:          cartier show {output} --plot plan.png --sheet sheet.png")
        print(f'ask it something:  cartier ask {output} "I would love to sit down"')


def _first_look(source: Recording, anyway: bool) -> Samples:
    """Some frames, of which the faults were said. Raises InputError if they make a map nonsense, unless ``anyway``."""
    from cartier.doctor.glance import NONSENSE, glance
    from cartier.mapping.samples import few, sample

    samples = sample(source, numbers=few(len(source)))
    for fault in glance(source, samples):
        line = f"{fault.fault}: {fault.evidence}; {fault.how}"
        if fault.fault in NONSENSE and not anyway:
            raise InputError(f"{source.name} cannot give a sound map: {line}; --anyway maps it as it is")
        say(line)
    return samples
