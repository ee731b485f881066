"""Plugin registry: backends by name, by entry point (group ``cartier.KIND``) or by path to a .py file.

A backend is a module whose docstring's first line describes it, with a factory ``make(**options)``; recordings have
``matches(path)`` and ``open(path, **options)`` instead. ``EXTRA = "llm"`` names the optional dependencies that it
needs.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import json
import urllib.parse
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, overload

from cartier.errors import BackendError, InputError, MissingExtra

if TYPE_CHECKING:
    from cartier.contracts import (
        Detector,
        Encoder,
        Reasoner,
        Recording,
        Robot,
        Source,
        SpatialIndex,
        VisionModel,
        World,
    )

KINDS = ("recordings", "sources", "detectors", "encoders", "indexes", "reasoners", "vision", "robots", "worlds")
PACKAGE = Path(__file__).parent
REMOTE = "folder"
"""The format of recordings that is read from object storage."""


@dataclass(frozen=True)
class Backend:
    """One row of ``cartier list``, read from the source, so that listing imports nothing heavy."""

    kind: str
    name: str
    summary: str
    extra: str | None


def backends(kind: str) -> list[Backend]:
    """Every built-in and installed backend of a kind, by name."""
    if kind not in KINDS:
        raise BackendError(f"there is no kind {kind!r} of backend; the kinds are {', '.join(KINDS)}")
    return sorted([*_built_in(kind), *_added(kind)], key=lambda backend: backend.name)


def neighbour(group: str, name: str) -> Any:
    """What a package beside this one offers under an entry point of the group ``cartier.GROUP``.

    Raises BackendError if no installed package has it.
    """
    for entry in _entry_points(group):
        if entry.name == name:
            return entry.load()
    raise BackendError(f"{name} is not installed: no package has the entry point cartier.{group} {name!r}")


@overload
def make(kind: Literal["sources"], name: str, **options: Any) -> Source: ...
@overload
def make(kind: Literal["detectors"], name: str, **options: Any) -> Detector: ...
@overload
def make(kind: Literal["encoders"], name: str, **options: Any) -> Encoder: ...
@overload
def make(kind: Literal["indexes"], name: str, **options: Any) -> SpatialIndex: ...
@overload
def make(kind: Literal["reasoners"], name: str, **options: Any) -> Reasoner: ...
@overload
def make(kind: Literal["vision"], name: str, **options: Any) -> VisionModel: ...
@overload
def make(kind: Literal["robots"], name: str, **options: Any) -> Robot: ...
@overload
def make(kind: Literal["worlds"], name: str, **options: Any) -> World: ...
def make(kind: str, name: str, **options: Any) -> Any:
    """Make a backend.

    Args:
        kind: "sources", "detectors", "encoders", "indexes", "reasoners", "vision", "robots" or "worlds".
        name: A name that ``cartier list`` shows, or the path to a .py file.
        **options: The options of its factory, which ``cartier list`` names.

    Returns:
        A new backend, which obeys the protocol of its kind in ``cartier.contracts``.

    Raises:
        BackendError: The kind, the name or an option is unknown, or a required option is missing.
        MissingExtra: It needs a package that is not installed.
    """
    return _call(kind, name, "make", (), options)


@overload
def make_from_spec(kind: Literal["detectors"], spec: str, **options: Any) -> Detector: ...
@overload
def make_from_spec(kind: Literal["encoders"], spec: str, **options: Any) -> Encoder: ...
@overload
def make_from_spec(kind: Literal["reasoners"], spec: str, **options: Any) -> Reasoner: ...
@overload
def make_from_spec(kind: Literal["vision"], spec: str, **options: Any) -> VisionModel: ...
def make_from_spec(kind: Any, spec: str, **options: Any) -> Any:
    """Make a backend from its form on the command line: NAME, or NAME:MODEL where it needs a model."""
    name, _, model = spec.partition(":")
    return make(kind, name, **({"model": model} if model else {}), **options)


def takes(kind: str, name: str, option: str) -> bool:
    """Whether a backend's factory has an option of this name."""
    factory = getattr(_load(kind, name), "make", None)
    return factory is not None and option in inspect.signature(factory).parameters


