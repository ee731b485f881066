"""Commands that measure: bench paper, things, look and routes, one a suite."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from cartier import specs
from cartier.cli.common import AsJson, BaseUrl, ModelName, Seed, progress, say
from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier_bench.batch import PromptWriter
    from cartier_bench.paper_run import ReasonerSpec

SUITES = ("paper", "things", "look", "routes")


class Suites(TyperGroup):
    """The suites; whoever writes options before a suite's name, as it was, is told how it is written now."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0].startswith("-") and args[0] != "--help":
            named = [b for a, b in zip(args, [*args[1:], ""], strict=True) if a == "--suite"]
            named += [arg.partition("=")[2] for arg in args if arg.startswith("--suite=")]
            suite = named[0] if named else "paper"
            if suite not in SUITES:
                raise InputError(f"there is no suite {suite!r}: cartier bench {'|'.join(SUITES)} -o RUN …")
            raise InputError(f"each suite is a command of its own: cartier bench {suite} -o RUN … (without --suite)")
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="bench", cls=Suites, no_args_is_help=True,
    help="Measure: the paper's evaluation, particular things, looks, routes under rules.",
)  # fmt: skip

Run = Annotated[
    Path, typer.Option("--output", "-o", metavar="RUN", help="The run folder; an interrupted run continues there.")
]
Homes = Annotated[str | None, typer.Option(help="Homes of the world, separated by commas. Default: all.")]
ReasonerName = Annotated[
    str | None, typer.Option(help="Any of 'cartier list', or NAME:MODEL. Default: embedded; replay with --replies.")
]
Replies = Annotated[
    Path | None, typer.Option(help="Score recorded replies: lines {query, reply}, or the output of a batch.")
]
WritePrompts = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Only write the prompts as a file for OpenAI's Batch API; with --replies those without a reply.",
    ),
]
Prompt = Annotated[str | None, typer.Option(help="The language model's prompt: rich (default) or paper.")]
Detectors = Annotated[
    list[str] | None,
    typer.Option(
        "--detector", help="As for map, or ground_truth:misses=0.3,jitter=0.05; may be repeated to compare detectors."
    ),
]
WorldName = Annotated[str, typer.Option(help="The simulator: dollhouse, or ai2thor with --homes.")]
MapsFolder = Annotated[
    Path | None, typer.Option("--maps", metavar="DIR", help="The folder of mapped homes. Default: RUN/maps.")
]


