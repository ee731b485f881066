"""API page: writes docs/api.md from the code; a test fails when it is out of date."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_overloads

import cartier
from cartier import contracts, testing

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
from command_line import Parser, run_script

ROOT = Path(__file__).parents[1]
PAGE, SAMPLE = ROOT / "docs" / "api.md", ROOT / "examples" / "map_and_ask.py"
FUNCTIONS = ("open_recording", "map_home", "ask", "make")
WITH_METHODS = ("Home", "Mapper", "Conversation")
ERRORS = ("CartierError", "InputError", "BackendError", "MissingExtra", "ReasonerError")
HEAD = """# The Python API

Written by `python tools/build_api_page.py` from the code. All of it is typed (`py.typed`). This sample passes
`mypy --strict`, and handles answers without an object, places without a goal, and mistakes of the user:

```python
{sample}```

`import cartier` exports all names of this page except the defaults of optional members (`cartier.contracts`) and the
checks (`cartier.testing`). Units are metres, seconds and radians; all conventions stand at the head of
`src/cartier/types/`. Mistakes of the user raise a `CartierError` whose message is one line. Names that are not on
this page may change.
"""


def page() -> str:
    """The whole page."""
    parts = [HEAD.format(sample=SAMPLE.read_text(encoding="utf-8"))]
    parts += ["## Functions\n", *(_function(getattr(cartier, name)) for name in FUNCTIONS)]
    for name in WITH_METHODS:
        parts += [f"## {name}\n", *_class(getattr(cartier, name), methods=True)]
    rest = [getattr(cartier, name) for name in cartier.__all__ if name not in (*FUNCTIONS, *WITH_METHODS, *ERRORS)]
    types = [kind for kind in rest if kind.__module__ != contracts.__name__]
    parts += ["## Core data types\n", *(line for kind in types for line in _class(kind, methods=True))]
    parts.append("## Errors\n")
    parts += [f"**`{name}`**: {_said(getattr(cartier, name))}\n" for name in ERRORS]
    parts.append("## Backend interfaces\n\nCONTRIBUTING.md says how a backend is found.\n")
    own = [value for value in vars(contracts).values() if getattr(value, "__module__", "") == contracts.__name__]
    for value in own:
        parts += _class(value, methods=True) if inspect.isclass(value) else [_function(value)]
    parts.append("## Checks of backends\n\n`cartier.testing`, for the tests of your own backend.\n")
    checks = [check for name, check in vars(testing).items() if name.startswith(("check_", "sample_"))]
    parts += [_function(inspect.unwrap(check)) for check in checks if check.__module__ == testing.__name__]
    return "\n".join(parts).rstrip() + "\n"


def _class(kind: type, methods: bool) -> Iterator[str]:
    yield f"### {kind.__name__}\n"
    yield f"{_said(kind)}\n"
    shown = dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ()
    fields = {field.name: str(field.type) for field in shown} or dict(inspect.get_annotations(kind))
    notes = _field_notes(kind)
    rows = [f"{name}: {type_}" + notes.get(name, "") for name, type_ in fields.items() if not name.startswith("_")]
    if not fields and "__init__" in vars(kind):
        rows.append(_signature(kind.__name__, kind))
    if rows:
        yield "```python\n" + "\n".join(rows) + "\n```\n"
    for name, member in _members(kind) if methods else ():
        plain = inspect.unwrap(getattr(member, "__func__", member))
        if isinstance(member, property):
            yield f"**`.{name}`** `: {inspect.signature(member.fget).return_annotation}`  \n{_said(member)}\n"  # type: ignore[arg-type]
        elif inspect.isfunction(plain) and (not name.startswith("_") or name in ("__len__", "__getitem__")):
            yield _function(plain, f"{kind.__name__}.{name}", bound=getattr(kind, name))


def _field_notes(kind: type) -> dict[str, str]:
    """The default and the docstring of each member of a protocol or of a class of defaults."""
    if kind.__module__ != contracts.__name__:
        return {}
    body = ast.parse(inspect.getsource(kind)).body[0].body  # type: ignore[attr-defined]
    notes = {}
    for member, after in itertools.pairwise([*body, ast.Pass()]):
        if isinstance(member, ast.AnnAssign):
            default = "" if member.value is None else f" = {ast.unparse(member.value)}"
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            note = f"  # {after.value.value}" if said else ""
            notes[ast.unparse(member.target)] = default + note.replace("``", "")
    return notes


def _members(kind: type) -> list[tuple[str, Any]]:
    """The members of a class, and those that it inherits from classes of cartier that are not exported."""
    bases = [base for base in kind.__mro__ if base.__module__.startswith("cartier.")]
    return [(name, member) for base in reversed(bases) for name, member in vars(base).items() if not _data(member)]


def _data(member: object) -> bool:
    return getattr(member, "__name__", "") == "<lambda>"  # the default of a field


def _function(what: Callable[..., Any], name: str = "", bound: Callable[..., Any] | None = None) -> str:
    words = _said(what)
    calls = [_signature(name or what.__name__, call) for call in get_overloads(what) or [bound or what]]
    return "```python\n" + "\n".join(calls) + "\n```\n" + (f"\n{words}\n" if words else "")


def _signature(name: str, what: Callable[..., Any]) -> str:
    """The call with its types, on one line or one parameter a line."""
    told = inspect.signature(inspect.unwrap(what))
    inner: list[str] = []
    for parameter in told.parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in inner:
            inner.append("*")
        known: dict[Any, str] = {parameter.VAR_KEYWORD: "**", parameter.VAR_POSITIONAL: "*"}
        stars = known.get(parameter.kind, "")
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        inner.append(f"{stars}{parameter.name}: {parameter.annotation}{default}")
    back = "" if told.return_annotation in (told.empty, "None") else f" -> {told.return_annotation}"
    line = f"{name}({', '.join(inner)}){back}"
    return line if len(line) <= 120 else f"{name}(\n    " + ",\n    ".join(inner) + f",\n){back}"


def _said(what: object) -> str:
    """A docstring as Markdown: its sections become lists, its example a block of code."""
    doc = (inspect.getdoc(what) or "").replace("``", "`")
    first, *rest = re.split(r"^(Args|Returns|Raises|Example):\n", doc, flags=re.MULTILINE)
    parts = [first.strip()]
    for title, text in zip(rest[::2], rest[1::2], strict=True):
        text = inspect.cleandoc(text)
        if title == "Example":
            parts.append(f"```python\n{text}\n```")
        elif title == "Returns":
            parts.append(f"*Returns*: {text}")
        else:
            items = re.sub(r"^([\w*, ]+): ", lambda head: f"- {_code(head[1])}: ", text, flags=re.MULTILINE)
            parts.append(f"*{title}*:\n\n{items}")
    return "\n\n".join(parts)


def _code(names: str) -> str:
    return ", ".join(f"`{name.strip()}`" for name in names.split(","))


def main() -> None:
    Parser(__doc__).parse_args()
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    run_script(main)
