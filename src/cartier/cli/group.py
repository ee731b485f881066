"""The group of all commands: each is imported when it is used, and the help of all is read from their sources."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

OWN = {
    command: module
    for module, commands in (
        ("_make", "map"), ("_list", "list"), ("_live", "live"), ("_join", "join"),
        ("_check", "convert doctor check-model"), ("_show", "show"), ("_ask", "ask"), ("_verify", "verify"),
        ("_correct", "name confirm relabel add merge split forget move undo"), ("_rules", "rules"),
        ("_serve", "serve mcp export"),
    )
    for command in commands.split()
}  # fmt: skip


class _ByName(Mapping[str, Any]):
    """The commands of this package and of those beside it (entry points ``cartier.commands``), by name."""

    @cached_property
    def beside(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in sorted(entry_points(group="cartier.commands"), key=lambda e: e.name)}

    def __getitem__(self, name: str) -> Any:
        app = import_module(f"cartier.cli.{OWN[name]}").app if name in OWN else self.beside[name].load()
        within = typer.Typer(callback=lambda: None, add_completion=False, rich_markup_mode=None)
        if app.info.name:
            within.add_typer(app)
        else:
            within.registered_commands = app.registered_commands
        return typer.main.get_group(within).commands[name]

    def __iter__(self) -> Iterator[str]:
        return iter(sorted([*OWN, *self.beside], key=lambda name: name != "demo"))

    def __len__(self) -> int:
        return len(OWN) + len(self.beside)

    def help(self, name: str) -> str:
        """What a command does, from its source alone."""
        module = f"cartier.cli.{OWN[name]}" if name in OWN else self.beside[name].module
        return _helps(module).get(name, "")


class Commands(TyperGroup):
    """A group whose commands load when they are used."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands = self.by_name = _ByName()  # type: ignore[assignment]

    def list_commands(self, ctx: Any) -> list[str]:
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        limit = formatter.width - 6 - max(map(len, self.commands))
        texts = {name: typer.core.TyperCommand(name, help=self.by_name.help(name)) for name in self.commands}
        with formatter.section("Commands"):
            formatter.write_dl([(name, text.get_short_help_str(limit)) for name, text in texts.items()])


@cache
def _helps(module: str) -> dict[str, str]:
    """The help of each command that a module defines by ``app.command``, and of the group that it names."""
    package, *within = module.split(".")
    spec = find_spec(package)  # of the module itself, it would import the packages above
    folders = spec.submodule_search_locations if spec is not None else None
    file = Path(folders[0], *within).with_suffix(".py") if folders else Path((spec and spec.origin) or "")
    found = dict[str, str]()
    for node in ast.parse(file.read_text("utf-8")).body if file.is_file() else ():
        if isinstance(node, ast.FunctionDef):
            names = [d.args[0] for d in node.decorator_list if isinstance(d, ast.Call) and d.args]
            name = ast.literal_eval(names[0]) if names else node.name
            found[name] = ast.get_docstring(node) or ""
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            given = {k.arg: str(k.value.value) for k in node.value.keywords if isinstance(k.value, ast.Constant)}
            found[given.get("name", "")] = given.get("help", "")
    return found
