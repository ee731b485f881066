"""Write docs/api.md from the code: ``python tools/build_api_page.py``. A test says when it has to be run again."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_overloads

import cartier
from cartier import contracts, testing

ROOT = Path(__file__).parents[1]
PAGE, SAMPLE = ROOT / "docs" / "api.md", ROOT / "examples" / "map_and_ask.py"
FUNCTIONS = ("open_recording", "map_home", "ask", "make")
WITH_METHODS = ("Home", "Mapper")
ERRORS = ("CartierError", "InputError", "BackendError", "MissingExtra", "ReasonerError")
HEAD = """# The Python API

Written by `python tools/build_api_page.py` from the code. All of it has types (`py.typed`); this sample passes `mypy
--strict`, and survives an answer without an object, a place without a goal, and what a user gets wrong:

```python
{sample}```

`import cartier` brings all names of this page but the contracts (`cartier.contracts`) and the laws
(`cartier.testing`). Metres, seconds, radians; the conventions stand at the head of `src/cartier/types.py`. What a user
got wrong is a `CartierError` of one line. Names that are not here may change.
"""


def page() -> str:
    """The whole page."""
    parts = [HEAD.format(sample=SAMPLE.read_text(encoding="utf-8"))]
    parts += ["## Functions\n", *(_function(getattr(cartier, name)) for name in FUNCTIONS)]
    for name in WITH_METHODS:
        parts += [f"## {name}\n", *_class(getattr(cartier, name), methods=True)]
    rest = [name for name in cartier.__all__ if name not in (*FUNCTIONS, *WITH_METHODS, *ERRORS)]
    parts += ["## What flows\n", *(line for name in rest for line in _class(getattr(cartier, name), methods=False))]
    parts.append("## Errors\n")
    parts += [f"**`{name}`**: {_said(getattr(cartier, name))}\n" for name in ERRORS]
    parts.append(
        "## What can be swapped\n\nProtocols of `cartier.contracts`; CONTRIBUTING.md says how a backend is found.\n"
    )
    kinds = [
        kind
        for kind in vars(contracts).values()
        if getattr(kind, "_is_protocol", False) and kind.__module__ == contracts.__name__
    ]
    parts += [line for kind in kinds for line in _class(kind, methods=True)]
    parts.append("## Laws\n\n`cartier.testing`, for the tests of your own backend.\n")
    laws = [law for name, law in vars(testing).items() if name.startswith(("check_", "sample_"))]
    parts += [_function(inspect.unwrap(law)) for law in laws if law.__module__ == testing.__name__]
    return "\n".join(parts).rstrip() + "\n"


def _class(kind: type, methods: bool) -> Iterator[str]:
    yield f"### {kind.__name__}\n"
    yield f"{_said(kind)}\n"
    shown = dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ()
    fields = {field.name: str(field.type) for field in shown} or dict(inspect.get_annotations(kind))
    rows = [f"{name}: {type_}" for name, type_ in fields.items() if not name.startswith("_")]
    if not fields and "__init__" in vars(kind):
        rows.append(_signature(kind.__name__, kind))
    if rows:
        yield "```python\n" + "\n".join(rows) + "\n```\n"
    for name, member in vars(kind).items() if methods else ():
        plain = inspect.unwrap(getattr(member, "__func__", member))
        if isinstance(member, property):
            yield f"**`.{name}`** `: {inspect.signature(member.fget).return_annotation}`  \n{_said(member)}\n"  # type: ignore[arg-type]
        elif inspect.isfunction(plain) and (not name.startswith("_") or name in ("__len__", "__getitem__")):
            yield _function(plain, f"{kind.__name__}.{name}", bound=getattr(kind, name))


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
        stars = {parameter.VAR_KEYWORD: "**", parameter.VAR_POSITIONAL: "*"}.get(parameter.kind, "")
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        inner.append(f"{stars}{parameter.name}: {parameter.annotation}{default}")
    back = "" if told.return_annotation in (told.empty, "None") else f" -> {told.return_annotation}"
    line = f"{name}({', '.join(inner)}){back}"
    return line if len(line) <= 120 else f"{name}(\n    " + ",\n    ".join(inner) + f",\n){back}"


def _said(what: object) -> str:
    return (inspect.getdoc(what) or "").replace("``", "`")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
