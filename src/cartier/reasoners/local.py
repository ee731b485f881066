"""Local language model without a server or a network: any GGUF file, through mistral.rs."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cartier.errors import InputError, ReasonerError
from cartier.llm.client import LanguageModel
from cartier.llm.prompts import Messages, Schema

EXTRA = "local"
COMPACT = {"x-guidance": {"whitespace_flexible": False}}
"""For the engine's grammar: no white space between the parts of a reply, where a small model could loop."""


def make(
    model: str | Path | None = None,
    prompt: str = "rich",
    timeout_s: float = 120.0,
    temperature: float = 0.0,
    cache: str | Path | None = None,
) -> LanguageModel:
    """``model`` is a GGUF file with a chat template in it; CARTIER_MODEL is read if it is not given.

    ``prompt`` is one of cartier.llm.prompts.PROMPTS, ``cache`` an SQLite file, ``timeout_s`` the limit for one reply.
    Raises InputError if the file is missing or damaged, or if the engine does not know its kind of model.
    """
    given = model or os.environ.get("CARTIER_MODEL")
    if not given:
        raise InputError("the local reasoner needs a model: --model FILE.gguf, or CARTIER_MODEL=FILE.gguf")
    if not timeout_s > 0:
        raise InputError(f"timeout_s must be positive, got {timeout_s}")
    return LanguageModel(GGUF(Path(given), timeout_s, temperature), prompt, cache)


class GGUF:
    """An engine for ``LanguageModel`` that holds the model and constrains its output to the schema."""

    def __init__(self, file: Path, timeout_s: float, temperature: float) -> None:
        self.name = f"local {file.name}"
        self.identity = ("local", _fingerprint(file), {"temperature": temperature})
        self.calls = self.tokens = 0
        self._timeout_s, self._temperature = timeout_s, temperature
        self._runner = _load(file)

    def complete(
        self, messages: Messages, schema: Schema | None, max_tokens: int, is_answer: Callable[[str], bool]
    ) -> str:
        """One reply of at most ``max_tokens``. Raises ReasonerError if it takes too long or fails."""
        import mistralrs

        request = mistralrs.ChatCompletionRequest(
            model="default", messages=messages, temperature=self._temperature, max_tokens=max_tokens, stream=True,
            enable_thinking=False, grammar=json.dumps(schema | COMPACT) if schema else None,
            grammar_type="json_schema" if schema else None,
        )  # fmt: skip
        deadline, text, used = time.monotonic() + self._timeout_s, "", 0
        self.calls += 1
        try:
            for chunk in self._runner.send_chat_completion_request(request):  # leaving the loop ends the computation
                text += chunk.choices[0].delta.content or ""
                used = chunk.usage.total_tokens if chunk.usage else used
                if time.monotonic() > deadline:
                    raise ReasonerError(
                        f"{self.name} did not answer within {self._timeout_s:g} s: "
                        "take a smaller model (or raise timeout_s)"
                    )
        except BaseException as error:
            raise _mendable(error, ReasonerError, f"{self.name} failed") from error
        self.tokens += used
        return text


def _load(file: Path) -> Any:
    """The engine with the model loaded, silent, and without network access."""
    os.environ.setdefault("RUST_LOG", "off")  # read on import; the engine's log goes to standard output
    import mistralrs

    which: Any = mistralrs.Which.GGUF(quantized_model_id=str(file.resolve().parent), quantized_filename=file.name)
    try:
        return mistralrs.Runner(which, max_seqs=1, prefix_cache_n=2, token_source="none")
    except BaseException as error:
        raise _mendable(error, InputError, f"{file} cannot be used as a language model") from error


def _fingerprint(file: Path) -> str:
    """The identity of a model file, without reading gigabytes: its size, its first and its last MiB."""
    try:
        with file.open("rb") as opened:
            size = opened.seek(0, os.SEEK_END)
            opened.seek(0)
            begin = opened.read(2**20)
            opened.seek(max(0, size - 2**20))
            end = opened.read(2**20)
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror}") from error
    if begin[:4] != b"GGUF":
        raise InputError(f"{file} is no GGUF file: a language model for this reasoner ends in .gguf")
    return hashlib.sha256(b"%d:%b%b" % (size, begin, end)).hexdigest()


def _mendable(error: BaseException, kind: type[Exception], what: str) -> BaseException:
    """The engine's error in one line; other exceptions (an interrupt, our own errors) stay as they are."""
    panic = type(error).__name__ == "PanicException"  # Rust's, which is no Exception
    if isinstance(error, (InputError, ReasonerError)) or not (panic or isinstance(error, Exception)):
        return error
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return kind(f"{what}: {''.join(c if c.isprintable() else ' ' for c in lines[0])[:160]}")
