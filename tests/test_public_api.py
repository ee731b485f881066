"""Public API: what ``cartier`` exports, what its docstrings say, and that their examples run."""

from __future__ import annotations

import ast
import dataclasses
import doctest
import inspect
import itertools
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

import cartier
from cartier import contracts, pipeline, testing
from cartier.cli import app
from cartier.cli.group import OWN
from cartier.home import entity
from cartier.mapping import mapper
from cartier_dollhouse import Dollhouse

INTERNAL = {"Store", "Corrected", "Mended", "Alignment"}
"""Classes of fields that ``Home.load`` sets and no user makes."""
PUBLIC: dict[str, Any] = {f"cartier.{name}": getattr(cartier, name) for name in cartier.__all__}
PUBLIC |= {
    f"{module.__name__}.{name}": value
    for module in (contracts, testing)
    for name, value in vars(module).items()
    if not name.startswith("_") and callable(value) and getattr(value, "__module__", "") == module.__name__
}


def callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function, class and method, by its name."""
    for name, value in PUBLIC.items():
        yield name, value
        if not inspect.isclass(value) or issubclass(value, Exception):
            continue
        for method, member in vars(value).items():
            plain = inspect.unwrap(getattr(member, "__func__", member))
            public = not method.startswith("_") or method == "__getitem__"
            if inspect.isfunction(plain) and public and plain.__name__ != "<lambda>":  # the default of a field
                yield f"{name}.{method}", plain


def parameters(what: Callable[..., Any]) -> list[str]:
    if inspect.isclass(what) and dataclasses.is_dataclass(what):
        return [field.name for field in dataclasses.fields(what) if field.init]
    if inspect.isclass(what) and ("__init__" not in vars(what) or getattr(what, "_is_protocol", False)):
        return []
    given = inspect.signature(inspect.unwrap(what)).parameters
    return [name for name in given if name not in ("self", "cls")]


def sections(doc: str) -> dict[str, str]:
    """The Google-style sections of a docstring by their names."""
    parts = re.split(r"^(Args|Returns|Raises|Example):\n", inspect.cleandoc(doc), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def described_fields(what: Callable[..., Any]) -> set[str]:
    """The fields of a dataclass that have a string below them."""
    if not (inspect.isclass(what) and dataclasses.is_dataclass(what)):
        return set()
    body = ast.parse(inspect.cleandoc(inspect.getsource(what))).body[0].body  # type: ignore[attr-defined]
    pairs = itertools.pairwise(body)
    return {
        one.target.id
        for one, two in pairs
        if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and isinstance(two, ast.Expr)
    }


def documented(args: str) -> set[str]:
    heads = re.findall(r"^ {4}([\w*, ]+): ", args, flags=re.MULTILINE)
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


@pytest.mark.parametrize(("name", "what"), list(callables()), ids=lambda value: value if isinstance(value, str) else "")
def test_docstrings_name_every_argument_and_result(name: str, what: Callable[..., Any]) -> None:
    doc = inspect.getdoc(what)
    assert doc, name
    found, expected = sections(doc), set(parameters(what))
    assert documented(found.get("Args", "")) | described_fields(what) == expected, name
    if inspect.isclass(what):
        return
    back = inspect.signature(inspect.unwrap(what)).return_annotation
    assert ("Returns" in found) == (back not in ("None", inspect.Signature.empty)), name


def test_raises_sections_name_errors() -> None:
    known = {"IndexError", "KeyError", "TypeError", "ValueError", "AssertionError"} | set(cartier.__all__)
    count = 0
    for name, what in callables():
        raises = documented(sections(inspect.getdoc(what) or "").get("Raises", ""))
        assert raises <= known, name
        count += bool(raises)
    assert count > 30


def test_classes_in_public_signatures_are_exported() -> None:
    seen = set()
    for name in cartier.__all__:
        value = getattr(cartier, name)
        holders = list(value.__mro__[:-1]) if inspect.isclass(value) else []
        texts = [str(kind) for holder in holders for kind in inspect.get_annotations(holder).values()]
        functions = [what for found, what in callables() if found.split(".")[1] == name and not inspect.isclass(what)]
        texts += [str(kind) for function in functions for kind in function.__annotations__.values()]
        seen |= {word for text in texts for word in re.findall(r"\b[A-Z]\w+", text)}
    ours = {word for word in seen if any(word in vars(module) for module in ours_of_cartier(word))}
    assert ours - INTERNAL <= set(cartier.__all__), ours - INTERNAL - set(cartier.__all__)


def ours_of_cartier(word: str) -> list[Any]:
    """The modules of cartier that define a class of this name."""
    modules = [module for name, module in sys.modules.items() if name.startswith("cartier.")]
    return [m for m in modules if getattr(getattr(m, word, None), "__module__", "") == m.__name__]


@pytest.fixture(scope="module")
def one_walk() -> Iterator[None]:
    """Worlds give the walk of equal options once: all examples show the same one."""
    walks: dict[str, Any] = {}
    explore = Dollhouse.explore

    def kept(world: Dollhouse, home: str, **options: Any) -> Any:
        key = repr((world._size, home, sorted(options.items())))
        if key not in walks:
            walks[key] = explore(world, home, **options)
        return walks[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dollhouse, "explore", kept)
        yield


@pytest.mark.usefixtures("one_walk")
@pytest.mark.parametrize(
    "where", [pipeline.map_home, pipeline.ask, mapper.Mapper, entity.Home], ids=lambda where: where.__name__
)
def test_examples_run(where: Any) -> None:
    tests = doctest.DocTestFinder(recurse=False).find(where, where.__name__, globs={})
    assert len(tests) == 1 and len(tests[0].examples) >= 5
    result = doctest.DocTestRunner().run(tests[0])
    assert result.failed == 0


@pytest.mark.parametrize(
    ("code", "heaviest"), [("", []), ("[getattr(cartier, name) for name in cartier.__all__]", ["numpy"])]
)
def test_importing_cartier_loads_nothing_and_its_names_numpy_alone(code: str, heaviest: list[str]) -> None:
    code = (
        f"import sys; before = set(sys.modules); import cartier\n{code}\n"
        "loaded = {name.split('.')[0] for name in set(sys.modules) - before}\n"
        "print(sorted(n for n in loaded - set(sys.stdlib_module_names) if not n.startswith('_')))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == str(["cartier", "lazy_loader", *heaviest])


def test_help_loads_no_numpy() -> None:
    code = (
        "import sys; from cartier.cli import app; app(['--help'], standalone_mode=False); print('numpy' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.split()[-1] == "False"


def test_help_lists_every_command() -> None:
    lines = CliRunner().invoke(app, ["--help"]).output.partition("Commands:")[2].splitlines()
    told = [line.split(maxsplit=1) for line in lines if line.strip()]
    modules = [import_module(f"cartier.cli.{name}") for name in sorted(set(OWN.values()))]
    own = {
        command.name or command.callback.__name__ for module in modules for command in module.app.registered_commands
    }
    beside = {entry.name for entry in entry_points(group="cartier.commands")}
    assert own == set(OWN) == {name for name, _ in told} - beside and {"bench", "fleet", "play"} <= beside
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert all(
        commands[name].name == name and text.rstrip(".") in " ".join(commands[name].help.split()) for name, text in told
    )


@pytest.mark.parametrize(("before", "after"), [(None, "1"), ("4", "4")])
def test_the_command_line_keeps_numpy_to_one_thread_unless_told_otherwise(before: str | None, after: str) -> None:
    """Set before numpy loads, which reads it once."""
    code = (
        "import builtins, os, sys\nload = builtins.__import__\ndef watched(name, *rest):\n"
        "    if name == 'numpy' and name not in sys.modules: print(os.environ.get('OPENBLAS_NUM_THREADS'))\n"
        "    return load(name, *rest)\nbuiltins.__import__ = watched\nimport cartier.cli, numpy"
    )
    given = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    given |= {"OPENBLAS_NUM_THREADS": before} if before else {}
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=given).stdout
    assert said.split()[0] == after
