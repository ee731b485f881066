"""Commands of a fleet: map many recordings into one store, see how it stands, and fetch a home."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from cartier.cli.common import AsJson, progress, say
from cartier.errors import InputError
from cartier.labels import number_of

app = typer.Typer(
    name="fleet", help="Many homes in one store: map, status, pull, compact, ask, query.", no_args_is_help=True
)
STATES = {"done": "done", "running": "running", "waiting": "waiting", "failed": "set aside"}
StorePlace = Annotated[
    str, typer.Argument(metavar="STORE", help="A folder, or s3://BUCKET/PREFIX, gs://…, az://… (extra fleet).")
]


@app.command("map")
def map_command(
    recordings: Annotated[
        str,
        typer.Argument(
            metavar="RECORDINGS",
            help="A folder of recordings, or s3://… of those in cartier's own format; homes are called by the paths "
            "below it.",
        ),
    ],
    store: Annotated[str, typer.Option("--store", metavar="STORE", help="A folder, or s3://BUCKET/PREFIX, gs://… .")],
    runner: Annotated[
        str, typer.Option(help="local (processes of this machine) or ray (actors of a cluster).")
    ] = "local",
    workers: Annotated[int, typer.Option(help="How many recordings are mapped at once.")] = 1,
    gpus: Annotated[float, typer.Option(help="Ray: the share of a GPU for each worker.")] = 0.0,
    detector: Annotated[str | None, typer.Option(help="As in 'cartier map'.")] = None,
    threshold: Annotated[float | None, typer.Option(help="The least score of a detection.")] = None,
    every: Annotated[int | None, typer.Option("--every", metavar="N", help="Process each N-th frame.")] = None,
    index: Annotated[str | None, typer.Option("--index", help="The indices to build, separated by commas.")] = None,
    encoder: Annotated[str, typer.Option(help="For the index vlmaps.")] = "embedded",
    config: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Numbers of the mapping.")] = None,
    lease: Annotated[
        float, typer.Option(help="Seconds without a sign of life after which a job is taken over.")
    ] = 60.0,
    as_json: AsJson = False,
) -> None:
    """Map every recording below a place into a store; what is done already is left as it is.

    Any number of these commands may run at once, and each may be stopped and run again.
    """
    from cartier.blob_stores import open_store
    from cartier.mapping.config import read_config
    from cartier.mapping.indexing import make_indexes
    from cartier.mapping.keyframes import Keyframes
    from cartier_fleet.catalog_rows import arrow
    from cartier_fleet.jobs import MapSettings, Task, find_tasks
    from cartier_fleet.runners import run
    from cartier_fleet.worker import Outcome

    arrow()
    Keyframes(every)
    names = tuple(name.strip() for name in index.split(",")) if index else None
    make_indexes(names or (), encoder)
    changed = read_config(config).differences() if config else {}
    settings = MapSettings(detector, threshold, every, names, encoder, changed)
    tasks = find_tasks(recordings)
    open_store(store).list("names/")  # what is wrong with it is said before the work
    with progress("mapping") as step:

        def told(task: Task, outcome: Outcome, done: int, total: int) -> None:
            step(done, total)
            if outcome.state in ("failed", "again", "died"):
                say(f"{task.name}: {outcome.line}{'' if outcome.state == 'failed' else ' (tried again)'}")

        outcomes = run(tasks, store, settings, runner=runner, workers=workers, gpus=gpus, lease_s=lease, told=told)
    states = [outcome.state for outcome in outcomes.values()]
    counts = {state: states.count(state) for state in ("mapped", "finished")}
    counts["failed"] = len(states) - sum(counts.values())
    if as_json:
        print(json.dumps({"store": store, **counts, "frames": sum(outcome.frames for outcome in outcomes.values())}))
    else:
        print(
            f"{store}: {counts['mapped']} mapped, {counts['finished']} were done before, {counts['failed']} set aside"
        )
        print(f"see them:  cartier fleet status {store}")
    if counts["failed"]:
        raise InputError(f"{counts['failed']} of {len(tasks)} recordings were set aside: cartier fleet status {store}")


@app.command("status")
def status_command(store: StorePlace, as_json: AsJson = False) -> None:
    """Say how many recordings are mapped, running and set aside, and why; how fast it goes, and what a home costs."""
    from cartier.blob_stores import open_store
    from cartier_fleet.status import speed, status

    found, fast = status(open_store(store)), speed(open_store(store))
    if as_json:
        print(json.dumps(found | {"speed": fast}))
        return
    print(f"{store}: {', '.join(f'{found[state]} {word}' for state, word in STATES.items())}")
    if fast:
        print(f"  {fast['frames_per_s']:g} frames a second lately; {fast['core_s_per_home']:g} core-seconds a home")
    for why, count in found["reasons"].items():
        print(f"  {count:6} {why}")


@app.command("pull")
def pull_command(
    store: StorePlace,
    home: Annotated[str, typer.Argument(metavar="NAME", help="The name of a home, or one of its versions.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HOME", help="The folder; an older home is replaced.")
    ],
) -> None:
    """Fetch a home: every checksum is verified before the folder is switched to it."""
    from cartier.blob_stores import open_store
    from cartier_fleet.publishing import pull

    pulled = pull(open_store(store), home, output)
    sure = sum(obj.confirmed for obj in pulled.objects)
    objects, kinds = number_of(sure, "object"), number_of(len(pulled.names), "kind")
    print(f"{output}: {objects} of {kinds} ({pulled.detector})")


@app.command("compact")
def compact_command(store: StorePlace) -> None:
    """Make one snapshot of the catalog's new entries, so that questions read one file and not one for each home."""
    from cartier.blob_stores import open_store
    from cartier_fleet.catalog import compact

    made = compact(open_store(store))
    print(f"{store}: {made['compacted']} new entries compacted; {made['homes']} homes, {made['objects']} objects")


@app.command("ask")
def ask_command(
    store: StorePlace,
    words: Annotated[str, typer.Argument(metavar="WORDS", help='"which flats have no fire extinguisher?"')],
    home: Annotated[
        str | None, typer.Option("--home", metavar="NAME", help="Ask one home, as 'cartier ask' does.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Answer a question over all homes: which have or lack something, how many, most, fewest, the biggest, a list."""
    from dataclasses import asdict

    from cartier.pipeline import ask
    from cartier_fleet.entity import Fleet

    if home is not None:
        answer = ask(Fleet(store).home(home), words)
        print(json.dumps(answer.to_dict()) if as_json else answer.selection.text or answer.selection.reason)
        return
    found = Fleet(store).ask(words)
    print(json.dumps(asdict(found)) if as_json else found.text)


@app.command("query")
def query_command(
    store: StorePlace,
    sql: Annotated[str, typer.Argument(metavar="SQL", help="One SELECT over homes, rooms and objects.")],
    limit: Annotated[int, typer.Option(help="The most rows.")] = 1000,
    as_json: AsJson = False,
) -> None:
    """Run SQL over the catalog; docs/fleet.md has the columns. Nothing else can be read, and nothing written."""
    from cartier_fleet.entity import Fleet

    columns, rows = Fleet(store).query(sql, limit)
    if as_json:
        print(json.dumps([dict(zip(columns, row, strict=True)) for row in rows], default=str))
        return
    print("\t".join(columns))
    for row in rows:
        print("\t".join("" if value is None else str(value) for value in row))
