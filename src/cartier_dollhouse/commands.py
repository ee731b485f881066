"""Commands of the simulator: demo, record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cartier import plugins, specs
from cartier.cli.common import Seed, progress
from cartier.errors import InputError

app = typer.Typer()


@app.command()
def demo(
    home: Annotated[
        str, typer.Option(help="A home of the dollhouse: studio, dollhouse:studio, or a number for a generated one.")
    ] = "kitchen_diner",
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The folder for images and answers; an older demo there is replaced.")
    ] = Path("cartier-demo"),
    seed: Seed = 0,
    detector: Annotated[str, typer.Option(help="embedded, or ground_truth (a perfect detector).")] = specs.DETECTOR,
) -> None:
    """Run everything offline on a built-in home.

    Explores and maps the home, asks three requests and drives to their goals.
    """
    from cartier_dollhouse.demo import run

    steps = run(home, out, seed, detector, say=print, progress=progress)
    print(f"\nimages:      {', '.join(str(out / step.picture) for step in steps)}")
    print(f'ask more:    cartier ask {out / "home"} "I\'d like to read a little" --plot answer.png')
    print("your own:    cartier map RECORDING -o HOME      (cartier list shows the formats)")


@app.command()
def record(
    source: Annotated[
        str,
        typer.Argument(metavar="WORLD:HOME", help="dollhouse:studio, dollhouse:7 (generated), ai2thor:FloorPlan1 …"),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="The folder to write.")],
    seed: Seed = 0,
    sensor: Annotated[
        str,
        typer.Option(
            metavar="KIND", help="exact, or with the faults of a depth-camera or phone: depth, images, poses."
        ),
    ] = "exact",
    drive: Annotated[bool, typer.Option("--drive", help="Drive with the keyboard instead of exploring.")] = False,
) -> None:
    """Explore a home of a simulator and save the recording."""
    from cartier.recordings.folder import save

    name, _, home = source.partition(":")
    world = plugins.make("worlds", name)
    if not home:
        raise InputError(f"which home? {name} has {', '.join(world.homes())}: cartier record {name}:HOME -o {output}")
    options: dict[str, Any] = {"seed": seed} | ({"drive": True} if drive else {})
    options |= {"sensor": sensor} if sensor != "exact" else {}
    recording = world.explore(home, **options)
    with progress("saving") as step:
        save(recording, output, step)
    print(f"{output}: {len(recording)} frames of {recording.name}")
    print(f"map it:  cartier map {output} -o HOME")
