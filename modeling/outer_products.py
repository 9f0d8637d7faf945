"""BLAS's sum of the outer products of many rows, callable from compiled code without Python's lock.

scipy publishes the addresses of its BLAS for Cython. They are made known to the linker of compiled code by name, so
that code from numba's cache finds them again. Arrays are in C's order: BLAS, which is Fortran, sees them transposed.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg.cython_blas as blas
from llvmlite.binding import add_symbol
from numba import njit, types

Floats = npt.NDArray[np.floating[Any]]

_LETTERS = np.frombuffer(b"UN", dtype=np.uint8)  # upper, not transposed


def _external(name: str, arguments: int) -> Any:
    """Return a routine of scipy's BLAS, all of whose arguments are addresses."""
    capsules: dict[str, Any] = vars(blas)["__pyx_capi__"]
    capsule = capsules[name]
    name_of, address_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    address_of.restype, address_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    symbol = f"wheelprint_{name}"
    add_symbol(symbol, address_of(capsule, name_of(capsule)))
    return types.ExternalFunction(symbol, types.void(*[types.intp] * arguments))


_SSYRK, _DSYRK = _external("ssyrk", 10), _external("dsyrk", 10)


@njit(cache=True, nogil=True)
def outer_products(rows: Floats, total: Floats) -> None:
    """Write the lower triangle of Σ y yᵀ over rows y (n, d) into `total` (d, d) (BLAS: syrk).

    Numbers of any units, both arrays of the same type, which is not asked.
    """
    sizes = np.array([rows.shape[1], rows.shape[0]], dtype=np.int32)
    _syrk(sizes, np.array([1, 0], dtype=rows.dtype), rows, total)


# It stands below the other because an array whose address alone is passed on may be freed before the call.
@njit(cache=True, nogil=True)
def _syrk(sizes: npt.NDArray[np.int32], factors: Floats, rows: Floats, total: Floats) -> None:
    letter, d, one = _LETTERS.ctypes.data, sizes.ctypes.data, factors.ctypes.data
    n, a, c, zero = d + 4, rows.ctypes.data, total.ctypes.data, one + rows.itemsize
    if rows.itemsize == 4:
        _SSYRK(letter, letter + 1, d, n, one, a, d, zero, c, d)
    else:
        _DSYRK(letter, letter + 1, d, n, one, a, d, zero, c, d)
