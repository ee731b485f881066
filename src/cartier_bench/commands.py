"""Command that repeats the paper's evaluation: bench."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartier import specs
from cartier.cli.common import AsJson, BaseUrl, ModelName, Seed, progress, say
from cartier.contracts import Reasoner
from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier_bench.batch import PromptWriter

app = typer.Typer()


@app.command()
def bench(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="RUN", help="The run folder; an interrupted run continues there.")
    ],
    homes: Annotated[str | None, typer.Option(help="Homes of the world, separated by commas. Default: all.")] = None,
    methods: Annotated[str | None, typer.Option(help="Methods, separated by commas. Default: all.")] = None,
    suite: Annotated[
        str,
        typer.Option(
            help="paper: its evaluation; things: requests and questions about particular objects; look: questions "
            "about how objects look, to a vision model (docs/look.md); routes: drives under rules, and sentences about "
            "the way (docs/routes.md)."
        ),
    ] = "paper",
    queries: Annotated[
        str | None,
        typer.Option(
            help="Suite paper: paper (default), extended, or a FILE.jsonl with id, type, target, accept, text. "
            "Suite things: all (default), made, written, or a FILE.jsonl (docs/things.md). Suite routes: a FILE.txt of "
            "sentences (default: held-out ones)."
        ),
    ] = None,
    answers: Annotated[
        Path | None, typer.Option(help="Suite things: score these answers of any system (docs/things.md).")
    ] = None,
    reasoner: Annotated[
        str | None, typer.Option(help="Any of 'cartier list', or NAME:MODEL. Default: embedded; replay with --replies.")
    ] = None,
    model: ModelName = None,
    base_url: BaseUrl = None,
    replies: Annotated[
        Path | None, typer.Option(help="Score recorded replies: lines {query, reply}, or the output of a batch.")
    ] = None,
    write_prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Only write the prompts as a file for OpenAI's Batch API; with --replies those without a reply.",
        ),
    ] = None,
    vision: Annotated[
        str | None,
        typer.Option(metavar="NAME[:MODEL]", help="Suite look: the vision model. Default: only the list answers."),
    ] = None,
    judge: Annotated[
        str | None,
        typer.Option(
            metavar="NAME[:MODEL]",
            help="Suite look: the language model that scores answers (OpenEQA's LLM-Match): openai, openai:MODEL, or "
            "replay:FILE with replies to RUN/match-prompts.jsonl. Default: nobody does.",
        ),
    ] = None,
    prompt: Annotated[str | None, typer.Option(help="The language model's prompt: rich (default) or paper.")] = None,
    detector: Annotated[
        list[str] | None,
        typer.Option(
            help="As for map, or ground_truth:misses=0.3,jitter=0.05; may be repeated to compare detectors. "
            f"Default: {specs.DETECTOR}."
        ),
    ] = None,
    encoder: Annotated[
        str | None, typer.Option(help="As for map. Default: embedded, from pixels where the detector is.")
    ] = None,
    world: Annotated[str, typer.Option(help="The simulator: dollhouse, or ai2thor with --homes.")] = "dollhouse",
    seed: Seed = 0,
    maps: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The folder of mapped homes. Default: RUN/maps.")
    ] = None,
    marked: Annotated[
        Path | None, typer.Option(help="RUN/marking.csv, filled in by hand: its agreement with the automatic match.")
    ] = None,
    runner: Annotated[
        str | None,
        typer.Option(help="Suite paper: share the homes among workers: local (processes) or ray (docs/fleet.md)."),
    ] = None,
    workers: Annotated[int, typer.Option(help="With --runner: how many homes are mapped and asked at once.")] = 2,
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's evaluation.

    Runs every method on every kind of request in every home, and writes a report.
    """
    from cartier_bench.batch import PromptWriter

    if runner is not None and (suite != "paper" or write_prompts is not None):
        raise InputError("--runner is for suite paper, and not for --write-prompts")
    if suite == "look":
        seen = f"replay:{replies}" if replies is not None else vision
        _look(output, _names(homes), seen, model, base_url, write_prompts, judge, maps or output / "maps", as_json)
        return
    answered = specs.reasoner("replay", path=replies) if replies and write_prompts else None
    writer = PromptWriter(model, prompt or "rich", answered) if write_prompts is not None else None
    who = reasoner or ("replay" if replies else "embedded")
    own_prompt = None if who == "replay" else prompt  # replies to any prompt are read alike
    if suite == "things":
        chosen = writer or specs.reasoner(who, model=model, base_url=base_url, prompt=own_prompt, path=replies)
        _things(
            output, homes, detector, queries or "all", world, seed, chosen, maps or output / "maps", answers, as_json
        )
        _save(writer, write_prompts)
        return
    if suite == "routes" and writer is not None:
        _route_prompts(queries, writer)
        _save(writer, write_prompts)
        return
    if suite == "routes":
        chosen = specs.reasoner(who, model=model, base_url=base_url, prompt=own_prompt, path=replies)
        _routes(output, _names(homes), queries, chosen, seed, as_json)
        return
    if suite != "paper" or answers is not None:
        raise InputError(
            "--answers goes with --suite things"
            if suite == "paper"
            else f"there is no suite {suite!r}: paper, things, look, routes"
        )
    queries = queries or "paper"
    from cartier_bench import report
    from cartier_bench.maps import Maps, MapSettings, encoder_for
    from cartier_bench.methods import METHODS
    from cartier_bench.queries import SPLITS, load_file, load_queries
    from cartier_bench.run import BenchSettings, run
    from cartier_bench.run import write_prompts as write
    from cartier_bench.run_shared import ReasonerSpec, share

    detectors = list(dict.fromkeys(detector or [specs.DETECTOR]))
    made_by = [MapSettings(world, one, encoder or encoder_for(one), seed) for one in detectors]
    asked = load_queries(queries) if queries in SPLITS else load_file(queries)
    where = _names(homes) or tuple(Maps(output, made_by[0]).world.homes())
    kept, beside = maps or output / "maps", [output / _folder(one) for one in detectors[1:]]
    every = list(zip([output, *beside], made_by, strict=True))
    runs = [
        (folder, BenchSettings(where, _names(methods) or tuple(METHODS), queries, made, seed, prompt))
        for folder, made in every
    ]
    if writer is not None:
        for _, settings in runs:
            with _stages() as step:
                write(writer, settings, asked, kept, step)
        _save(writer, write_prompts)
        return
    chosen = specs.reasoner(who, model=model, base_url=base_url, prompt=own_prompt, path=replies)
    found = []
    for folder, settings in runs:
        with _stages() as step:
            if runner is not None:
                spec = ReasonerSpec(who, model, base_url, own_prompt, None if replies is None else str(replies))
                share(folder, settings, asked, spec, kept, runner=runner, workers=workers, progress=step)
            found.append(run(folder, settings, asked, chosen, kept, step))
    for folder, made in reversed(every):  # the main report comes last, since it compares all
        results = report.write_report(folder, Maps(kept, made).photo, beside if folder == output else ())
    rows = found[0]
    if not (output / "marking.csv").exists():  # keep one that is being filled in
        report.export_marking(rows, output / "marking.csv")
    if marked is not None:
        agreed = report.agreement(rows, marked)
        percent = f"{agreed['agree']:.1%} of {agreed['n']} answers"
        say(f"automatic and manual match agree on {percent} (kappa {agreed['kappa']:.2f})")
    if as_json:
        print(json.dumps(results))
        return
    say(f"{len(rows)} answers by {len(settings.methods)} methods in {len(where)} homes")
    print(f"report:   {output / 'report.md'}\nfigures:  {output / 'object_match.png'}, {output / 'failures.html'}")


