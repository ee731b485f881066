"""The command that repeats the paper's evaluation: bench."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import specs
from cartier.cli._common import AsJson, progress, say
from cartier.contracts import Reasoner
from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier.evaluation.batch import PromptWriter

app = typer.Typer()


@app.command()
def bench(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="RUN", help="The run folder; an interrupted run goes on there.")
    ],
    homes: Annotated[
        str | None, typer.Option(help="Homes of the world, separated by commas. Default: all that it names.")
    ] = None,
    methods: Annotated[str | None, typer.Option(help="Methods, separated by commas. Default: all.")] = None,
    suite: Annotated[
        str, typer.Option(help="paper: its evaluation; things: requests and questions about particular things.")
    ] = "paper",
    queries: Annotated[
        str | None,
        typer.Option(
            help="Suite paper: paper (default), extended, or your own FILE.jsonl with id, type, target, accept, text a line. "
            "Suite things: all (default), made, written, or a FILE.jsonl as docs/things.md has it."
        ),
    ] = None,
    answers: Annotated[
        Path | None, typer.Option(help="Suite things: score these answers of any system, as docs/things.md has them.")
    ] = None,
    reasoner: Annotated[
        str | None, typer.Option(help="Any of 'cartier list', or NAME:MODEL. Default: embedded; replay with --replies.")
    ] = None,
    model: Annotated[str | None, typer.Option(help="The language model's name on its server.")] = None,
    base_url: Annotated[str | None, typer.Option(help="The server's URL; default OPENAI_BASE_URL.")] = None,
    replies: Annotated[
        Path | None,
        typer.Option(help="Score recorded replies: {query, reply} a line, or what came back of --write-prompts."),
    ] = None,
    write_prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write every prompt of the run as a batch file of OpenAI's Batch API, ask nobody, and score nothing. With "
            "--replies: those that have no reply yet.",
        ),
    ] = None,
    prompt: Annotated[str | None, typer.Option(help="The language model's prompt: rich (default) or paper.")] = None,
    detector: Annotated[
        list[str] | None,
        typer.Option(
            help="As for map; ground_truth:misses=0.3,jitter=0.05 disturbs the truth. Several, each with its own --detector, "
            f"stand side by side in the report. Default: {specs.DETECTOR}."
        ),
    ] = None,
    encoder: Annotated[
        str | None, typer.Option(help="As for map. Default: embedded, from pixels where the detector is.")
    ] = None,
    world: Annotated[str, typer.Option(help="The simulator: dollhouse, or ai2thor with --homes.")] = "dollhouse",
    seed: Annotated[int, typer.Option(help="Of exploring, of the detector's faults, and of the random yardstick.")] = 0,
    maps: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep the mapped homes here, for other runs too. Default: RUN/maps."),
    ] = None,
    marked: Annotated[
        Path | None,
        typer.Option(help="RUN/marking.csv with its column filled in by hand: how far the automatic match agrees."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's evaluation: every method, every kind of request, in every home; tables, figures, failures."""
    from cartier.evaluation.batch import PromptWriter

    answered = specs.reasoner("replay", path=replies) if replies and write_prompts else None
    writer = PromptWriter(model, prompt or "rich", answered) if write_prompts is not None else None
    who = reasoner or ("replay" if replies else "embedded")
    own_prompt = None if who == "replay" else prompt  # a reply is read alike, whatever prompt it answers
    if suite == "things":
        thinks = writer or specs.reasoner(who, model=model, base_url=base_url, prompt=own_prompt, path=replies)
        _things(
            output, homes, detector, queries or "all", world, seed, thinks, maps or output / "maps", answers, as_json
        )
        _save(writer, write_prompts)
        return
    if suite != "paper" or answers is not None:
        raise InputError(
            "--answers goes with --suite things" if suite == "paper" else f"there is no suite {suite!r}: paper, things"
        )
    queries = queries or "paper"
    from cartier.evaluation import report
    from cartier.evaluation.maps import Maps, MapSettings, encoder_for
    from cartier.evaluation.methods import METHODS
    from cartier.evaluation.queries import SPLITS, load_file, load_queries
    from cartier.evaluation.run import BenchSettings, run
    from cartier.evaluation.run import write_prompts as write

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
    thinks = specs.reasoner(who, model=model, base_url=base_url, prompt=own_prompt, path=replies)
    found = []
    for folder, settings in runs:
        with _stages() as step:
            found.append(run(folder, settings, asked, thinks, kept, step))
    for folder, made in reversed(every):  # the run's own report comes last, since it has them all
        results = report.write_report(folder, Maps(kept, made).photo, beside if folder == output else ())
    rows = found[0]
    if not (output / "marking.csv").exists():  # somebody may have begun to mark it
        report.export_marking(rows, output / "marking.csv")
    if marked is not None:
        agreed = report.agreement(rows, marked)
        say(f"hand and table agree on {agreed['agree']:.1%} of {agreed['n']} answers (kappa {agreed['kappa']:.2f})")
    if as_json:
        print(json.dumps(results))
        return
    say(f"{len(rows)} answers by {len(settings.methods)} methods in {len(where)} homes")
    print(f"read  {output / 'report.md'}\nlook  {output / 'object_match.png'}, {output / 'failures.html'}")


def _things(
    output: Path, homes: str | None, detector: list[str] | None, queries: str, world: str, seed: int, thinks: Reasoner,
    maps: Path, answers: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Requests and questions about particular things, asked of our own system or answered in a file."""
    from cartier.evaluation import things_run
    from cartier.evaluation.batch import PromptWriter
    from cartier.evaluation.things import load_answers

    made_by = tuple(dict.fromkeys(detector or things_run.DETECTORS))
    replayed = thinks.name.startswith("replay ")  # replies are to the prompts with the map
    settings = things_run.ThingsSettings(
        _names(homes) or things_run.homes_of(queries), made_by, queries, world, seed,
        runs=("map", "blind") if replayed else things_run.RUNS,
    )  # fmt: skip
    with _stages() as step:
        items = things_run.requests(settings, maps, step)
        if isinstance(thinks, PromptWriter):
            things_run.write_prompts(settings, items, thinks, maps, step)
            return
        if answers is not None:
            things_run.score_answers(output, settings, items, load_answers(answers, items), answers.name)
        else:
            things_run.run(output, settings, items, thinks, maps, step)
    if as_json:
        print((output / "results.json").read_text("utf-8"))
        return
    print((output / "report.md").read_text("utf-8"))
    say(f"{len(items)} requests in {len(settings.homes)} homes; look at {output / 'failures.md'} too")


def _save(writer: PromptWriter | None, file: Path | None) -> None:
    if writer is not None and file is not None:
        writer.save(file)
        print(f"{len(writer.requests)} prompts in {file}; nothing was sent. Score what comes back with --replies FILE")


def _folder(detector: str) -> str:
    """The name of a folder beside the run's own files."""
    return "with-" + "".join(c if c.isalnum() or c in "-_" else "_" for c in detector)[:80]


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip()) if text else ()


class _stages:
    """One progress bar after the other: a home being mapped, then the questions."""

    def __enter__(self) -> Any:
        self._bar: Any = None
        self._what, self._step = "", None
        return self._tell

    def _tell(self, what: str, done: int, total: int) -> None:
        if what != self._what:
            self.__exit__()
            self._bar, self._what = progress("asking" if what == "asking" else f"mapping {what}"), what
            self._step = self._bar.__enter__()
        assert self._step is not None
        self._step(done, total)

    def __exit__(self, *error: Any) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)
            self._bar = None
