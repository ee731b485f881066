"""Vision models on OpenAI-compatible servers (vLLM, llama.cpp, Ollama, LM Studio, OpenAI …), in chat completions."""

from __future__ import annotations

from collections.abc import Sequence

from cartier.llm import capabilities
from cartier.llm.server import THINKING_OFF, Server
from cartier.llm.structured_output import Refused
from cartier.types import CandidateView, VisualQuestion, VisualReply
from cartier.vision import prompt

EXTRA = "llm"
_url_forms: dict[tuple[str, str], bool] = {}  # (server, model) → whether ``image_url`` is a bare string


def make(
    model: str | None = None,
    base_url: str | None = None,
    api_key: str | None = None,
    timeout_s: float = 60.0,
    temperature: float = 0.0,
) -> VisionServer:
    """``OPENAI_API_KEY``, ``OPENAI_BASE_URL`` and ``OPENAI_MODEL`` are read; a server of one's own needs no key.

    ``timeout_s`` is the limit for one question with all its retries.
    """
    return VisionServer(Server(model, base_url, api_key, timeout_s, temperature, extra=THINKING_OFF))


class VisionServer:
    """A vision model behind a URL: one call per question, once the form that the server supports is known."""

    def __init__(self, server: Server) -> None:
        self.name, self.endpoint = server.name, server.where
        self._server = server
        self.capabilities = capabilities.apply(server.server, server.where, server.model)

    @property
    def sees(self) -> bool | None:
        """What ``cartier check-model`` found; None if this model was never checked."""
        return self.capabilities.sees if self.capabilities is not None else None

    @property
    def calls(self) -> int:
        """How many requests were sent so far."""
        return self._server.calls

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        """One answer for each picture; "cannot tell" for all if the reply is not of the schema."""
        words, before = prompt.text(question, pictures), self._server.tokens
        reply = self._reply(words, question, pictures)
        answers, used = prompt.read(reply, question, pictures), self._server.tokens - before
        told = answers or prompt.cannot_tell(pictures)
        return VisualReply(told, self.name, self.endpoint, words, reply, used, valid=answers is not None)

    def _reply(self, words: str, question: VisualQuestion, pictures: Sequence[CandidateView]) -> str:
        """The raw reply. ``image_url`` is an object, or a bare string for a server that understands only that."""
        key = (self._server.server, self._server.model)
        forms = [_url_forms[key]] if key in _url_forms else [False, True]
        for bare in forms:
            try:
                reply = self._server.complete(
                    prompt.messages(words, pictures, bare), prompt.schema(question, len(pictures)), prompt.MAX_TOKENS,
                    lambda text: prompt.read(text, question, pictures) is not None,
                )  # fmt: skip
            except Refused:
                if bare is forms[-1]:
                    raise
                continue
            _url_forms[key] = bare
            return reply
        raise AssertionError("one of the forms returns or raises")
