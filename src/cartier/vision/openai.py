"""Vision models on OpenAI-compatible servers (vLLM, llama.cpp, Ollama, LM Studio, OpenAI …), in chat completions."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from cartier.errors import NothingSent, ReasonerError
from cartier.llm.server import THINKING_OFF, NoReply, Server
from cartier.llm.structured_output import Refused
from cartier.types import CandidateView, VisualQuestion, VisualReply
from cartier.vision import prompt
from cartier.vision.made import DIGITS, READ, made

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

    ``timeout_s`` is the limit for one question, and that for finding out what the server understands.
    """
    return VisionServer(Server(model, base_url, api_key, timeout_s, temperature, extra=THINKING_OFF))


class VisionServer:
    """A vision model behind a URL. A photograph leaves once a question, whatever becomes of the request.

    What the server understands is found out with a made picture before the first question, where ``cartier
    check-model`` has not done so.
    """

    def __init__(self, server: Server) -> None:
        self.name, self.endpoint = server.name, server.way
        self._server = server
        self.capabilities = server.as_checked()
        self._tried = self.capabilities is not None and self.capabilities.leaves_out is not None
        self.bare_urls = self.capabilities is not None and self.capabilities.bare_urls
        """Whether the server takes pictures as bare URLs only."""

    @property
    def sees(self) -> bool | None:
        """What ``cartier check-model`` found; None if this model was never checked."""
        return self.capabilities.sees if self.capabilities is not None else None

    @property
    def calls(self) -> int:
        """How many requests were sent so far, those with a made picture among them."""
        return self._server.calls

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        """One answer for each picture; "cannot tell" for all if the reply is not of the schema.

        Raises NothingSent, a ReasonerError, if the server does not even take a made picture.
        """
        if not self._tried:
            self._try_out()
        before = self._server.tokens
        words, answers, reply = prompt.text(question, pictures), None, ""
        sent, form = prompt.messages(words, pictures, self.bare_urls), prompt.schema(question, len(pictures))
        with contextlib.suppress(NoReply):
            reply = self._server.once(sent, form, prompt.MAX_TOKENS)
            answers = prompt.read(reply, question, pictures)
        told, used = answers or prompt.cannot_tell(pictures), self._server.tokens - before
        return VisualReply(told, self.name, self.endpoint, words, reply, used, valid=answers is not None)

    def _try_out(self) -> None:
        """Find the form of requests and of pictures with a made picture. Raises NothingSent if there is none."""
        key, shown = (self._server.server, self._server.model), [made(DIGITS[0], 0)]
        words, form = prompt.text(READ, shown), prompt.schema(READ, 1)
        forms = [_url_forms[key]] if key in _url_forms else [False, True]
        for bare in forms:
            try:
                self._server.complete(
                    prompt.messages(words, shown, bare), form, prompt.MAX_TOKENS,
                    lambda reply: prompt.read(reply, READ, shown) is not None,
                )  # fmt: skip
            except NoReply:
                pass  # it takes the request, and may answer another one
            except ReasonerError as error:
                if isinstance(error, Refused) and bare is not forms[-1]:
                    continue
                raise NothingSent(str(error)) from error
            self.bare_urls = _url_forms[key] = bare
            self._tried = True
            return
