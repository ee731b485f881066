"""Command that lists the backends: list."""

from __future__ import annotations

import json

import typer

from cartier import plugins
from cartier.cli.common import AsJson

app = typer.Typer()


@app.command("list")
def list_command(as_json: AsJson = False) -> None:
    """List every backend and what it needs."""
    rows = [backend for kind in plugins.KINDS for backend in plugins.backends(kind)]
    if as_json:
        print(json.dumps([vars(row) for row in rows]))
        return
    for kind in dict.fromkeys(row.kind for row in rows):
        print(kind)
        for row in (r for r in rows if r.kind == kind):
            needs = f"  [needs cartier[{row.extra}]]" if row.extra else ""
            print(f"  {row.name:18} {row.summary}{needs}")
