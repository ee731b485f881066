"""Command that asks a vision model about the doubtful objects of a home: verify."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cartier import specs
from cartier.cli.common import AsJson, BaseUrl, Blur, HomeFolder, ModelName, VisionName, progress, say
from cartier.errors import InputError

if TYPE_CHECKING:
    from cartier.home import Home
    from cartier.types import CandidateView, VisualQuestion
    from cartier.vision.verification import Calibration

app = typer.Typer()


@app.command()
def verify(
    home: HomeFolder,
    look: Annotated[
        str, typer.Option("--look", help="ask (you agree once before photographs are sent) or auto.")
    ] = "ask",
    vision: VisionName = "openai",
    model: ModelName = None,
    base_url: BaseUrl = None,
    blur: Blur = False,
    write_prompts: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Only write the prompts and photographs; score with --vision replay:REPLIES."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Ask a vision model once about tentative and doubtful objects, and keep what it says as evidence.

    An answer changes how likely an object is, by how often the same model is right about objects of this home that are
    beyond doubt. 'cartier undo HOME' takes the latest back.
    """
    from cartier.home import Home
    from cartier.home.looking import verify as check

    mapped = Home.load(home)
    if write_prompts is not None:
        _write(mapped, write_prompts, model, blur)
        return
    named = None if ":" in vision else model
    allowed = specs.look(look, vision, _agreed_once(mapped), blur, model=named, base_url=base_url)
    if allowed is None:
        raise InputError("--look never asks nobody: verify with --look ask or auto")
    with progress("asking") as step:
        calibration, checked = check(mapped, allowed, step)
    after = {obj.id: obj for obj in Home.load(home).objects}
    rows = [each.to_dict(after[each.obj.id].probability) for each in checked]
    if as_json:
        print(json.dumps({"model": allowed.model.name, "calibration": calibration.to_dict(), "objects": rows}))
        return
    _print(calibration, rows)


def _write(mapped: Home, file: Path, model: str | None, blur: bool) -> None:
    from cartier.home.looking import ask_about_doubts
    from cartier.vision.batch import PictureWriter
    from cartier.vision.permission import Look

    writer = PictureWriter(model)
    with progress("writing") as step:
        ask_about_doubts(mapped, Look(writer, "auto", blur=blur), step)
    folder = writer.save(file)
    print(f"{len(writer.requests)} prompts in {file}, their photographs in {folder}; nothing was sent")


def _agreed_once(mapped: Home) -> Callable[[VisualQuestion, Sequence[CandidateView]], bool]:
    """Consent to all photographs of this run, asked before the first; nobody at a terminal does not agree."""
    agreed: list[bool] = []

    def ask(question: VisualQuestion, pictures: Sequence[CandidateView]) -> bool:
        if not agreed:
            what = f"send photographs of doubtful objects in {mapped.name} to the vision model, and of a few others"
            agreed.append(sys.stdin.isatty() and typer.confirm(what, err=True))
        return agreed[0]

    return ask


def _print(calibration: Calibration, rows: Sequence[dict[str, Any]]) -> None:
    if not rows:
        print("nothing to ask: no object is in doubt that was not asked about")
        return
    known, misnamed = calibration.named, calibration.misnamed
    print(
        f"objects beyond doubt: it said yes to {known['yes']} of {known.total()} by their names and to "
        f"{misnamed['yes']} of {misnamed.total()} by others: a yes counts x {calibration.factor('yes'):.2g}, "
        f"a no x {calibration.factor('no'):.2g}"
    )
    for row in rows:
        said = row["said"] if row["asked"] else "not asked"
        why = f" ({row['why']})" if row["said"] == "cannot tell" else ""
        print(f"  {row['label']} ({row['id']}): {said}, {row['before']:.0%} before, {row['after']:.0%} now{why}")
    say("each answer is an entry of the home's log; 'cartier undo HOME' takes the latest back")
