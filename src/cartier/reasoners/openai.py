"""OpenAI-compatible servers (OpenAI, vLLM, llama.cpp, Ollama, LM Studio …) through the official SDK."""

from __future__ import annotations

from pathlib import Path

from cartier.llm.client import LanguageModel
from cartier.llm.server import Server

EXTRA = "llm"


def make(
    model: str | None = None,
    base_url: str | None = None,
    api_key: str | None = None,
    prompt: str = "rich",
    timeout_s: float = 30.0,
    temperature: float = 0.0,
    cache: str | Path | None = None,
) -> LanguageModel:
    """``OPENAI_API_KEY``, ``OPENAI_BASE_URL`` and ``OPENAI_MODEL`` are read; a server of one's own needs no key.

    ``prompt`` is one of cartier.llm.prompts.PROMPTS, ``cache`` an SQLite file, ``timeout_s`` the limit for one request
    with all its retries. The first request has the form that ``cartier check-model`` found, where it was run.
    """
    server = Server(model, base_url, api_key, timeout_s, temperature)
    server.as_checked()
    return LanguageModel(server, prompt, cache)
