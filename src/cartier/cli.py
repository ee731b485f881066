"""The command line: parse, call, print. No logic lives here."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import plugins
from cartier.errors import CartierError, InputError
from cartier.prompts import check_query

if TYPE_CHECKING:
    from cartier.contracts import Recording
    from cartier.home import Home
    from cartier.types import Answer

app = typer.Typer(
    help="Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output; all else goes to standard error.")
]
HomeFolder = Annotated[Path, typer.Argument(metavar="HOME", help="A folder that 'cartier map' made.")]
IndexName = Annotated[str | None, typer.Option("--index", help="Which of the home's indices to look in.")]


def main() -> None:
    """Entry point: a user's mistake is one line and exit code 1, anything else keeps its traceback."""
    try:
        app()
    except CartierError as error:
        print(f"cartier: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)


@app.command()
def demo(
    home: Annotated[
        str, typer.Option(help="A home of the dollhouse by name, or a number for a generated one.")
    ] = "kitchen_diner",
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="The folder to leave pictures and answers in; an older demo there is replaced."
        ),
    ] = Path("cartier-demo"),
    seed: Annotated[int, typer.Option(help="Another number, another exploration.")] = 0,
) -> None:
    """Run the whole line on a built-in home, offline: explore, map, ask three requests, drive there."""
    from cartier.demo import run

    told = run(home, out, seed, say=print, progress=_progress)
    print(f"\nlook at  {', '.join(str(out / t.picture) for t in told)}")
    print(f'ask more:    cartier ask {out / "home"} "I\'d like to read a little" --plot answer.png')
    print("your own:    cartier map RECORDING --detector MODEL.onnx -o HOME      (cartier list shows the formats)")


@app.command()
def record(
    source: Annotated[
        str,
        typer.Argument(
            metavar="WORLD:HOME", help="For example dollhouse:studio, dollhouse:7 (generated), ai2thor:FloorPlan1."
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="The folder to write the recording to.")
    ],
    seed: Annotated[int, typer.Option(help="Another number, another exploration.")] = 0,
    sensor: Annotated[bool, typer.Option(help="Disturb depth, image and poses as a real sensor does.")] = False,
    drive: Annotated[bool, typer.Option("--drive", help="Steer with the keyboard instead of exploring.")] = False,
) -> None:
    """Explore a home of a simulator and save the recording."""
    from cartier.recordings.folder import save

    name, _, home = source.partition(":")
    world = plugins.make("worlds", name)
    if not home:
        raise InputError(f"which home? {name} has {', '.join(world.homes())}: cartier record {name}:HOME -o {output}")
    options: dict[str, Any] = {"seed": seed} | ({"sensor": True} if sensor else {}) | ({"drive": True} if drive else {})
    recording = world.explore(home, **options)
    with _progress("saving") as progress:
        save(recording, output, progress)
    print(f"{output}: {len(recording)} frames of {recording.name}")
    print(f"map it:  cartier map {output} --detector ground_truth -o HOME")


