"""Batch file of questions about photographs, for OpenAI's Batch API or for anybody who looks and answers by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cartier.io.atomic import write_file
from cartier.llm.batch import save_requests
from cartier.llm.client import server_asked
from cartier.llm.prompts import Request
from cartier.types import CandidateView, VisualQuestion, VisualReply
from cartier.vision import prompt


class PictureWriter:
    """A vision model that asks nobody: it keeps what would be sent, and can tell nothing.

    ``model`` is by default OPENAI_MODEL, else that of the openai reasoner.
    """

    name, endpoint = "prompts, written and not sent", ""

    def __init__(self, model: str | None = None) -> None:
        self._model = server_asked(model)[1]
        self.requests: dict[str, Request] = {}
        self._pictures: dict[str, tuple[CandidateView, ...]] = {}

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        request = prompt.request(question, pictures)
        self.requests[request.id], self._pictures[request.id] = request, tuple(pictures)
        return VisualReply(prompt.cannot_tell(pictures), self.name, "", prompt.text(question, pictures))

    def save(self, file: Path) -> Path:
        """Write the requests, one a line, and beside them a folder of the photographs and words, by the request's id.

        Returns the folder. Raises InputError if either cannot be written.
        """
        folder = file.with_name(f"{file.stem}-photos")
        folder.mkdir(parents=True, exist_ok=True)
        save_requests(file, self.requests, self._model)
        for key, pictures in self._pictures.items():
            for k, picture in enumerate(pictures, start=1):
                write_file(folder / f"{key}-{k}-crop.jpg", picture.crop_jpeg)
                write_file(folder / f"{key}-{k}-context.jpg", picture.context_jpeg)
            content = self.requests[key].messages[0]["content"]
            write_file(folder / f"{key}.txt", f"{content[-1]['text']}\n".encode())
        return folder