@app.command()
def paper(
    output: Run,
    homes: Homes = None,
    methods: Annotated[str | None, typer.Option(help="Methods, separated by commas. Default: all.")] = None,
    queries: Annotated[
        str,
        typer.Option(help="paper, extended, or a FILE.jsonl with id, type, target, accept, text (docs/queries.md)."),
    ] = "paper",
    reasoner: ReasonerName = None,
    model: ModelName = None,
    base_url: BaseUrl = None,
    replies: Replies = None,
    write_prompts: WritePrompts = None,
    prompt: Prompt = None,
    detector: Detectors = None,
    encoder: Annotated[
        str | None, typer.Option(help="As for map. Default: embedded, from pixels where the detector is.")
    ] = None,
    world: WorldName = "dollhouse",
    seed: Seed = 0,
    maps: MapsFolder = None,
    marked: Annotated[
        Path | None, typer.Option(help="RUN/marking.csv, filled in by hand: its agreement with the automatic match.")
    ] = None,
    runner: Annotated[
        str | None, typer.Option(help="Share the homes among workers: local (processes) or ray (docs/fleet.md).")
    ] = None,
    workers: Annotated[int, typer.Option(help="With --runner: how many homes are mapped and asked at once.")] = 2,
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's evaluation: every method on every kind of request in every home, and a report."""
    from cartier_bench import paper_run, report, suite
    from cartier_bench.maps import Maps, MapSettings, encoder_for, file_name
    from cartier_bench.methods import METHODS
    from cartier_bench.queries import SPLITS, load_file, load_queries

    if runner is not None and write_prompts is not None:
        raise InputError("--runner asks, and --write-prompts asks nobody: leave one of them out")
    asked = load_queries(queries) if queries in SPLITS else load_file(queries)
    detectors = list(dict.fromkeys(detector or [specs.DETECTOR]))
    made_by = [MapSettings(world, one, encoder or encoder_for(one), seed) for one in detectors]
    where = _names(homes) or tuple(Maps(output, made_by[0]).world.homes())
    kept, beside = maps or output / "maps", [output / f"with-{file_name(one)}" for one in detectors[1:]]
    every = [
        (folder, paper_run.BenchSettings(where, _names(methods) or tuple(METHODS), queries, made, seed, prompt))
        for folder, made in zip([output, *beside], made_by, strict=True)
    ]
    if write_prompts is not None:
        with _writer(write_prompts, model, prompt, replies) as writer, _stages() as step:
            for _, settings in every:
                suite.show(paper_run.paper(None, settings, asked, writer, kept), step)
        return
    spec = _spec(reasoner, model, base_url, prompt, replies)
    who, found = spec.make(), []
    for folder, settings in every:
        with _stages() as step:
            if runner is not None:
                paper_run.share(folder, settings, asked, spec, kept, runner=runner, workers=workers, progress=step)
            found.append(suite.run(folder, paper_run.paper(folder, settings, asked, who, kept), step))
    for folder, settings in reversed(every):  # the main report comes last, since it compares all
        photo = Maps(kept, settings.maps).photo
        results = report.write_report(folder, photo, beside if folder == output else ())
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
    say(f"{len(rows)} answers by {len(every[0][1].methods)} methods in {len(where)} homes")
    print(f"report:   {output / 'report.md'}\nfigures:  {output / 'object_match.png'}, {output / 'failures.html'}")


@app.command()
def things(
    output: Run,
    homes: Homes = None,
    queries: Annotated[
        str, typer.Option(help="all, made (from the truth), written (by hand), or a FILE.jsonl (docs/things.md).")
    ] = "all",
    answers: Annotated[
        Path | None, typer.Option(help="Score these answers of any system instead of asking (docs/things.md).")
    ] = None,
    reasoner: ReasonerName = None,
    model: ModelName = None,
    base_url: BaseUrl = None,
    replies: Replies = None,
    write_prompts: WritePrompts = None,
    prompt: Prompt = None,
    detector: Detectors = None,
    world: WorldName = "dollhouse",
    seed: Seed = 0,
    maps: MapsFolder = None,
    as_json: AsJson = False,
) -> None:
    """Ask for particular things and about them: "the cup by the sink", counts, comparisons (docs/things.md)."""
    from cartier_bench import suite, things_run
    from cartier_bench.things import load_answers

    kept, asking = maps or output / "maps", write_prompts is None and answers is None
    spec = _spec(reasoner, model, base_url, prompt, replies)
    runs = (
        ("map",) if write_prompts else ("map", "blind") if spec.name.partition(":")[0] == "replay" else things_run.RUNS
    )
    settings = things_run.ThingsSettings(
        _names(homes) or things_run.homes_of(queries), tuple(dict.fromkeys(detector or things_run.DETECTORS)), queries,
        world, seed, runs=runs,
    )  # fmt: skip
    who = spec.make() if asking else None
    with _stages() as step:
        items = things_run.requests(settings, kept, step)
        if write_prompts is not None:
            with _writer(write_prompts, model, prompt, replies) as writer:
                suite.show(things_run.things(settings, items, writer, kept), step)
            return
        if answers is not None:
            given = load_answers(answers, items)
            suite.run(output, things_run.answered(settings, items, given, answers.name, kept), step)
        elif who is not None:
            suite.run(output, things_run.things(settings, items, who, kept), step)
    _show(output, as_json)
    say(f"{len(items)} requests in {len(settings.homes)} homes; failures: {output / 'failures.md'}")


@app.command()
def look(
    output: Run,
    homes: Annotated[str | None, typer.Option(help="Rooms of the suite, separated by commas. Default: all.")] = None,
    vision: Annotated[
        str | None, typer.Option(metavar="NAME[:MODEL]", help="The vision model. Default: only the list answers.")
    ] = None,
    model: ModelName = None,
    base_url: BaseUrl = None,
    replies: Annotated[Path | None, typer.Option(help="Score recorded replies: as --vision replay:FILE.")] = None,
    write_prompts: WritePrompts = None,
    judge: Annotated[
        str | None,
        typer.Option(
            metavar="NAME[:MODEL]",
            help="The language model that scores answers (OpenEQA's LLM-Match): openai, openai:MODEL, or "
            "replay:FILE with replies to RUN/match-prompts.jsonl. Default: nobody does.",
        ),
    ] = None,
    maps: MapsFolder = None,
    as_json: AsJson = False,
) -> None:
    """Ask a vision model how objects look, in rooms whose truth is known (docs/look.md)."""
    from cartier.vision.batch import PictureWriter
    from cartier_bench import llm_match, look_run, suite

    asked, kept = look_run.questions(_names(homes)), maps or output / "maps"
    if write_prompts is not None:
        writer = PictureWriter(model)
        with _stages() as step:
            suite.show(look_run.look(None, asked, writer, kept), step)
        folder = writer.save(write_prompts)
        print(f"{len(writer.requests)} prompts in {write_prompts}, their photographs in {folder}; nothing was sent")
        return
    seen = f"replay:{replies}" if replies is not None else vision
    named = None if seen is None or ":" in seen else model
    allowed = None if seen is None else specs.look("auto", seen, model=named, base_url=base_url)
    judges = None if judge is None else llm_match.judge(judge, base_url)
    with _stages() as step:
        suite.run(output, look_run.look(output, asked, None if allowed is None else allowed.model, kept, judges), step)
    _show(output, as_json)
    say(f"{len(asked)} questions; failures: {output / 'failures.md'}")


@app.command()
def routes(
    output: Run,
    homes: Homes = None,
    queries: Annotated[Path | None, typer.Option(help="A FILE.txt of sentences. Default: held-out ones.")] = None,
    reasoner: ReasonerName = None,
    model: ModelName = None,
    base_url: BaseUrl = None,
    replies: Replies = None,
    write_prompts: WritePrompts = None,
    prompt: Prompt = None,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Drive under rules, and read sentences about the way (docs/routes.md)."""
    from cartier_bench import suite
    from cartier_bench.route_homes import home_names
    from cartier_bench.route_run import RouteSettings
    from cartier_bench.route_run import routes as suite_of
    from cartier_bench.route_sentences import sentence_lines

    lines = sentence_lines([] if queries is None else [queries])
    settings = RouteSettings(home_names(_names(homes)), seed)
    with _stages() as step:
        if write_prompts is not None:
            with _writer(write_prompts, model, prompt, replies) as writer:
                suite.show(suite_of(settings, lines, writer), step)
            return
        who = _spec(reasoner, model, base_url, prompt, replies).make()
        suite.run(output, suite_of(settings, lines, who, step), step)
    _show(output, as_json)


def _spec(
    reasoner: str | None, model: str | None, base_url: str | None, prompt: str | None, replies: Path | None
) -> ReasonerSpec:
    """Who is asked; recorded replies to any prompt are read alike."""
    from cartier_bench.paper_run import ReasonerSpec

    name = reasoner or ("replay" if replies else "embedded")
    path = None if replies is None else str(replies)
    return ReasonerSpec(name, model, base_url, None if name == "replay" else prompt, path)


@contextmanager
def _writer(file: Path, model: str | None, prompt: str | None, replies: Path | None) -> Iterator[PromptWriter]:
    """Who only writes what would be asked; the file is written when the block ends."""
    from cartier_bench.batch import PromptWriter

    answered = None if replies is None else specs.reasoner("replay", path=replies)
    writer = PromptWriter(model, prompt or "rich", answered)
    yield writer
    writer.save(file)
    print(f"{len(writer.requests)} prompts in {file}; nothing was sent. Score the replies with --replies FILE")


def _show(run: Path, as_json: bool) -> None:
    print((run / ("results.json" if as_json else "report.md")).read_text("utf-8"))


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
            title = what if what in ("asking", "drawing") else f"mapping {what}"
            stage, step = what, stack.enter_context(progress(title))
        step(done, total)

    with ExitStack() as stack:
        yield tell