def open_recording(path: str | Path, format: str | None = None, **options: Any) -> Recording:
    """Open a recording.

    Args:
        path: A file or folder; or ``s3://BUCKET/PREFIX``, ``gs://…``, ``az://…`` of a recording in cartier's own
            format, whose frames are fetched one by one.
        format: The name of its format; by default the one that recognises the path.
        **options: Options of that format's reader.

    Returns:
        The recording; ``read_with`` holds the options given.

    Raises:
        InputError: The path does not exist, no format or more than one recognises it, or the recording is damaged.
        BackendError: The format or an option is unknown.
        MissingExtra: The reader needs a package that is not installed.
    """
    options = {n: tuple(v) if isinstance(v, list) else v for n, v in options.items()}  # as fingerprints have them
    place = str(path) if "://" in str(path) else Path(path)
    name = _format_there(place, format) if isinstance(place, str) else _format_of(place, format)
    recording: Recording = _call("recordings", name, "open", (place,), options)
    given = {"format": format, **options}
    with suppress(AttributeError):  # a reader from elsewhere may have slots
        recording.read_with = {n: v for n, v in given.items() if v is not None}  # type: ignore[attr-defined]
    return recording


def _format_there(place: str, format: str | None) -> str:
    """The format of a recording on object storage."""
    if format not in (None, REMOTE):
        raise InputError(f"{place}: on object storage, cartier reads its own format ({REMOTE}), not {format}")
    return REMOTE


def _format_of(path: Path, format: str | None) -> str:
    """The format of a recording: the given one, or the one that recognises it."""
    if not path.exists():
        raise InputError(f"{path} does not exist")
    names = [format] if format else formats_of(path)
    if not names:
        known = ", ".join(b.name for b in backends("recordings"))
        hints = importlib.import_module("cartier.recordings.hints")  # it lies above this module, as the readers do
        generic = f"the formats are {known}, and 'cartier list' says what each one looks like"
        raise InputError(f"{path} is no recording that cartier knows: {hints.what_else(path, formats_of) or generic}")
    if len(names) > 1:
        raise InputError(f"{path} may be one of {', '.join(names)}: say which with --format (in Python, format=…)")
    return names[0]


def formats_of(path: Path) -> list[str]:
    """The formats of recordings that recognise a path."""
    return [b.name for b in backends("recordings") if _load("recordings", b.name).matches(path)]


@cache  # opening a recording asks every format
def _built_in(kind: str, pattern: str = "*") -> tuple[Backend, ...]:
    files = [f for f in (PACKAGE / kind).glob(pattern) if f.suffix == ".py" or (f / "__init__.py").is_file()]
    return tuple(backend for f in files if (backend := _read(kind, f.stem, f)) is not None)


@cache
def _added(kind: str) -> tuple[Backend, ...]:
    """The backends of other packages. Their sources are read, as ours are; nothing is imported."""
    added = []
    for entry in _entry_points(kind):
        package, *parts = entry.module.split(".")
        spec = importlib.util.find_spec(package)
        place = Path(spec.origin).parent.joinpath(*parts) if spec is not None and spec.origin else Path(package)
        files = (place.with_suffix(".py"), place) if parts else (place,)
        read = next((_read(kind, entry.name, f) for f in files if f.exists() and not entry.attr), None)
        added.append(read or Backend(kind, entry.name, f"from {entry.value}", None))
    return tuple(added)


