"""What a process that converts logs keeps: memory that it frees while it reads, and no library that it never uses."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

import pyarrow as pa

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_LARGEST = 32 << 20
"""Bytes; glibc's own limit for the sizes that it may keep."""


def keep_memory() -> None:
    """Let what is freed be taken again, as glibc does by itself from the first freed block of 32 MiB on.

    Else the arrays of every batch are new memory, which the system clears page by page: a tenth of all work.
    """
    with suppress(AttributeError):  # It is glibc's own.
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_TRIM_THRESHOLD, 2 * _LARGEST)


def leave_out_asammdf() -> None:
    """Import cantools, and python-can with it, without asammdf, which is 110 MB and half a second and not used here.

    For processes of Wheelprint's own: python-can reads no MF4 in a process that begins so. Nothing happens where
    python-can is there already.
    """
    if "can" not in sys.modules and "asammdf" not in sys.modules:
        sys.modules["asammdf"] = None  # type: ignore[assignment]  # so its import fails as if it were not installed
        try:
            import cantools  # noqa: F401 - for what it imports
        finally:
            del sys.modules["asammdf"]


def leave_out_pandas() -> None:
    """Let Arrow believe that pandas is not installed, which it else imports at the first list it makes an array of.

    That is 45 MB and half a second, and not used here. For processes of Wheelprint's own: Arrow imports pandas where it
    has to have it, but no longer takes its NaT and NA in lists for null.
    """
    if "pandas" not in sys.modules:
        sys.modules["pandas"] = None  # type: ignore[assignment]  # so its import fails as if it were not installed
        try:
            # Its part in Cython takes the None for the module and fails at what that lacks; then its part in C++ looks.
            with suppress(AttributeError):
                pa.array([])
            pa.array([])
        finally:
            del sys.modules["pandas"]


def leave_out_scipy() -> None:
    """Import numba without `scipy.linalg`, which it else imports with its first compiled code to see if it is there.

    That is 15 MB and a fifth of a second, and not used by what reads logs. Nothing is lost: where matrices are
    multiplied numba looks again. Nothing happens where it is there already.
    """
    if "scipy.linalg" not in sys.modules:
        sys.modules["scipy.linalg"] = None  # type: ignore[assignment]  # so its import fails as if it were not installed
        try:
            import numba.np.arraymath  # noqa: F401 - for what it imports
        finally:
            del sys.modules["scipy.linalg"]


def give_memory_back() -> None:
    """Return what is free to the system: else the C library keeps what one log took beside what the next one takes."""
    pa.default_memory_pool().release_unused()
    with suppress(AttributeError):  # It is glibc's own.
        ctypes.CDLL(None).malloc_trim(0)
