"""Command for the route rules of a home: rules."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Annotated

import typer

from cartier.cli._correct import Who, user
from cartier.cli.common import AsJson
from cartier.cli.places import HomePlace, home_at

app = typer.Typer()


@app.command()
def rules(
    home: HomePlace,
    add: Annotated[
        str | None, typer.Option(metavar="RULE", help="Add a rule, such as 'avoid room:bedroom hard standing'.")
    ] = None,
    lift: Annotated[str | None, typer.Option(metavar="ID|RULE", help="Take a rule back.")] = None,
    who: Who = None,
    as_json: AsJson = False,
) -> None:
    """List how the robot is to drive; add a rule, or take one back."""
    from cartier.serving.values import rule_row

    mapped = home_at(home)
    if add is not None:
        mapped, told = mapped.correct("rule", add, who=who or user())
        print(told)
    if lift is not None:
        mapped, told = mapped.correct("lift", lift, who=who or user())
        print(told)
    now = datetime.now().astimezone()
    rows = [rule_row(rule, now) for rule in mapped.rules]
    if as_json:
        print(json.dumps({"home": mapped.name, "rules": rows}, ensure_ascii=False))
    elif add is None and lift is None:
        for row in rows:
            said = f"  “{row['said']}”" if row["said"] else ""
            print(f"{row['id']}  {row['rule']}\n  {row['words']} ({row['holds']}){said}")
        if not rows:
            print(f'no rules hold in {mapped.name}: say one ("never through the bedroom"), or add one with --add')
