"""Thoughts of a model in the text of its reply, in the marks of many models, and the reply without them."""

from __future__ import annotations

import re

_WORDS = r"(?:\w{1,12}:)?(?:think(?:ing)?|thoughts?|reason(?:ing)?|reflection|scratchpad|analysis)"
_OPEN = (
    rf"<{_WORDS}>|\[THINK\]|◁think▷|<\|(?:begin_of_thought|START_THINKING)\|>|<\|channel\|>\s?analysis"
    r"|<\|channel>thought|\Aanalysis(?=[A-Z])|\AHere(?: is|'s) my thought process:"
)
_CLOSE = (
    rf"</{_WORDS}>|\[/THINK\]|◁/think▷|<\|(?:end_of_thought|END_THINKING)\|>|<channel\|>|assistantfinal"
    r"|<\|channel\|>\s?(?:final|commentary)[^<]{0,60}(?:<\|constrain\|>\w{0,20})?<\|message\|>"
    r"|Here(?: is|'s) my response:"
)
_MARK = re.compile(rf"(?P<open>{_OPEN})|(?P<close>{_CLOSE})|(?P<end><\|end\|>)", re.IGNORECASE)
_LAST = re.compile(r"(?:<\|\w{1,20}\|>|</s>)\Z")
MAX_LAST = 8  # marks at the end of a message


def without_thoughts(text: str) -> str | None:
    """What a model says after and between its thoughts; None if the text ends in the middle of them.

    A closing mark without an opening one ends thoughts that began with the text: chat templates open them in the
    prompt. ``<|end|>`` ends a message; outside of thoughts it says nothing.
    """
    kept: list[str] = []
    begin, thinks = 0, False
    for mark in _MARK.finditer(text):
        if mark["open"]:
            if not thinks:
                kept.append(text[begin : mark.start()])
            thinks = True
        elif thinks:
            begin, thinks = mark.end(), False
        elif mark["close"]:
            kept, begin = [], mark.end()
    if thinks:
        return None
    spoken = "".join([*kept, text[begin:]]).strip()
    for _ in range(MAX_LAST):
        if last := _LAST.search(spoken[-24:]):
            spoken = spoken[: -len(last[0])].rstrip()
    return spoken
