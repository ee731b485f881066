"""Batch file of a run's prompts for OpenAI's Batch API, which costs half, or for anybody who answers them by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cartier.contracts import Reasoner
from cartier.errors import ReasonerError
from cartier.llm.batch import save_requests
from cartier.llm.client import server_asked
from cartier.llm.prompts import Request, check_query, prompt_named, propose_request
from cartier.types import Inventory, Selection

UNASKED = Selection("not_found", reason="nobody was asked")


class PromptWriter:
    """A reasoner that asks nobody: it keeps what a language model would be asked, each prompt once, and answers
    nothing.

    ``model`` is by default OPENAI_MODEL, else that of the openai reasoner. ``replies`` is a replay of what came back so
    far. What it holds is answered and not kept, so that a prompt which depends on an earlier reply (NLMap's choice, the
    next turn of a conversation) is written in the next round.
    """

    name = "prompts, written and not sent"

    def __init__(self, model: str | None = None, prompt: str = "rich", replies: Reasoner | None = None) -> None:
        self._model, self._prompt, self.replies = server_asked(model)[1], prompt_named(prompt), replies
        self.requests: dict[str, Request] = {}
        self.unanswered = 0
        """How many questions had no reply yet."""

    def select(self, query: str, inventory: Inventory, dialogue: Sequence[tuple[str, str]] = ()) -> Selection:
        query = check_query(query)
        if self.replies is not None:
            try:
                return self.replies.select(query, inventory, dialogue)
            except ReasonerError:  # not answered yet
                pass
        self.unanswered += 1
        if inventory.names:
            self._keep(self._prompt.request(query, inventory, dialogue))
        return UNASKED

    def propose(self, query: str) -> list[str]:
        query = check_query(query)
        if self.replies is not None:
            try:
                return self.replies.propose(query)
            except ReasonerError:
                pass
        self._keep(propose_request(query))
        return []

    def _keep(self, request: Request) -> None:
        self.requests[request.id] = request

    def save(self, file: Path) -> None:
        """One request a line: custom_id, method, url and body. Raises InputError if the file cannot be written."""
        save_requests(file, self.requests, self._model)
