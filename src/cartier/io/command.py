"""Command that an owner sets, run without a shell and with one JSON object on its standard input."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
from collections.abc import Mapping
from typing import Any

from cartier.errors import InputError, brief

TIME_S = 10.0  # then it is ended


class OwnerCommand:
    """A command line, split as a shell would split it; nothing in it is expanded.

    Raises InputError where it names no program that can be run.
    """

    def __init__(self, line: str, option: str, time_s: float = TIME_S) -> None:
        try:
            self._arguments = shlex.split(line)
        except ValueError as error:
            raise InputError(f"{option} {brief(line, 60)!r} is no command: {error}") from None
        if not self._arguments or shutil.which(self._arguments[0]) is None:
            raise InputError(f"{option}: there is no program {brief((self._arguments or [''])[0], 60)!r} to run")
        self._time_s = time_s

    def run(self, values: Mapping[str, Any]) -> str:
        """Run it to its end, for at most its time; returns a line that says what came of it."""
        words = json.dumps(values, ensure_ascii=False).encode()
        try:
            done = subprocess.run(
                self._arguments, input=words, timeout=self._time_s, check=False,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return f"{self._arguments[0]} was ended after {self._time_s:g} s"
        except OSError as error:
            return f"{self._arguments[0]} could not be run: {error.strerror}"
        return (
            f"{self._arguments[0]} was told"
            if done.returncode == 0
            else f"{self._arguments[0]} failed: exit code {done.returncode}"
        )
