"""Queues between the threads of a live session: bounded, and what does not fit is told."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Bounded(Generic[Item]):
    """A queue of at most ``size`` items, in order.

    Args:
        size: How many items may wait.
        worth: Which of the items is let go when there are too many: that of the least worth; None for the oldest.
        waits: Whether ``put`` waits for room instead.
    """

    def __init__(self, size: int, worth: Callable[[Item], float] | None = None, waits: bool = False) -> None:
        self._size, self._worth, self._waits = size, worth, waits
        self._items: deque[tuple[float, Item]] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> Item | None:
        """Add an item; returns the one that was let go for it, if any."""
        worth = 0.0 if self._worth is None else self._worth(item)
        with self._changed:
            while self._waits and len(self._items) >= self._size and not self._closed:
                self._changed.wait()
            if self._closed:
                return item
            self._items.append((worth, item))
            self._changed.notify_all()
            if len(self._items) <= self._size:
                return None
            least = 0 if self._worth is None else min(range(len(self._items)), key=lambda k: self._items[k][0])
            _, gone = self._items[least]
            del self._items[least]
            return gone

    def get(self) -> Item | None:
        """The next item, once there is one; None when the queue is closed and empty."""
        with self._changed:
            while not self._items and not self._closed:
                self._changed.wait()
            if not self._items:
                return None
            _, item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Take no more items; those that wait can still be had."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
