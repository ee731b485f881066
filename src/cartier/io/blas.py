"""One thread for numpy's products of matrices: those of a sentence are small, and are slower when they are shared."""

from __future__ import annotations

from contextlib import ContextDecorator
from threading import Lock
from typing import Any


class _OneBlasThread(ContextDecorator):
    """While anybody is inside, BLAS computes on one thread in the whole process; the last one out restores its own."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._limit: Any = None

    def __enter__(self) -> None:
        from threadpoolctl import ThreadpoolController  # finds the libraries that are loaded by now

        with self._lock:
            if not self._inside:
                self._limit = ThreadpoolController().limit(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._limit.restore_original_limits()


one_blas_thread = _OneBlasThread()
