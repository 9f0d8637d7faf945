"""Power series in compiled loops: import it where it is used, numba is heavy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numba import types
from numba.extending import intrinsic


def series(coefficients: Sequence[float]) -> Any:
    """Return what adds up a power series of a number, for use in compiled code, by Horner's rule.

    It is written term by term for LLVM itself: of a loop over the terms numba makes one that cannot be done for several
    numbers at once by vector units.

    Args:
        coefficients: That of the highest power first.
    """

    @intrinsic
    def total(_typing: Any, z: Any) -> tuple[Any, Any]:
        """Return the sum of the series of `z`, float64."""

        def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            (number,) = arguments
            summed = number.type(coefficients[0])
            for coefficient in coefficients[1:]:
                summed = builder.fadd(builder.fmul(summed, number), number.type(coefficient))
            return summed

        return types.float64(z), emit

    return total
