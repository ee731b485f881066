"""Strict YAML: plain values with the line of each entry; no aliases, no tags, bounded nesting."""

from __future__ import annotations

from typing import Any

import yaml

from cartier.errors import brief

MAX_DEPTH = 40  # libyaml's own recursion ends the process at some ten thousand
MAX_ENTRIES = 200_000  # each takes some 600 bytes on the way
MAX_NUMBER_CHARS = 64  # YAML 1.1 reads 1:1:1:… as a number to the base of 60, in time that grows with its square
Loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader  # the same, ten times as fast
Path = tuple[str | int, ...]

_TAGS = ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq")


class YamlFault(Exception):
    """What is wrong with a text, and in which of its lines."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(reason)
        self.line = line


def read_yaml(text: str) -> tuple[Any, dict[Path, int]]:
    """The value of a text (lists as tuples, keys as written), and the line (from 1) of the entry at each path.

    Raises YamlFault for anything but plain maps, lists and scalars of a sane number and depth.
    """
    lines: dict[Path, int] = {}
    try:
        _check_events(text)
        loader = Loader(text)
        try:
            node = loader.get_single_node()
            return (None if node is None else _value(loader, node, (), lines)), lines
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark: Any = error.problem_mark
        if "maximum nesting depth" in (error.problem or ""):  # newer ones have a limit of their own
            raise YamlFault(mark.line + 1 if mark else 1, f"nested deeper than {MAX_DEPTH} levels") from error
        raise YamlFault(mark.line + 1 if mark else 1, f"not valid YAML: {brief(error.problem)}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise YamlFault(1, f"not valid YAML: {brief(error)}") from error


def _check_events(text: str) -> None:
    """Refuses what would let a small file grow huge in memory: aliases, and entries or nesting without end."""
    depth = entries = 0
    for event in yaml.parse(text, Loader=Loader):
        line = event.start_mark.line + 1 if event.start_mark else 1
        if isinstance(event, yaml.AliasEvent):
            raise YamlFault(line, f"YAML aliases (*{brief(event.anchor, 40)}) are not allowed")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise YamlFault(line, f"nested deeper than {MAX_DEPTH} levels")
        entries += isinstance(event, yaml.NodeEvent)
        if entries > MAX_ENTRIES:
            raise YamlFault(line, f"more than {MAX_ENTRIES} entries")


def _value(loader: yaml.SafeLoader | yaml.CSafeLoader, node: yaml.Node, path: Path, lines: dict[Path, int]) -> Any:
    """A node as plain values with tuples for lists; notes the line of each entry."""
    lines[path] = node.start_mark.line + 1
    if isinstance(node, yaml.CollectionNode) and node.tag not in _TAGS:
        raise YamlFault(lines[path], f"the YAML tag {brief(node.tag, 80)} is not allowed")
    if isinstance(node, yaml.MappingNode):
        held: dict[str, Any] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise YamlFault(key.start_mark.line + 1, "a key must be a word")
            name = key.value  # as written: YAML 1.1 would read the key `on` as True
            if name in held:
                raise YamlFault(key.start_mark.line + 1, f"{brief(name, 80)!r} is given twice")
            held[name] = _value(loader, value, (*path, name), lines)
            lines[*path, name] = key.start_mark.line + 1
        return held
    if isinstance(node, yaml.SequenceNode):
        return tuple(_value(loader, value, (*path, i), lines) for i, value in enumerate(node.value))
    return node.value if len(node.value) > MAX_NUMBER_CHARS else loader.construct_object(node)
