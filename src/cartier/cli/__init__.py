"""Command line: parses options, calls the library, prints."""

from __future__ import annotations

import errno
import io
import os
import sys

import typer

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy loads: small products, which threads only make wait

from cartier.cli.group import Commands
from cartier.errors import CartierError

DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)
"""Errors of the disk, which no program can repair: one line instead of a traceback."""

app = typer.Typer(
    help="Talk to a mapped home: a recording and a need in, the object that serves it and a reachable pose out.",
    cls=Commands,
    callback=lambda: None,  # a group, though no command is registered
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Entry point: a user's mistake is one line and exit code 1; any other exception keeps its traceback."""
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()  # closed by >&-
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # what a DOS code page lacks is replaced
            stream.reconfigure(errors="replace")
    try:
        app()
    except CartierError as error:
        print(f"cartier: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        if error.errno not in DISK:
            raise
        print(f"cartier: {error.filename or 'the disk'}: {error.strerror}", file=sys.stderr)
        sys.exit(1)
