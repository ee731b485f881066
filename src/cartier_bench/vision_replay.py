"""Recorded replies of a vision model, from the output of a batch: each to the very words and pictures sent."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cartier.errors import ReasonerError
from cartier.llm.batch import read_replies
from cartier.types import CandidateView, VisualQuestion, VisualReply
from cartier.vision import prompt


def make(model: str | Path) -> Replay:
    """``model`` is the file of replies to the prompts that ``--write-prompts`` wrote, one a line; the last one counts.

    Raises InputError if the file is missing, too large, or has an invalid line.
    """
    path = Path(model)
    return Replay(path, read_replies(path))


class Replay:
    """Replies are read exactly as a server's are; nothing leaves."""

    endpoint = ""

    def __init__(self, path: Path, replies: dict[str, str]) -> None:
        self.name = f"replay {path.name}"
        self._path, self._replies = path, replies

    def look(self, question: VisualQuestion, pictures: Sequence[CandidateView]) -> VisualReply:
        """The recorded answers. Raises ReasonerError if none is recorded for these words and pictures."""
        request = prompt.request(question, pictures)
        if (reply := self._replies.get(request.id)) is None:
            raise ReasonerError(f"{self._path} holds no reply to “{question.words}” with these photographs")
        answers = prompt.read(reply, question, pictures)
        told, words = answers or prompt.cannot_tell(pictures), prompt.text(question, pictures)
        return VisualReply(told, self.name, "", words, reply, valid=answers is not None)
