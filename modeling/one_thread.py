"""One thread for the matrix products of this process, however many it may use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS use one thread: sums would depend on their number, and ours would get in their way.

    Its threads spin while they wait: on a busy machine two of them are slower than one by a factor of ten.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> Any:
    """Return the loaded BLAS libraries; to look for them takes milliseconds."""
    import scipy.linalg.blas  # noqa: F401 - loads scipy's own BLAS, which is limited only where it is loaded
    from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]  # it ships no types

    return ThreadpoolController()
