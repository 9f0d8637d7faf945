"""Windows cut from series, compiled: copying a short stretch for each row is what numpy is slow at."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from .estimator import FloatArray


@njit(cache=True, nogil=True)
def cut(values: FloatArray, begins: npt.NDArray[np.int64], column: int, length: int, rows: FloatArray) -> None:
    """Write `values` (n_values,) from each of `begins` (n,) on into `length` columns of rows (n, d), from `column` on.

    Units stay. Nothing is checked: `values` must reach `length` further than each begin.
    """
    for row in range(len(begins)):
        source, target = values[begins[row] : begins[row] + length], rows[row, column : column + length]
        for i in range(length):
            target[i] = source[i]