@app.command("map")
def map_command(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="A recording in any format that 'cartier list' shows.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="HOME", help="The folder to write; an older home there is replaced at the end."
        ),
    ],
    detector: Annotated[
        str,
        typer.Option(
            help="FILE.onnx, detections in FILE.json or FILE.jsonl, transformers:MODEL, ./mine.py, or a name from 'cartier list'."
        ),
    ],
    threshold: Annotated[
        float | None, typer.Option(help="Least score of a detection; each detector has its own default.")
    ] = None,
    vocabulary: Annotated[
        Path | None, typer.Option(help="Text file of names for a zero-shot transformers model; default: LVIS's 1,203.")
    ] = None,
    index: Annotated[
        str | None,
        typer.Option("--index", help="Indices to build, separated by commas. Default: all that need no encoder."),
    ] = None,
    encoder: Annotated[
        str, typer.Option(help="For the index vlmaps: embedded, or clip:MODEL, lseg:FILE (a folder or a hub id).")
    ] = "embedded",
    min_views: Annotated[
        int | None, typer.Option(help="How many frames must agree on an object; each detector has its own default.")
    ] = None,
    radius: Annotated[float, typer.Option(help="Robot radius in metres, for the goals.")] = 0.2,
    up: Annotated[
        str | None,
        typer.Option(help="X,Y,Z: which way is up in the recording's own world, if it is estimated wrongly."),
    ] = None,
    floor: Annotated[
        float | None, typer.Option(help="Height in metres of the floor along up, if it is estimated wrongly.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Map a recording: detect objects, build the indices and the floor plan, save a home."""
    from cartier.pipeline import map_home

    level: dict[str, Any] = {"up": _numbers(up, 3, "--up"), "floor_m": floor}
    source = plugins.open_recording(recording, **{name: value for name, value in level.items() if value is not None})
    for note in source.notes:
        _say(note)
    eyes = _detector(detector, threshold, vocabulary, source)
    names = [name.strip() for name in index.split(",")] if index else None
    unfinished = output.parent / f".{output.name}.unfinished.jsonl"
    with _progress("mapping") as progress:
        home = map_home(
            source, eyes, names, encoder=encoder, min_views=min_views, robot_radius_m=radius, resume=unfinished,
            progress=progress,
        )  # fmt: skip
    home.save(output)
    unfinished.unlink(missing_ok=True)
    if as_json:
        print(json.dumps({"home": str(output), "id": home.id, "objects": home.objects, "notes": list(home.notes)}))
    else:
        print(f"{output}: {len(home.objects)} kinds of object in {len(source)} frames ({home.detector})")
        print(f'ask it something:  cartier ask {output} "I would love to sit down"')


@app.command()
def ask(
    home: HomeFolder,
    words: Annotated[str, typer.Argument(metavar="WORDS", help="What the person says, in their own words.")],
    reasoner: Annotated[
        str | None, typer.Option(help="embedded, openai, … Default: openai if a key or base URL is set, else embedded.")
    ] = None,
    model: Annotated[str | None, typer.Option(help="The language model's name on its server.")] = None,
    base_url: Annotated[str | None, typer.Option(help="The server's URL; default OPENAI_BASE_URL.")] = None,
    replies: Annotated[Path | None, typer.Option(help="Recorded replies, for --reasoner replay.")] = None,
    index: IndexName = None,
    start: Annotated[
        str | None,
        typer.Option("--from", metavar="X,Y", help="Where the robot stands; default: where the recording began."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the answer into this picture.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what you need; get the object that serves it, its place, and a pose to drive to."""
    from cartier.home import Home
    from cartier.pipeline import ask as answer_to

    mapped = Home.load(home)
    mind = _reasoner(reasoner, model, base_url, replies)
    answer = answer_to(mapped, words, mind, index=index, from_xy=_numbers(start, 2, "--from"))
    mapped.remember(answer)
    if plot:
        from cartier.picture import draw_answer

        draw_answer(mapped, answer, plot)
        _say(f"picture: {plot}")
    print(json.dumps(answer.to_dict(), ensure_ascii=False)) if as_json else _print_answer(answer)


@app.command()
def show(
    home: HomeFolder,
    index: IndexName = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the floor plan with the objects into this picture.")] = None,
    find: Annotated[
        str | None, typer.Option(metavar="WORDS", help="Draw how similar any words are to each spot (index vlmaps).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show what is in a home: every kind of object, how often it was seen, and where it is."""
    from cartier.home import Home

    mapped = Home.load(home)
    if find is not None:
        _find(mapped, check_query(find), index, plot or Path("find.png"), as_json)
        return
    rows = mapped.table(index)
    if plot:
        from cartier.picture import draw_home

        draw_home(mapped, plot, index)
        _say(f"picture: {plot}")
    if as_json:
        about = {"home": mapped.name, "id": mapped.id, "detector": mapped.detector, "index": mapped.index(index)[0]}
        print(json.dumps(about | {"objects": rows, "notes": list(mapped.notes)}, ensure_ascii=False))
    else:
        _print_table(mapped, rows, mapped.index(index)[0])


@app.command("list")
def list_command(as_json: AsJson = False) -> None:
    """List every backend there is, and what it needs."""
    rows = [backend for kind in plugins.KINDS for backend in plugins.backends(kind)]
    if as_json:
        print(json.dumps([vars(row) for row in rows]))
        return
    for kind in dict.fromkeys(row.kind for row in rows):
        print(kind)
        for row in (r for r in rows if r.kind == kind):
            needs = f"  [needs cartier[{row.extra}]]" if row.extra else ""
            print(f"  {row.name:18} {row.summary}{needs}")


def _find(home: Home, words: str, index: str | None, plot: Path, as_json: bool) -> None:
    from cartier.picture import draw_find

    name, searched = home.searchable(index)
    place = draw_find(home, words, plot, name)
    for note in searched.notes:
        _say(note)
    about = {"home": home.name, "index": name, "encoder": searched.encoder, "detector": home.detector}
    if as_json:
        print(json.dumps(about | {"words": words, "place": place.to_dict(), "picture": str(plot)}, ensure_ascii=False))
        return
    x, y, z = place.position
    print(f"best   x {x:.2f}  y {y:.2f}  z {z:.2f} m   (cosine {place.score:.2f}, frame {place.frame})")
    print(f"  by     {name}, {searched.encoder}, {home.detector}")
    print(f"  look   {plot}")


def _detector(spec: str, threshold: float | None, vocabulary: Path | None, source: Recording) -> Any:
    given = {"threshold": threshold, "vocabulary": vocabulary}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if spec == "ground_truth":
        options |= {"truth": source.truth, "source": source.name}
    suffix = Path(spec).suffix.lower()
    if suffix == ".onnx":
        return plugins.make("detectors", "onnx", model=spec, **options)
    if suffix in (".json", ".jsonl"):
        return plugins.make("detectors", "file", path=spec, **options)
    return plugins.make_from_spec("detectors", spec, **options)


def _reasoner(name: str | None, model: str | None, base_url: str | None, replies: Path | None) -> Any:
    if name is None:
        name = (
            "openai"
            if base_url or os.environ.get("OPENAI_API_KEY") or os.environ.get("OPENAI_BASE_URL")
            else "embedded"
        )
        if name == "embedded":
            _say("no OPENAI_API_KEY and no OPENAI_BASE_URL: the embedded reasoner answers")
    given = {"model": model, "base_url": base_url, "path": replies}
    return plugins.make("reasoners", name, **{key: value for key, value in given.items() if value is not None})


def _numbers(text: str | None, count: int, option: str) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise InputError(f"{option} needs {count} numbers separated by commas, got {text!r}")
    return numbers


def _say(line: str) -> None:
    print(line, file=sys.stderr)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on standard error where a person watches; silence where nobody does."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _print_answer(answer: Answer) -> None:
    chosen, place, goal = answer.selection, answer.place, answer.goal
    print(f"{chosen.status}: {chosen.object or chosen.question or chosen.reason}")
    if chosen.object and chosen.reason:
        print(f"  why    {chosen.reason}")
    if place:
        x, y, z = place.position
        what = "seen from" if place.view_yaw is not None else "place"
        print(f"  {what:6} x {x:.2f}  y {y:.2f}  z {z:.2f} m   (frame {place.frame}, score {place.score:.2f})")
    if goal:
        print(f"  goal   x {goal.x:.2f}  y {goal.y:.2f} m  yaw {goal.yaw:.2f} rad   ({goal.length_m:.2f} m to drive)")
    for note in answer.notes:
        print(f"  note   {note}")
    print(f"  by     {answer.reasoner}, {answer.index}, {answer.detector}")


def _print_table(home: Home, rows: list[dict[str, Any]], index: str) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        "object",
        "frames",
        "best score",
        "x (m)",
        "y (m)",
        "z (m)",
        "evidence",
        box=box.SIMPLE,
        title=home.name,
        title_justify="left",
    )
    for row in rows:
        place = row["place"]
        where = [f"{v:.2f}" for v in place["position"]] + [f"frame {place['frame']}"] if place else ["–", "–", "–", "–"]
        table.add_row(row["object"], str(row["frames"]), f"{row['best_score']:.2f}", *where)
    console = Console(width=None if sys.stdout.isatty() else 100)
    console.print(table)
    console.print(
        f"index: {index}   detector: {home.detector}   robot radius: {home.robot_radius_m} m", highlight=False
    )
    for note in home.notes:
        console.print(f"note: {note}", highlight=False, markup=False)
