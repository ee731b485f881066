"""Options and output that the commands share."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from cartier import plugins
from cartier.errors import InputError, MissingExtra, brief

AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output; the rest goes to standard error.")
]


def _folder(home: Path) -> Path:
    """The folder, or an InputError for a published home, which stays as it is."""
    if not home.exists() and ("#" in str(home) or ":/" in str(home)):
        raise InputError(f"{home} is no folder: 'cartier fleet pull STORE NAME -o HOME' makes one of a published home")
    return home


HomeFolder = Annotated[
    Path, typer.Argument(metavar="HOME", help="A folder that 'cartier map' wrote.", callback=_folder)
]
IndexName = Annotated[str | None, typer.Option("--index", help="The index of the home to search.")]
ModelName = Annotated[str | None, typer.Option(help="The language model's name on its server, or a FILE.gguf.")]
BaseUrl = Annotated[str | None, typer.Option(help="The server's URL; default OPENAI_BASE_URL.")]
VisionName = Annotated[
    str, typer.Option("--vision", metavar="NAME[:MODEL]", help="The vision model: any of 'cartier list'.")
]
Blur = Annotated[bool, typer.Option("--blur", help="Blur people and screens in photographs before they are sent.")]
Threshold = Annotated[float | None, typer.Option(help="The least score of a detection. Default: the detector's own.")]
Every = Annotated[int | None, typer.Option("--every", metavar="N", help="Process each N-th frame. Default: keyframes.")]
Append = Annotated[bool, typer.Option("--append", help="Add to the home at HOME (same pose frame, same detector).")]
Seed = Annotated[int, typer.Option(help="Seed of all random choices.")]


def numbers(text: str | None, count: int, option: str) -> tuple[float, ...] | None:
    """The numbers of an option, separated by commas. Raises InputError if they are not ``count`` finite ones."""
    if text is None:
        return None
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{option} needs {count} finite numbers separated by commas, got {brief(text)!r}")
    return numbers


def duration(seconds: float) -> str:
    """A time in s, min or h."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def say(line: str) -> None:
    """Print a line on standard error."""
    print(line, file=sys.stderr)


def missing(extra: str, error: ModuleNotFoundError) -> MissingExtra:
    """The error that names the extra of a package that is not installed."""
    package = (error.name or "").split(".")[0]
    if package in ("", "cartier"):  # a broken import within cartier is a bug and keeps its traceback
        raise error
    return MissingExtra(f"this needs the package {package!r}: {plugins.install(extra, package)}")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error if that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    ) as bar:  # fmt: skip
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
