"""Batch files: requests to a model as lines that OpenAI's Batch API takes, and the replies that come back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cartier.errors import InputError
from cartier.io.atomic import write_file
from cartier.io.files import read_text
from cartier.llm.completion import read_completion
from cartier.llm.prompts import Request, without_bounds

URL = "/v1/chat/completions"
MAX_BYTES = 256 * 1024 * 1024
FORM = '{"custom_id": "…", "reply": "…"}, or a line of a batch\'s output, {"custom_id": "…", "response": {…}}'


def save_requests(file: Path, requests: Mapping[str, Request], model: str) -> None:
    """One request a line: custom_id, method, url and body. Raises InputError if the file cannot be written."""
    lines = [
        {"custom_id": key, "method": "POST", "url": URL, "body": without_bounds(request.body(model))}
        for key, request in requests.items()
    ]
    write_file(file, "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines).encode())


def read_replies(path: Path) -> dict[str, str]:
    """Replies by the ids of their requests, one a line; the last line of an id counts.

    Raises InputError if the file is missing, too large, or has an invalid line.
    """
    replies = dict[str, str]()
    for number, line in enumerate(read_text(path, MAX_BYTES).split("\n"), start=1):
        if line.strip():
            try:
                replies |= answered(json.loads(line))
            except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
                raise InputError(f"{path} line {number}: expected {FORM}") from error
    return replies


def answered(row: Mapping[str, Any]) -> dict[str, str]:
    """The id of a request and the whole reply to it, from a line of a batch's output; nothing for a failed request.

    Who answers by hand writes {"custom_id": id, "reply": text}. Raises LookupError, TypeError or ValueError for another
    line.
    """
    if "reply" in row:
        content = row["reply"]
    else:
        response = row["response"]
        if row.get("error") or response["status_code"] != 200:
            return {}
        completion = read_completion(response["body"])
        content = completion.text if completion.ended == "whole" else None
    if not isinstance(row["custom_id"], str) or not isinstance(content, str | None):
        raise TypeError("custom_id and content must be text")
    return {} if content is None else {row["custom_id"]: content}