def _things(
    output: Path, homes: str | None, detector: list[str] | None, queries: str, world: str, seed: int,
    reasoner: Reasoner, maps: Path, answers: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Evaluate requests and questions about particular objects, or score the answers in a file."""
    from cartier_bench import things_run
    from cartier_bench.batch import PromptWriter
    from cartier_bench.things import load_answers

    made_by = tuple(dict.fromkeys(detector or things_run.DETECTORS))
    replayed = reasoner.name.startswith("replay ")  # replies belong to the prompts with the map
    settings = things_run.ThingsSettings(
        _names(homes) or things_run.homes_of(queries), made_by, queries, world, seed,
        runs=("map", "blind") if replayed else things_run.RUNS,
    )  # fmt: skip
    with _stages() as step:
        items = things_run.requests(settings, maps, step)
        if isinstance(reasoner, PromptWriter):
            things_run.write_prompts(settings, items, reasoner, maps, step)
            return
        if answers is not None:
            things_run.score_answers(output, settings, items, load_answers(answers, items), answers.name)
        else:
            things_run.run(output, settings, items, reasoner, maps, step)
    if as_json:
        print((output / "results.json").read_text("utf-8"))
        return
    print((output / "report.md").read_text("utf-8"))
    say(f"{len(items)} requests in {len(settings.homes)} homes; failures: {output / 'failures.md'}")


def _look(
    output: Path, rooms: tuple[str, ...], vision: str | None, model: str | None, base_url: str | None,
    write_prompts: Path | None, judge: str | None, maps: Path, as_json: bool,
) -> None:  # fmt: skip
    """Ask questions about how objects look, or write them with their photographs."""
    from cartier.vision.batch import PictureWriter
    from cartier_bench import llm_match, look_run

    asked = look_run.questions(rooms)
    if write_prompts is not None:
        writer = PictureWriter(model)
        with _stages() as step:
            look_run.write_prompts(asked, writer, maps, step)
        folder = writer.save(write_prompts)
        print(f"{len(writer.requests)} prompts in {write_prompts}, their photographs in {folder}; nothing was sent")
        return
    named = None if vision is None or ":" in vision else model
    allowed = None if vision is None else specs.look("auto", vision, model=named, base_url=base_url)
    judges = None if judge is None else llm_match.judge(judge, base_url)
    with _stages() as step:
        look_run.run(output, asked, None if allowed is None else allowed.model, maps, step, judges)
    print((output / ("results.json" if as_json else "report.md")).read_text("utf-8"))
    say(f"{len(asked)} questions; failures: {output / 'failures.md'}")


def _routes(
    output: Path, homes: tuple[str, ...], queries: str | None, reasoner: Reasoner, seed: int, as_json: bool
) -> None:
    """Drive under rules, and ask sentences about the way."""
    from cartier_bench import route_run

    with _stages() as step:
        route_run.run(output, homes, [Path(queries)] if queries else (), reasoner, seed, progress=step)
    print((output / ("results.json" if as_json else "report.md")).read_text("utf-8"))


def _route_prompts(queries: str | None, writer: PromptWriter) -> None:
    """Write what a language model would be asked about the way; no drive depends on it."""
    from cartier_bench import route_sentences

    lines = route_sentences.sentence_lines([Path(queries)] if queries else ())
    with _stages() as step:
        list(route_sentences.judged(lines, writer, step))


def _save(writer: PromptWriter | None, file: Path | None) -> None:
    if writer is not None and file is not None:
        writer.save(file)
        print(f"{len(writer.requests)} prompts in {file}; nothing was sent. Score the replies with --replies FILE")


def _folder(detector: str) -> str:
    """The name of the folder for another detector's run."""
    return "with-" + "".join(c if c.isalnum() or c in "-_" else "_" for c in detector)[:80]


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip()) if text else ()


@contextmanager
def _stages() -> Iterator[Callable[[str, int, int], None]]:
    """A progress bar for each stage in turn: each home that is mapped, then the requests."""
    stage: str | None = None
    step: Callable[[int, int], None] | None = None

    def tell(what: str, done: int, total: int) -> None:
        nonlocal stage, step
        if what != stage or step is None:
            stack.close()
            stage, step = (
                what,
                stack.enter_context(progress(what if what in ("asking", "driving") else f"mapping {what}")),
            )
        step(done, total)

    with ExitStack() as stack:
        yield tell
