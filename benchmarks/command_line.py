"""Command line of the scripts: help from the docstring, mistakes and missing data as one line."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from cartier.errors import CartierError

OPTIONAL = (
    "boto3",
    "duckdb",
    "httpx",
    "moto",
    "obstore",
    "pyarrow",
    "onnx",
    "safetensors",
    "torch",
    "transformers",
)  # packages that only some scripts need


class Parser(argparse.ArgumentParser):
    """An argument parser that is described by a script's docstring."""

    def __init__(self, description: str | None = None, **options: Any) -> None:
        super().__init__(description=description, formatter_class=argparse.RawDescriptionHelpFormatter, **options)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (--help lists the options)\n")


def print_parts(parts: Mapping[str, Mapping[str, Any]], width: int, file: Path | None) -> None:
    """Print the figures of each part, one a line, after names of ``width`` letters; write them as JSON into a file."""
    for part, figures in parts.items():
        print(part)
        for name, value in figures.items():
            print(f"  {name:{width}} {value:.3f}" if isinstance(value, float) else f"  {name:{width}} {value}")
    if file is not None:
        file.write_text(json.dumps(parts, indent=1), encoding="utf-8")


def run_script(main: Callable[[], int | None]) -> NoReturn:
    """Run a script and exit with its code; data or a package that is missing is one line and exit code 1."""
    try:
        sys.exit(main())
    except CartierError as error:
        sys.exit(f"{sys.argv[0]}: {error}")
    except FileNotFoundError as error:
        sys.exit(f"{sys.argv[0]}: {error.filename} does not exist")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in OPTIONAL:
            raise
        sys.exit(f"{sys.argv[0]}: needs {error.name}, which is not installed")