def _read(kind: str, name: str, file: Path) -> Backend | None:
    """The backend that a source file defines; None for a module without the factory, which is a helper of backends."""
    source = file / "__init__.py" if file.is_dir() else file
    tree = ast.parse(source.read_text(encoding="utf-8") if source.is_file() else "")
    factory = "open" if kind == "recordings" else "make"
    if not any(isinstance(n, ast.FunctionDef) and n.name == factory for n in tree.body):
        return None
    extra = next(
        (
            n.value.value
            for n in tree.body
            if isinstance(n, ast.Assign)
            and isinstance(n.targets[0], ast.Name)
            and n.targets[0].id == "EXTRA"
            and isinstance(n.value, ast.Constant)
        ),
        None,
    )
    return Backend(kind, name, (ast.get_docstring(tree) or "").split("\n")[0], str(extra) if extra else None)


def _entry_points(kind: str) -> Any:
    return _all_entry_points().select(group=f"cartier.{kind}")


@cache
def _all_entry_points() -> Any:
    from importlib.metadata import entry_points  # 30 ms that "import cartier" need not pay

    return entry_points()


def _load(kind: str, name: str) -> ModuleType:
    if name.endswith(".py"):
        return _load_file(Path(name))
    for entry in _entry_points(kind):
        if entry.name == name:
            module: ModuleType = entry.load()
            return module
    if not name.isidentifier() or not any(b.name == name for b in _built_in(kind, f"{name}*")):
        known = [b.name for b in backends(kind)]
        close = get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise BackendError(
            f"there is no {name!r} among the {kind}; {hint}There are {', '.join(known)}, or a path to a .py file"
        )
    return importlib.import_module(f"cartier.{kind}.{name}")


def _load_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise BackendError(f"backend file {path} does not exist")
    spec = importlib.util.spec_from_file_location(f"cartier_plugin_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # a .py suffix always has a loader
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise BackendError(f"{path} line {error.lineno}: {error.msg}") from error
    return module


def _call(kind: str, name: str, function: str, args: tuple[Any, ...], options: dict[str, Any]) -> Any:
    try:
        module = _load(kind, name)
        factory: Callable[..., Any] | None = getattr(module, function, None)
        if factory is None:
            raise BackendError(
                f"{name} has no function {function}(…), which a backend of {kind} needs (see CONTRIBUTING.md)"
            )
        parameters = inspect.signature(factory).parameters
        open_ended = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
        plain = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
        required = [n for n, p in parameters.items() if p.default is p.empty and p.kind in plain][len(args) :]
        lacking = [name for name in required if name not in options]
        if lacking:
            raise BackendError(
                f"{name} needs the option {lacking[0]!r}: {name}:MODEL on the command line, {lacking[0]}=… in Python"
                if lacking[0] == "model"
                else f"{name} needs the option {lacking[0]!r}: cartier.make({kind!r}, {name!r}, {lacking[0]}=…)"
            )
        unknown = [] if open_ended else [o for o in options if o not in parameters]
        if unknown:
            offered = list(parameters)[len(args) :]
            raise BackendError(f"{kind} {name!r} has no option {unknown[0]!r}; it has {', '.join(offered) or 'none'}")
        return factory(*args, **options)
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        if missing in ("", "cartier"):  # a broken import of ours is a bug and keeps its traceback
            raise
        extra = next((b.extra for b in backends(kind) if b.name == name), None)
        raise MissingExtra(f"{kind} {name!r} needs the package {missing!r}: {install(extra, missing)}") from error


def install(extra: str | None, package: str) -> str:
    """The command that installs a missing package, from the folder or repository that cartier was installed from."""
    if not extra:
        return f"pip install '{package}'"
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        source = json.loads(distribution("cartier").read_text("direct_url.json") or "{}")
        url = str(source.get("url", ""))
    except (PackageNotFoundError, ValueError):
        source, url = {}, ""
    if url.startswith("file:") and "dir_info" in source:
        path = urllib.parse.unquote(urllib.parse.urlsplit(url).path)
        return f"pip install {'-e ' if source['dir_info'].get('editable') else ''}'{path}[{extra}]'"
    return f"pip install 'cartier[{extra}]{f' @ {url}' if url else ''}'"
