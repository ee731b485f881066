"""ROS messages of a stream: their bytes, what they hold, and the first of each topic, from which topics are chosen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from cartier.io.bounded_file import Index
from cartier_ros.bags.bag import Bag, Header, decoded, header_of

KEPT_FIRST = 3  # messages of each topic


class Message(NamedTuple):
    """A message as it came: its topic, type, bytes and their encoding (``cdr`` or ``ros1``)."""

    topic: str
    kind: str
    data: bytes
    encoding: str = "cdr"

    def decode(self) -> Any:
        """An object with the fields of its type. Raises InputError for a damaged message."""
        return decoded(self.data, self.kind, self.encoding, f"a message of {self.topic}")

    def header(self) -> Header:
        """Its stamp and frame. Raises InputError for a damaged message."""
        return header_of(self.data, self.kind, self.encoding, f"a message of {self.topic}")


def bag_messages(bag: Bag, kinds: frozenset[str] | None = None) -> Iterator[tuple[int, Message]]:
    """All messages of a bag by the time at which they were recorded (ns), of some types only if ``kinds`` is given."""
    names = bag.topics(*kinds) if kinds is not None else bag.all_topics()
    parts = [(bag.index(name), number) for number, name in enumerate(names)]
    rows = [np.insert(part, 0, number, axis=1) for part, number in parts if len(part)]
    if not rows:
        return
    every = np.concatenate(rows)
    for row in every[np.argsort(every[:, 1], kind="stable")]:
        name = names[int(row[0])]
        yield int(row[1]), Message(name, bag.type_of(name), bag.read(row[1:]), bag.encoding(name))


class FirstMessages:
    """The first messages of each topic; what ``recordings.ros.topics.choose`` looks at."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._topics: dict[str, list[Message]] = {}

    def add(self, message: Message) -> bool:
        """Take in a message; returns whether it was kept."""
        held = self._topics.setdefault(message.topic, [])
        if len(held) == KEPT_FIRST:
            return False
        held.append(message)
        return True

    def topics(self, *types: str) -> list[str]:
        return sorted(name for name, held in self._topics.items() if held[0].kind in types)

    def index(self, name: str) -> Index:
        number = list(self._topics).index(name)
        return np.array([[0, number, 0, k] for k in range(len(self._topics[name]))], np.int64)

    def read(self, row: Index) -> bytes:
        return list(self._topics.values())[int(row[1])][int(row[3])].data

    def header(self, name: str, row: Index) -> Header:
        return self._topics[name][int(row[3])].header()

    def decode(self, name: str, data: bytes) -> Any:
        return self._topics[name][0]._replace(data=data).decode()
